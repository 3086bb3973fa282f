"""The claims of how the user's hand goes from sample to sample, how deep it was, and how far off the shown one is."""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.result.reader import Result
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_JUDGED, Claim, judged
from hhsim.verify.contacts import near_pairs
from hhsim.verify.kinematics import Posed, rotations
from hhsim.verify.tick_data import LENGTH, WHY_LENGTH, JudgedTicks

DEPTH = "input_depth_max"
CORRECTION = ("correction_palm_mean", "correction_palm_max", "correction_joint_mean", "correction_joint_max")
FIGURES = (DEPTH, *CORRECTION)
SEARCHED = 1e-6
"""The deepest tick is found to this [m]."""
BETWEEN = 1e-8
"""What is off the curve between two samples by no more [m, rad] lies on it: a stamp is a tick's to a nanosecond."""
FIRST_LOOKS = 20
"""Ticks between two that are looked at whatever the others are."""


def input_hand_claims(judge: JudgedTicks) -> list[Claim]:
    """What the summary says of the user's hand; nothing of a session, which has no summary, or of an older file."""
    if judge.result.live is not None or not judge.result.complete or DEPTH not in judge.result.summary:
        return []
    return [_depth(judge), _correction(judge)]


def motion_claim(result: Result) -> Claim:
    """What the ticks of one sample have in common: between two samples all goes along one curve, or stands still.

    The curve is a cubic of each number, whose fourth differences are nothing, and for a quaternion a steady turn.
    """
    name, says = "motion", "between two samples, the user's hand and the object go as samples are told to be joined"
    if result.live is not None:
        return Claim(name, says, NOT_JUDGED, note="a glove's samples are claims of their own")
    held = result.scene.get("samples") == "hold"
    seq, off = np.asarray(result["input_seq"]), np.full(result.ticks, np.nan)
    things = ["haptic"] if result.free or not result.driven else ["haptic", "object"]
    for thing in things:
        for part in HandConfiguration._fields if thing == "haptic" else ("position", "orientation"):
            rows = np.asarray(result[f"{thing}/{part}"]).reshape(result.ticks, -1)
            turns = part == "orientation" and not held
            way, size = (_turns(rows), 1) if turns else (rows, 1 if held else 4)
            bent = np.abs(np.diff(way, size, axis=0)).max(axis=1, initial=0.0)
            reach = result.ticks - len(bent)
            same = np.flatnonzero(seq[reach:] == seq[: len(bent)])
            off[same + reach] = np.fmax(off[same + reach], bent[same])
    known = np.flatnonzero(~np.isnan(off))
    if known.size == 0:
        note = "no sample has ticks enough to tell; --again makes the motion once more"
        return Claim(name, says, NOT_JUDGED, note=note)
    rest = result.ticks - len(known)
    note = f"not known of {counted(rest, 'tick')}, whose sample has too few" if rest else ""
    return judged(name, says, off[known], BETWEEN, "m, rad", "rounding of stamps", ticks=known, note=note)


def _turns(quaternion: FloatArray) -> FloatArray:
    """Turn from each tick to the next [rad], as the first tick's axes have it, shape (T - 1, 3)."""
    here, none = rotations(quaternion)
    turn = np.asarray((here[:-1].inv() * here[1:]).as_rotvec())
    turn[none[:-1] | none[1:]] = np.inf
    return turn


def _depth(judge: JudgedTicks) -> Claim:
    name, says = "input depth", "the user's hand is as deep as the summary says, and in no tick deeper"
    if judge.on_mesh:
        return Claim(name, says, NOT_JUDGED, unit="m", note="inside a mesh the referee has no depth of its own")
    stated, looked = float(judge.result.summary[DEPTH]), np.append(judge.numbers[:-1:FIRST_LOOKS], judge.numbers[-1])
    way, depth = np.concatenate([[0.0], np.cumsum(_moved(judge))]), _depths(judge, looked)
    while True:
        # A depth changes by no more than the hand moves.
        room = 0.5 * (depth[:-1] + depth[1:] + np.diff(way[looked]))
        gaps = np.flatnonzero((room > depth.max() + SEARCHED) & (np.diff(looked) > 1))
        if gaps.size == 0:
            break
        more = (looked[gaps] + looked[gaps + 1]) // 2
        looked, depth = np.insert(looked, gaps + 1, more), np.insert(depth, gaps + 1, _depths(judge, more))
    off = np.where(depth == depth.max(), np.abs(depth - stated), 0.0)
    return judged(name, says, off, SEARCHED, "m", "as near as it is searched for", ticks=looked)


def _depths(judge: JudgedTicks, ticks: IntArray) -> FloatArray:
    """Of the user's hand in the leaf spheres at some ticks [m], shape (len(ticks),)."""
    if len(ticks) == 0:
        return np.empty(0)
    posed = Posed(*(values[ticks] for values in judge.wanted_posed))
    pairs = near_pairs(judge.hand, posed, judge.pieces, judge.fingers, 0.0)
    return np.asarray(np.maximum(0.0, -pairs.nearest(len(ticks)).min(axis=1)))


def _moved(judge: JudgedTicks) -> FloatArray:
    """Way of the farthest joint or palm sphere of the user's hand to the next tick [m], shape (T - 1,)."""
    posed = judge.wanted_posed
    joints = np.linalg.norm(np.diff(posed.joints, axis=0), axis=3).max(axis=(1, 2))
    palm = np.linalg.norm(np.diff(posed.palm, axis=0), axis=2).max(axis=1)
    return np.asarray(np.maximum(joints, palm))


def _correction(judge: JudgedTicks) -> Claim:
    says = "the shown hand is as far from the user's, in the ticks in which it touches, as the summary says"
    result, shown, wanted = judge.result, judge.shown_posed, judge.wanted_posed
    touch = np.asarray(result["contacts/touching"]) > 0
    for part in ("position", "orientation", "flexion", "abduction"):
        given = np.asarray(result[f"haptic/{part}"])
        touch &= np.isfinite(given).all(axis=tuple(range(1, given.ndim)))
    palm = np.sqrt(((shown.position - wanted.position)[touch] ** 2).sum(axis=1))
    joints = np.sqrt(((shown.joints - wanted.joints)[touch] ** 2).sum(axis=3)).reshape(len(palm), 20)
    found = np.full(4, np.nan)
    if len(palm):
        found = np.array([palm.mean(), palm.max(), joints.mean(), joints.max()])
    stated = np.array([float(result.summary.get(name, np.inf)) for name in CORRECTION])
    # Where nothing touches there is no such figure.
    off = np.where(np.isnan(stated) & np.isnan(found), 0.0, np.abs(stated - found))
    return judged("correction", says, off, LENGTH, "m", WHY_LENGTH)
