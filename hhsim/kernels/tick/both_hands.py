"""Ticks of two hands that keep out of each other, on an object that stands still or moves as recorded.

Each hand's tick is the one that it has alone, on where both began. Only where these two ways might have met are both
taken back, and the tick is one program of both hands' 42 variables: the rows of each, and those of pairs of their
bodies. It goes the round of `kernels.tick.tick`: both make the same share of a step, a step of which the object or the
other hand would be entered is taken back, and what is shown is the last pose of both that was free. Rows of pairs are
those that the step would break, added until it breaks none.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.contact.detection import find_contacts, pairs_near
from hhsim.kernels.contact.hand_pairs import (
    HAND_PAIRS,
    HAND_ROWS,
    add_broken_pairs,
    add_hand_row,
    bound_motions,
    clear_share,
    hands_nearest,
    look_at_pairs,
    part_of,
    row_rest,
)
from hhsim.kernels.contact.linearise import LIMIT_ROWS, ROW_CAPACITY, build_rows, clamp_to_limits
from hhsim.kernels.contact.redundant_contacts import drop_redundant_contacts
from hhsim.kernels.contact.self_pairs import BROKEN, SELF_ROWS, add_rows, begin_rows, foresee_rows, scale_rows
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.hand.pose import copy_configuration, move, update_kinematics
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit, jit_noinline
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork, solve
from hhsim.kernels.qp.row_scan import WideRows
from hhsim.kernels.rotation import rotation_vector_between
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_tick
from hhsim.kernels.tick.evaluation import (
    REACH_FLOOR,
    end_work,
    evaluate_pose,
    is_budget_spent,
    least_distance,
    spent_units,
)
from hhsim.kernels.tick.force import FORCE_PAPER, hand_forces
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.linearisation import count_linearisation, find_program_contacts, step_to_haptic
from hhsim.kernels.tick.method import OVERFLOW, recover, tick
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.restoration import TRUST_DECAY, only_restores, take_back
from hhsim.kernels.tick.settled_forces import ON_THE_WAY
from hhsim.kernels.tick.state import (
    STATUS_CAPACITY_EXCEEDED,
    STATUS_INPUT_INVALID,
    STATUS_LAG,
    STATUS_NO_PLACE,
    WORK_ROWS,
    WORK_TOUCHING,
    WORK_UNITS,
)
from hhsim.kernels.tick.step import (
    ACTIVE_CAPACITY,
    DURATION_DETECT,
    DURATION_FORCE,
    DURATION_PALM,
    copy_active,
    guess_rows,
    store_active,
    store_meeting,
)
from hhsim.kernels.tick.step_length import CLEAR, LEAST_SHARE, WHOLE_TARGET, allowed_fraction
from hhsim.kernels.tick.tick import MOST_FAILED_STEPS, accept, begin_tick, tick_status, update_reach

BOTH_DOF = 2 * DOF
BOTH_ROWS = 2 * (ROW_CAPACITY + SELF_ROWS) + HAND_ROWS
ROUNDS = 12
"""Most programs of a linearisation, each with the rows that the step of the one before would break."""
UNITS_ROUND = 25_000
"""Work units of one of these: of looking at the pairs, and of rows of both hands."""
DEEP = 1e-3
"""Hands that parts have pushed deeper into each other than this [m] are parted along the line of their palms, whatever
is deeper meanwhile: there the normals of their pairs contradict each other."""
OTHER_HAND = 1 << 62
"""Key of a force of the other hand among a hand's active contacts: no contact has it, and no guess takes it for one."""

