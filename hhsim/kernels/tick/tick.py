"""One tick: from the last graphic hand and the new haptic hand to the new graphic hand and its forces (paper, Fig. 3).

A tick is a short sequence of linearisations. Each one finds the contacts within the margin, builds the quadratic
program, solves it by the chosen method and takes the step, shortened so that no point of the hand moves further than
the pairs at hand can vouch for: no feature of the object can be jumped over. (Between the ends of a step a rotation can
graze a sphere to second order in the step: about a micrometre at the default margin, and in proportion to its square.)
After each step the *true* distances decide. A configuration without penetration becomes the last feasible one; from a
penetrating one (the second order of a rotation) the next linearisation corrects; if it does not come free, the tick
goes back, takes the share of its first penetrating step that keeps the clearance, and tries shorter ones. A program
that fails is never followed. Since the tick starts from a feasible configuration and ends at the last feasible one,
the graphic hand never penetrates.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.detection import COUNT_NODE_TESTS, COUNT_PAIR_TESTS, evaluate, find_contacts, pairs_near
from hhsim.kernels.contact.linearise import build_rows, clamp_to_limits
from hhsim.kernels.contact.parallel_detection import evaluate_in_parallel, worth_sharing
from hhsim.kernels.contact.redundant_contacts import drop_redundant_contacts
from hhsim.kernels.copy import copy_values
from hhsim.kernels.hand.kinematics import (
    BODY_COUNT,
    DOF,
    FINGER_COUNT,
    PHALANX_COUNT,
    HandArrays,
    motion_bounds,
)
from hhsim.kernels.hand.pose import copy_configuration, farthest_joint, is_finite_configuration, move, update_kinematics
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_inline, jit_once
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.rotation import rotation_vector_between
from hhsim.kernels.tick.coupled import solve_coupled
from hhsim.kernels.tick.force import FORCE_PAPER, hand_forces
from hhsim.kernels.tick.method import WAY_STEPS, Coupled, Progressive, is_oscillating, is_strained, solve_program, tick
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import (
    STATUS_ABDUCTION_HELD,
    STATUS_CAPACITY_EXCEEDED,
    STATUS_INPUT_INVALID,
    STATUS_LAG,
    STATUS_STUCK,
    UNITS_CONTACT,
    UNITS_LINEARISATION,
    UNITS_NODE_TEST,
    UNITS_PAIR_TEST,
    UNITS_QP_ITERATION,
    UNITS_ROW,
    WORK_BODIES,
    WORK_CANDIDATES,
    WORK_LINEARISATIONS,
    WORK_QP_ITERATIONS,
    WORK_ROWS,
    WORK_TOUCHING,
    WORK_UNITS,
)
from hhsim.kernels.tick.step import (
    DURATION_DETECT,
    DURATION_FINGERS,
    DURATION_FORCE,
    DURATION_PALM,
    copy_active,
    keep_active,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

REACH_PACE = 1.5
REACH_FLOOR = 2.0
REACH_GROWTH = 4.0
"""A tick's first program reaches as far as this many motions of the last tick, and this many settled steps.

A step that is cut short by the reach lets the next one reach farther by the last factor, up to the margin; after a
whole one the next reaches `REACH_FLOOR` times as far as that step was long.
"""
TRUST_DECAY = 0.25
TRUST_GROWTH = 2.0
LEAST_TRUST = 1e-6
"""What is left of the longest step after penetrating ones, what it grows by, and the share of the margin that is none.
"""
LATCH_MARGINS = 10.0
"""How far the user's hand goes from where palm and fingers apart came to nothing before they are tried apart again."""


