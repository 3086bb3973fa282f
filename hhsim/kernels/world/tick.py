"""One tick of hands and bodies: from where they are and the users' new hands to where they are shown, and the forces.

docs/methods.md ("A tick that cannot penetrate") has its 13 lines, each with the function that does it. In short: a
program, as much of its step as the listed pairs allow, the true distances. By these alone poses become the safe ones,
and a tick ends at safe ones.

A program's step moves hands and bodies. For each pair, the step of its body is subtracted from that of the hand, or of
the other body: this relative motion is bounded by the listed pairs, and judged by the true distances at its end. If
anything penetrates there, the whole step is taken back. The table is a half-space, so that nothing can jump over it:
its distance at the end of a step is enough. All hands and bodies make the same share of a step. The tick ends when all
have arrived. What bodies that move, pairs of hands' parts or moving parts of a body add is called by address
(`kernels.world.pairs`, `kernels.contact.hand_pairs`).
"""

import numpy as np

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.detection import find_surface_contacts, pairs_near
from hhsim.kernels.contact.hand_pairs import CROSS, OWN
from hhsim.kernels.contact.linearise import clamp_to_limits
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.hand.pose import move
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit, jit_noinline
from hhsim.kernels.machine_code import call_code, run_code
from hhsim.kernels.memory import copy_values
from hhsim.kernels.parallel.thread_team import thread_team_cpu_ns
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.block import OVERFLOW, HapticBlock, TickRecord, record_tick, set_haptic
from hhsim.kernels.tick.evaluation import REACH_FLOOR, end_work, least_distance, spent_units
from hhsim.kernels.tick.force import FORCE_PAPER, hand_forces
from hhsim.kernels.tick.state import (
    STATUS_CAPACITY_EXCEEDED,
    STATUS_LAG,
    STATUS_SNAP,
    WORK_COUNTERS,
    WORK_LINEARISATIONS,
    WORK_TOUCHING,
)
from hhsim.kernels.tick.step import (
    DURATION_DETECT,
    DURATION_FINGERS,
    DURATION_FORCE,
    DURATION_PALM,
    WHOLE_TARGET,
    copy_active,
    keep_bound,
    lap,
    store_active_contacts,
)
from hhsim.kernels.tick.tick import (
    MOST_FAILED_STEPS,
    TRUST_DECAY,
    accept,
    begin_tick,
    energy_stalled,
    suspend_decoupling,
    tick_status,
    update_reach,
)
from hhsim.kernels.world.columns import is_still
from hhsim.kernels.world.hand_contact import add_hand_contact_forces
from hhsim.kernels.world.linearisation import allowed_share, prepare, solve_linearisation, solve_with_pairs
from hhsim.kernels.world.pairs import STAGE, World, ask_bodies, measure, mover_of, rebuild, surface_at
from hhsim.kernels.world.record import WorldRecord
from hhsim.kernels.world.restoration import forget_prediction, keep_first_step, predict_pose, restore, take_free_share

STILL = 2e-3
"""Motion of a hand in the last tick, in offsets, up to which the first program of the next one is flat."""
ON_THE_WAY = 20.0
"""Distance up to which a lagging hand bears on the object, in offsets: its last step has not brought it nearer yet."""


@jit
def _goes_alone(method: World) -> bool:
    """Return True for one hand beside what stands still."""
    return as_bool(method.bodies == 0 and method.world[0].problem.hands == 1)


@jit
def _restore_poses(method: World) -> None:
    """Return to the last poses without penetration."""
    world = method.world[0]
    for p in range(world.problem.pairs):
        restore(method.states[p])
        method.states[p].progress.failed_steps = 0
    ask_bodies(method, STAGE.RESTORE_POSES, 0.0)


@jit
def _retry(method: World, state: Record) -> bool:
    """Return to the last poses without penetration with a smaller trust radius; False where the pairs do not fit."""
    _restore_poses(method)
    for p in range(0 if state.prediction.is_predicted else method.world[0].problem.pairs):
        method.states[p].trust.radius *= TRUST_DECAY
    state.prediction.is_predicted = False
    return measure(method)


