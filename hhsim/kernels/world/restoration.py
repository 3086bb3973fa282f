"""Restoration after a step that ends inside, and prediction of the pose that a tick begins with.

The prediction is the last pose, moved on as in the last tick. A hand that slides needs two linearisations from where it
stands, and one from where it is going, since the step from there is short and its contacts are the right ones. Nothing
is accepted by a prediction: a tick that finds no step from there returns to where it began. No decision depends on how
old the lists of pairs are: neither do the bits.
"""

import math

from hhsim.kernels.contact.linearise import clamp_to_limits
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT
from hhsim.kernels.hand.pose import copy_configuration, move, step_between
from hhsim.kernels.jit import Record, jit, jit_inline, jit_noinline
from hhsim.kernels.tick.evaluation import REACH_FLOOR, complete_lists, least_distance
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.step import allowed_fraction
from hhsim.kernels.tick.tick import LEAST_TRUST
from hhsim.kernels.world.pairs import World, measure

FREE_SHARE = 0.8
"""Factor of the share of a step whose second-order term is estimated to equal the clearance."""


@jit
def restore(state: Record) -> None:
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
def take_free_share(method: World, state: Record) -> bool:
    """Return to the last feasible configuration, and make the free share of its first step; returns whether it is free.

    A hand that is faster than the tick's work would else stand still in every other tick. The pose is evaluated in
    either case.
    """
    restore(state)
    first = state.first_step
    if first.free_share >= LEAST_TRUST:
        move(state.pose, first.delta, first.abduction, first.free_share)
        if measure(method) and least_distance(state) >= 0.0:
            copy_configuration(state.pose, state.safe)
            state.progress.is_accepted = True
            return True
        copy_configuration(state.safe, state.pose)
    measure(method)
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


SLOWER = 0.5
"""Ratio of the user's motion to that of the last tick, below which nothing is predicted: the hand stops."""
UNFORESEEN = 0.5
"""Reach of the first program after a prediction, as a share of the predicted motion."""


@jit_noinline
def predict_pose(method: World, state: Record) -> None:
    """Move a hand in contact on as the last tick did and the user's slows down, within the bound of the tick."""
    prediction, sample, progress = state.prediction, state.input, state.progress
    options, hand = method.options, method.movers[0]
    reach = min(state.trust.reach, state.trust.radius)
    share = min(1.0, sample.motion / sample.previous_motion) if sample.previous_motion > 0.0 else 0.0
    prediction.is_predicted = False
    foreseeable = share >= SLOWER and prediction.is_steady and state.active.count > 0
    if foreseeable:
        delta, abduction = state.step.delta[:], state.problem.abduction_step[:]
        step_between(prediction.start, state.pose, delta, abduction, state.scratch)
        for j in range(DOF):
            delta[j] *= share
        for f in range(FINGER_COUNT):
            abduction[f] *= share
            clamp_to_limits(hand, state.pose, f, delta)
    copy_configuration(state.pose, prediction.start)
    if not foreseeable:
        return
    _, longest = allowed_fraction(hand, options, state)
    if not options.step_tolerance < longest <= min(reach, progress.bound):
        return
    complete_lists(hand, method.surfaces[0], options, state)
    if progress.pairs_overflow:
        return
    prediction.is_predicted = True
    move(state.pose, state.step.delta, state.problem.abduction_step, 1.0)
    progress.differs_from_safe = True
    progress.path += longest
    state.trust.reach = min(state.trust.reach, max(REACH_FLOOR * options.step_tolerance, UNFORESEEN * longest))
    measure(method)


@jit_inline
def forget_prediction(method: World, state: Record) -> bool:
    """Return to where the tick began if its hand is there by prediction alone; returns whether it was."""
    if not state.prediction.is_predicted:
        return False
    state.prediction.is_predicted = False
    state.progress.snaps = False
    restore(state)
    measure(method)
    return True