@jit_inline
def set_haptic(
    hand: HandArrays, position: Array, orientation: Array, flexion: Array, abduction: Array, state: Record
) -> int:
    """Take the new haptic configuration; returns 0, or STATUS_INPUT_INVALID and keeps the old one: it is not finite."""
    haptic = state.haptic
    state.asked_before = state.asked
    state.asked = 0.0
    if not is_finite_configuration(position, orientation, flexion, abduction):
        return STATUS_INPUT_INVALID
    square = 0.0
    for i in range(4):
        square += orientation[i] * orientation[i]
    scale = 1.0 / math.sqrt(square)
    for i in range(3):
        haptic.position[i] = position[i]
    for i in range(4):
        haptic.orientation[i] = orientation[i] * scale
    for f in range(FINGER_COUNT):
        haptic.abduction[f] = abduction[f]
        for k in range(PHALANX_COUNT):
            haptic.flexion[f, k] = flexion[f, k]
    copy_values(haptic.joints[:], state.haptic_joints[:])
    update_kinematics(hand, haptic)
    state.asked = farthest_joint(state.haptic_joints, haptic.joints)
    return 0


@jit
def _usual_reach(options: TickOptions, state: Record) -> float:
    # What moves as fast as in the last tick, or stands still, needs no more; what does not, gains reach as it goes.
    return min(options.margin, max(REACH_FLOOR * options.step_tolerance, REACH_PACE * state.moved))