BOTH_HANDS = np.dtype(
    [
        ("common", np.float64, (BOTH_DOF, BOTH_ROWS)),  # columns of all rows, divided by √G
        ("block", np.float64, (3, 1)),  # none
        ("rhs", np.float64, (BOTH_ROWS,)),  # [m], [rad] for joint limits
        ("target", np.float64, (BOTH_DOF,)),  # √G δ*
        ("start", np.int64, (1,)),  # the rows are one group
        ("stop", np.int64, (1,)),
        ("group", np.int64, (1,)),
        ("base", np.int64, (3,)),  # first row of each hand, and of their pairs
        ("guess", np.int64, (2 * ACTIVE_CAPACITY + HAND_ROWS,)),
        ("failed", np.int64),  # steps in a row that ended inside
        ("held", np.float64),  # distance that steps keep [m]: 0, or less where parts have pushed a hand into the other
        ("longest", np.float64, (2,)),  # motion of each hand in the step [m]
        ("is_near", np.bool_),  # the next tick begins as one of both
        ("status", np.int64, (2,)),  # status bits of each hand's tick
        ("pairs", HAND_PAIRS),
    ],
    align=True,
)
"""Program of two hands, and what is kept from tick to tick."""


@jit
def _aim(hands: Any, options: Any, share: float, stands: bool, states: Any, both: Record) -> None:
    """Write each hand's rows and target, a share of the step to the user's hand; its abduction, none if it `stands`.

    Hands deep in each other go apart instead.
    """
    first, second = states[0][0].pose.position, states[1][0].pose.position
    between = math.sqrt((first[0] - second[0]) ** 2 + (first[1] - second[1]) ** 2 + (first[2] - second[2]) ** 2)
    for h in range(2):
        state = states[h][0]
        problem, relaxed, offset = state.problem, state.program.is_relaxed, options[h].offset
        step_to_haptic(state, problem.target[:], problem.abduction_step[:])
        if both.held < -DEEP:
            for j in range(DOF):
                problem.target[j] = 0.0
            for j in range(3):
                away = first[j] - second[j] if h == 0 else second[j] - first[j]
                problem.target[j] = -0.5 * both.held * away / max(between, DEEP)
        for f in range(FINGER_COUNT):
            problem.abduction_step[f] *= 0.0 if stands or both.held < -DEEP else share * state.self_contact.share[f]
        build_rows(hands[h], state.pose, state.contacts, offset, relaxed, problem)
        scale_rows(options[h].own, offset, relaxed, state)
        for j in range(DOF):
            problem.target[j] *= share / problem.inverse_root[j]


@jit
def _pack(offset: float, states: Any, both: Record) -> None:
    """Write the rows and targets of both hands, and the rows of their pairs, as those of one program."""
    common, rhs, pairs, row = both.common, both.rhs, both.pairs, as_int64(0)
    for h in range(2):
        state, first = states[h][0], DOF * h
        problem, start, own = state.problem, state.contacts.start, state.self_contact
        contacts, both.base[h] = start[FINGER_COUNT + 1], row
        count = contacts + LIMIT_ROWS + own.count
        for i in range(count):
            for j in range(BOTH_DOF):
                common[j, row + i] = 0.0
            rhs[row + i] = problem.rhs[i]
            if i >= contacts + LIMIT_ROWS:
                for j in range(DOF):
                    common[first + j, row + i] = own.dense[i - contacts - LIMIT_ROWS, j]
                continue
            for j in range(6 if i < contacts else 0):
                common[first + j, row + i] = problem.common[j, i]
        for f in range(FINGER_COUNT):
            for k in range(PHALANX_COUNT):
                column = first + 6 + PHALANX_COUNT * f + k
                for i in range(start[f + 1], start[f + 2]):
                    common[column, row + i] = problem.block[k, i]
                for i in range(contacts + 2 * PHALANX_COUNT * f, contacts + 2 * PHALANX_COUNT * (f + 1)):
                    common[column, row + i] = problem.block[k, i]
        for j in range(DOF):
            both.target[first + j] = problem.target[j]
        row += count
    both.base[2] = row
    for i in range(pairs.count):
        rhs[row + i] = row_rest(offset, states, as_int64(i), pairs)
        for h in range(2):
            weight = states[h][0].problem.inverse_root
            for j in range(DOF):
                common[DOF * h + j, row + i] = pairs.gradient[i, DOF * h + j] * weight[j]
    both.start[0], both.stop[0], both.group[0] = 0, row + pairs.count, -1


