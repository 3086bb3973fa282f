"""One tick of hand and free object: the loop of `kernels.tick.tick`, with the object's step in the same program.

The hand is kept as the object sees it. A program's step moves both; the object's is taken out of the hand's, and what
is left, the hand's way past the object, is what is bounded by the pairs at hand and judged by true distances. A step of
which hand or table would be entered is taken back like any other, and the last pose of both that was free is what is
shown. The table is a half-space: nothing can be behind it, so that the end of a step says all.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.detection import pairs_near
from hhsim.kernels.contact.linearise import build_rows, clamp_to_limits, limit_start
from hhsim.kernels.contact.redundant_contacts import drop_redundant_contacts
from hhsim.kernels.copy import copy_values
from hhsim.kernels.free.body import (
    Support,
    as_object_moves,
    body_target,
    keep_body,
    move_body,
    predict,
    see_hand,
    take_body_back,
    take_velocity,
    turn_back,
)
from hhsim.kernels.free.program import begin_search, clip_shifts, scale_target, solve_free, take_step
from hhsim.kernels.free.record import copy_borne, find_borne, turn_loads
from hhsim.kernels.free.rows import (
    COMMON,
    FREE_DOF,
    begin_frictions,
    find_frictions,
    keep_entry,
    object_columns,
    table_distances,
)
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, HandArrays
from hhsim.kernels.hand.pose import move, update_kinematics
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_once
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.evaluation import (
    REACH_FLOOR,
    end_work,
    evaluate_pose,
    is_budget_spent,
    least_distance,
    rebuild_candidates,
)
from hhsim.kernels.tick.force import hand_forces
from hhsim.kernels.tick.linearisation import count_linearisation, find_program_contacts, step_to_haptic
from hhsim.kernels.tick.method import (
    OVERFLOW,
    advance,
    begin_motion,
    finish_tick,
    may_end,
    recover,
    solve_linearisation,
    tick,
)
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.restoration import TRUST_DECAY, only_restores, take_back
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, WORK_LINEARISATIONS, WORK_TOUCHING
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FORCE, DURATION_PALM
from hhsim.kernels.tick.step_length import WHOLE_TARGET, allowed_fraction
from hhsim.kernels.tick.tick import (
    MOST_FAILED_STEPS,
    accept,
    converge,
    tick_status,
    update_reach,
)

CLOSE = 20.0
FLOATS = 2.0
"""Contacts up to CLOSE offsets, plus FLOATS times the residual of Γ of the tick before, have rows of friction."""
SEARCHED = 2
"""Programs of a tick in which Γ and directions are sought; in the later ones they stand."""


class Free(NamedTuple):
    """Method that solves hand and free object together, with the parts of the object that can stand on a table."""

    options: TickOptions
    support: Support


@jit_once
def _see_haptic(hand: HandArrays, state: Record) -> None:
    haptic = state.haptic
    see_hand(state.body, state.palm_position[:], state.palm_orientation[:], haptic.position[:], haptic.orientation[:])
    update_kinematics(hand, haptic)


@jit
def _aim(state: Record) -> None:
    haptic, problem = state.haptic, state.free_problem
    see_hand(state.body, state.palm_position[:], state.palm_orientation[:], haptic.position[:], haptic.orientation[:])
    step_to_haptic(state, problem.hand_target[:], problem.abduction_step[:])
    body_target(state.body, problem.body_target[:])


@jit_once
def _prepare(hand: HandArrays, method: Free, surface: Any, state: Record) -> int:
    """Build the program at the present poses.

    Returns the number of rows that contacts have, -1 where they do not fit into the records.
    """
    began = monotonic_ns()
    options, contacts, problem, friction, body = (
        method.options,
        state.contacts,
        state.free_problem,
        state.friction,
        state.body,
    )
    if not find_program_contacts(hand, surface, options, state):
        return -1
    reach = min(state.trust.reach, state.trust.radius)
    found = contacts.start[FINGER_COUNT + 1]
    drop_redundant_contacts(hand, reach, contacts, state.open_distance[:])
    total = contacts.start[FINGER_COUNT + 1]
    _aim(state)
    state.body.clipped[:] = 0.0
    for f in range(FINGER_COUNT):
        if contacts.start[f + 2] == contacts.start[f + 1]:
            clamp_to_limits(hand, state.pose, f, problem.hand_target[:])
    build_rows(hand, state.pose, contacts, options.offset, state.program.is_relaxed, problem)
    object_columns(body, contacts, problem)
    # A contact floats by what Γ was short of its slip, and goes on rubbing.
    close = CLOSE * options.offset + FLOATS * state.borne.residual
    find_frictions(state.pose, body, contacts, method.support, options.margin, close, problem.body_target[:], friction)
    if state.work[WORK_LINEARISATIONS] == 0:
        step, abduction = problem.before[:], problem.before_abduction[:]
    else:
        step, abduction = problem.total[:], problem.abduction_total[:]
    # Directions that went on turning would give each program another one, and the tick no end.
    turns = as_bool(state.work[WORK_LINEARISATIONS] < SEARCHED)
    begin_frictions(state.pose, body, step, abduction, problem, state.held, turns, friction)
    scale_target(body, problem)
    count = total + friction.count - friction.of_hand
    count_linearisation(hand, surface, options, found, count, state)
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return count


@jit
def _solve(method: Free, count: int, clipped: bool, state: Record, qp: QpWork) -> int:
    problem = state.free_problem
    if count == 0:
        for j in range(6):
            problem.delta[j] = problem.hand_target[j]
            problem.delta[6 + j] = problem.body_target[j]
        for j in range(6, DOF):
            problem.delta[6 + j] = problem.hand_target[j]
        state.loaded.count = 0
        problem.gamma_error = 0.0
        take_step(state.pose, state.body, problem, state.step.delta[:])
        return OPTIMAL
    return _solve_rows(method, clipped, state, qp)


@jit
def _solve_rows(method: Free, clipped: bool, state: Record, qp: QpWork) -> int:
    began = monotonic_ns()
    rounds = as_int64(1)
    if state.work[WORK_LINEARISATIONS] <= SEARCHED and not clipped:
        rounds = begin_search(state.coulomb)
    status = solve_free(method.options, rounds, clipped, state, qp)
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    return status


@jit
def _take_back(state: Record) -> None:
    """Return to the last poses without penetration."""
    take_back(state)
    state.progress.failed_steps = 0
    take_body_back(state.body)
    copy_values(state.body_safe_total[:], state.free_problem.total[:])
    copy_values(state.body_safe_abduction[:], state.free_problem.abduction_total[:])


@recover.of(Free)
@jit
def _recover(method: Free, hand: HandArrays, surface: Any, state: Record) -> bool:
    if not state.program.is_relaxed:
        state.program.is_relaxed = True
        return True
    if state.progress.failed_steps > 0:
        _take_back(state)
        state.trust.radius *= TRUST_DECAY
        return evaluate_pose(hand, surface, method.options, state)
    if not state.program.holds_abduction:
        state.program.holds_abduction = True
        return True
    return False


@jit_once
def _clip_target(hand: HandArrays, method: Free, only_restore: bool, state: Record) -> float:
    """Bring a far target nearer, see `kernels.tick.step_length.clip_target`.

    The motions of hand and object are shortened alike: a hand that was short of its motion past the object alone would
    be carried along by it, for no force, and its springs drawn out by nobody. The targets are moved by what is taken
    off, so that springs and inertia pull as they did.
    """
    options, problem = method.options, state.free_problem
    copy_values(problem.abduction_step[:], state.problem.abduction_step[:])
    fraction, longest = allowed_fraction(hand, options, state)
    if only_restore:
        fraction = 0.0
    elif fraction >= 0.5:
        return WHOLE_TARGET
    off = 1.0 - fraction
    for j in range(6):
        problem.hand_target[j] -= off * problem.delta[j]
        state.body.clipped[j] = off * problem.delta[6 + j]
        problem.body_target[j] -= state.body.clipped[j]
    for j in range(6, DOF):
        problem.hand_target[j] -= off * problem.delta[6 + j]
    for f in range(FINGER_COUNT):
        problem.abduction_step[f] *= fraction
    build_rows(hand, state.pose, state.contacts, options.offset, state.program.is_relaxed, problem)
    scale_target(state.body, problem)
    clip_shifts(fraction, state.friction)
    return longest


@solve_linearisation.of(Free)
@jit
def _solve_linearisation(
    method: Free, hand: HandArrays, surface: Any, done: int, state: Record, qp: QpWork
) -> tuple[int, float]:
    count, full_motion = _prepare(hand, method, surface, state), WHOLE_TARGET
    if count < 0:
        return as_int64(OVERFLOW), full_motion
    status = _solve(method, count, as_bool(False), state, qp)
    if status == OPTIMAL and count > 0:
        full_motion = _clip_target(hand, method, only_restores(method.options, state, done), state)
        if full_motion != WHOLE_TARGET:
            status = _solve(method, count, as_bool(True), state, qp)
    return status, full_motion


@jit
def _table(method: Free, state: Record) -> tuple[float, int]:
    if state.body.has_table == 0:
        return np.inf, as_int64(-1)
    return table_distances(state.body, method.support)


@jit_once
def _move_both(hand: HandArrays, fraction: float, state: Record) -> None:
    """Make a share of the step of hand and object, and find what bears it."""
    step, problem, body = state.step, state.free_problem, state.body
    for j in range(FREE_DOF):
        problem.total[j] += fraction * problem.delta[j]
    for f in range(FINGER_COUNT):
        problem.abduction_total[f] += fraction * problem.abduction_step[f]
    limits = limit_start(state.contacts, as_int64(0))
    limits_end = limit_start(state.contacts, as_int64(FINGER_COUNT))
    find_borne(
        state.pose,
        body,
        state.contacts,
        problem,
        state.friction,
        state.loaded,
        limits,
        limits_end,
        state.warm,
        state.tried,
    )
    # What comes next in the tick is added to it in the frame of the object as it then stands.
    for part in range(3):
        turn_back(body, problem.delta[6:12], fraction, problem.total[3 * part : 3 * part + 3])
    if 0.0 < fraction < 1.0:
        # Part of the way that hand and object make, which is no part of the straight way between their ends.
        for j in range(COMMON):
            problem.whole[j] = fraction * problem.delta[j]
        as_object_moves(body, state.pose.position[:], problem.whole[0:6], problem.whole[6:12], step.delta[0:6])
        for j in range(6):
            step.delta[j] /= fraction
    move(state.pose, step.delta, problem.abduction_step, fraction)
    move_body(body, problem.delta[6:12], fraction)


@jit_once
def _keep(table: float, state: Record) -> None:
    """Keep the object's pose, and what bears it, as those of an accepted step."""
    problem = state.free_problem
    keep_body(state.body)
    state.table_distance = table
    copy_values(problem.total[:], state.body_safe_total[:])
    copy_values(problem.abduction_total[:], state.body_safe_abduction[:])
    state.tried.residual = problem.gamma_error
    copy_borne(state.tried, state.borne)


