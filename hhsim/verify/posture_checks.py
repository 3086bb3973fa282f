"""Claims of the hand's posture at every tick: joints follow from angles, within limits, and jump as is said."""

from dataclasses import replace

import numpy as np

from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import ticks_alone
from hhsim.verify.claim import NOT_CLAIMED, NOT_JUDGED, Claim, as_number, difference, judged
from hhsim.verify.tick_data import LENGTH, WHY_LENGTH, JudgedTicks

ANGLE = 1e-9
"""Tolerance of angles [rad]."""
JUMPS = ("posture_jump_max", "posture_jump_p999")
"""Figures of the shown hand's jumps [m]."""


def posture_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the joints of the shown hand, their limits and its jumps."""
    result, hand, at, ticks = judge.result, judge.hand, judge.shown, judge.numbers
    unit = np.abs(np.linalg.norm(at.orientation, axis=1) - 1.0)
    # The opposite quaternion is the same rotation, but a jump of its numbers.
    unit[1:][(at.orientation[1:] * at.orientation[:-1]).sum(axis=1) < 0.0] = np.inf
    off = np.linalg.norm(judge.shown_posed.joints - result["graphic/joints"], axis=3).max(axis=(1, 2))
    off = np.maximum(off, np.where(unit <= ANGLE, 0.0, np.inf))
    says = "the joints are those of the stored angles and pose, whose quaternions are unit and change no sign"
    claims = [judged("kinematics", says, off, LENGTH, "m", WHY_LENGTH, ticks=ticks)]
    beyond = np.maximum(hand.flexion_min - at.flexion, at.flexion - hand.flexion_max).max(axis=(1, 2))
    beyond, says = np.maximum(0.0, beyond), "no joint is beyond its limit"
    limits = judged("joint limits", says, beyond, ANGLE, "rad", "rounding of the solver's steps", ticks=ticks)
    if not result.gives("status"):
        note = f"of a method that is not hhsim's; its joints are up to {beyond.max(initial=0.0):.3g} rad beyond"
        limits = replace(limits, verdict=NOT_CLAIMED, note=note)
    return [*claims, limits, *_jumps(judge)]


def _jumps(judge: JudgedTicks) -> list[Claim]:
    """Judge by how far the shown hand goes beyond its user's, from poses of the referee's own."""
    name, says, result = "jumps", "the shown hand goes beyond its user's from tick to tick as is said", judge.result
    stated = {name: as_number(value) for name, value in result.summary.items() if name in JUMPS}
    if result.live is not None or not result.complete or not stated:
        return []
    if len(result.bodies) > 1:
        note = "beside several bodies the referee does not tell which move"
        return [Claim(name, says, NOT_JUDGED, unit="m", note=note)]
    run = replace(ticks_alone(result), hand=None, user=judge.wanted_posed.joints)
    off = difference(np.array([*stated.values()]), np.array([run_figure(name, run) for name in stated]))
    return [judged(name, says, off, LENGTH, "m", WHY_LENGTH)]
