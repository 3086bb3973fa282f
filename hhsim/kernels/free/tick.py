"""One tick of hands and free objects: the loop of `kernels.tick.tick`, with all steps in one program.

A program's step moves hands and bodies. For each pair, the step of its body is subtracted from that of the hand, or of
the other body: this relative motion is bounded by the listed pairs, and judged by the true distances at its end. If
anything penetrates there, the whole step is taken back. What is shown are the last poses without penetration. The table
is a half-space, so that nothing can jump over it: its distance at the end of a step is enough.

All hands and bodies make the same share of a step. The tick ends when all have arrived.
"""

import numpy as np

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.contact.linearise import clamp_to_limits
from hhsim.kernels.contact.surface_code import SurfaceCode, find_surface_contacts, pairs_near
from hhsim.kernels.copy import copy_values
from hhsim.kernels.free.body import (
    OBJECT_DOF,
    drive_body,
    keep_body,
    move_body,
    predict,
    see_hand,
    take_body_back,
    take_velocity,
    turn_back,
)
from hhsim.kernels.free.bound import (
    MOST_DAMPING,
    MOST_RAISES,
    begin_bounds,
    beyond_bound,
    mark_snap,
    measure_user_motions,
    raise_damping,
)
from hhsim.kernels.free.columns import (
    States,
    body_column,
    body_count,
    hand_count,
    is_still,
    pair_count,
    palm_column,
    variable_count,
)
from hhsim.kernels.free.joints import begin_joints, joints_hold
from hhsim.kernels.free.linearisation import allowed_share, prepare, solve_with_pairs
from hhsim.kernels.free.meeting import DEEP, bear_meetings, bear_own, measure_hands, stay_apart
from hhsim.kernels.free.pairs import Free, measure, measure_table, mover_of, place_pairs, rebuild, surface_at
from hhsim.kernels.free.program import take_steps
from hhsim.kernels.free.record import WorldRecord, clear_borne, copy_borne, find_borne, record_bodies, turn_loads
from hhsim.kernels.free.support import keep_entry
from hhsim.kernels.hand.kinematics import FINGER_COUNT, HandArrays
from hhsim.kernels.hand.pose import move, update_kinematics
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit, jit_noinline
from hhsim.kernels.machine_code import call_code
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_tick
from hhsim.kernels.tick.evaluation import REACH_FLOOR, end_work, is_budget_spent, least_distance
from hhsim.kernels.tick.force import FORCE_PAPER, hand_forces
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.method import advance, begin_motion, finish_tick, may_end, recover, tick
from hhsim.kernels.tick.restoration import TRUST_DECAY, take_back
from hhsim.kernels.tick.settled_forces import ON_THE_WAY
from hhsim.kernels.tick.state import (
    STATUS_CAPACITY_EXCEEDED,
    STATUS_LAG,
    STATUS_SNAP,
    WORK_LINEARISATIONS,
    WORK_TOUCHING,
)
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FORCE, DURATION_PALM, copy_active
from hhsim.kernels.tick.step_length import keep_bound
from hhsim.kernels.tick.tick import MOST_FAILED_STEPS, accept, begin_tick, converge, tick_status, update_reach


@jit
def _see_haptic(hand: HandArrays, world: Record, h: int, state: Record) -> None:
    haptic = state.haptic
    place, turn = world.palm_position[h], world.palm_orientation[h]
    see_hand(world.bodies[0], place, turn, haptic.position[:], haptic.orientation[:])
    update_kinematics(hand, haptic)


@jit
def _take_back(method: Free) -> None:
    """Return to the last poses without penetration."""
    world = method.world[0]
    for p in range(pair_count(world.problem)):
        take_back(method.states[p])
        method.states[p].progress.failed_steps = 0
    world.apart = 0.0
    for k in range(body_count(world.problem)):
        take_body_back(world.bodies[k])
    variables = variable_count(world.problem)
    copy_values(world.safe_total[:variables], world.problem.total[:variables])
    copy_values(world.safe_abduction[:], world.problem.abduction_total[:])