@advance.of(Free)
@jit
def _advance(method: Free, hand: HandArrays, surface: Any, full_motion: float, state: Record) -> bool:
    """Make the step as far as the pairs at hand vouch for, and judge it by the true distances and the table's."""
    began = monotonic_ns()
    options, step, problem, progress = method.options, state.step, state.free_problem, state.progress
    for f in range(FINGER_COUNT):
        clamp_to_limits(hand, state.pose, f, step.delta[:])
    copy_values(problem.abduction_step[:], state.problem.abduction_step[:])
    fraction, longest = allowed_fraction(hand, options, state)
    _move_both(hand, fraction, state)
    foreseen = max(REACH_FLOOR * options.step_tolerance, longest)
    update_reach(options, fraction, longest, full_motion, foreseen, state)
    fits = evaluate_pose(hand, surface, options, state)
    table, lowest = _table(method, state)
    if table < 0.0:
        keep_entry(lowest, state.friction)
    done = False
    if not fits:
        progress.lag = max(full_motion, longest) - fraction * longest
        done = True
    elif least_distance(state) >= 0.0 and table >= 0.0:
        _keep(table, state)
        done = accept(options, fraction, longest, full_motion, state)
    else:
        # Were this the tick's last step it would be taken back, and nothing of it made.
        progress.failed_steps += 1
        progress.lag = max(full_motion, longest)
        if progress.failed_steps > MOST_FAILED_STEPS:
            _take_back(state)
            state.trust.radius *= TRUST_DECAY
            done = not evaluate_pose(hand, surface, options, state)
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return done


