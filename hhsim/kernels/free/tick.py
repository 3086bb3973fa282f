"""One tick of one or two hands and a free object: the loop of `kernels.tick.tick`, with all steps in one program.

A hand is kept as the object sees it. A program's step moves all; the object's is taken out of a hand's, and what
is left, the hand's way past the object, is what is bounded by the pairs at hand and judged by true distances. A step of
which hand or table would be entered is taken back like any other, and the last pose of both that was free is what is
shown. The table is a half-space: nothing can be behind it, so that the end of a step says all.

Two hands make the same share of a step, and the tick ends where both have arrived. They do not see each other.
"""

from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.contact.detection import pairs_near
from hhsim.kernels.contact.linearise import LIMIT_ROWS, build_rows, clamp_to_limits
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
from hhsim.kernels.free.program import begin_search, clip_shifts, scale_target, solve_free, take_steps
from hhsim.kernels.free.record import copy_borne, find_borne, turn_loads
from hhsim.kernels.free.rows import (
    SECOND_KEYS,
    States,
    begin_frictions,
    find_frictions,
    keep_entry,
    object_columns,
    own_columns,
    table_distances,
)
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import move, update_kinematics
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, generic, jit, jit_inline, jit_once
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_object, record_tick
from hhsim.kernels.tick.evaluation import (
    REACH_FLOOR,
    end_work,
    evaluate_pose,
    is_budget_spent,
    least_distance,
    rebuild_candidates,
)
from hhsim.kernels.tick.force import hand_forces
from hhsim.kernels.tick.haptic_input import set_haptic
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
from hhsim.kernels.tick.tick import MOST_FAILED_STEPS, accept, begin_tick, converge, tick_status, update_reach

CLOSE = 20.0
FLOATS = 2.0
"""Contacts up to CLOSE offsets, plus FLOATS times the residual of Γ of the tick before, have rows of friction."""
SEARCHED = 2
"""Programs of a tick in which Γ and directions are sought; in the later ones they stand."""


class Free(NamedTuple):
    """Method that solves hand and free object together.

    | field | meaning |
    |---|---|
    | options | of a tick |
    | support | parts of the object that can stand on a table |
    | states | of each hand; the first one, which a tick is given, has the object's fields |
    """

    options: TickOptions
    support: Support
    states: States


class FreeOfTwo(NamedTuple):
    """Method that solves two hands and a free object together; fields as those of `Free`, and the second hand."""

    options: TickOptions
    support: Support
    states: States
    second: HandArrays


@generic
def _hand_at(method: Any, hand: HandArrays, h: int) -> HandArrays:
    """Return the arrays of the h-th hand, of which `hand` is the first."""


@_hand_at.of(Free)
@jit_inline
def _only_hand(method: Free, hand: HandArrays, h: int) -> HandArrays:
    return hand


@_hand_at.of(FreeOfTwo)
@jit_inline
def _hand_of_two(method: FreeOfTwo, hand: HandArrays, h: int) -> HandArrays:
    return hand if h == 0 else method.second


@jit
def _see_haptic(hand: HandArrays, body: Record, state: Record) -> None:
    haptic = state.haptic
    see_hand(body, state.palm_position[:], state.palm_orientation[:], haptic.position[:], haptic.orientation[:])
    update_kinematics(hand, haptic)


@jit
def _aim(state: Record, body: Record, target_out: Array, abduction_out: Array) -> None:
    haptic = state.haptic
    see_hand(body, state.palm_position[:], state.palm_orientation[:], haptic.position[:], haptic.orientation[:])
    step_to_haptic(state, target_out, abduction_out)