@jit
def recover(method: World, state: Record) -> bool:
    """Make the next program easier after one without solution; returns False where nothing is left to try.

    First contacts nearer than the offset may stay as near as they are, then all return to the last poses without
    penetration with a smaller trust radius, then the abduction stays as it is.
    """
    if not state.fallback.is_relaxed:
        state.fallback.is_relaxed = state.fallback.is_coupled = True
        return True
    if state.progress.failed_steps > 0 or state.prediction.is_predicted:
        return _retry(method, state)
    if not state.fallback.holds_abduction:
        for p in range(method.world[0].problem.pairs):
            method.states[p].fallback.holds_abduction = True
        return True
    return False


@jit_noinline
def _find_loads(method: World, state: Record) -> None:
    """Find the forces of the solution on hands; beside bodies that move those of contacts are found as these move."""
    world, states = method.world[0], method.states
    problem = world.problem
    for h in range(problem.hands if method.bodies == 0 else 0):
        store_active_contacts(state.contacts, problem.first[h], problem.last[h], world.loaded, states[h].warm)
    add_hand_contact_forces(states, world.hand_pairs)


@jit
def _accept_all(method: World, fraction: float, longest: float, full_motion: float, state: Record) -> bool:
    """Let the present poses be the safe ones; returns whether the tick is done."""
    world, states, options = method.world[0], method.states, method.options
    problem, still, pairs = world.problem, is_still(world.problem), world.hand_pairs
    if pairs.kept < 0.0:
        pairs.kept = min(pairs.least[CROSS], 0.0)
    done = joints_kept = as_bool(ask_bodies(method, STAGE.ACCEPT_STEP, 0.0) > 0.0 or still)
    for p in range(problem.pairs):
        arrived = accept(options, fraction, world.longest[p], full_motion, states[p])
        states[p].progress.snaps = problem.other[p] < 0 and states[problem.hand[p]].progress.snaps
        done = (arrived or (still and states[p].progress.snaps)) and done
    if not joints_kept:
        state.progress.lag = max(state.progress.lag, longest)
    if pairs.crossing > 0 and longest > options.step_tolerance:
        # Hands that meet bend their rows: they have not arrived after a whole step that is long.
        done = False
        for h in range(problem.hands):
            if states[h].progress.lag == 0.0:
                states[h].progress.lag = longest
    return as_bool(done)


@jit_noinline
def _fail(method: World, fraction: float, longest: float, full_motion: float, clearance: float, state: Record) -> bool:
    """Go on from a step that has ended inside, and return to the safe poses after a few; returns whether that is all.

    The first step led there from a `clearance` [m].
    """
    world, states, options, progress = method.world[0], method.states, method.options, state.progress
    alone = _goes_alone(method)
    if alone and progress.failed_steps == 0:
        keep_first_step(options, fraction, clearance, -least_distance(state), state)
    # Were this the tick's last step it would be taken back, and nothing of it made.
    progress.failed_steps += 1
    for p in range(world.problem.pairs):
        states[p].progress.failed_steps = progress.failed_steps
        states[p].progress.lag = max(full_motion, longest)
    if progress.failed_steps <= MOST_FAILED_STEPS:
        return False
    if not alone:
        return not _retry(method, state)
    if not state.fallback.is_coupled:
        suspend_decoupling(state)
    take_free_share(method, state)
    progress.failed_steps = 0
    state.trust.radius *= TRUST_DECAY
    return bool(progress.pairs_overflow)