@jit
def evaluate_pose(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> int:
    """Kinematics and pair distances at the present configuration."""
    update_kinematics(hand, state.pose)
    pose, candidates, margin, skin = state.pose, state.candidates, options.margin, options.skin
    # As far as the next program may reach, in this tick or in the next.
    needed = max(options.listed, max(state.reach, _usual_reach(options, state)))
    # A reach exceeds the step that is expected: lists that vouch for that one may wait for a tick that makes no other,
    # and where the step turns out longer it is had anew, see `_complete_lists`.
    candidates.leeway = needed - max(options.listed, needed / REACH_PACE)
    team, work = state.thread_team, state.work
    if team.members > 1 and worth_sharing(hand, pose, needed, margin, skin, candidates, team, work):
        return evaluate_in_parallel(hand, pose, surface, margin, skin, candidates, team, work)
    return evaluate(hand, pose, surface, needed, margin, skin, candidates, work)


@jit
def least_distance(candidates: Record) -> float:
    """Least signed distance [m] of all pairs at hand, infinite where there is none."""
    least = np.inf
    for body in range(BODY_COUNT):
        least = min(least, candidates.nearest[body])
    return least


@jit_once
def _stays_latched(options: TickOptions, state: Record) -> bool:
    # Palm and fingers that came to nothing apart do so again from where solving them together has led: the hand would
    # be pulled to and fro for ever. They stay together until the user's hand has left that place.
    if not state.decoupling_latched:
        return False
    return farthest_joint(state.latch_joints, state.haptic.joints) <= LATCH_MARGINS * options.margin


@jit
def switch_to_coupled(state: Record) -> None:
    """Let palm and fingers share a program in this tick, and as long as the user's hand stays near."""
    state.in_one_program = True
    state.decoupling_latched = True
    copy_values(state.haptic.joints[:], state.latch_joints[:])


@jit_once
def _take_over(options: TickOptions, state: Record) -> None:
    # A tick whose work ran out before it came anywhere would else begin the next one as it began, for ever: what it
    # found too long, or without solution, is not tried again until the hand has arrived.
    if state.unfinished:
        if state.accepted and state.bad_steps == 0:
            state.trust = min(options.margin, TRUST_GROWTH * state.trust)
        elif state.bad_steps > 0 and not state.accepted:
            state.trust *= TRUST_DECAY
    if not state.unfinished or state.trust < LEAST_TRUST * options.margin:
        state.unfinished = False
        state.trust = options.margin
        state.relaxed = False
        state.hold_abduction = False
        state.in_one_program = state.decoupling_latched


@jit_once
def _follow_way(options: TickOptions, state: Record) -> None:
    # Where the user's hand rests: how often the hand has left where it had arrived, and how far ticks that lag have
    # moved it. A round may take many ticks.
    lags = state.lag > 0.0
    if lags:
        if farthest_joint(state.rest_joints, state.haptic.joints) <= options.step_tolerance:
            state.relapses += 0 if state.lagged else 1
            state.rest_moved += state.moved
        else:
            copy_values(state.haptic.joints[:], state.rest_joints[:])
            state.rest_way = farthest_joint(state.pose.joints, state.haptic.joints)
            state.rest_moved = 0.0
            state.relapses = 0
    state.lagged = lags
    # A tick of few linearisations is too short to see whether the hand goes to and fro: several make one way.
    if state.lag > 0.0 and state.way_steps < WAY_STEPS:
        state.way_steps += state.work[WORK_LINEARISATIONS]
        state.way_moved += state.moved
    else:
        state.way_steps = 0
        state.way_moved = 0.0
        copy_values(state.pose.joints[:], state.way_joints[:])
    state.work[:] = 0


@jit
def begin_tick(options: TickOptions, state: Record) -> None:
    """Reset what belongs to one tick; the present configuration, evaluated and free of penetration, is the safe one."""
    copy_configuration(state.pose, state.safe)
    for body in range(BODY_COUNT):
        state.since_safe[body] = 0.0
    state.decoupling_latched = _stays_latched(options, state)
    _take_over(options, state)
    state.progressive.variables = 6
    state.accepted = False
    state.full = False
    state.part = 0.0
    state.bad_steps = 0
    state.step.duration[:] = 0
    state.step.iterations = 0
    state.reach = _usual_reach(options, state)
    if state.lag == 0.0:
        state.turns = -1
    elif state.turns < 0:
        state.turns = 0
        state.last_step[:] = 0.0
    _follow_way(options, state)
    state.steady = state.lag == 0.0 and state.moved <= STEADY * state.moved_before
    state.moved_before = state.moved
    state.moved = 0.0
    state.lag = 0.0


@jit
def spent_units(state: Record) -> int:
    """Work units of the tick so far; `work[WORK_UNITS]` itself counts linearisations and rows until the tick ends."""
    work = state.work
    units = work[WORK_UNITS] + UNITS_QP_ITERATION * state.step.iterations
    return units + UNITS_NODE_TEST * work[COUNT_NODE_TESTS] + UNITS_PAIR_TEST * work[COUNT_PAIR_TESTS]


@jit
def _aim(state: Record) -> None:
    pose, haptic, problem = state.pose, state.haptic, state.problem
    rotation_vector_between(pose.orientation, haptic.orientation, state.scratch)
    for i in range(3):
        problem.target[i] = haptic.position[i] - pose.position[i]
        problem.target[3 + i] = state.scratch[i]
    for f in range(FINGER_COUNT):
        held = state.hold_abduction
        problem.abduction_step[f] = 0.0 if held else haptic.abduction[f] - pose.abduction[f]
        for k in range(PHALANX_COUNT):
            problem.target[6 + 3 * f + k] = haptic.flexion[f, k] - pose.flexion[f, k]


@jit
def find_program_contacts(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> int:
    """Contact records as far as the program may reach; where they do not fit, it may reach less, and go as far.

    Returns:
        0, or FULL: not even those that touch fit.
    """
    while True:
        reach = min(state.reach, state.trust)
        status = find_contacts(surface, hand, state.pose, state.candidates, reach, state.contacts)
        if status == 0 or reach < LEAST_TRUST * options.margin:
            return status
        state.trust = TRUST_DECAY * reach
        state.work[WORK_UNITS] += UNITS_CONTACT * state.contacts.key.shape[0]


@jit_once
def prepare(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> int:
    """Contacts and program at the present configuration; returns the number of contacts, -1 where they do not fit."""
    began = monotonic_ns()
    candidates = state.candidates
    if find_program_contacts(hand, surface, options, state) != 0:
        return -1
    reach = min(state.reach, state.trust)
    found = state.contacts.start[FINGER_COUNT + 1]
    drop_redundant_contacts(hand, reach, state.contacts, state.excess[:])
    _aim(state)
    state.clipped = False
    contacts = state.contacts.start[FINGER_COUNT + 1]
    bodies, pairs = pairs_near(surface, hand, candidates, max(options.listed, state.reach))
    state.work[WORK_BODIES] = max(state.work[WORK_BODIES], bodies)
    state.work[WORK_LINEARISATIONS] += 1
    state.work[WORK_CANDIDATES] = max(state.work[WORK_CANDIDATES], pairs)
    state.work[WORK_ROWS] = max(state.work[WORK_ROWS], contacts)
    state.work[WORK_UNITS] += UNITS_LINEARISATION + UNITS_CONTACT * found + UNITS_ROW * contacts
    if contacts == 0:
        for j in range(DOF):
            state.step.delta[j] = state.problem.target[j]
        for f in range(FINGER_COUNT):
            clamp_to_limits(hand, state.pose, f, state.step.delta[:])
        state.step.count = 0
    else:
        for f in range(FINGER_COUNT):
            if state.contacts.start[f + 2] == state.contacts.start[f + 1]:
                clamp_to_limits(hand, state.pose, f, state.problem.target[:])
        build_rows(hand, state.pose, state.contacts, options.offset, state.relaxed, state.problem)
        for j in range(DOF):
            state.problem.target[j] /= state.problem.inverse_root[j]
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return contacts


# Absorbed by its one caller it made every tick on triangles 5 % slower.
@jit
def _complete_lists(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> bool:
    """Gather what a program's step would go beyond, at the pose it was made for; whether it is to be made anew.

    Rows that a list lacks are farther than its slack, and change nothing as long as no body moves by so much: the step
    is the one of all rows. A longer one would hang on when a list happened to be made.
    """
    candidates = state.candidates
    reach = min(state.reach, state.trust)
    lacking = False
    for body in range(BODY_COUNT):
        lacking = lacking or candidates.slack[body] < reach
    if not lacking:
        return False
    motion_bounds(hand, state.pose, state.step.delta, state.problem.abduction_step, 0.0, state.motion)
    beyond = False
    for body in range(BODY_COUNT):
        slack = candidates.slack[body]
        beyond = beyond or (state.modelled[body] == 1 and slack < reach and state.motion[body] > slack - options.offset)
    if not beyond:
        return False
    candidates.leeway = 0.0
    skin, work = options.skin, state.work
    if evaluate(hand, state.pose, surface, candidates.needed, options.margin, skin, candidates, work) != 0:
        state.full = True
        return False
    return True


@jit
def _take_back(state: Record) -> None:
    copy_configuration(state.safe, state.pose)
    for body in range(BODY_COUNT):
        state.since_safe[body] = 0.0
    state.bad_steps = 0


PART = 0.8
"""Of the share of a step at which its second order is thought to use up the clearance."""


@jit
def _keep_first_step(options: TickOptions, fraction: float, clearance: float, depth: float, state: Record) -> None:
    # The step that has led from the safe hand into the object by `depth`, and the share of it that would not have: a
    # row that is kept is violated by the second order alone.
    for j in range(DOF):
        state.first_step[j] = fraction * state.step.delta[j]
    for f in range(FINGER_COUNT):
        state.first_abduction[f] = fraction * state.problem.abduction_step[f]
    state.part = PART * math.sqrt(min(max(clearance, 0.0), options.offset) / (depth + options.offset))


@jit
def _go_part_of_the_way(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> bool:
    # Return to the safe hand, and go from there as far as its first step allows; whether that has led anywhere.
    _take_back(state)
    if state.part >= LEAST_TRUST:
        move(state.pose, state.first_step, state.first_abduction, state.part)
        if evaluate_pose(hand, surface, options, state) == 0 and least_distance(state.candidates) >= 0.0:
            copy_configuration(state.pose, state.safe)
            state.accepted = True
            return True
        copy_configuration(state.safe, state.pose)
    if evaluate_pose(hand, surface, options, state) != 0:
        state.full = True
    return False


@jit_once
def recover(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> bool:
    """After a program without solution: make the next one easier. False where nothing is left to try."""
    if not state.relaxed:
        state.relaxed = True
        state.in_one_program = True
        return True
    moved = 0.0
    for body in range(BODY_COUNT):
        moved += state.since_safe[body]
    if moved > 0.0:
        if not state.predicted:
            state.trust *= TRUST_DECAY
        state.predicted = False
        _take_back(state)
        state.full = evaluate_pose(hand, surface, options, state) != 0
        return not state.full
    if not state.hold_abduction:
        state.hold_abduction = True
        return True
    return False


@jit
def shortening(hand: HandArrays, options: TickOptions, state: Record) -> tuple[float, float]:
    """The share of the step that the pairs at hand vouch for, and the way of the hand's farthest point in it [m]."""
    candidates = state.candidates
    reach = min(state.reach, state.trust)
    # A step that ends the tick, of a hand that rests, needs no better bound.
    enough = options.step_tolerance
    motion_bounds(hand, state.pose, state.step.delta, state.problem.abduction_step, enough, state.motion)
    fraction = 1.0
    longest = 0.0
    for body in range(BODY_COUNT):
        if state.modelled[body] == 0:
            continue
        motion = state.motion[body]
        longest = max(longest, motion)
        near = candidates.nearest[body]
        if near <= reach:
            allowed = min(candidates.slack[body], reach)
        else:
            allowed = min(candidates.slack[body], near)
        if motion * fraction > allowed:
            fraction = allowed / motion
    return fraction, longest


OPPOSITE = 0.9
"""Steps whose directions have a cosine below minus this go back on each other."""
MOST_TURNS = 2
"""Steps in a row that each go back on the one before, by more than half: the last of them is halved."""


# Absorbed by its one caller it made every tick 3 to 6 % slower.
@jit
def _damping(state: Record) -> float:
    # Where what is nearest changes from step to step, two linearisations may each lead past the optimum to where the
    # other one was made, for ever. Between them is where both lead.
    step, problem, last = state.step.delta, state.problem, state.last_step
    if state.turns < 0:
        last[:] = 0.0
    now, before, along = 0.0, 0.0, 0.0
    for j in range(DOF):
        x = step[j] / problem.inverse_root[j]
        now += x * x
        before += last[j] * last[j]
        along += x * last[j]
        last[j] = x
    if along >= -OPPOSITE * math.sqrt(now * before):
        state.turns = 0
    elif 4.0 * now > before:
        state.turns += 1
    return 0.5 if state.turns >= MOST_TURNS else 1.0


CLEAR = 0.8
LEAST_SHARE = 0.05
"""A hand that nothing is nearer to than this share of its clearance goes this share of a step or more of it."""


@jit_once
def clip_target(hand: HandArrays, options: TickOptions, last_chance: bool, state: Record) -> bool:
    """Bring a far target nearer where the step would be shortened to less than half and has something to mend.

    With `last_chance`, to where the hand is: the step then only mends, see `is_last_chance`. True where the program is
    to be solved anew.

    Shortening a step also shortens what it does to mend a penetration or to keep a clearance; a program with a nearer
    target mends all of it. A tick that ends like this lags; `finish_tick` computes its forces from what touches.
    A hand that has its clearance keeps it on any part of a step, and the part is the better one where contacts bend: a
    third of the target brings a third of the multipliers, with which a hand that slips off what held it would creep by
    hundredths of what the pairs at hand vouch for.
    """
    if state.clipped:
        return False
    fraction, longest = shortening(hand, options, state)
    if last_chance:
        fraction = 0.0
    elif fraction >= (LEAST_SHARE if least_distance(state.candidates) >= CLEAR * options.offset else 0.5):
        return False
    state.clipped = True
    state.unclipped_motion = longest
    problem = state.problem
    for j in range(DOF):
        problem.target[j] *= fraction
    for f in range(FINGER_COUNT):
        problem.abduction_step[f] *= fraction
    build_rows(hand, state.pose, state.contacts, options.offset, state.relaxed, problem)
    return True


STEADY = 2.0
"""Ratio of a tick's motion to that of the tick before, above which the hand has jumped and nothing is predicted."""
SLOWER = 0.5
"""Ratio of the way of the user's hand to that of the last tick, below which nothing is predicted: the hand stops."""
UNFORESEEN = 0.5
"""Reach of the first program after a prediction, as a share of the predicted motion."""


@jit
def predict_pose(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> None:
    """Move the hand on as the last tick moved it, so that the first program is made near where the step will end.

    A step of second order then ends the tick, where a hand that slides would need two programs. Nothing is accepted by
    it: a tick that finds no step from there goes back to where it began. No decision hangs on what the lists hold.
    """
    pose, before, delta = state.pose, state.before, state.step.delta
    abduction, reach = state.problem.abduction_step, min(state.reach, state.trust)
    share = min(1.0, state.asked / state.asked_before) if state.asked_before > 0.0 else 0.0
    state.predicted = False
    if share < SLOWER or not state.steady or state.active.count == 0:
        copy_configuration(pose, before)
        return
    rotation_vector_between(before.orientation, pose.orientation, state.scratch)
    for i in range(3):
        delta[i] = share * (pose.position[i] - before.position[i])
        delta[3 + i] = share * state.scratch[i]
    for f in range(FINGER_COUNT):
        abduction[f] = share * (pose.abduction[f] - before.abduction[f])
        for k in range(PHALANX_COUNT):
            delta[6 + 3 * f + k] = share * (pose.flexion[f, k] - before.flexion[f, k])
        clamp_to_limits(hand, pose, f, delta[:])
    copy_configuration(pose, before)
    _, longest = shortening(hand, options, state)
    if not options.step_tolerance < longest <= reach:
        return
    _complete_lists(hand, surface, options, state)
    if state.full:
        return
    state.predicted = True
    move(pose, delta, abduction, 1.0)
    for body in range(BODY_COUNT):
        state.since_safe[body] += state.motion[body]
    state.moved += longest
    state.reach = min(state.reach, max(REACH_FLOOR * options.step_tolerance, UNFORESEEN * longest))
    state.full = evaluate_pose(hand, surface, options, state) != 0


@jit
def forget_prediction(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> bool:
    """Go back to where the tick began if its hand is there by prediction alone; return whether it was."""
    if not state.predicted:
        return False
    state.predicted = False
    _take_back(state)
    state.full = evaluate_pose(hand, surface, options, state) != 0
    return True


@jit_once
def advance(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> bool:
    """Take the step as far as the pairs at hand vouch for and judge it by the true distances.

    True where the tick is done.
    """
    began = monotonic_ns()
    candidates, step, problem = state.candidates, state.step, state.problem
    keep_active(state.contacts, step, state.warm)
    # A program may miss a joint limit by its tolerance, and the next one would start from there: with a palm that is a
    # million times stiffer than a joint that adds up.
    for f in range(FINGER_COUNT):
        clamp_to_limits(hand, state.pose, f, step.delta[:])
    clearance = least_distance(candidates)
    fraction, longest = shortening(hand, options, state)
    # A tick that arrives in its first step, as most do, has nothing to go back on.
    if state.contacts.start[FINGER_COUNT + 1] > 0 and (state.turns >= 0 or state.work[WORK_LINEARISATIONS] > 1):
        fraction = min(fraction, _damping(state))
    move(state.pose, step.delta, problem.abduction_step, fraction)
    for body in range(BODY_COUNT):
        state.since_safe[body] += fraction * state.motion[body]
    state.moved += fraction * longest
    if fraction < 1.0 or state.clipped:
        state.reach = min(options.margin, REACH_GROWTH * state.reach)
    else:
        # What a whole step leaves to go is of second order: its contacts are near ones. The next may be the longer one
        # all the same, where contacts change, and one that the reach cuts short would grow it, and go to and fro.
        state.reach = min(state.reach, REACH_FLOOR * max(options.step_tolerance, longest))
    status = evaluate_pose(hand, surface, options, state)
    wanted = max(state.unclipped_motion if state.clipped else 0.0, longest)
    done = False
    if status != 0:
        state.full = True
        done = True
    elif least_distance(candidates) >= 0.0:
        copy_configuration(state.pose, state.safe)
        for body in range(BODY_COUNT):
            state.since_safe[body] = 0.0
        copy_active(state.warm, state.active)
        state.accepted = True
        state.predicted = False
        state.bad_steps = 0
        state.lag = wanted - fraction * longest
        unhindered = state.contacts.start[FINGER_COUNT + 1] == 0
        done = fraction == 1.0 and not state.clipped and (unhindered or longest <= options.step_tolerance)
        if not done and state.lag == 0.0:
            # A whole step, but not a short one: were this the budget's last, up to as much could still be to go.
            state.lag = longest
        elif done:
            state.lag = 0.0
    elif forget_prediction(hand, surface, options, state):
        done = state.full
    else:
        if state.bad_steps == 0:
            state.lag = wanted
            _keep_first_step(options, fraction, clearance, -least_distance(candidates), state)
        state.bad_steps += 1
        if state.bad_steps > 3:
            if not state.in_one_program:
                switch_to_coupled(state)
            _go_part_of_the_way(hand, surface, options, state)
            state.trust *= TRUST_DECAY
            done = state.full
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return done


@jit
def cap_lag(state: Record) -> None:
    """Let the lag be no longer than from where the hand is shown to where the user has it.

    A program's step can be longer than any way that is left, where a soft direction is all but free.
    """
    state.lag = min(state.lag, farthest_joint(state.pose.joints, state.haptic.joints))


ON_THE_WAY = 20.0
"""A hand on its way bears on what is this many offsets from it: its last step has not brought it nearer yet."""


@jit_once
def _settle_forces(hand: HandArrays, surface: Any, options: TickOptions, state: Record, qp: QpWork) -> None:
    # A tick that ends on its way shows a configuration that is no optimum, and the multipliers of its last program
    # belong to another one. What touches at the configuration shown bears the coupling as far as it can: one more
    # program, of the touching contacts only, that standing still satisfies, so that the forces stay within the
    # coupling's own. The same where the palm has yielded to a finger: it stands at the edge of what the finger's own
    # program allows, and there that program's multipliers grow without bound.
    near = max(options.touch, ON_THE_WAY * options.offset) if state.lag > 0.0 else options.touch
    contacts = find_contacts(surface, hand, state.pose, state.candidates, near, state.contacts)
    state.active.count = 0
    if contacts != 0 or state.contacts.start[FINGER_COUNT + 1] == 0:
        return
    _aim(state)
    for f in range(FINGER_COUNT):
        state.problem.abduction_step[f] = 0.0
        if state.contacts.start[f + 2] == state.contacts.start[f + 1]:
            clamp_to_limits(hand, state.pose, f, state.problem.target[:])
    build_rows(hand, state.pose, state.contacts, options.offset, as_bool(True), state.problem)
    for j in range(DOF):
        state.problem.target[j] /= state.problem.inverse_root[j]
    if solve_coupled(Coupled(options), state, qp) == OPTIMAL:
        keep_active(state.contacts, state.step, state.active)


@jit
def is_last_chance(options: TickOptions, state: Record, done: int) -> bool:
    """Whether the tick's next step, its last, only leaves the object.

    Where an axis lies along an edge its nearest place runs along it as it turns, and each step that goes on towards
    the user brings as much penetration as it mends. A tick that has taken steps back for that, and stands inside
    before its last linearisation, has come somewhere by the step that leaves the object and does no more.
    """
    shorter = state.trust < options.margin
    return shorter and state.bad_steps > 0 and not state.accepted and done == options.linearisations - 1


MOST_IDLE = 10
"""Ticks in a row that may come nowhere for want of time before they are stuck."""


@jit_once
def finish_tick(hand: HandArrays, surface: Any, options: TickOptions, strained: bool, state: Record, qp: QpWork) -> int:
    """Return to the last feasible configuration, count what touches, compute the forces; returns status bits.

    `strained`: the last program's multipliers are no forces, see `is_strained`.
    """
    began = monotonic_ns()
    status = 0
    candidates = state.candidates
    cut_short = state.work[WORK_LINEARISATIONS] < options.linearisations and spent_units(state) >= options.budget
    unsafe = 0.0
    for body in range(BODY_COUNT):
        unsafe += state.since_safe[body]
    bad_steps = state.bad_steps
    part = False
    if unsafe > 0.0:
        if state.accepted or state.full:
            state.part = 0.0
        part = _go_part_of_the_way(hand, surface, options, state)
        state.bad_steps = bad_steps
    if part:
        # What is not safe in one program may be in several.
        state.trust = max(TRUST_DECAY, state.part) * min(state.reach, state.trust)
    state.idle = 0 if state.accepted else state.idle + 1
    if state.full:
        status |= STATUS_CAPACITY_EXCEEDED
    if not state.accepted:
        # A tick that was not given the time to find a step is on its way: the next one goes on. But not for ever.
        status |= STATUS_LAG if cut_short and state.idle <= MOST_IDLE else STATUS_STUCK
        state.lag = np.inf
    elif state.lag > 0.0:
        status |= STATUS_LAG
    state.unfinished = not state.accepted or part or (state.unfinished and state.lag > 0.0)
    if state.accepted and state.hold_abduction:
        status |= STATUS_ABDUCTION_HELD
    if status & (STATUS_STUCK | STATUS_LAG):
        cap_lag(state)
    _, touching = pairs_near(surface, hand, candidates, options.touch)
    state.work[WORK_TOUCHING] = touching
    detected = monotonic_ns()
    if (status & STATUS_LAG or strained) and options.force_model != FORCE_PAPER:
        # The program's time belongs to the forces, which count it below.
        palm, fingers = state.step.duration[DURATION_PALM], state.step.duration[DURATION_FINGERS]
        _settle_forces(hand, surface, options, state, qp)
        state.step.duration[DURATION_PALM] = palm
        state.step.duration[DURATION_FINGERS] = fingers
    if options.force_model == FORCE_PAPER:
        find_contacts(surface, hand, state.pose, candidates, options.touch, state.contacts)
    hand_forces(options, state)
    state.step.duration[DURATION_DETECT] += detected - began
    state.work[WORK_UNITS] = spent_units(state)
    state.work[WORK_QP_ITERATIONS] = state.step.iterations
    state.step.duration[DURATION_FORCE] += monotonic_ns() - detected
    return status


@tick.of(Coupled)
@tick.of(Progressive)
@jit
def converge(method: Any, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
    """Go from linearisation to linearisation until the hand stands still; returns status bits."""
    options = method.options
    begin_tick(options, state)
    predict_pose(hand, surface, options, state)
    status = 0
    for i in range(options.linearisations):
        # With lists that are not whole a program could miss a pair.
        if state.full or (i > 0 and spent_units(state) >= options.budget):
            break
        if is_oscillating(method, state, i):
            switch_to_coupled(state)
        last_chance = is_last_chance(options, state, i)
        contacts, solved, units = as_int64(0), OPTIMAL, state.work[WORK_UNITS]
        anew, complete = True, False
        while True:
            if anew:
                # Of a program that is made anew only what was walked and solved for counts.
                state.work[WORK_UNITS] = units
                contacts = prepare(hand, surface, options, state)
            if contacts > 0:
                solved = solve_program(method, state, qp)
            if contacts < 0 or solved != OPTIMAL:
                break
            anew = not complete and _complete_lists(hand, surface, options, state)
            if anew:
                state.work[WORK_LINEARISATIONS] -= 1
            complete = True
            if not anew and (contacts == 0 or not clip_target(hand, options, last_chance, state)):
                break
        if contacts < 0:
            status |= STATUS_CAPACITY_EXCEEDED
            break
        if solved != OPTIMAL:
            if recover(hand, surface, options, state):
                continue
            break
        if advance(hand, surface, options, state):
            break
    return status | finish_tick(hand, surface, options, as_bool(is_strained(method, state)), state, qp)


@jit
def rebuild_candidates(hand: HandArrays, surface: Any, options: TickOptions, states: NDArray[np.void]) -> int:
    """Take the graphic hand's configuration as it now stands: kinematics, near pairs, distances; returns 0 or FULL."""
    state = states[0]
    copy_configuration(state.pose, state.before)
    for body in range(BODY_COUNT):
        # A body that the scene does not use is never due for a walk and never near.
        state.candidates.fresh[body] = -np.inf if state.modelled[body] == 1 else np.inf
        state.candidates.count[body] = 0
    return evaluate_pose(hand, surface, options, state)