@jit
def _find_contacts(hand: HandArrays, method: Any, surface: Any, state: Record) -> int:
    """Find each hand's contacts, and say which rows they have; returns how many are kept, -1 where they do not fit.

    Those of a second hand are written behind the rows of the first one's joint limits, too.
    """
    problem, joined = state.free_problem, state.contacts
    row, kept = as_int64(0), as_int64(0)
    for h in range(problem.first.shape[0]):
        each, arrays = method.states[h], _hand_at(method, hand, h)
        contacts = each.contacts
        if not find_program_contacts(arrays, surface, method.options, each):
            return as_int64(-1)
        each.found = contacts.start[FINGER_COUNT + 1]
        reach = min(each.trust.reach, each.trust.radius)
        drop_redundant_contacts(arrays, reach, contacts, each.open_distance[:])
        count = contacts.start[FINGER_COUNT + 1]
        if row + count > joined.key.shape[0]:
            return as_int64(-1)
        problem.first[h], problem.last[h] = row, row + count
        for i in range(count if h > 0 else 0):
            joined.distance[row + i] = contacts.distance[i]
            joined.body[row + i] = contacts.body[i] + BODY_COUNT * h
            joined.key[row + i] = contacts.key[i] + SECOND_KEYS * h
            for j in range(3):
                joined.point[j, row + i] = contacts.point[j, i]
                joined.normal[j, row + i] = contacts.normal[j, i]
        row += count + LIMIT_ROWS
        kept += count
    return kept


@jit
def _write_hands(hand: HandArrays, method: Any, state: Record) -> None:
    """Write the rows of the hands' contacts and joint limits, but for the object's columns."""
    problem, relaxed, offset = state.free_problem, state.program.is_relaxed, method.options.offset
    build_rows(hand, state.pose, state.contacts, offset, relaxed, problem)
    for h in range(1, problem.first.shape[0]):
        each, first = method.states[h], problem.first[h]
        own = each.problem
        for f in range(FINGER_COUNT):
            own.abduction_step[f] = problem.abduction_step[FINGER_COUNT * h + f]
        build_rows(_hand_at(method, hand, h), each.pose, each.contacts, offset, relaxed, own)
        for i in range(problem.last[h] - first + LIMIT_ROWS):
            for j in range(6):
                problem.common[12 * h + j, first + i] = own.common[j, i]
            for j in range(PHALANX_COUNT):
                problem.block[j, first + i] = own.block[j, i]
            problem.rhs[first + i] = own.rhs[i]


@jit_once
def _prepare(hand: HandArrays, method: Any, surface: Any, state: Record) -> int:
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
    total = _find_contacts(hand, method, surface, state)
    if total < 0:
        return -1
    body_target(body, problem.body_target[:])
    body.clipped[:] = 0.0
    for h in range(problem.first.shape[0]):
        each, target = method.states[h], problem.hand_target[DOF * h : DOF * h + DOF]
        _aim(each, body, target, problem.abduction_step[FINGER_COUNT * h : FINGER_COUNT * h + FINGER_COUNT])
        for f in range(FINGER_COUNT):
            if each.contacts.start[f + 2] == each.contacts.start[f + 1]:
                clamp_to_limits(_hand_at(method, hand, h), each.pose, f, target)
    _write_hands(hand, method, state)
    object_columns(body, contacts, problem)
    # A contact floats by what Γ was short of its slip, and goes on rubbing.
    close = CLOSE * options.offset + FLOATS * state.borne.residual
    find_frictions(body, contacts, problem, method.support, options.margin, close, problem.body_target[:], friction)
    if state.work[WORK_LINEARISATIONS] == 0:
        step, abduction = problem.before[:], problem.before_abduction[:]
    else:
        step, abduction = problem.total[:], problem.abduction_total[:]
    # Directions that went on turning would give each program another one, and the tick no end.
    turns = as_bool(state.work[WORK_LINEARISATIONS] < SEARCHED)
    begin_frictions(method.states, body, step, abduction, problem, state.held, turns, friction)
    scale_target(body, problem)
    count = total + friction.count - friction.of_hand
    for h in range(problem.first.shape[0]):
        each = method.states[h]
        count_linearisation(_hand_at(method, hand, h), surface, options, each.found, count, each)
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return count


@jit
def _solve(method: Any, count: int, clipped: bool, state: Record, qp: QpWork) -> int:
    problem = state.free_problem
    if count == 0:
        for h in range(problem.first.shape[0]):
            fingers = own_columns(problem, BODY_COUNT * h)
            for j in range(6):
                problem.delta[12 * h + j] = problem.hand_target[DOF * h + j]
            for j in range(6, DOF):
                problem.delta[fingers - 6 + j] = problem.hand_target[DOF * h + j]
        for j in range(6):
            problem.delta[6 + j] = problem.body_target[j]
        state.loaded.count = 0
        problem.gamma_error = 0.0
        take_steps(method.states, state.body, problem)
        return OPTIMAL
    return _solve_rows(method, clipped, state, qp)


