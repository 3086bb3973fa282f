"""The claims of how deep the user's hand was and how far the shown one is from it, by the referee's own hands."""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.verify.claim import NOT_JUDGED, Claim, judged
from hhsim.verify.contacts import near_pairs
from hhsim.verify.file_checks import leaves
from hhsim.verify.kinematics import Posed
from hhsim.verify.tick_data import LENGTH, WHY_LENGTH, JudgedTicks

DEPTH = "input_depth_max"
CORRECTION = ("correction_palm_mean", "correction_palm_max", "correction_joint_mean", "correction_joint_max")
FIGURES = (DEPTH, *CORRECTION)
SEARCHED = 1e-6
"""The deepest tick is found to this [m]."""


def input_hand_claims(judge: JudgedTicks) -> list[Claim]:
    """What the summary says of the user's hand; nothing of a session, which has no summary, or of an older file."""
    if judge.result.live is not None or not judge.result.complete or DEPTH not in judge.result.summary:
        return []
    return [_depth(judge), _correction(judge)]


def _depth(judge: JudgedTicks) -> Claim:
    name, says = "input depth", "the user's hand is as deep as the summary says, and no tick looked at is deeper"
    if judge.on_mesh:
        return Claim(name, says, NOT_JUDGED, unit="m", note="inside a mesh the referee has no depth of its own")
    stated, looked = float(judge.result.summary[DEPTH]), judge.chosen
    depth = _depths(judge, looked)
    if depth.max() < stated - SEARCHED:
        # A depth changes by no more than the hand moves: the tick that is meant can only be where there is room for it.
        way = np.concatenate([[0.0], np.cumsum(_moved(judge))])[looked]
        room = 0.5 * (depth[:-1] + depth[1:] + np.diff(way))
        gaps = [np.arange(looked[k] + 1, looked[k + 1]) for k in np.flatnonzero(room >= stated - SEARCHED)]
        more = np.concatenate([np.empty(0, np.int64), *gaps])
        looked, depth = np.append(looked, more), np.append(depth, _depths(judge, more))
    # Deeper than it says, at some tick; or nowhere as deep, which is told of the deepest.
    over = np.maximum(depth - stated, np.where(depth == depth.max(), stated - depth, 0.0))
    return judged(name, says, np.maximum(0.0, over), SEARCHED, "m", "as near as it is searched for", ticks=looked)


def _depths(judge: JudgedTicks, ticks: IntArray) -> FloatArray:
    """Of the user's hand in the leaf spheres at some ticks [m], shape (len(ticks),)."""
    if len(ticks) == 0:
        return np.empty(0)
    posed = Posed(*(values[ticks] for values in judge.wanted_posed))
    pairs = near_pairs(judge.hand, posed, *leaves(judge.result), judge.fingers, 0.0)
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