@jit
def _guess_active(states: Any, both: Record) -> int:
    """Guess the rows that a solution of before had active; returns their number."""
    pairs, guess, filled = both.pairs, both.guess, as_int64(0)
    for h in range(2):
        step = states[h][0].step
        for i in range(step.count):
            guess[filled] = both.base[h] + step.row[i]
            filled += 1
    for i in range(pairs.count):
        if pairs.multiplier[i] > 0.0:
            guess[filled] = both.base[2] + i
            filled += 1
    return filled


@jit_noinline
def _solve_both(options: TickOptions, states: Any, both: Record, qp: QpWork) -> int:
    """Solve the program at hand into each hand's step and the multipliers of the pairs; returns a status."""
    pairs = both.pairs
    rows = WideRows(
        as_int64(BOTH_DOF), both.common[:], both.block[:], both.rhs[:], both.start[:], both.stop[:], both.group[:]
    )
    target, guess, guessed = both.target[:], both.guess[:], _guess_active(states, both)
    status = solve(as_int64(BOTH_DOF), rows, target, options.tolerance, options.relaxation, guess, guessed, qp)
    states[0][0].step.iterations += qp.counts[1]
    if status != OPTIMAL:
        return status
    for i in range(pairs.count):
        pairs.multiplier[i] = 0.0
    for h in range(2):
        step, weight = states[h][0].step, states[h][0].problem.inverse_root
        step.count = 0
        for j in range(DOF):
            step.delta[j] = qp.x[DOF * h + j] * weight[j]
    for i in range(qp.counts[0]):
        row = qp.active[i]
        if row >= both.base[2]:
            pairs.multiplier[row - both.base[2]] += qp.multiplier[i]
            continue
        h = 1 if row >= both.base[1] else 0
        step = states[h][0].step
        step.row[step.count], step.multiplier[step.count] = row - both.base[h], qp.multiplier[i]
        step.count += 1
    return status


@jit_noinline
def _solve(
    hands: Any, options: Any, share: float, within: float, stands: bool, states: Any, both: Record, qp: QpWork
) -> int:
    """Solve with rows, as of `_aim`, for all pairs nearer than `within` [m] that the step would bring together."""
    offset, began, status = options[0].offset, monotonic_ns(), as_int64(OPTIMAL)
    for _ in range(ROUNDS):
        _aim(hands, options, share, stands, states, both)
        _pack(offset, states, both)
        status = _solve_both(options[0], states, both, qp)
        if status != OPTIMAL:
            break
        bound_motions(hands, states, both.pairs)
        look_at_pairs(hands, states, offset, within, offset, both.pairs)
        added = both.held >= -DEEP and add_broken_pairs(hands, states, offset, both.pairs)
        for h in range(2):
            work, own = states[h][0].work, states[h][0].self_contact.count
            rows = states[h][0].contacts.start[FINGER_COUNT + 1] + own + both.pairs.count
            work[WORK_UNITS] += UNITS_ROUND
            work[WORK_ROWS] = max(work[WORK_ROWS], rows)
        for h in range(2):
            if not stands:
                added = add_rows(options[h].own, hands[h], BROKEN, options[h], states[h][0]) or added
        if not added:
            break
    states[0][0].step.duration[DURATION_PALM] += monotonic_ns() - began
    return status