@jit
def _solve_rows(method: Any, clipped: bool, state: Record, qp: QpWork) -> int:
    began = monotonic_ns()
    rounds = as_int64(1)
    if state.work[WORK_LINEARISATIONS] <= SEARCHED and not clipped:
        rounds = begin_search(state.coulomb)
    status = solve_free(method.options, method.states, rounds, clipped, state, qp)
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    return status


@jit
def _take_back(method: Any, state: Record) -> None:
    """Return to the last poses without penetration."""
    for h in range(state.free_problem.first.shape[0]):
        take_back(method.states[h])
        method.states[h].progress.failed_steps = 0
    take_body_back(state.body)
    copy_values(state.body_safe_total[:], state.free_problem.total[:])
    copy_values(state.body_safe_abduction[:], state.free_problem.abduction_total[:])


@jit
def _measure(hand: HandArrays, method: Any, surface: Any, state: Record) -> bool:
    """Compute the distances of each hand; False where its pairs do not fit into the arrays."""
    fits = True
    for h in range(state.free_problem.first.shape[0]):
        fits = evaluate_pose(_hand_at(method, hand, h), surface, method.options, method.states[h]) and fits
    state.progress.pairs_overflow = not fits
    return fits


@jit
def _retry(hand: HandArrays, method: Any, surface: Any, state: Record) -> bool:
    """Return to the last poses without penetration with a smaller trust radius; False where the pairs do not fit."""
    _take_back(method, state)
    for h in range(state.free_problem.first.shape[0]):
        method.states[h].trust.radius *= TRUST_DECAY
    return _measure(hand, method, surface, state)


@recover.of(Free)
@recover.of(FreeOfTwo)
@jit
def _recover(method: Any, hand: HandArrays, surface: Any, state: Record) -> bool:
    if not state.program.is_relaxed:
        state.program.is_relaxed = True
        return True
    if state.progress.failed_steps > 0:
        return _retry(hand, method, surface, state)
    if not state.program.holds_abduction:
        for h in range(state.free_problem.first.shape[0]):
            method.states[h].program.holds_abduction = True
        return True
    return False


@jit
def _allowed(hand: HandArrays, method: Any, state: Record) -> tuple[float, float]:
    """Compute the share of the step that all pairs at hand vouch for, and how far the farthest hand goes in it [m]."""
    problem, fraction, longest = state.free_problem, 1.0, 0.0
    for h in range(problem.first.shape[0]):
        each = method.states[h]
        for f in range(FINGER_COUNT):
            each.problem.abduction_step[f] = problem.abduction_step[FINGER_COUNT * h + f]
        share, motion = allowed_fraction(_hand_at(method, hand, h), method.options, each)
        each.longest = motion
        fraction, longest = min(fraction, share), max(longest, motion)
    return fraction, longest


@jit_once
def _clip_target(hand: HandArrays, method: Any, only_restore: bool, state: Record) -> float:
    """Bring a far target nearer, see `kernels.tick.step_length.clip_target`.

    The motions of hands and object are shortened alike: a hand that was short of its motion past the object alone would
    be carried along by it, for no force, and its springs drawn out by nobody. The targets are moved by what is taken
    off, so that springs and inertia pull as they did.
    """
    problem = state.free_problem
    fraction, longest = _allowed(hand, method, state)
    if only_restore:
        fraction = 0.0
    elif fraction >= 0.5:
        return WHOLE_TARGET
    off = 1.0 - fraction
    for h in range(problem.first.shape[0]):
        fingers = own_columns(problem, BODY_COUNT * h)
        for j in range(6):
            problem.hand_target[DOF * h + j] -= off * problem.delta[12 * h + j]
        for j in range(6, DOF):
            problem.hand_target[DOF * h + j] -= off * problem.delta[fingers - 6 + j]
    for j in range(6):
        state.body.clipped[j] = off * problem.delta[6 + j]
        problem.body_target[j] -= state.body.clipped[j]
    for f in range(problem.abduction_step.shape[0]):
        problem.abduction_step[f] *= fraction
    _write_hands(hand, method, state)
    scale_target(state.body, problem)
    clip_shifts(fraction, state.friction)
    return longest