@jit
def advance(method: World, full_motion: float, state: Record) -> bool:
    """Make as much of the step as the listed pairs allow, and judge it by the true distances; True ends the tick."""
    world = method.world[0]
    options, problem, progress, states = method.options, world.problem, state.progress, method.states
    pairs, still = problem.pairs, is_still(problem)
    # A program may miss a joint limit by its tolerance, and the next one would start from there: with a palm that is a
    # million times stiffer than a joint that adds up.
    for p in range(pairs):
        for f in range(FINGER_COUNT if problem.other[p] < 0 else 0):
            changed = clamp_to_limits(mover_of(method, p), states[p].pose, f, states[p].step.delta[:])
            world.knows_share = world.knows_share and not changed
    clearance = least_distance(state)
    fraction, longest = world.share, 0.0
    if world.knows_share:
        for p in range(pairs):
            longest = max(longest, world.longest[p])
    else:
        fraction, longest = allowed_share(method)
    for h in range(problem.hands if still else 0):
        hindered = as_bool(states[h].contacts.start[FINGER_COUNT + 1] + states[h].hand_contact.rows > 0)
        fraction = keep_bound(method.movers[h], options, hindered, fraction, world.longest[h], states[h])
    ask_bodies(method, STAGE.MOVE_BODIES, fraction)
    _find_loads(method, state)
    for p in range(pairs):
        motion = world.longest[p]
        move(states[p].pose, states[p].step.delta, states[p].problem.abduction_step, fraction)
        # Twice the step: where contacts change, the next one may be longer, and cut short by the reach, make that grow.
        foreseen = REACH_FLOOR * max(options.step_tolerance, motion)
        if not still:
            foreseen = max(REACH_FLOOR * options.step_tolerance, motion)
        update_reach(options, fraction, motion, full_motion, foreseen, states[p])
    fits, least = measure(method), np.inf
    for p in range(pairs):
        least = min(least, least_distance(states[p]))
    if not still:
        least = min(least, ask_bodies(method, STAGE.MEASURE_TABLE, 0.0))
    if not fits:
        progress.lag = max(full_motion, longest) - fraction * longest
        done = True
    elif least < 0.0 and forget_prediction(method, state):
        done = bool(progress.pairs_overflow)
    elif least < 0.0:
        done = _fail(method, fraction, longest, full_motion, clearance, state)
    elif ask_bodies(method, STAGE.DAMP_HANDS, 0.0) > 0.0:
        _restore_poses(method)
        done = not measure(method)
    else:
        done = _accept_all(method, fraction, longest, full_motion, state)
    lap(DURATION_DETECT, state)
    return as_bool(done)


@jit_noinline
def settle_forces(method: World, near: float, state: Record, qp: QpWork) -> bool:
    """Compute the multipliers of the contacts up to `near` [m] where hands are shown; False where they do not fit.

    A lagging tick's last program was made for another configuration, and a finger's own program that the palm has
    yielded to has multipliers without bound. One more program, of the touching contacts alone, gives them: standing
    still satisfies it, so that they stay within the coupling's own. Without a solution they stay as they were. It
    counts in the forces' time.
    """
    world, step = method.world[0], state.step
    lap(DURATION_DETECT, state)
    start = step.lap
    problem, relaxed, holds = world.problem, state.fallback.is_relaxed, state.fallback.holds_abduction
    iterations, coupled, duration = step.iterations, state.fallback.is_coupled, step.duration
    palm, fingers, detect = duration[DURATION_PALM], duration[DURATION_FINGERS], duration[DURATION_DETECT]
    # Rows of pairs that are near come with the steps that break them.
    pairs, within = world.hand_pairs, (world.hand_pairs.within[OWN], world.hand_pairs.within[CROSS])
    pairs.count, pairs.within[:], state.fallback.is_coupled = 0, near, True
    for h in range(problem.hands):
        method.states[h].fallback.is_relaxed = method.states[h].fallback.holds_abduction = True
        method.states[h].hand_contact.bends = False
    world.curved = False
    count = prepare(method, near, state)
    for h in range(problem.hands if count >= 0 else 0):
        # What is inside, where parts left no place, stays as deep as it is.
        for i in range(problem.first[h], problem.last[h]):
            problem.rhs[i] = min(problem.rhs[i], 0.0)
    if count >= 0 and solve_with_pairs(method, count, as_bool(False), state, qp) == OPTIMAL:
        _find_loads(method, state)
        for h in range(problem.hands):
            copy_active(method.states[h].warm, method.states[h].active)
    for h in range(problem.hands):
        method.states[h].fallback.is_relaxed, method.states[h].fallback.holds_abduction = relaxed, holds
    pairs.within[OWN], pairs.within[CROSS], state.fallback.is_coupled = within[OWN], within[CROSS], coupled
    duration[DURATION_PALM], duration[DURATION_FINGERS], duration[DURATION_DETECT] = palm, fingers, detect
    duration[DURATION_FORCE] += step.lap - start
    step.iterations = iterations
    return as_bool(count >= 0)


