"""One tick of hand and free object: as `kernels.tick.tick`, with the object's step in the same program.

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
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import copy_configuration, move, update_kinematics
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_once
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.rotation import rotation_vector_between
from hhsim.kernels.tick.force import hand_forces
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import (
    STATUS_ABDUCTION_HELD,
    STATUS_CAPACITY_EXCEEDED,
    STATUS_LAG,
    STATUS_STUCK,
    UNITS_CONTACT,
    UNITS_LINEARISATION,
    UNITS_ROW,
    WORK_BODIES,
    WORK_CANDIDATES,
    WORK_LINEARISATIONS,
    WORK_QP_ITERATIONS,
    WORK_ROWS,
    WORK_TOUCHING,
    WORK_UNITS,
)
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FORCE, DURATION_PALM, copy_active
from hhsim.kernels.tick.tick import (
    MOST_IDLE,
    REACH_FLOOR,
    REACH_GROWTH,
    TRUST_DECAY,
    begin_tick,
    cap_lag,
    evaluate_pose,
    find_program_contacts,
    is_last_chance,
    least_distance,
    shortening,
    spent_units,
)

Array = NDArray[np.float64]

CLOSE = 20.0
FLOATS = 2.0
"""A contact up to so many offsets apart, and this many residuals of the tick before, has friction."""
SEARCHED = 2
"""In so many programs of a tick Γ and directions are sought; in the others they stand."""


class Free(NamedTuple):
    """How hand and free object are solved for together, and what of the object can stand on a table."""

    options: TickOptions
    support: Support


@jit_once
def _see_haptic(hand: HandArrays, state: Record) -> None:
    haptic = state.haptic
    see_hand(state.body, state.palm_position[:], state.palm_orientation[:], haptic.position[:], haptic.orientation[:])
    update_kinematics(hand, haptic)


@jit
def _aim(state: Record) -> None:
    pose, haptic, problem = state.pose, state.haptic, state.free_problem
    see_hand(state.body, state.palm_position[:], state.palm_orientation[:], haptic.position[:], haptic.orientation[:])
    rotation_vector_between(pose.orientation[:], haptic.orientation[:], state.scratch[:])
    for i in range(3):
        problem.hand_target[i] = haptic.position[i] - pose.position[i]
        problem.hand_target[3 + i] = state.scratch[i]
    for f in range(FINGER_COUNT):
        problem.abduction_step[f] = 0.0 if state.hold_abduction else haptic.abduction[f] - pose.abduction[f]
        for k in range(PHALANX_COUNT):
            problem.hand_target[6 + 3 * f + k] = haptic.flexion[f, k] - pose.flexion[f, k]
    body_target(state.body, problem.body_target[:])


@jit_once
def _prepare(hand: HandArrays, method: Free, surface: Any, state: Record) -> int:
    # Contacts and rows at the present poses; returns the number of rows that contacts have, -1 where they do not fit.
    began = monotonic_ns()
    options, contacts, problem, friction, body = (
        method.options,
        state.contacts,
        state.free_problem,
        state.friction,
        state.body,
    )
    if find_program_contacts(hand, surface, options, state) != 0:
        return -1
    reach = min(state.reach, state.trust)
    found = contacts.start[FINGER_COUNT + 1]
    drop_redundant_contacts(hand, reach, contacts, state.excess[:])
    total = contacts.start[FINGER_COUNT + 1]
    _aim(state)
    state.clipped = False
    state.body.clipped[:] = 0.0
    bodies, pairs = pairs_near(surface, hand, state.candidates, max(options.listed, state.reach))
    for f in range(FINGER_COUNT):
        if contacts.start[f + 2] == contacts.start[f + 1]:
            clamp_to_limits(hand, state.pose, f, problem.hand_target[:])
    build_rows(hand, state.pose, contacts, options.offset, state.relaxed, problem)
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
    work = state.work
    work[WORK_BODIES] = max(work[WORK_BODIES], bodies)
    work[WORK_LINEARISATIONS] += 1
    work[WORK_CANDIDATES] = max(work[WORK_CANDIDATES], pairs)
    work[WORK_ROWS] = max(work[WORK_ROWS], count)
    work[WORK_UNITS] += UNITS_LINEARISATION + UNITS_CONTACT * found + UNITS_ROW * count
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return count


@jit
def _solve(method: Free, count: int, state: Record, qp: QpWork) -> int:
    problem = state.free_problem
    if count == 0:
        for j in range(6):
            problem.delta[j] = problem.hand_target[j]
            problem.delta[6 + j] = problem.body_target[j]
        for j in range(6, DOF):
            problem.delta[6 + j] = problem.hand_target[j]
        state.loaded.count = 0
        problem.astray = 0.0
        take_step(state.pose, state.body, problem, state.step.delta[:])
        return OPTIMAL
    return _solve_rows(method, state, qp)


@jit
def _solve_rows(method: Free, state: Record, qp: QpWork) -> int:
    began = monotonic_ns()
    rounds = as_int64(1)
    if state.work[WORK_LINEARISATIONS] <= SEARCHED and not state.clipped:
        rounds = begin_search(state.coulomb)
    status = solve_free(
        method.options,
        state.pose,
        state.contacts,
        state.body,
        state.relaxed,
        state.free_problem,
        state.friction,
        state.loaded,
        state.coulomb,
        state.leanings,
        state.held,
        state.step,
        qp,
        rounds,
        state.clipped,
    )
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    return status


@jit
def _take_back(state: Record) -> None:
    copy_configuration(state.safe, state.pose)
    take_body_back(state.body)
    copy_values(state.body_safe_total[:], state.free_problem.total[:])
    copy_values(state.body_safe_abduction[:], state.free_problem.abduction_total[:])
    for body in range(BODY_COUNT):
        state.since_safe[body] = 0.0
    state.bad_steps = 0


@jit_once
def _recover(hand: HandArrays, surface: Any, options: TickOptions, state: Record) -> bool:
    if not state.relaxed:
        state.relaxed = True
        return True
    if state.bad_steps > 0:
        _take_back(state)
        state.trust *= TRUST_DECAY
        state.full = evaluate_pose(hand, surface, options, state) != 0
        return not state.full
    if not state.hold_abduction:
        state.hold_abduction = True
        return True
    return False


@jit_once
def _clip_target(hand: HandArrays, method: Free, last_chance: bool, state: Record) -> bool:
    # See `kernels.tick.tick.clip_target`. The ways of hand and object are shortened alike: a hand that was short of its
    # way past the object alone would be carried along by it, for no force, and its springs drawn out by nobody. The
    # targets are moved by what is taken off, so that springs and inertia pull as they did.
    if state.clipped:
        return False
    options, problem = method.options, state.free_problem
    copy_values(problem.abduction_step[:], state.problem.abduction_step[:])
    fraction, longest = shortening(hand, options, state)
    if last_chance:
        fraction = 0.0
    elif fraction >= 0.5:
        return False
    state.clipped = True
    state.unclipped_motion = longest
    off = 1.0 - fraction
    for j in range(6):
        problem.hand_target[j] -= off * problem.delta[j]
        state.body.clipped[j] = off * problem.delta[6 + j]
        problem.body_target[j] -= state.body.clipped[j]
    for j in range(6, DOF):
        problem.hand_target[j] -= off * problem.delta[6 + j]
    for f in range(FINGER_COUNT):
        problem.abduction_step[f] *= fraction
    build_rows(hand, state.pose, state.contacts, options.offset, state.relaxed, problem)
    scale_target(state.body, problem)
    clip_shifts(fraction, state.friction)
    return True


@jit
def _table(method: Free, state: Record) -> tuple[float, int]:
    if state.body.has_table == 0:
        return np.inf, as_int64(-1)
    return table_distances(state.body, method.support)


@jit_once
def _advance(hand: HandArrays, method: Free, surface: Any, state: Record) -> bool:
    # Take the step as far as the pairs at hand vouch for and judge it; True where the tick is done.
    began = monotonic_ns()
    options, step, problem, body = method.options, state.step, state.free_problem, state.body
    for f in range(FINGER_COUNT):
        clamp_to_limits(hand, state.pose, f, step.delta[:])
    copy_values(problem.abduction_step[:], state.problem.abduction_step[:])
    fraction, longest = shortening(hand, options, state)
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
    for b in range(BODY_COUNT):
        state.since_safe[b] += fraction * state.motion[b]
    state.moved += fraction * longest
    if fraction < 1.0 or state.clipped:
        state.reach = min(options.margin, REACH_GROWTH * state.reach)
    else:
        state.reach = min(state.reach, max(REACH_FLOOR * options.step_tolerance, longest))
    status = evaluate_pose(hand, surface, options, state)
    table, lowest = _table(method, state)
    if table < 0.0:
        keep_entry(lowest, state.friction)
    wanted = max(state.unclipped_motion if state.clipped else 0.0, longest)
    state.lag = wanted - fraction * longest
    done = False
    if status != 0:
        state.full = True
        done = True
    elif least_distance(state.candidates) >= 0.0 and table >= 0.0:
        copy_configuration(state.pose, state.safe)
        keep_body(body)
        state.table_distance = table
        copy_values(problem.total[:], state.body_safe_total[:])
        copy_values(problem.abduction_total[:], state.body_safe_abduction[:])
        for b in range(BODY_COUNT):
            state.since_safe[b] = 0.0
        copy_active(state.warm, state.active)
        state.tried.residual = problem.astray
        copy_borne(state.tried, state.borne)
        state.accepted = True
        state.bad_steps = 0
        unhindered = state.contacts.start[FINGER_COUNT + 1] == 0
        done = fraction == 1.0 and not state.clipped and (unhindered or longest <= options.step_tolerance)
        if not done and state.lag == 0.0:
            state.lag = longest
        elif done:
            state.lag = 0.0
    else:
        # Were this the tick's last step it would be taken back, and nothing of it made.
        state.bad_steps += 1
        state.lag = wanted
        if state.bad_steps > 3:
            _take_back(state)
            state.trust *= TRUST_DECAY
            state.full = evaluate_pose(hand, surface, options, state) != 0
            done = state.full
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return done


@jit_once
def _end_tick(hand: HandArrays, method: Free, surface: Any, state: Record) -> int:
    # Return to the last poses without penetration, take the velocities and the forces; returns status bits.
    began = monotonic_ns()
    options = method.options
    status = 0
    cut_short = state.work[WORK_LINEARISATIONS] < options.linearisations and spent_units(state) >= options.budget
    state.idle = 0 if state.accepted else state.idle + 1
    if state.bad_steps > 0:
        _take_back(state)
        if evaluate_pose(hand, surface, options, state) != 0:
            status |= STATUS_CAPACITY_EXCEEDED
    if state.full:
        status |= STATUS_CAPACITY_EXCEEDED
    _see_haptic(hand, state)
    if not state.accepted:
        status |= STATUS_LAG if cut_short and state.idle <= MOST_IDLE else STATUS_STUCK
        state.lag = np.inf
        state.borne.count = 0
        state.borne.residual = 0.0
        state.borne.bare = 0.0
        state.borne.hand_wrench[:] = 0.0
        state.borne.table_wrench[:] = 0.0
        state.active.count = 0
    elif state.lag > 0.0:
        status |= STATUS_LAG
    state.unfinished = not state.accepted or (state.unfinished and state.lag > 0.0)
    if state.accepted and state.hold_abduction:
        status |= STATUS_ABDUCTION_HELD
    if status & (STATUS_STUCK | STATUS_LAG):
        cap_lag(state)
    if state.accepted:
        take_velocity(state.body)
    _, touching = pairs_near(surface, hand, state.candidates, options.touch)
    state.work[WORK_TOUCHING] = touching
    detected = monotonic_ns()
    turn_loads(state.body, state.active)
    hand_forces(options, state)
    state.step.duration[DURATION_DETECT] += detected - began
    state.work[WORK_UNITS] = spent_units(state)
    state.work[WORK_QP_ITERATIONS] = state.step.iterations
    state.step.duration[DURATION_FORCE] += monotonic_ns() - detected
    return status


@jit
def free_tick(method: Free, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
    """Bring the hand towards the user's, and the object to where forces and inertia take it; returns status bits."""
    options, problem = method.options, state.free_problem
    begin_tick(options, state)
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
    status = 0
    for i in range(options.linearisations):
        # Where nothing is accepted yet the object would stop in the air: it goes on.
        if i > 0 and state.accepted and spent_units(state) >= options.budget:
            break
        count = _prepare(hand, method, surface, state)
        if count < 0:
            status |= STATUS_CAPACITY_EXCEEDED
            break
        last_chance = is_last_chance(options, state, i)
        solved = OPTIMAL
        while True:
            solved = _solve(method, count, state, qp)
            if solved != OPTIMAL or count == 0 or not _clip_target(hand, method, last_chance, state):
                break
        if solved != OPTIMAL:
            if _recover(hand, surface, options, state):
                continue
            break
        if _advance(hand, method, surface, state):
            break
    return status | _end_tick(hand, method, surface, state)


@jit
def rebuild(hand: HandArrays, method: Free, surface: Any, states: NDArray[np.void]) -> int:
    """Take the poses of hand and object as they now stand in the object's frame; returns 0 or FULL."""
    state = states[0]
    state.table_distance, _ = _table(method, state)
    for body in range(BODY_COUNT):
        state.candidates.fresh[body] = -np.inf if state.modelled[body] == 1 else np.inf
        state.candidates.count[body] = 0
    return evaluate_pose(hand, surface, method.options, state)