@jit
def _retry(method: Free) -> bool:
    """Return to the last poses without penetration with a smaller trust radius; False where the pairs do not fit."""
    _take_back(method)
    for p in range(pair_count(method.world[0].problem)):
        method.states[p].trust.radius *= TRUST_DECAY
    return measure(method)


@recover.of(Free)
@jit
def _recover(method: Free, hand: HandArrays, surface: SurfaceCode, state: Record) -> bool:
    if not state.program.is_relaxed:
        state.program.is_relaxed = True
        return True
    if state.progress.failed_steps > 0:
        return _retry(method)
    if not state.program.holds_abduction:
        for p in range(pair_count(method.world[0].problem)):
            method.states[p].program.holds_abduction = True
        return True
    return False


@jit_noinline
def _find_loads(method: Free, state: Record) -> None:
    """Find the forces of the solution on bodies and hands."""
    world, states = method.world[0], method.states
    problem, contacts = world.problem, state.contacts
    find_borne(states, world.bodies, contacts, problem, world.friction, world.loaded, world.tried)
    if hand_count(problem) > 1:
        bear_meetings(states, world)
    for h in range(hand_count(problem)):
        bear_own(method.options.own.pairs, states[h], as_int64(h), problem)


@jit
def _move_all(method: Free, fraction: float, state: Record) -> None:
    """Make a share of the step of hands and bodies, and find what bears it."""
    world = method.world[0]
    problem, bodies, states = world.problem, world.bodies, method.states
    for j in range(variable_count(problem)):
        problem.total[j] += fraction * problem.delta[j]
    for f in range(FINGER_COUNT * hand_count(problem)):
        problem.abduction_total[f] += fraction * problem.abduction_step[f]
    _find_loads(method, state)
    # What comes next in the tick is added to it in the frame of each body as it then stands.
    first = body_column(problem, as_int64(0))
    for h in range(hand_count(problem)):
        palm = palm_column(problem, h)
        for j in (palm, palm + 3):
            turn_back(bodies[0], problem.delta[first : first + OBJECT_DOF], fraction, problem.total[j : j + 3])
    for k in range(body_count(problem)):
        j = body_column(problem, k)
        turn_back(bodies[k], problem.delta[j : j + OBJECT_DOF], fraction, problem.total[j : j + 3])
    if 0.0 < fraction < 1.0:
        take_steps(states, bodies, fraction, problem)
    for p in range(pair_count(problem)):
        each = states[p]
        move(each.pose, each.step.delta, each.problem.abduction_step, fraction)
    for k in range(body_count(problem)):
        j = body_column(problem, k)
        move_body(bodies[k], problem.delta[j : j + OBJECT_DOF], fraction)


@jit
def _keep(world: Record) -> None:
    """Keep the bodies' poses, and what bears them, as those of an accepted step."""
    problem = world.problem
    for k in range(body_count(problem)):
        keep_body(world.bodies[k])
        world.bodies[k].table_distance = world.bodies[k].measured_distance
    variables = variable_count(problem)
    copy_values(problem.total[:variables], world.safe_total[:variables])
    copy_values(problem.abduction_total[:], world.safe_abduction[:])
    world.tried.residual = problem.gamma_error
    copy_borne(body_count(problem), world.tried, world.borne)


@jit_noinline
def _damp_and_retry(method: Free, state: Record) -> bool:
    """Damp hands that are beyond their bound and return to the safe poses; True if the program is to be solved anew."""
    world, options = method.world[0], method.options
    ratio = beyond_bound(options, method.states, world)
    can_raise = world.raises < MOST_RAISES and world.damping < MOST_DAMPING
    programs, progress = state.work[WORK_LINEARISATIONS], state.progress
    # A tick that ended without a step would stop the bodies.
    left, needed = options.linearisations - programs, 2 if progress.is_accepted else programs - progress.restarted
    is_late = left < needed
    if ratio <= 1.0 or not can_raise or is_late:
        return as_bool(False)
    raise_damping(ratio, method.states, world)
    progress.restarted = programs
    _take_back(method)
    return as_bool(True)


