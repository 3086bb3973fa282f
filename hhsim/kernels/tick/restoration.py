"""Restoration after steps that end inside the object and programs without a solution."""

import math

from hhsim.kernels.contact.surface_code import SurfaceCode
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, HandArrays
from hhsim.kernels.hand.pose import copy_configuration, move
from hhsim.kernels.jit import Record, jit, jit_noinline
from hhsim.kernels.tick.evaluation import evaluate_pose, least_distance
from hhsim.kernels.tick.options import TickOptions

TRUST_DECAY = 0.25
"""Share of the trust radius that is left when a step has been taken back."""
LEAST_TRUST = 1e-6
"""Share of the margin, or of a step, that is not worth a step."""
FREE_SHARE = 0.8
"""Factor of the share of a step whose second-order term is estimated to equal the clearance."""


@jit
def take_back(state: Record) -> None:
    """Return to the last configuration without penetration."""
    copy_configuration(state.safe, state.pose)
    state.progress.differs_from_safe = False


@jit
def keep_first_step(options: TickOptions, fraction: float, clearance: float, depth: float, state: Record) -> None:
    """Keep the step that has led into the object, and estimate the share of it that would not have.

    The share `fraction` of it led from `clearance` to `depth` [m] inside. A row that is kept is violated by the second
    order alone, which grows with the square of the step.
    """
    first = state.first_step
    for j in range(DOF):
        first.delta[j] = fraction * state.step.delta[j]
    for f in range(FINGER_COUNT):
        first.abduction[f] = fraction * state.problem.abduction_step[f]
    first.free_share = FREE_SHARE * math.sqrt(min(max(clearance, 0.0), options.offset) / (depth + options.offset))


@jit_noinline
def take_free_share(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record) -> bool:
    """Return to the last feasible configuration, and make the free share of its first step; returns whether it is free.

    A hand that is faster than the tick's work would else stand still in every other tick. The pose is evaluated in
    either case.
    """
    take_back(state)
    first = state.first_step
    if first.free_share >= LEAST_TRUST:
        move(state.pose, first.delta, first.abduction, first.free_share)
        if evaluate_pose(hand, surface, options, state) and least_distance(state) >= 0.0:
            copy_configuration(state.pose, state.safe)
            state.progress.is_accepted = True
            return True
        copy_configuration(state.safe, state.pose)
    evaluate_pose(hand, surface, options, state)
    return False


@jit
def only_restores(options: TickOptions, state: Record, done: int) -> bool:
    """Return whether the tick's next step, after `done` linearisations, only leaves the object.

    A hand that snaps has gone as far as it may, and one that is inside without an accepted step has but one step left.
    Where an axis lies along an edge its nearest place runs along it as it turns, and each step towards the user brings
    as much penetration as it mends. So a tick whose trust radius is reduced for that, and whose pose is inside, ends
    with a step of the target 0. Without it a hand that is faster than its few linearisations is left behind.
    """
    progress = state.progress
    is_last = done == options.linearisations - 1
    is_lost = is_last and state.trust.radius < options.margin and not progress.is_accepted
    return progress.failed_steps > 0 and (is_lost or progress.snaps)
