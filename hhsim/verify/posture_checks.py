"""Claims of where the hand is: joints, limits, how far behind it is. All ticks are judged."""

import numpy as np

from hhsim.verify.claim import Claim, judged
from hhsim.verify.tick_data import (
    ABDUCTION_HELD,
    CAPACITY_EXCEEDED,
    INPUT_INVALID,
    LAG,
    LENGTH,
    START_INSIDE,
    STUCK,
    WHY_LENGTH,
    JudgedTicks,
)

ANGLE = 1e-9
"""Angles that differ by this [rad] are the same."""
WHY_ANGLE = "rounding of the solver's steps"


def posture_claims(judge: JudgedTicks) -> list[Claim]:
    """Joints, limits, abduction, lag, and hands that are stuck."""
    result, hand, at, ticks = judge.result, judge.hand, judge.shown, judge.numbers
    unit = np.abs(np.linalg.norm(at.orientation, axis=1) - 1.0)
    off = np.linalg.norm(judge.shown_posed.joints - result["graphic/joints"], axis=3).max(axis=(1, 2))
    beyond = np.maximum(hand.flexion_min - at.flexion, at.flexion - hand.flexion_max).max(axis=(1, 2))
    says = "the joints are those of the stored angles and pose"
    return [
        judged("unit quaternions", "orientations are unit", unit, 1e-9, "1", "rounding", ticks=ticks),
        judged("kinematics", says, off, LENGTH, "m", WHY_LENGTH, ticks=ticks),
        judged(
            *("joint limits", "no joint is beyond its limit", np.maximum(0.0, beyond), ANGLE, "rad", WHY_ANGLE),
            ticks=ticks,
        ),
        _abduction(judge),
        _lag(judge),
        *_stuck(judge),
    ]


def _abduction(judge: JudgedTicks) -> Claim:
    settled = judge.status & (STUCK | LAG | INPUT_INVALID | START_INSIDE | CAPACITY_EXCEEDED | ABDUCTION_HELD) == 0
    spread = np.abs(judge.shown.abduction - judge.wanted.abduction).max(axis=1)[settled]
    says = "settled ticks show the user's abduction"
    return judged("abduction", says, spread, ANGLE, "rad", WHY_ANGLE, ticks=judge.numbers[settled])


def _lag(judge: JudgedTicks) -> Claim:
    far = np.linalg.norm(judge.shown_posed.joints - judge.wanted_posed.joints, axis=3).max(axis=(1, 2))
    lag, late = np.asarray(judge.result["lag"]), judge.status & (STUCK | LAG) > 0
    over = np.where(late, np.maximum(0.0, np.maximum(lag - far, -lag)), np.abs(lag))
    says = "a settled tick has none, another no more than the way left"
    return judged("lag", says, over, LENGTH, "m", WHY_LENGTH, ticks=judge.numbers)


def _stuck(judge: JudgedTicks) -> list[Claim]:
    stuck = judge.stuck
    if stuck.size == 0 or not judge.safe:
        return []
    joints = judge.shown_posed.joints
    apart = np.linalg.norm(joints[stuck] - joints[stuck - 1], axis=3).max(axis=(1, 2))
    says = "a stuck tick shows the hand of the tick before"
    return [judged("stuck ticks", says, apart, LENGTH, "m", WHY_LENGTH, ticks=stuck)]
