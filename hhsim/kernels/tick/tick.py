"""One tick: from the last graphic hand and the new haptic hand to the new graphic hand and its forces (paper, Fig. 3).

docs/methods.md ("A tick that cannot penetrate") has its 14 lines, each with the function that does it. In short:
a program, as much of its step as the listed pairs allow, the true distances. By these alone a pose becomes the safe
one, and a tick ends at a safe one.

With ρ the smaller of the trust region's radius and reach, `allowed_fraction` lets body b move by min(slack, ρ) if one
of its pairs is within ρ, else by min(slack, its least distance): pairs that are not listed are farther than the slack.
An unfinished tick leaves three flags to the next: clearance waived, palm and fingers together, abduction held.
"""

from typing import Any

import numpy as np

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.linearise import clamp_to_limits
from hhsim.kernels.contact.self_pairs import choose_bends
from hhsim.kernels.contact.surface_code import SurfaceCode, find_surface_contacts, pairs_near
from hhsim.kernels.hand.kinematics import BODY_COUNT, FINGER_COUNT, HandArrays
from hhsim.kernels.hand.pose import copy_configuration, farthest_joint, move
from hhsim.kernels.jit import Record, as_bool, as_int64, generic, jit, jit_inline
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.decoupling import palm_yielded, stays_suspended, suspend_decoupling
from hhsim.kernels.tick.evaluation import (
    REACH_FLOOR,
    end_work,
    evaluate_pose,
    is_budget_spent,
    least_distance,
    spent_units,
    usual_reach,
)
from hhsim.kernels.tick.force import FORCE_PAPER, hand_forces
from hhsim.kernels.tick.linearisation import add_broken_rows, build_program, complete_lists
from hhsim.kernels.tick.method import (
    OVERFLOW,
    Coupled,
    Progressive,
    advance,
    begin_motion,
    energy_stalled,
    finish_tick,
    may_end,
    recover,
    solve_linearisation,
    solve_program,
    tick,
)
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.prediction import forget_prediction, judge_last_tick
from hhsim.kernels.tick.restoration import LEAST_TRUST, TRUST_DECAY, keep_first_step, only_restores, take_free_share
from hhsim.kernels.tick.second_order import FLAT_PROGRAMS
from hhsim.kernels.tick.settled_forces import settle_forces
from hhsim.kernels.tick.state import (
    STATUS_ABDUCTION_HELD,
    STATUS_CAPACITY_EXCEEDED,
    STATUS_LAG,
    STATUS_SNAP,
    STATUS_STUCK,
    UNITS_ROW,
    WORK_LINEARISATIONS,
    WORK_ROWS,
    WORK_TOUCHING,
    WORK_UNITS,
)
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FORCE, copy_active, store_active, store_meeting
from hhsim.kernels.tick.step_length import WHOLE_TARGET, allowed_fraction, clip_target, keep_bound, set_bound

REACH_GROWTH = 4.0
"""Growth of the reach after a step that it has cut short."""
TRUST_GROWTH = 2.0
"""Growth of the trust radius from one unfinished tick to the next, after a step that was accepted."""
MOST_FAILED_STEPS = 3
"""Steps in a row that may end inside the object before they are taken back."""
MOST_IDLE_TICKS = 10
"""Ticks in a row that may accept no step before those that the budget cuts short count as stuck, too."""


@jit
def _carry_over_trust(options: TickOptions, state: Record) -> None:
    """Adjust the trust radius of an unfinished tick and keep its flags, or begin with the whole margin.

    Else ticks whose work runs out before they accept a step could repeat themselves for ever.
    """
    progress, trust, program = state.progress, state.trust, state.program
    if progress.is_unfinished:
        if progress.is_accepted and progress.failed_steps == 0:
            trust.radius = min(options.margin, TRUST_GROWTH * trust.radius)
        elif progress.failed_steps > 0 and not progress.is_accepted:
            trust.radius *= TRUST_DECAY
    if not progress.is_unfinished or trust.radius < LEAST_TRUST * options.margin:
        progress.is_unfinished = False
        trust.radius = options.margin
        program.is_relaxed = False
        program.holds_abduction = False
        program.is_coupled = state.decoupling.is_suspended