@advance.of(Free)
@jit
def _advance(method: Free, hand: HandArrays, surface: SurfaceCode, full_motion: float, state: Record) -> bool:
    """Make as much of the step as the listed pairs allow, and judge it by the true distances and the table's."""
    world = method.world[0]
    began = monotonic_ns()
    options, problem, progress, states = method.options, world.problem, state.progress, method.states
    pairs, still = pair_count(problem), is_still(problem)
    for p in range(pairs):
        for f in range(FINGER_COUNT if problem.other[p] < 0 else 0):
            clamp_to_limits(mover_of(method, p), states[p].pose, f, states[p].step.delta[:])
    fraction, longest = allowed_share(method)
    for h in range(hand_count(problem) if still else 0):
        own = states[h].contacts.start[FINGER_COUNT + 1] + states[h].self_contact.count
        hindered = as_bool(own + world.meeting.count > 0)
        fraction = keep_bound(method.movers[h], options, hindered, fraction, world.longest[h], states[h])
    _move_all(method, fraction, state)
    least = np.inf
    for p in range(pairs):
        motion = world.longest[p]
        # Where nothing else moves as of a hand alone, see `kernels.tick.tick`.
        foreseen = REACH_FLOOR * max(options.step_tolerance, motion)
        if not still:
            foreseen = max(REACH_FLOOR * options.step_tolerance, motion)
        update_reach(options, fraction, motion, full_motion, foreseen, states[p])
    fits = measure(method)
    for p in range(pairs):
        least = min(least, least_distance(states[p]))
    if hand_count(problem) > 1 and not stay_apart(fraction, states, world):
        apart = measure_hands(method.movers, states, world)
        least = min(least, apart - world.kept_apart if world.kept_apart >= -DEEP else 0.0)
    table, number, lowest = measure_table(method)
    if table < 0.0:
        keep_entry(number, lowest, world.friction)
    done = False
    if fits and least >= 0.0 and table >= 0.0 and not still and _damp_and_retry(method, state):
        done = not measure(method)
    elif not fits:
        progress.lag = max(full_motion, longest) - fraction * longest
        done = True
    elif least >= 0.0 and table >= 0.0:
        _keep(world)
        if world.kept_apart < 0.0:
            world.kept_apart = min(world.apart, 0.0)
        done = held = joints_hold(states, world.bodies, problem)
        for p in range(pairs):
            arrived = accept(options, fraction, world.longest[p], full_motion, states[p])
            states[p].progress.snaps = problem.other[p] < 0 and states[problem.hand[p]].progress.snaps
            done = (arrived or (still and states[p].progress.snaps)) and done
        if not held:
            progress.lag = max(progress.lag, longest)
        if hand_count(problem) > 1 and world.meeting.count > 0 and longest > options.step_tolerance:
            # Hands that meet bend their rows: they have not arrived after a whole step that is long.
            done = False
            for h in range(hand_count(problem)):
                if states[h].progress.lag == 0.0:
                    states[h].progress.lag = longest
    else:
        # Were this the tick's last step it would be taken back, and nothing of it made.
        progress.failed_steps += 1
        for p in range(pairs):
            states[p].progress.failed_steps = progress.failed_steps
            states[p].progress.lag = max(full_motion, longest)
        if progress.failed_steps > MOST_FAILED_STEPS:
            done = not _retry(method)
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return done