@solve_linearisation.of(Free)
@solve_linearisation.of(FreeOfTwo)
@jit
def _solve_linearisation(
    method: Any, hand: HandArrays, surface: Any, done: int, state: Record, qp: QpWork
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
def _table(method: Any, state: Record) -> tuple[float, int]:
    if state.body.has_table == 0:
        return np.inf, as_int64(-1)
    return table_distances(state.body, method.support)


@jit_once
def _move_all(hand: HandArrays, method: Any, fraction: float, state: Record) -> None:
    """Make a share of the step of hands and object, and find what bears it."""
    problem, body, states = state.free_problem, state.body, method.states
    for j in range(problem.total.shape[0]):
        problem.total[j] += fraction * problem.delta[j]
    for f in range(problem.abduction_total.shape[0]):
        problem.abduction_total[f] += fraction * problem.abduction_step[f]
    find_borne(states, body, state.contacts, problem, state.friction, state.loaded, state.tried)
    # What comes next in the tick is added to it in the frame of the object as it then stands.
    for part in range(problem.common.shape[0] // 3 - 1):
        # Both parts of a palm's step, and the way of the object's centre.
        first = 3 * part if part < 3 else 3 * part + 3
        turn_back(body, problem.delta[6:12], fraction, problem.total[first : first + 3])
    if 0.0 < fraction < 1.0:
        # Part of the way that hand and object make, which is no part of the straight way between their ends.
        for j in range(problem.common.shape[0]):
            problem.whole[j] = fraction * problem.delta[j]
    for h in range(problem.first.shape[0]):
        each, step = states[h], states[h].step
        if 0.0 < fraction < 1.0:
            palm = problem.whole[12 * h : 12 * h + 6]
            as_object_moves(body, each.pose.position[:], palm, problem.whole[6:12], step.delta[0:6])
            for j in range(6):
                step.delta[j] /= fraction
        move(each.pose, step.delta, each.problem.abduction_step, fraction)
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
@advance.of(FreeOfTwo)
@jit
def _advance(method: Any, hand: HandArrays, surface: Any, full_motion: float, state: Record) -> bool:
    """Make the step as far as the pairs at hand vouch for, and judge it by the true distances and the table's."""
    began = monotonic_ns()
    options, problem, progress, hands = method.options, state.free_problem, state.progress, method.states
    for h in range(problem.first.shape[0]):
        for f in range(FINGER_COUNT):
            clamp_to_limits(_hand_at(method, hand, h), hands[h].pose, f, hands[h].step.delta[:])
    fraction, longest = _allowed(hand, method, state)
    _move_all(hand, method, fraction, state)
    least = np.inf
    for h in range(problem.first.shape[0]):
        motion = hands[h].longest
        foreseen = max(REACH_FLOOR * options.step_tolerance, motion)
        update_reach(options, fraction, motion, full_motion, foreseen, hands[h])
    fits = _measure(hand, method, surface, state)
    for h in range(problem.first.shape[0]):
        least = min(least, least_distance(hands[h]))
    table, lowest = _table(method, state)
    if table < 0.0:
        keep_entry(lowest, state.friction)
    done = False
    if not fits:
        progress.lag = max(full_motion, longest) - fraction * longest
        done = True
    elif least >= 0.0 and table >= 0.0:
        _keep(table, state)
        done = True
        for h in range(problem.first.shape[0]):
            done = accept(options, fraction, hands[h].longest, full_motion, hands[h]) and done
    else:
        # Were this the tick's last step it would be taken back, and nothing of it made.
        progress.failed_steps += 1
        for h in range(problem.first.shape[0]):
            hands[h].progress.failed_steps = progress.failed_steps
            hands[h].progress.lag = max(full_motion, longest)
        if progress.failed_steps > MOST_FAILED_STEPS:
            done = not _retry(hand, method, surface, state)
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return done


@finish_tick.of(Free)
@finish_tick.of(FreeOfTwo)
@jit
def _finish_tick(method: Any, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
    """Return to the last poses without penetration, take the velocities and the forces; returns status bits."""
    began = monotonic_ns()
    options, progress, borne, hands = method.options, state.progress, state.borne, method.states
    cut_short, pairs_overflow = is_budget_spent(options, state), progress.pairs_overflow
    if progress.failed_steps > 0 or pairs_overflow:
        _take_back(method, state)
        pairs_overflow = not _measure(hand, method, surface, state) or pairs_overflow
    for h in range(state.free_problem.first.shape[0]):
        each = hands[h]
        _see_haptic(_hand_at(method, hand, h), state.body, each)
        each.status = tick_status(cut_short, as_bool(False), each)
        if pairs_overflow:
            each.status |= STATUS_CAPACITY_EXCEEDED
    if progress.is_accepted:
        take_velocity(state.body)
    else:
        borne.count = 0
        borne.residual = 0.0
        borne.bare = 0.0
        borne.hand_wrench[:] = 0.0
        borne.table_wrench[:] = 0.0
    detected = monotonic_ns()
    for h in range(state.free_problem.first.shape[0]):
        each = hands[h]
        if not progress.is_accepted:
            each.active.count = 0
        _, each.work[WORK_TOUCHING] = pairs_near(surface, _hand_at(method, hand, h), each.candidates, options.touch)
        detected = monotonic_ns()
        turn_loads(state.body, each.active)
        hand_forces(options, each)
        if h > 0:
            # The program is one: its work is that of both.
            each.step.iterations = state.step.iterations
            copy_values(state.step.duration[:], each.step.duration[:])
        end_work(each)
    state.step.duration[DURATION_DETECT] += detected - began
    state.step.duration[DURATION_FORCE] += monotonic_ns() - detected
    return state.status


@may_end.of(Free)
@may_end.of(FreeOfTwo)
@jit
def _may_end(method: Any, state: Record) -> bool:
    # Where nothing is accepted yet the object would stop in the air: it goes on.
    return state.progress.is_accepted


@tick.of(Free)
@tick.of(FreeOfTwo)
@jit
def _tick(method: Any, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
    """Take the user's hands, which are the world's, and converge; they are then as the object sees them."""
    for h in range(state.free_problem.first.shape[0]):
        each = method.states[h]
        if each.input.is_valid:
            copy_values(each.haptic.position[:], each.palm_position[:])
            copy_values(each.haptic.orientation[:], each.palm_orientation[:])
    return converge(method, hand, surface, state, qp)


@begin_motion.of(Free)
@begin_motion.of(FreeOfTwo)
@jit
def _begin_motion(method: Any, hand: HandArrays, surface: Any, state: Record) -> None:
    """Let the object go on by its velocity and its weight."""
    problem = state.free_problem
    for h in range(1, problem.first.shape[0]):
        begin_tick(method.options, method.states[h])
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
def rebuild(hand: HandArrays, method: Any, surface: Any, states: States) -> bool:
    """Take the poses of hands and object as they now stand, in the object's frame; returns whether the pairs fit."""
    state, fits = states[0], True
    state.table_distance, _ = _table(method, state)
    for h in range(state.free_problem.first.shape[0]):
        fits = rebuild_candidates(_hand_at(method, hand, h), surface, method.options, states[h : h + 1]) and fits
    return fits


@jit
def run_two_hands(
    method: FreeOfTwo,
    hand: HandArrays,
    surface: Any,
    states: States,
    qp: QpWork,
    haptic: tuple[HapticBlock, HapticBlock],
    record: tuple[TickRecord, TickRecord],
    object_record: Any,
) -> int:
    """Run one tick of two hands for each row of their haptic inputs, as `kernels.tick.block.run_block` does of one."""
    state = states[0]
    for i in range(haptic[0].position.shape[0]):
        cpu = thread_cpu_ns()
        wall = monotonic_ns()
        for h in range(2):
            arrays, given = _hand_at(method, hand, h), haptic[h]
            states[h].taken = set_haptic(
                arrays, given.position[i], given.orientation[i], given.flexion[i], given.abduction[i], states[h]
            )
        tick(method, hand, surface, state, qp)
        wall = monotonic_ns() - wall
        cpu = thread_cpu_ns() - cpu
        for h in range(2):
            record_tick(states[h], states[h].taken | states[h].status, wall, cpu, i, record[h])
        record_object(object_record, state, i)
        if state.status & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return haptic[0].position.shape[0]
