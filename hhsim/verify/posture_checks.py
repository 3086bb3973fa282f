"""Claims of the hand's posture at every tick: joints, limits, abduction, lag."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_CLAIMED, Claim, judged
from hhsim.verify.file_checks import spent
from hhsim.verify.kinematics import turn_between
from hhsim.verify.tick_data import (
    ABDUCTION_HELD,
    LAG,
    LENGTH,
    NO_PLACE,
    SNAP,
    STUCK,
    UNSETTLED,
    WHY_LENGTH,
    JudgedTicks,
    left_out,
)

ANGLE = 1e-9
"""Tolerance of angles [rad]."""
LIMITS = "no joint is beyond its limit"
WHY_ANGLE = "rounding of the solver's steps"


def posture_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge joints, limits, abduction, lag and stuck ticks."""
    result, hand, at, ticks = judge.result, judge.hand, judge.shown, judge.numbers
    unit = np.abs(np.linalg.norm(at.orientation, axis=1) - 1.0)
    # The opposite quaternion is the same rotation, but a jump of its numbers.
    unit[1:][(at.orientation[1:] * at.orientation[:-1]).sum(axis=1) < 0.0] = np.inf
    off = np.linalg.norm(judge.shown_posed.joints - result["graphic/joints"], axis=3).max(axis=(1, 2))
    beyond = np.maximum(hand.flexion_min - at.flexion, at.flexion - hand.flexion_max).max(axis=(1, 2))
    units, says = "orientations are unit, and change no sign", "the joints are those of the stored angles and pose"
    return [
        judged("unit quaternions", units, unit, 1e-9, "1", "rounding", ticks=ticks),
        judged("kinematics", says, off, LENGTH, "m", WHY_LENGTH, ticks=ticks),
        *_of_the_solver(judge, np.maximum(0.0, beyond)),
        *_free(judge),
        *_stuck(judge),
    ]


def _of_the_solver(judge: JudgedTicks, beyond: FloatArray) -> list[Claim]:
    """Judge the claims of every tick of hhsim's own methods; another method makes none."""
    if not judge.result.gives("status"):
        note = f"of a method that is not hhsim's; its joints are up to {beyond.max(initial=0.0):.3g} rad beyond"
        return [Claim("joint limits", LIMITS, NOT_CLAIMED, checked=len(beyond), note=note)]
    return [
        judged("joint limits", LIMITS, beyond, ANGLE, "rad", WHY_ANGLE, ticks=judge.numbers),
        _abduction(judge),
        _lag(judge),
    ]


def _abduction(judge: JudgedTicks) -> Claim:
    kept = np.flatnonzero(judge.status & UNSETTLED == 0)
    off = np.abs(judge.shown.abduction - judge.wanted.abduction)
    # Each step goes towards the user's, but a tick may begin with the step of the one before.
    last = np.abs(np.diff(judge.shown.abduction, axis=0, prepend=judge.shown.abduction[:1]))
    before = np.abs(np.roll(judge.shown.abduction, 1, axis=0) - judge.wanted.abduction) + np.roll(last, 1, axis=0)
    held = judge.status & ABDUCTION_HELD > 0
    off = np.where(held[:, None], np.maximum(0.0, off - before), off).max(axis=1)[kept]
    says = "settled ticks show the user's abduction; where it is held, it goes no farther from it"
    note = f"held in {counted(int(held.sum()), 'tick')}" if held.any() else ""
    note = "; ".join(filter(None, (note, left_out(judge.status, UNSETTLED))))
    return judged("abduction", says, off, ANGLE, "rad", WHY_ANGLE, ticks=judge.numbers[kept], note=note)


def _lag(judge: JudgedTicks) -> Claim:
    far = np.linalg.norm(judge.shown_posed.joints - judge.wanted_posed.joints, axis=3).max(axis=(1, 2))
    lag, late = np.asarray(judge.result["lag"]), judge.status & (STUCK | LAG | NO_PLACE | SNAP) > 0
    over = np.where(late, np.maximum(0.0, np.maximum(lag - far, -lag)), np.abs(lag))
    # A hand that lags has a distance left, unless it is there.
    # Of a snap the forces may have yet to follow.
    none = late & (lag <= 0.0) & (far > LENGTH) & (judge.status & SNAP == 0)
    others = _of_others(judge) & none
    over[none & ~others] = np.inf
    says = "a settled tick has none, another some, and no more than the way left"
    count = counted(int(others.sum()), "tick")
    note = f"in {count} the hand is done beside the first body, and what lags has no distance in the file"
    return judged("lag", says, over, LENGTH, "m", WHY_LENGTH, ticks=judge.numbers, note=note if others.any() else "")


def _of_others(judge: JudgedTicks) -> BoolArray:
    """True for ticks that may lag by the first hand's flag though that hand is done beside the first body, shape (T,).

    Of several bodies it has the flag also where a body, or a hand beside another body, has distance still to go; the
    file has the distance of the hand beside the first body.
    """
    result, status = judge.result, judge.status
    several = result.name == next(iter(result.hands)) and result.body.is_free and len(result.bodies) > 1
    return np.asarray(several & spent(result) & (status & (STUCK | NO_PLACE) == 0))


def _free(judge: JudgedTicks) -> list[Claim]:
    if not judge.safe:
        return []
    clear = np.asarray(judge.result["work/rows"]) == 0
    settled = clear & (judge.status & UNSETTLED == 0)
    at, wanted = judge.shown, judge.wanted
    bend = np.clip(wanted.flexion, judge.hand.flexion_min, judge.hand.flexion_max)
    off = np.maximum(
        np.linalg.norm(at.position - wanted.position, axis=1),
        np.linalg.norm(turn_between(wanted.orientation, at.orientation), axis=1),
    )
    off = np.maximum(off, np.abs(at.flexion - bend).max(axis=(1, 2)))[settled]
    says = "a settled tick without a contact shows the user's hand"
    note = left_out(judge.status[clear], UNSETTLED)
    return [judged("free hand", says, off, ANGLE, "m, rad", WHY_ANGLE, ticks=judge.numbers[settled], note=note)]


def _stuck(judge: JudgedTicks) -> list[Claim]:
    stuck = judge.stuck
    if stuck.size == 0 or not judge.safe:
        return []
    joints = judge.shown_posed.joints
    apart = np.linalg.norm(joints[stuck] - joints[stuck - 1], axis=3).max(axis=(1, 2))
    says = "a stuck tick shows the hand of the tick before"
    return [judged("stuck ticks", says, apart, LENGTH, "m", WHY_LENGTH, ticks=stuck)]