@finish_tick.of(Free)
@jit
def _finish_tick(method: Free, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
    """Return to the last poses without penetration, take the velocities and the forces; returns status bits."""
    began = monotonic_ns()
    options, progress, borne = method.options, state.progress, state.borne
    cut_short, pairs_overflow = is_budget_spent(options, state), progress.pairs_overflow
    if progress.failed_steps > 0 or pairs_overflow:
        _take_back(state)
        pairs_overflow = not evaluate_pose(hand, surface, options, state) or pairs_overflow
    _see_haptic(hand, state)
    status = tick_status(cut_short, as_bool(False), state)
    if pairs_overflow:
        status |= STATUS_CAPACITY_EXCEEDED
    if progress.is_accepted:
        take_velocity(state.body)
    else:
        borne.count = 0
        borne.residual = 0.0
        borne.bare = 0.0
        borne.hand_wrench[:] = 0.0
        borne.table_wrench[:] = 0.0
        state.active.count = 0
    _, state.work[WORK_TOUCHING] = pairs_near(surface, hand, state.candidates, options.touch)
    detected = monotonic_ns()
    turn_loads(state.body, state.active)
    hand_forces(options, state)
    end_work(state)
    state.step.duration[DURATION_DETECT] += detected - began
    state.step.duration[DURATION_FORCE] += monotonic_ns() - detected
    return status


@may_end.of(Free)
@jit
def _may_end(method: Free, state: Record) -> bool:
    # Where nothing is accepted yet the object would stop in the air: it goes on.
    return state.progress.is_accepted


@tick.of(Free)
@jit
def _tick(method: Free, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
    """Take the user's hand, which is the world's, and converge; the hand is then as the object sees it."""
    if state.input.is_valid:
        copy_values(state.haptic.position[:], state.palm_position[:])
        copy_values(state.haptic.orientation[:], state.palm_orientation[:])
    return converge(method, hand, surface, state, qp)


@begin_motion.of(Free)
@jit
def _begin_motion(method: Free, hand: HandArrays, surface: Any, state: Record) -> None:
    """Let the object go on by its velocity and its weight."""
    problem = state.free_problem
    predict(state.body)
    keep_body(state.body)
    copy_values(state.body_safe_total[:], problem.before[:])
    copy_values(state.body_safe_abduction[:], problem.before_abduction[:])
    problem.total[:] = 0.0
    problem.abduction_total[:] = 0.0
    problem.solutions = 0
    state.friction.entries = 0
    state.body_safe_total[:] = 0.0
    state.body_safe_abduction[:] = 0.0


@jit
def rebuild(hand: HandArrays, method: Free, surface: Any, states: NDArray[np.void]) -> bool:
    """Take the poses of hand and object as they now stand, in the object's frame; returns whether the pairs fit."""
    state = states[0]
    state.table_distance, _ = _table(method, state)
    return rebuild_candidates(hand, surface, method.options, states)