@jit_inline
def begin_tick(options: TickOptions, state: Record) -> None:
    """Reset what belongs to one tick; the present configuration, evaluated and free of penetration, is the safe one."""
    progress = state.progress
    copy_configuration(state.pose, state.safe)
    progress.differs_from_safe = False
    state.decoupling.is_suspended = stays_suspended(options, state)
    _carry_over_trust(options, state)
    state.progressive.variables = 6
    progress.is_accepted = False
    progress.pairs_overflow = False
    progress.failed_steps = progress.restarted = 0
    state.first_step.free_share = 0.0
    state.step.duration[:] = 0
    state.step.iterations = 0
    state.trust.reach = usual_reach(options, state)
    judge_last_tick(state)
    state.work[:] = 0
    progress.path = 0.0
    set_bound(options, state)
    progress.lag = 0.0


@may_end.of(Coupled)
@may_end.of(Progressive)
@jit_inline
def hand_may_end(method: Any, state: Record) -> bool:
    """Return True: `safe` can be shown at any time."""
    return True


@generic
def solve_until_kept(method: Any, hand: HandArrays, has_rows: bool, share: float, state: Record, qp: QpWork) -> int:
    """Solve a program if it has rows, and again with rows of own pairs that its step would break; return a status."""


@solve_until_kept.of(Coupled)
@solve_until_kept.of(Progressive)
@jit
def solve_hand_until_kept(
    method: Any, hand: HandArrays, has_rows: bool, share: float, state: Record, qp: QpWork
) -> int:
    """Solve by a method of a hand alone, see `solve_until_kept`; `share` is that of the step to the user's hand."""
    status = solve_program(method, state, qp) if has_rows else as_int64(OPTIMAL)
    while status == OPTIMAL and add_broken_rows(hand, method.options, share, state):
        status = solve_program(method, state, qp)
    return as_int64(status)


@solve_linearisation.of(Coupled)
@solve_linearisation.of(Progressive)
@jit_inline
def solve_hand(
    method: Any, hand: HandArrays, surface: SurfaceCode, done: int, state: Record, qp: QpWork
) -> tuple[int, float]:
    """Build and solve a program; anew if its step needs longer lists, and with a nearer target if it is cut short."""
    options, work = method.options, state.work
    units, status, full_motion = work[WORK_UNITS], as_int64(OPTIMAL), WHOLE_TARGET
    contacts = as_int64(0)
    choose_bends(options.own.pairs, as_bool(done >= FLAT_PROGRAMS), hand, state.pose, state.self_contact)
    for attempt in range(2):
        contacts = build_program(hand, surface, options, state)
        if contacts < 0:
            return as_int64(OVERFLOW), full_motion
        has_rows = as_bool(contacts + state.self_contact.count > 0)
        status = solve_until_kept(method, hand, has_rows, 1.0, state, qp)
        if status != OPTIMAL or attempt == 1 or not complete_lists(hand, surface, options, state):
            break
        # Of the discarded program only node tests, pair tests and QP iterations count as work.
        work[WORK_UNITS] = units
        work[WORK_LINEARISATIONS] -= 1
    if state.progress.pairs_overflow:
        return as_int64(OVERFLOW), full_motion
    own_rows = state.self_contact.count
    if own_rows > 0:
        work[WORK_UNITS] += UNITS_ROW * own_rows
        work[WORK_ROWS] = max(work[WORK_ROWS], contacts + own_rows)
    if status == OPTIMAL and contacts + own_rows > 0:
        full_motion, share = clip_target(hand, options, only_restores(options, state, done), state)
        if full_motion != WHOLE_TARGET:
            status = solve_until_kept(method, hand, as_bool(True), share, state, qp)
    return status, full_motion