@jit_noinline
def _find_rows(hands: Any, options: Any, surfaces: Any, states: Any, both: Record) -> bool:
    """Find each hand's contacts, and foresee what was active in the last program; False where they do not fit."""
    pairs, began = both.pairs, monotonic_ns()
    for h in range(2):
        state = states[h][0]
        begin_rows(state.self_contact)
        if not find_program_contacts(hands[h], surfaces[h], options[h], state):
            return False
        found = state.contacts.start[FINGER_COUNT + 1]
        reach = min(state.trust.reach, state.trust.radius)
        drop_redundant_contacts(hands[h], reach, state.contacts, state.open_distance[:])
        count_linearisation(hands[h], surfaces[h], options[h], found, state.contacts.start[FINGER_COUNT + 1], state)
        step_to_haptic(state, state.problem.target[:], state.problem.abduction_step[:])
        foresee_rows(options[h].own, hands[h], state.warm, options[h], state)
        state.step.count = 0
        for group in range(FINGER_COUNT + 1):
            state.step.count = guess_rows(state.contacts, state.warm, group, state.step.row[:], state.step.count)
    held, pairs.count = pairs.count, 0
    for i in range(held):
        if pairs.multiplier[i] > 0.0 and both.held >= -DEEP:
            add_hand_row(hands, states, pairs.body[i, 0], pairs.body[i, 1], pairs.multiplier[i], pairs)
    states[0][0].step.duration[DURATION_DETECT] += monotonic_ns() - began
    return True


@jit
def _allowed(hands: Any, options: Any, states: Any, both: Record) -> float:
    """Return the share of the step that all pairs vouch for; each hand's motion in the step is then in `longest`."""
    fraction = clear_share(min(states[0][0].trust.radius, states[1][0].trust.radius), both.pairs)
    for h in range(2):
        share, both.longest[h] = allowed_fraction(hands[h], options[h], states[h][0])
        fraction = min(fraction, share)
    return fraction


@jit
def _solve_linearisation(
    hands: Any, options: Any, surfaces: Any, done: int, states: Any, both: Record, qp: QpWork
) -> tuple[int, float]:
    """Build and solve a program, with a nearer target if it is cut short; returns as `kernels.tick.method` says."""
    full_motion = WHOLE_TARGET
    if not _find_rows(hands, options, surfaces, states, both):
        return as_int64(OVERFLOW), full_motion
    status = _solve(hands, options, 1.0, options[0].margin, as_bool(False), states, both, qp)
    if status != OPTIMAL:
        return status, full_motion
    fraction, least = _allowed(hands, options, states, both), both.pairs.least
    for h in range(2):
        least = min(least, least_distance(states[h][0]))
    if only_restores(options[0], states[0][0], done):
        fraction = 0.0
    elif fraction >= (LEAST_SHARE if least >= CLEAR * options[0].offset else 0.5):
        return status, full_motion
    full_motion = max(both.longest[0], both.longest[1])
    return _solve(hands, options, fraction, options[0].margin, as_bool(False), states, both, qp), full_motion


@jit
def _store(hands: Any, options: Any, states: Any, both: Record) -> None:
    """Remember the contacts that carry the step's multipliers, and the forces of the other hand."""
    pairs = both.pairs
    for h in range(2):
        state = states[h][0]
        warm = state.warm
        store_active(state.contacts, state.step, warm)
        store_meeting(options[h].own, state, warm)
        for i in range(pairs.count):
            if pairs.multiplier[i] == 0.0 or warm.count == ACTIVE_CAPACITY:
                continue
            last = warm.count
            warm.key[last], warm.body[last] = OTHER_HAND, part_of(pairs.body[i, h])
            warm.multiplier[last] = pairs.multiplier[i]
            for j in range(3):
                warm.normal[j, last] = pairs.normal[i, j] if h == 0 else -pairs.normal[i, j]
                warm.point[j, last] = 0.0
            warm.count += 1


@jit
def _measure_hands(hands: Any, options: Any, surfaces: Any, states: Any) -> bool:
    """Compute the distances of each hand to the object; False where its pairs do not fit into the arrays."""
    fits = True
    for h in range(2):
        fits = evaluate_pose(hands[h], surfaces[h], options[h], states[h][0]) and fits
    return fits


