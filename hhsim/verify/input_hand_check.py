"""Claims of the user's hand: its motion between samples, its depth, and the correction of the shown hand."""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.metrics.input_hand import search_deepest
from hhsim.result.reader import Result
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_JUDGED, Claim, as_number, judged
from hhsim.verify.contacts import near_pairs
from hhsim.verify.judged_body import JudgedBody, judged_bodies
from hhsim.verify.kinematics import Posed, turn_between
from hhsim.verify.tick_data import LENGTH, WHY_LENGTH, JudgedTicks

DEPTH = "input_depth_max"
CORRECTION = ("correction_palm_mean", "correction_palm_max", "correction_joint_mean", "correction_joint_max")
FIGURES = (DEPTH, *CORRECTION)
INPUT_DEPTH = "input depth", "the user's hand is as deep as the summary says, and in no tick deeper"
OFF_THE_USER = (
    "correction",
    "the shown hand is as far from the user's, in the ticks in which it touches, as the summary says",
)
"""Claims of the summary, each a name and a statement."""
SEARCHED = 1e-6
"""Tolerance of the search for the deepest tick [m]."""
BETWEEN = 1e-8
"""Tolerance of the curve between two samples [m, rad]: a stamp belongs to its tick within a nanosecond."""


def input_hand_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the summary's figures of the user's hand; none of a session or a stopped run."""
    result = judge.result
    if result.live is not None or not result.complete:
        return []
    # No version tells them apart: results of several parts or things once had none of the figures, which are NaN there.
    # Now the depth is always a number, so that a result that lacks some of them is wrong.
    if result.parts and np.isnan([as_number(result.summary.get(name, np.inf)) for name in FIGURES]).all():
        note = "the file has no such figures, as those of several parts or things once had none; make it anew"
        return [Claim(*claim, NOT_JUDGED, unit="m", note=note) for claim in (INPUT_DEPTH, OFF_THE_USER)]
    return [_depth(judge), _correction(judge)]


def motion_claim(result: Result) -> Claim:
    """Judge that the ticks of one sample lie on one curve, or stand still.

    The curve is a cubic of each number, whose fourth differences are zero, and for a quaternion a steady turn.
    """
    name, says = "motion", "between two samples, the user's hand and the object go as samples are told to be joined"
    if result.live is not None:
        return Claim(name, says, NOT_JUDGED, note="a glove's samples are claims of their own")
    held = result.scene.get("samples") == "hold"
    seq, off = np.asarray(result["input_seq"]), np.full(result.ticks, np.nan)
    names = [f"haptic/{name}" for name in HandConfiguration._fields]
    if result.driven and not result.free:
        names += ["object/position", "object/orientation"]
    for column in names:
        rows = np.asarray(result[column]).reshape(result.ticks, -1)
        turns = column.endswith("orientation") and not held
        steps, order = (
            (np.nan_to_num(turn_between(rows[:-1], rows[1:]), nan=np.inf), 1) if turns else (rows, 1 if held else 4)
        )
        bent = np.abs(np.diff(steps, order, axis=0)).max(axis=1, initial=0.0)
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


def _depth(judge: JudgedTicks) -> Claim:
    if judge.on_mesh:
        return Claim(*INPUT_DEPTH, NOT_JUDGED, unit="m", note="inside a mesh the referee has no depth of its own")
    deepest, every = 0.0, np.arange(judge.result.ticks)
    for body in judged_bodies(judge.result, every):
        posed = body.seen(judge.wanted_posed, every)
        # Travel of the farthest joint or palm sphere to the next tick [m].
        joints = np.linalg.norm(np.diff(posed.joints, axis=0), axis=3).max(axis=(1, 2))
        moved = np.maximum(joints, np.linalg.norm(np.diff(posed.palm, axis=0), axis=2).max(axis=1))

        def depths(ticks: IntArray, posed: Posed = posed, body: JudgedBody = body) -> FloatArray:
            pairs = near_pairs(judge.hand, posed.at(ticks), body.pieces, judge.fingers, 0.0)
            return np.asarray(np.maximum(0.0, -pairs.nearest(len(ticks)).min(axis=1, keepdims=True)))

        deepest = search_deepest(moved[:, None], depths, deepest)
    off = abs(deepest - as_number(judge.result.summary.get(DEPTH)))
    return judged(*INPUT_DEPTH, [off], SEARCHED, "m", "as near as it is searched for")


def _correction(judge: JudgedTicks) -> Claim:
    result, shown, wanted = judge.result, judge.shown_posed, judge.wanted_posed
    touch = np.asarray(result["contacts/touching"]) > 0
    for part in ("position", "orientation", "flexion", "abduction"):
        given = np.asarray(result[f"haptic/{part}"])
        touch &= np.isfinite(given).all(axis=tuple(range(1, given.ndim)))
    palm = np.sqrt(((shown.position - wanted.position)[touch] ** 2).sum(axis=1))
    joints = np.sqrt(((shown.joints - wanted.joints)[touch] ** 2).sum(axis=3)).reshape(len(palm), 20)
    found = np.array([palm.mean(), palm.max(), joints.mean(), joints.max()] if len(palm) else [np.nan] * 4)
    stated = np.array([as_number(result.summary.get(name, np.inf)) for name in CORRECTION])
    # Without contact there is no such figure.
    off = np.where(np.isnan(stated) & np.isnan(found), 0.0, np.abs(stated - found))
    return judged(*OFF_THE_USER, off, LENGTH, "m", WHY_LENGTH)