@jit_inline
def accept(options: TickOptions, fraction: float, longest: float, full_motion: float, state: Record) -> bool:
    """Let the present configuration be the safe one; returns whether the tick is done.

    `fraction` is the share of the program's step that led here; `longest` and `full_motion` [m] are the motions of the
    whole step and of that with the true target, or `WHOLE_TARGET`.
    """
    progress = state.progress
    copy_configuration(state.pose, state.safe)
    progress.differs_from_safe = False
    copy_active(state.warm, state.active)
    progress.is_accepted = True
    state.prediction.is_predicted = False
    progress.failed_steps = 0
    unhindered = state.contacts.start[FINGER_COUNT + 1] + state.self_contact.count == 0
    is_whole = fraction == 1.0 and full_motion == WHOLE_TARGET
    done = is_whole and (unhindered or longest <= options.step_tolerance)
    progress.lag = max(full_motion, longest) - fraction * longest
    if done:
        progress.lag = 0.0
    elif progress.lag == 0.0:
        # A whole step, but not a short one: if the budget ended here, up to as much again could be left to go.
        progress.lag = longest
    return done


@jit_inline
def update_reach(
    options: TickOptions, fraction: float, longest: float, full_motion: float, foreseen: float, state: Record
) -> None:
    """Add a step to the path, and set the next one's reach from `foreseen` [m] and what `accept` is given."""
    progress, trust = state.progress, state.trust
    for body in range(BODY_COUNT):
        progress.differs_from_safe = progress.differs_from_safe or fraction * progress.motion[body] > 0.0
    progress.path += fraction * longest
    if fraction < 1.0 or full_motion != WHOLE_TARGET:
        trust.reach = min(options.margin, REACH_GROWTH * trust.reach)
    else:
        # After a whole step the rest is of second order: only near contacts matter.
        trust.reach = min(trust.reach, foreseen)


@advance.of(Coupled)
@advance.of(Progressive)
@jit_inline
def advance_hand(method: Any, hand: HandArrays, surface: SurfaceCode, full_motion: float, state: Record) -> bool:
    """Make as much of the step as the listed pairs allow, and judge it by the true distances."""
    began = monotonic_ns()
    options, step, progress = method.options, state.step, state.progress
    store_active(state.contacts, step, state.warm)
    store_meeting(options.own.pairs, state, state.warm)
    # A program may miss a joint limit by its tolerance, and the next one would start from there: with a palm that is a
    # million times stiffer than a joint that adds up.
    for f in range(FINGER_COUNT):
        clamp_to_limits(hand, state.pose, f, step.delta[:])
    clearance = least_distance(state)
    fraction, longest = allowed_fraction(hand, options, state)
    hindered = as_bool(state.contacts.start[FINGER_COUNT + 1] + state.self_contact.count > 0)
    fraction = keep_bound(hand, options, hindered, fraction, longest, state)
    move(state.pose, step.delta, state.problem.abduction_step, fraction)
    # Twice the step: where contacts change, the next one may be longer, and cut short by the reach, make that grow.
    foreseen = REACH_FLOOR * max(options.step_tolerance, longest)
    update_reach(options, fraction, longest, full_motion, foreseen, state)
    done = False
    if not evaluate_pose(hand, surface, options, state):
        done = True
    elif least_distance(state) >= 0.0:
        done = accept(options, fraction, longest, full_motion, state) or progress.snaps
    elif forget_prediction(hand, surface, options, state):
        done = progress.pairs_overflow
    else:
        if progress.failed_steps == 0:
            progress.lag = max(full_motion, longest)
            keep_first_step(options, fraction, clearance, -least_distance(state), state)
        progress.failed_steps += 1
        if progress.failed_steps > MOST_FAILED_STEPS:
            if not state.program.is_coupled:
                suspend_decoupling(state)
            take_free_share(hand, surface, options, state)
            progress.failed_steps = 0
            state.trust.radius *= TRUST_DECAY
            done = progress.pairs_overflow
    step.duration[DURATION_DETECT] += monotonic_ns() - began
    return done