@jit
def _return_to_safe(hands: Any, options: Any, surfaces: Any, states: Any, both: Record) -> bool:
    """Return to the last poses without penetration; False where the pairs do not fit into the arrays."""
    for h in range(2):
        take_back(states[h][0])
        states[h][0].progress.failed_steps = 0
    both.failed = 0
    return _measure_hands(hands, options, surfaces, states)


@jit
def _recover(methods: Any, hands: Any, surfaces: Any, states: Any) -> bool:
    """Make the next program easier, that of a hand that has not moved by what is left to it; False for nothing."""
    eased = False
    for h in range(2):
        eased = recover(methods[h], hands[h], surfaces[h], states[h][0]) or eased
    return eased


@jit_noinline
def _advance(hands: Any, options: Any, surfaces: Any, full_motion: float, states: Any, both: Record) -> bool:
    """Make the step as far as the pairs at hand vouch for, and judge it by the true distances."""
    began, tolerance = monotonic_ns(), options[0].step_tolerance
    _store(hands, options, states, both)
    for h in range(2):
        for f in range(FINGER_COUNT):
            clamp_to_limits(hands[h], states[h][0].pose, f, states[h][0].step.delta[:])
    fraction = _allowed(hands, options, states, both)
    longest = max(both.longest[0], both.longest[1])
    for h in range(2):
        state, motion = states[h][0], both.longest[h]
        move(state.pose, state.step.delta, state.problem.abduction_step, fraction)
        foreseen = REACH_FLOOR * max(tolerance, motion)
        update_reach(options[h], fraction, motion, full_motion, foreseen, state)
    fits, done = _measure_hands(hands, options, surfaces, states), True
    apart = hands_nearest(hands, states, options[0].margin, both.pairs)
    beyond = apart - both.held if both.held >= -DEEP else 0.0
    if fits and min(beyond, least_distance(states[0][0]), least_distance(states[1][0])) >= 0.0:
        both.failed, both.is_near, both.held = 0, apart < np.inf, min(apart, 0.0)
        for h in range(2):
            done = accept(options[h], fraction, both.longest[h], full_motion, states[h][0]) and done
        if both.pairs.count > 0 and longest > tolerance:
            done = False
        for h in range(2):
            # Neither has arrived before both have.
            if not done and states[h][0].progress.lag == 0.0:
                states[h][0].progress.lag = longest
    elif fits:
        both.failed += 1
        for h in range(2):
            states[h][0].progress.failed_steps = both.failed
            states[h][0].progress.lag = max(full_motion, longest)
        done = False
        if both.failed > MOST_FAILED_STEPS:
            for h in range(2):
                states[h][0].trust.radius *= TRUST_DECAY
            done = not _return_to_safe(hands, options, surfaces, states, both)
    states[0][0].step.duration[DURATION_DETECT] += monotonic_ns() - began
    return done


@jit_noinline
def _settle_forces(hands: Any, options: Any, surfaces: Any, states: Any, both: Record, qp: QpWork) -> None:
    """Compute the multipliers of what touches where the hands are shown, see `kernels.tick.settled_forces`."""
    near = max(options[0].touch, ON_THE_WAY * options[0].offset)
    both.pairs.count = 0
    for h in range(2):
        state = states[h][0]
        if find_contacts(surfaces[h], hands[h], state.pose, state.candidates, near, state.contacts) != 0:
            return
        begin_rows(state.self_contact)
        add_rows(options[h].own, hands[h], near, options[h], state)
        state.program.is_relaxed = True
        state.step.count = 0
    if _solve(hands, options, 1.0, near, as_bool(True), states, both, qp) == OPTIMAL:
        _store(hands, options, states, both)
        for h in range(2):
            copy_active(states[h][0].warm, states[h][0].active)