@jit
def _finish_way(method: World, state: Record) -> tuple[bool, bool]:
    """Return to the last poses without penetration; returns whether pairs did not fit, and part of a step was made."""
    progress, pairs_overflow = state.progress, as_bool(state.progress.pairs_overflow)
    if _goes_alone(method) and progress.differs_from_safe:
        if progress.is_accepted or pairs_overflow:
            state.first_step.free_share = 0.0
        made_part = take_free_share(method, state)
        if made_part:
            # A step that is not free as a whole may be in several shorter ones.
            share = max(TRUST_DECAY, state.first_step.free_share)
            state.trust.radius = share * min(state.trust.reach, state.trust.radius)
        return as_bool(pairs_overflow or progress.pairs_overflow), made_part
    if progress.failed_steps > 0 or pairs_overflow:
        _restore_poses(method)
        pairs_overflow = as_bool(not measure(method) or pairs_overflow)
    return pairs_overflow, as_bool(False)


@jit
def finish_tick(method: World, state: Record, qp: QpWork) -> None:
    """Return to the last poses without penetration, take the velocities, the forces and the status bits."""
    world = method.world[0]
    options, progress, states, problem = method.options, state.progress, method.states, world.problem
    cut_short = state.work[WORK_LINEARISATIONS] < options.linearisations and spent_units(state) >= options.budget
    still, palm_yields = is_still(problem), state.progressive.variables > 6
    pairs_overflow, made_part = _finish_way(method, state)
    ask_bodies(method, STAGE.END_TICK, 0.0)
    for p in range(problem.pairs):
        each = states[p]
        # Beside what moves a hand that snaps has made all of its step, unless it lags as well. Both hands are damped.
        snaps = as_bool((each.progress.snaps or (world.damping > 0.0 and p < problem.hands)) and not still)
        each.progress.snaps = each.progress.snaps and not snaps
        world.status[p] = tick_status(cut_short, made_part, each)
        if snaps and progress.is_accepted:
            ask_bodies(method, STAGE.MARK_SNAP, float(p))
        if pairs_overflow:
            world.status[p] |= STATUS_CAPACITY_EXCEEDED
        if p >= problem.hands:
            # A body that has distance still to go past another one has it whatever the hand has.
            world.status[0] |= world.status[p] & STATUS_LAG
    lags = False
    for h in range(problem.hands):
        lags = lags or world.status[h] & STATUS_LAG != 0
    if method.solver != 0 and _goes_alone(method) and progress.is_accepted and lags and energy_stalled(state):
        suspend_decoupling(state)
    if still and not pairs_overflow and options.force_model != FORCE_PAPER and (lags or palm_yields):
        near = max(options.touch, ON_THE_WAY * options.offset) if lags else options.touch
        settle_forces(method, near, state, qp)
    for h in range(problem.hands):
        each = states[h]
        each.work[WORK_TOUCHING] = 0
        for p in range(problem.pairs):
            if problem.hand[p] == h and problem.other[p] < 0:
                surface, arrays = surface_at(method, p), mover_of(method, p)
                each.work[WORK_TOUCHING] += pairs_near(surface, arrays, states[p].candidates, options.touch)[1]
        if options.force_model == FORCE_PAPER:
            shown = surface_at(method, h), mover_of(method, h), each.pose, each.candidates
            find_surface_contacts(*shown, options.touch, each.contacts)
    lap(DURATION_DETECT, state)
    for h in range(problem.hands):
        each = states[h]
        snaps = each.progress.snaps or each.progress.snapped > 0
        hand_forces(options, as_bool(still and snaps), each)
        # In its last tick, too, a snap may take the hand farther than the user's went.
        if each.progress.snaps or (still and snaps and each.progress.lag == 0.0):
            world.status[h] |= STATUS_SNAP
        if h > 0:
            # The program is one: its work is that of both.
            each.step.iterations = state.step.iterations
            copy_values(state.step.duration[:], each.step.duration[:])
        end_work(each)
    lap(DURATION_FORCE, state)