@jit_inline
def tick_status(cut_short: bool, made_part: bool, state: Record) -> int:
    """Return the tick's status bits; `cut_short` by the work budget, `made_part` of a step at its end."""
    progress, status = state.progress, 0
    # A step that was cut short may have ended inside, and a shorter way have led all the way.
    progress.snaps = progress.snaps and progress.is_accepted and progress.lag > 0.0
    progress.idle_ticks = 0 if progress.is_accepted else progress.idle_ticks + 1
    if not progress.is_accepted:
        # A tick whose budget ended before it found a step is on its way: the next one goes on. But not for ever.
        status |= STATUS_LAG if cut_short and progress.idle_ticks <= MOST_IDLE_TICKS else STATUS_STUCK
        progress.lag = np.inf
    elif progress.lag > 0.0:
        status |= 0 if progress.snaps else STATUS_LAG
    progress.is_unfinished = not progress.is_accepted or made_part or (progress.is_unfinished and progress.lag > 0.0)
    if progress.is_accepted and (state.program.holds_abduction or state.self_contact.holds):
        status |= STATUS_ABDUCTION_HELD
    if status & (STATUS_STUCK | STATUS_LAG) or progress.snaps:
        # Along a soft, almost unconstrained direction a step can be longer than the distance left to the haptic hand.
        progress.lag = min(progress.lag, farthest_joint(state.pose.joints, state.haptic.joints))
    return status


@finish_tick.of(Coupled)
@finish_tick.of(Progressive)
@jit_inline
def finish_hand(method: Any, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Return to the last feasible configuration, count what touches, compute the forces; returns status bits."""
    began = monotonic_ns()
    options, progress = method.options, state.progress
    cut_short = is_budget_spent(options, state)
    pairs_overflow, made_part = progress.pairs_overflow, False
    if progress.differs_from_safe:
        if progress.is_accepted or pairs_overflow:
            state.first_step.free_share = 0.0
        made_part = take_free_share(hand, surface, options, state)
        pairs_overflow = pairs_overflow or progress.pairs_overflow
    if made_part:
        # A step that is not free as a whole may be in several shorter ones.
        state.trust.radius = max(TRUST_DECAY, state.first_step.free_share) * min(state.trust.reach, state.trust.radius)
    status = tick_status(cut_short, made_part, state)
    if progress.is_accepted and status & STATUS_LAG and energy_stalled(method, state):
        suspend_decoupling(state)
    if pairs_overflow:
        status |= STATUS_CAPACITY_EXCEEDED
    _, state.work[WORK_TOUCHING] = pairs_near(surface, hand, state.candidates, options.touch)
    detected = monotonic_ns()
    if options.force_model == FORCE_PAPER:
        find_surface_contacts(surface, hand, state.pose, state.candidates, options.touch, state.contacts)
    elif status & STATUS_LAG or palm_yielded(state):
        settle_forces(hand, surface, options, state, qp)
    hand_forces(options, as_bool(progress.snaps or progress.snapped > 0), state)
    if progress.snaps:
        status |= STATUS_SNAP
    end_work(state)
    state.step.duration[DURATION_DETECT] += detected - began
    state.step.duration[DURATION_FORCE] += monotonic_ns() - detected
    return status


@tick.of(Coupled)
@tick.of(Progressive)
@jit_inline
def converge(method: Any, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Go from linearisation to linearisation until the hand stands still; returns status bits."""
    options, progress = method.options, state.progress
    begin_tick(options, state)
    begin_motion(method, hand, surface, state)
    status = 0
    for done in range(options.linearisations):
        if done > 0 and may_end(method, state) and spent_units(state) >= options.budget:
            break
        # With pairs missing from the lists a program could miss a contact.
        solved, full_motion = as_int64(OVERFLOW), WHOLE_TARGET
        if not progress.pairs_overflow:
            solved, full_motion = solve_linearisation(method, hand, surface, done, state, qp)
        if solved == OVERFLOW:
            status |= STATUS_CAPACITY_EXCEEDED
            break
        if solved != OPTIMAL:
            if recover(method, hand, surface, state):
                continue
            break
        if advance(method, hand, surface, full_motion, state):
            break
    return status | finish_tick(method, hand, surface, state, qp)