@jit_noinline
def _finish(hands: Any, options: Any, surfaces: Any, states: Any, both: Record, qp: QpWork) -> None:
    """Return to the last poses without penetration, and compute the forces; the status bits are in `both`."""
    began, first, second = monotonic_ns(), states[0][0], states[1][0]
    cut_short = is_budget_spent(options[0], first) or is_budget_spent(options[1], second)
    overflow = first.progress.pairs_overflow or second.progress.pairs_overflow
    if first.progress.differs_from_safe or second.progress.differs_from_safe:
        overflow = not _return_to_safe(hands, options, surfaces, states, both) or overflow
    lags = False
    for h in range(2):
        both.status[h] |= tick_status(cut_short, as_bool(False), states[h][0])
        if overflow:
            both.status[h] |= STATUS_CAPACITY_EXCEEDED
        lags = lags or both.status[h] & STATUS_LAG != 0
    detected, relaxed, palm = monotonic_ns(), first.program.is_relaxed, first.step.duration[DURATION_PALM]
    if lags and not overflow and options[0].force_model != FORCE_PAPER:
        _settle_forces(hands, options, surfaces, states, both, qp)
    for h in range(2):
        state = states[h][0]
        state.program.is_relaxed = relaxed
        _, state.work[WORK_TOUCHING] = pairs_near(surfaces[h], hands[h], state.candidates, options[h].touch)
        if options[h].force_model == FORCE_PAPER:
            find_contacts(surfaces[h], hands[h], state.pose, state.candidates, options[h].touch, state.contacts)
        hand_forces(options[h], state)
    first.step.duration[DURATION_DETECT] += detected - began
    first.step.duration[DURATION_FORCE] += monotonic_ns() - detected
    # The programs that settle the forces count as these.
    first.step.duration[DURATION_PALM] = palm
    second.step.iterations = first.step.iterations
    for i in range(second.step.duration.shape[0]):
        second.step.duration[i] = first.step.duration[i]
    for h in range(2):
        end_work(states[h][0])


@jit_noinline
def tick_of_both(methods: Any, hands: Any, options: Any, surfaces: Any, states: Any, both: Record, qp: QpWork) -> None:
    """Bring both graphic hands towards the haptic ones by programs of both; the status bits are in `both`."""
    both.failed, both.is_near = 0, True
    for h in range(2):
        state = states[h][0]
        both.status[h] = 0
        copy_configuration(state.pose, state.prediction.start)
        begin_tick(options[h], state)
        state.prediction.is_predicted = False
    for done in range(options[0].linearisations):
        # Where nothing is accepted yet the rows that were found would have to be found again: it goes on.
        spent = max(spent_units(states[0][0]), spent_units(states[1][0]))
        if spent >= options[0].budget and states[0][0].progress.is_accepted:
            break
        solved, full_motion = _solve_linearisation(hands, options, surfaces, done, states, both, qp)
        if solved == OVERFLOW:
            both.status[0] |= STATUS_CAPACITY_EXCEEDED
            break
        if solved != OPTIMAL:
            if _recover(methods, hands, surfaces, states):
                continue
            break
        if _advance(hands, options, surfaces, full_motion, states, both):
            break
    _finish(hands, options, surfaces, states, both, qp)


@jit
def _step_between(start: Record, pose: Record, step_out: Array, abduction_out: Array, scratch: Array) -> None:
    """Compute the step (21,) and the abduction step (5,) from a pose to the one before it."""
    rotation_vector_between(pose.orientation, start.orientation, scratch)
    for i in range(3):
        step_out[i], step_out[3 + i] = start.position[i] - pose.position[i], scratch[i]
    for f in range(FINGER_COUNT):
        abduction_out[f] = start.abduction[f] - pose.abduction[f]
        for k in range(PHALANX_COUNT):
            step_out[6 + PHALANX_COUNT * f + k] = start.flexion[f, k] - pose.flexion[f, k]