@jit
def follow(method: World, state: Record, qp: QpWork) -> int:
    """Go from linearisation to linearisation until all have arrived; returns the first hand's status bits."""
    options, progress = method.options, state.progress
    # By flat programs a hand that moves would creep towards where it comes to rest.
    moves = progress.path > STILL * options.offset
    method.world[0].unsettled = moves or (progress.lag > 0.0 and not progress.snaps)
    state.step.lap = monotonic_ns()
    ask_bodies(method, STAGE.BEGIN_TICK, 0.0)
    for p in range(method.world[0].problem.pairs if method.bodies == 0 else 0):
        begin_tick(options, method.states[p])
    if _goes_alone(method):
        predict_pose(method, state)
    status = as_int64(0)
    for done in range(options.linearisations):
        # Without a step accepted only a hand alone may end: bodies would stop, and two hands that meet, whose programs
        # take many times the work, would try the same for ever.
        may_end = done > 0 and (progress.is_accepted or _goes_alone(method))
        if may_end and spent_units(state) >= options.budget:
            break
        # With pairs missing from the lists a program could miss a contact.
        solved, full_motion = as_int64(OVERFLOW), WHOLE_TARGET
        if not progress.pairs_overflow:
            solved, full_motion = solve_linearisation(method, done, state, qp)
        if solved == OVERFLOW:
            status |= STATUS_CAPACITY_EXCEEDED
            break
        if solved != OPTIMAL:
            if recover(method, state):
                continue
            break
        if advance(method, full_motion, state):
            break
    finish_tick(method, state, qp)
    method.world[0].status[0] |= status
    return as_int64(method.world[0].status[0])


TICK, REBUILD, MEASURE = 0, 1, 2
"""What `tick_world` is asked for."""


@jit
def tick_world(method: World, qp: QpWork, asked: int) -> int:
    """Make one tick of all hands and bodies on the input that they have; returns the first hand's status bits.

    Asked to `REBUILD` it takes all as it stands, and to `MEASURE` the poses of hands that went on alone: 0, or -1 where
    the pairs do not fit. It is one function, since each of them would be compiled with the whole detection.
    """
    if asked == REBUILD:
        return as_int64(0 if rebuild(method) else -1)
    if asked == MEASURE:
        return as_int64(0 if measure(method) else -1)
    if method.parts_tick == 0:
        return as_int64(follow(method, method.states[0], qp))
    world, state = method.world[0], method.states[0]
    world.status[0] = call_code(method.parts_tick, (method.parts, method, qp))
    if world.status[0] == 0:
        follow(method, state, qp)
        # Those that are the most of a program are the tick's own.
        for i in range(WORK_COUNTERS):
            state.work[i] += world.work[i]
        for i in range(4):
            state.step.duration[i] += world.spent[i]
    return as_int64(world.status[0])


@jit
def run_many(
    method: World,
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
    world, states, hands = method.world[0], method.states, method.world[0].problem.hands
    for i in range(haptic.position.shape[1]):
        cpu = thread_team_cpu_ns(states[0].thread_team)
        wall = monotonic_ns()
        for h in range(hands):
            world.taken[h] = set_haptic(method.movers[h], haptic, (h, i), states[h])
        for k in range(world.problem.bodies):
            if world.bodies[k].is_driven == 1:
                copy_values(driven[k, i, :3], world.bodies[k].goal_position[:])
                copy_values(driven[k, i, 3:], world.bodies[k].goal_orientation[:])
        call_code(code, (method, qp, as_int64(TICK)))
        wall = monotonic_ns() - wall
        cpu = thread_team_cpu_ns(states[0].thread_team) - cpu
        for h in range(hands):
            record_tick(states[h], world.taken[h] | world.status[h], wall, cpu, (h, i), record)
        if method.recorder != 0:
            run_code(method.recorder, (object_record, world, as_int64(i)))
        if world.status[0] & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return haptic.position.shape[1]