@jit_noinline
def _settle_forces(method: Free, state: Record, qp: QpWork) -> None:
    """Compute the multipliers of what touches where hands are shown, see `kernels.tick.settled_forces`."""
    world, options, step = method.world[0], method.options, state.step
    problem, relaxed, holds = world.problem, state.program.is_relaxed, state.program.holds_abduction
    palm, detect, iterations = step.duration[DURATION_PALM], step.duration[DURATION_DETECT], step.iterations
    near = max(options.touch, ON_THE_WAY * options.offset)
    world.meeting.count, world.within, world.settles = 0, near, True
    for h in range(hand_count(problem)):
        method.states[h].program.is_relaxed = method.states[h].program.holds_abduction = True
        method.states[h].self_contact.bends = False
    count = prepare(method, near, state)
    if count >= 0 and solve_with_pairs(method, count, as_bool(False), state, qp) == OPTIMAL:
        _find_loads(method, state)
        for h in range(hand_count(problem)):
            copy_active(method.states[h].warm, method.states[h].active)
    for h in range(hand_count(problem)):
        method.states[h].program.is_relaxed, method.states[h].program.holds_abduction = relaxed, holds
    world.within, world.settles = options.margin, False
    step.duration[DURATION_PALM], step.duration[DURATION_DETECT] = palm, detect
    step.iterations = iterations