@jit
def _may_have_met(hands: Any, offset: float, states: Any, both: Record) -> bool:
    """Return whether the way of each hand's last tick might have led it nearer than the clearance to the other one."""
    for h in range(2):
        state = states[h][0]
        delta, abduction = state.step.delta[:], state.problem.abduction_step[:]
        _step_between(state.prediction.start, state.pose, delta, abduction, state.scratch[:])
    bound_motions(hands, states, both.pairs)
    look_at_pairs(hands, states, offset, np.inf, np.inf, both.pairs)
    return bool(both.pairs.least < np.inf)


@jit
def find_meeting(hands: Any, offset: float, records: Any, states: Any, both: Record) -> int:
    """Return the first tick of a block in which the hands, each alone, might have met; the number of ticks for none.

    The poses of the states are those before the block; without a meeting they are in the end what they were after it.
    """
    for i in range(records[0].position.shape[0]):
        for h in range(2):
            state, record = states[h][0], records[h]
            copy_configuration(state.pose, state.prediction.start)
            for j in range(3):
                state.pose.position[j] = record.position[i, j]
            for j in range(4):
                state.pose.orientation[j] = record.orientation[i, j]
            for f in range(FINGER_COUNT):
                state.pose.abduction[f] = record.abduction[i, f]
                for k in range(PHALANX_COUNT):
                    state.pose.flexion[f, k] = record.flexion[i, f, k]
            update_kinematics(hands[h], state.pose)
        if _may_have_met(hands, offset, states, both):
            return i
    return int(records[0].position.shape[0])


@jit
def run_hands_apart(
    methods: Any,
    both_methods: Any,
    hands: Any,
    surfaces: Any,
    states: Any,
    qps: Any,
    haptic: tuple[HapticBlock, HapticBlock],
    record: tuple[TickRecord, TickRecord],
    whole: NDArray[np.void],
    both_qp: QpWork,
    parts_move: bool,
) -> int:
    """Run one tick of two hands for each row of their haptic inputs, as `kernels.tick.block.run_block` does of one.

    `methods` are those of each hand alone, `both_methods` of both where parts that may move stand still. Where
    `parts_move` each hand gives way to them by its own tick first. A hand that they leave no place stays there.
    """
    both, options = whole[0], (both_methods[0].options, both_methods[1].options)
    for i in range(haptic[0].position.shape[0]):
        began, cpu = monotonic_ns(), thread_cpu_ns()
        alone = parts_move or not both.is_near
        for h in range(2):
            state, given = states[h][0], haptic[h]
            wall, own_cpu = monotonic_ns(), thread_cpu_ns()
            status = set_haptic(
                hands[h], given.position[i], given.orientation[i], given.flexion[i], given.abduction[i], state
            )
            if alone:
                status |= tick(methods[h], hands[h], surfaces[h], state, qps[h])
                record_tick(state, status, monotonic_ns() - wall, thread_cpu_ns() - own_cpu, i, record[h])
            else:
                record[h].status[i] = status
        said = record[0].status[i] | record[1].status[i]
        if alone and (said & STATUS_NO_PLACE or not _may_have_met(hands, options[0].offset, states, both)):
            if said & STATUS_CAPACITY_EXCEEDED:
                return i + 1
            continue
        if alone:
            for h in range(2):
                copy_configuration(states[h][0].prediction.start, states[h][0].pose)
                record[h].status[i] &= STATUS_INPUT_INVALID
            _measure_hands(hands, options, surfaces, states)
            both.pairs.count = 0
        both.held = min(hands_nearest(hands, states, 0.0, both.pairs), 0.0) if parts_move else 0.0
        tick_of_both(both_methods, hands, options, surfaces, states, both, both_qp)
        if both.held < 0.0:
            both.status[0] |= STATUS_NO_PLACE
            both.status[1] |= STATUS_NO_PLACE
        wall, cpu = monotonic_ns() - began, thread_cpu_ns() - cpu
        for h in range(2):
            record_tick(states[h][0], record[h].status[i] | both.status[h], wall, cpu, i, record[h])
        if (both.status[0] | both.status[1]) & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return int(haptic[0].position.shape[0])