@finish_tick.of(Free)
@jit
def _finish_tick(method: Free, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Return to the last poses without penetration, take the velocities and the forces; returns status bits."""
    world = method.world[0]
    began = monotonic_ns()
    options, progress, borne, states = method.options, state.progress, world.borne, method.states
    problem, bodies = world.problem, world.bodies
    cut_short, pairs_overflow = is_budget_spent(options, state), progress.pairs_overflow
    if progress.failed_steps > 0 or pairs_overflow:
        _take_back(method)
        pairs_overflow = not measure(method) or pairs_overflow
    for p in range(pair_count(problem)):
        each = states[p]
        if p < hand_count(problem):
            _see_haptic(mover_of(method, p), world, p, each)
        # Beside what moves a hand that snaps has made all of its step, unless it lags as well. Both hands are damped.
        snaps = as_bool(
            (each.progress.snaps or (world.damping > 0.0 and p < hand_count(problem))) and not is_still(problem)
        )
        each.progress.snaps = each.progress.snaps and not snaps
        world.status[p] = tick_status(cut_short, as_bool(False), each)
        if snaps and progress.is_accepted:
            mark_snap(each, world)
        if pairs_overflow:
            world.status[p] |= STATUS_CAPACITY_EXCEEDED
        if p >= hand_count(problem):
            # A body that has distance still to go past another one has it whatever the hand has.
            world.status[0] |= world.status[p] & STATUS_LAG
    if progress.is_accepted:
        for k in range(body_count(problem)):
            take_velocity(bodies[k])
    else:
        clear_borne(body_count(problem), borne)
    detected, still = monotonic_ns(), is_still(problem)
    if still and not pairs_overflow and options.force_model != FORCE_PAPER:
        lags = False
        for h in range(hand_count(problem)):
            lags = lags or world.status[h] & STATUS_LAG != 0
        if lags:
            _settle_forces(method, state, qp)
    settled = monotonic_ns() - detected
    for h in range(hand_count(problem)):
        each = states[h]
        if not progress.is_accepted and not still:
            each.active.count = 0
        each.work[WORK_TOUCHING] = 0
        for p in range(pair_count(problem)):
            if problem.hand[p] == h and problem.other[p] < 0:
                given = surface_at(method, p), mover_of(method, p), states[p].candidates
                _, near = pairs_near(*given, options.touch)
                each.work[WORK_TOUCHING] += near
        if options.force_model == FORCE_PAPER:
            shown = surface_at(method, h), mover_of(method, h), each.pose, each.candidates
            find_surface_contacts(*shown, options.touch, each.contacts)
        detected = monotonic_ns()
        turn_loads(bodies[0], each.active)
        snaps = each.progress.snaps or each.progress.snapped > 0
        hand_forces(options, as_bool(still and snaps), each)
        if each.progress.snaps:
            world.status[h] |= STATUS_SNAP
        if h > 0:
            # The program is one: its work is that of both.
            each.step.iterations = state.step.iterations
            copy_values(state.step.duration[:], each.step.duration[:])
        end_work(each)
    state.step.duration[DURATION_DETECT] += detected - began - settled
    state.step.duration[DURATION_FORCE] += monotonic_ns() - detected + settled
    return world.status[0]


@may_end.of(Free)
@jit
def _may_end(method: Free, state: Record) -> bool:
    # Where nothing is accepted yet the object would stop in the air: it goes on.
    return state.progress.is_accepted


@tick.of(Free)
@jit
def _tick(method: Free, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Take the user's hands, which are the world's, and converge; they are then as the object sees them."""
    world = method.world[0]
    measure_user_motions(method.states, world)
    for h in range(hand_count(world.problem)):
        each = method.states[h]
        if each.input.is_valid:
            copy_values(each.haptic.position[:], world.palm_position[h])
            copy_values(each.haptic.orientation[:], world.palm_orientation[h])
    return converge(method, hand, surface, state, qp)


@begin_motion.of(Free)
@jit
def _begin_motion(method: Free, hand: HandArrays, surface: SurfaceCode, state: Record) -> None:
    """Let the bodies go on by their velocity and their weight."""
    world = method.world[0]
    problem = world.problem
    place_pairs(method)
    begin_joints(method.states, world.bodies, problem)
    for p in range(1, pair_count(problem)):
        begin_tick(method.options, method.states[p])
    begin_bounds(method.options, method.states, world)
    for k in range(body_count(world.problem)):
        predict(world.bodies[k])
        keep_body(world.bodies[k])
    variables = variable_count(problem)
    copy_values(world.safe_total[:variables], problem.before[:variables])
    copy_values(world.safe_abduction[:], problem.before_abduction[:])
    problem.total[:variables] = 0.0
    problem.abduction_total[:] = 0.0
    problem.solutions = 0
    world.friction.entries[:] = 0
    world.safe_total[:variables] = 0.0
    world.safe_abduction[:] = 0.0


TICK, REBUILD, MEASURE = 0, 1, 2
"""What `tick_world` is asked for."""


@jit
def tick_world(method: Free, states: States, qp: QpWork, asked: int) -> int:
    """Make one tick of all hands and bodies on the input that they have; returns the first hand's status bits.

    Asked to `REBUILD` it takes all as it stands, and to `MEASURE` the poses of hands that went on alone: 0, or -1 where
    the pairs do not fit. It is one function, since each of them would be compiled with the whole detection.
    """
    if asked == REBUILD:
        return as_int64(0 if rebuild(method, states) else -1)
    if asked == MEASURE:
        return as_int64(0 if measure(method) else -1)
    return tick(method, method.movers[0], method.surfaces[0], states[0], qp)


@jit
def run_many(
    method: Free,
    states: States,
    qp: QpWork,
    haptic: HapticBlock,
    record: TickRecord,
    object_record: WorldRecord,
    driven: Array,
    code: int,
) -> int:
    """Run one tick for each row of the haptic inputs of the hands, as `kernels.tick.block.run_block` does of one.

    Inputs and record have the hand as their first axis. `driven` has position [m] and orientation of each body's centre
    at each tick, (K, B, 7), read of driven ones. `code` is that of `tick_world`.
    """
    world = method.world[0]
    hands = hand_count(world.problem)
    for i in range(haptic.position.shape[1]):
        cpu = thread_cpu_ns()
        wall = monotonic_ns()
        for h in range(hands):
            world.taken[h] = set_haptic(
                method.movers[h],
                haptic.position[h, i],
                haptic.orientation[h, i],
                haptic.flexion[h, i],
                haptic.abduction[h, i],
                states[h],
            )
        for k in range(body_count(world.problem)):
            if world.bodies[k].is_driven == 1:
                drive_body(world.bodies[k], driven[k, i])
        call_code(code, (method, states, qp, as_int64(TICK)))
        wall = monotonic_ns() - wall
        cpu = thread_cpu_ns() - cpu
        for h in range(hands):
            record_tick(states[h], world.taken[h] | world.status[h], wall, cpu, (h, i), record)
        record_bodies(object_record, world, i)
        if world.status[0] & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return haptic.position.shape[1]
