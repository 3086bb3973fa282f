"""One linearisation of a tick: the contacts of all pairs, the program that they make, and its solution.

Hands keep out of themselves and of each other by rows of pairs of their parts, added where a step would bring these
together until none does.
"""

import numpy as np

from hhsim.kernels.contact.detection import find_surface_contacts, pairs_near
from hhsim.kernels.contact.hand_pairs import ADD_ROWS, CLEAR_SHARE, DEEP_HANDS, KEEP_LOADED_ROWS, ask_pairs
from hhsim.kernels.contact.linearise import LIMIT_ROWS, build_rows, clamp_to_limits, drop_redundant_contacts
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_noinline
from hhsim.kernels.machine_code import call_code, run_code
from hhsim.kernels.memory import copy_values
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.block import OVERFLOW
from hhsim.kernels.tick.evaluation import complete_lists, count_program, least_distance
from hhsim.kernels.tick.state import WORK_LINEARISATIONS, WORK_ROWS, WORK_UNITS
from hhsim.kernels.tick.step import (
    CLEAR,
    DURATION_DETECT,
    DURATION_PALM,
    LEAST_SHARE,
    WHOLE_TARGET,
    allowed_fraction,
    lap,
)
from hhsim.kernels.tick.tick import find_program_contacts, step_to_haptic
from hhsim.kernels.world.columns import hand_column, is_still, name_rows
from hhsim.kernels.world.hand_contact import part_targets
from hhsim.kernels.world.pairs import STAGE, World, ask_bodies, damped_target, mover_of, surface_at
from hhsim.kernels.world.program import scale_target, solve_plain, take_hand_steps, take_targets
from hhsim.kernels.world.restoration import only_restores
from hhsim.kernels.world.rows import PAIR_KEYS, bends
from hhsim.kernels.world.second_order import FLAT_PROGRAMS

PAIR_ROUNDS = 12
"""Most programs of a linearisation, each with rows of hands' pairs that the step of the one before would break."""
UNITS_ROUND = 25_000
"""Work units of a program more for pairs that the step of the one before would bring together."""


@jit
def _find_contacts(method: World, near: float, state: Record) -> int:
    """Find each pair's contacts and their rows, further pairs' behind the first one's limits; return how many or -1.

    They are those within reach, or all up to `near` [m] where that is above 0.
    """
    world = method.world[0]
    problem, joined = world.problem, state.contacts
    row, kept = as_int64(0), as_int64(0)
    for p in range(problem.pairs):
        each, arrays = method.states[p], mover_of(method, p)
        contacts = each.contacts
        if near > 0.0:
            if find_surface_contacts(surface_at(method, p), arrays, each.pose, each.candidates, near, contacts) != 0:
                return as_int64(-1)
        elif not find_program_contacts(arrays, surface_at(method, p), method.options, each):
            return as_int64(-1)
        if problem.other[p] >= 0:
            ask_bodies(method, STAGE.RECORD_EDGES, float(p))
        world.found[p] = contacts.start[FINGER_COUNT + 1]
        # A row that may give in to a depth implies no other one.
        if near == 0.0 and not (world.stays and problem.slacks > 0):
            reach = min(each.trust.reach, each.trust.radius)
            drop_redundant_contacts(arrays, reach, contacts, each.open_distance[:])
        if problem.other[p] >= 0:
            ask_bodies(method, STAGE.KEEP_LOWEST, float(p))
        count = contacts.start[FINGER_COUNT + 1]
        if row + count > joined.key.shape[0]:
            return as_int64(-1)
        problem.first[p], problem.last[p] = row, row + count
        for i in range(count if p > 0 else 0):
            joined.distance[row + i] = contacts.distance[i]
            joined.body[row + i] = contacts.body[i] + BODY_COUNT * p
            joined.key[row + i] = contacts.key[i] + PAIR_KEYS * p
            for j in range(3):
                joined.point[j, row + i] = contacts.point[j, i]
                joined.normal[j, row + i] = contacts.normal[j, i]
        row += count + (LIMIT_ROWS if p < problem.hands else 0)
        kept += count
    return kept


@jit
def _write_contacts(method: World, state: Record) -> None:
    """Write the rows of all contacts and joint limits, but for the bodies' columns."""
    problem, relaxed, offset = method.world[0].problem, state.fallback.is_relaxed, method.options.offset
    spread = state.problem.abduction_step[:]
    build_rows(method.movers[0], state.pose, state.contacts, offset, relaxed, spread, problem)
    problem.is_fresh, problem.share = 1, 1.0
    if method.pairs != 0:
        run_code(method.pairs, (method, state))


@jit
def write_other_pairs(method: World, state: Record) -> None:
    """Write the rows of all pairs but the first, as `_write_contacts`."""
    problem, relaxed, offset = method.world[0].problem, state.fallback.is_relaxed, method.options.offset
    for p in range(1, problem.pairs):
        each, first, last = method.states[p], problem.first[p], problem.last[p]
        own, palm = each.problem, problem.palm[problem.hand[p]]
        if problem.other[p] >= 0:
            for i in range(last - first):
                rhs = offset - each.contacts.distance[i]
                problem.rhs[first + i] = min(rhs, 0.0) if relaxed and each.contacts.distance[i] >= 0.0 else rhs
                for j in range(PHALANX_COUNT):
                    problem.block[j, first + i] = 0.0
            continue
        copy_values(method.states[problem.hand[p]].problem.abduction_step[:], own.abduction_step[:])
        build_rows(mover_of(method, p), each.pose, each.contacts, offset, relaxed, own.abduction_step[:], own)
        for i in range(last - first + (LIMIT_ROWS if p < problem.hands else 0)):
            for j in range(6):
                problem.common[palm + j, first + i] = own.common[j, i]
            for j in range(PHALANX_COUNT):
                problem.block[j, first + i] = own.block[j, i]
            problem.rhs[first + i] = own.rhs[i]


@jit
def _aim_fingers(method: World, world: Record) -> None:
    """Let the targets of fingers that no row may bend be within the joints' limits, and all others the user's own."""
    problem = world.problem
    for h in range(problem.hands if world.hand_pairs.kept >= -DEEP_HANDS and not world.stays else 0):
        each, target = method.states[h], problem.hand_target[DOF * h : DOF * h + DOF]
        for f in range(FINGER_COUNT):
            for k in range(PHALANX_COUNT):
                target[6 + PHALANX_COUNT * f + k] = each.haptic.flexion[f, k] - each.pose.flexion[f, k]
            if not bends(method.states, problem, as_int64(h), f):
                clamp_to_limits(mover_of(method, h), each.pose, f, target)
        damped_target(world, as_int64(h), as_int64(6), as_int64(DOF))


@jit_noinline
def prepare(method: World, near: float, state: Record) -> int:
    """Build the program at the present poses; return how many rows contacts have, -1 where they do not fit.

    Contacts are those of `_find_contacts`.
    """
    world = method.world[0]
    options, problem = method.options, world.problem
    ask_bodies(method, STAGE.SET_TARGETS, 0.0)
    count = _find_contacts(method, near, state)
    if count < 0:
        return -1
    for h in range(problem.hands):
        target = problem.hand_target[DOF * h : DOF * h + DOF]
        abduction = method.states[h].problem.abduction_step[:]
        step_to_haptic(method.states[h], target, abduction)
        if world.stays:
            target[:] = 0.0
            abduction[:] = 0.0
        damped_target(world, as_int64(h), as_int64(0), as_int64(6))
    if world.hand_pairs.kept < -DEEP_HANDS:
        part_targets(method.states, problem, world.hand_pairs.kept)
    ask_pairs(options.pairs, KEEP_LOADED_ROWS, options.offset, 0.0)
    count += world.hand_pairs.count
    _aim_fingers(method, world)
    _write_contacts(method, state)
    name_rows(state.contacts, problem)
    count += int(ask_bodies(method, STAGE.WRITE_COLUMNS, 0.0))
    scale_target(world)
    for p in range(problem.pairs if near == 0.0 else 0):
        each = method.states[p]
        near_by = max(options.listed, each.trust.reach)
        parts, pairs = pairs_near(surface_at(method, p), mover_of(method, p), each.candidates, near_by)
        count_program(parts, pairs, world.found[p], count, each.work[:])
    lap(DURATION_DETECT, state)
    return count


@jit
def _add_rows(method: World, clipped: bool, state: Record) -> bool:
    """Add rows of pairs of hands' parts that the step at hand would bring together; return whether one is new."""
    world, options = method.world[0], method.options
    problem = world.problem
    if ask_pairs(options.pairs, ADD_ROWS, options.offset, 0.0) == 0.0:
        return False
    for h in range(problem.hands if is_still(problem) else 0):
        work, rows = method.states[h].work, problem.last[h] - problem.first[h] + method.states[h].hand_contact.rows
        work[WORK_UNITS] += UNITS_ROUND
        work[WORK_ROWS] = max(work[WORK_ROWS], rows)
    share = problem.share
    _write_anew(method, state)
    problem.share = share
    if not clipped:
        _aim_fingers(method, world)
        scale_target(world)
    return True


@jit
def solve_with_pairs(method: World, count: int, clipped: bool, state: Record, qp: QpWork) -> int:
    """Solve a program, and again with rows of hands' pairs that its step would bring together; return a status.

    Without rows, where `count` is 0, the step is that to the target.
    """
    world, status = method.world[0], as_int64(OPTIMAL)
    if count > 0:
        status = _solve_rows(method, clipped, state, qp)
    else:
        world.problem.dense_rows = 0
        take_targets(world.problem)
        world.loaded.count = 0
        world.problem.gamma_error = 0.0
        if is_still(world.problem):
            take_hand_steps(method.states, world.problem)
        ask_bodies(method, STAGE.TAKE_STEPS, 0.0)
    for _ in range(PAIR_ROUNDS):
        if status != OPTIMAL or not _add_rows(method, clipped, state):
            break
        status = _solve_rows(method, clipped, state, qp)
    return status


@jit
def _solve_rows(method: World, clipped: bool, state: Record, qp: QpWork) -> int:
    if method.solver != 0:
        status = call_code(method.solver, (method, state, clipped, qp))
    else:
        status = solve_plain(method.options, method.states, method.world[0], qp)
    lap(DURATION_PALM, state)
    return status


@jit
def allowed_share(method: World) -> tuple[float, float]:
    """Compute the share of the step that all listed pairs allow, and how far the farthest mover goes in it [m]."""
    world = method.world[0]
    problem, fraction, longest = world.problem, 1.0, 0.0
    for p in range(problem.pairs):
        share, motion = allowed_fraction(mover_of(method, p), method.options, method.states[p])
        world.longest[p] = motion
        fraction, longest = min(fraction, share), max(longest, motion)
    radius = method.states[0].trust.radius
    for h in range(1, problem.hands):
        radius = min(radius, method.states[h].trust.radius)
    return min(fraction, ask_pairs(method.options.pairs, CLEAR_SHARE, 0.0, radius)), longest


@jit
def _clip_target(method: World, only_restore: bool, state: Record) -> tuple[float, float]:
    """Bring a far target nearer; return the motion of the whole step [m], or `WHOLE_TARGET`, and the share left of it.

    The motions of hands and bodies are shortened alike: a hand that was short of its motion past the object alone would
    be carried along by it, for no force, and its springs drawn out by nobody. The targets are moved by what is taken
    off, so that springs and inertia pull as they did.
    """
    world = method.world[0]
    problem = world.problem
    fraction, longest = allowed_share(method)
    still, least = is_still(problem), 0.5
    if still:
        # As one hand beside what stands still: one that has its clearance keeps it on any part of a step.
        away = np.inf
        for h in range(problem.hands):
            away = min(away, least_distance(method.states[h]))
        least = LEAST_SHARE if away >= CLEAR * method.options.offset else least
    if only_restore:
        fraction = 0.0
    elif fraction >= least:
        world.share, world.knows_share = fraction, True
        return WHOLE_TARGET, 1.0
    off = 1.0 - fraction
    for h in range(problem.hands):
        for j in range(DOF):
            # Where nothing else moves a part of the target brings a part of the forces (`kernels.tick.step`).
            step = problem.delta[hand_column(problem, h, j)]
            problem.hand_target[DOF * h + j] -= off * (problem.hand_target[DOF * h + j] if still else step)
        for f in range(FINGER_COUNT):
            method.states[h].problem.abduction_step[f] *= fraction
    ask_bodies(method, STAGE.CLIP_TARGETS, fraction)
    _write_anew(method, state)
    scale_target(world)
    return longest, fraction


@jit
def _write_anew(method: World, state: Record) -> None:
    """Write the rows of contacts and limits once more."""
    world = method.world[0]
    _write_contacts(method, state)
    if world.problem.pairs > world.problem.hands:
        # What this writes anew has not been turned to the frame of the first body.
        ask_bodies(method, STAGE.REWRITE_COLUMNS, 0.0)


@jit
def solve_linearisation(method: World, done: int, state: Record, qp: QpWork) -> tuple[int, float]:
    """Build and solve the program at the present poses, after `done` others of this tick.

    Returns a status, and the motion of the step before its target was brought nearer [m], see `_clip_target`.
    """
    world, options = method.world[0], method.options
    hands, world.curved, world.knows_share = world.problem.hands, world.unsettled or done > 0, False
    for h in range(hands):
        contact = method.states[h].hand_contact
        contact.bends = options.pairs.curvature != 0 and (world.unsettled or done >= FLAT_PROGRAMS or contact.steep)
    count, status, full_motion, units = as_int64(0), as_int64(OPTIMAL), WHOLE_TARGET, state.work[WORK_UNITS]
    for attempt in range(2):
        count = prepare(method, 0.0, state)
        if count < 0:
            return as_int64(OVERFLOW), full_motion
        status = solve_with_pairs(method, count, as_bool(False), state, qp)
        # Of a hand alone no step depends on how old its lists are.
        alone = method.bodies == 0 and hands == 1 and attempt == 0 and status == OPTIMAL
        if not (alone and complete_lists(method.movers[0], method.surfaces[0], options, state)):
            break
        # Of the discarded program only node tests, pair tests and QP iterations count as work.
        state.work[WORK_UNITS] = units
        state.work[WORK_LINEARISATIONS] -= 1
    if state.progress.pairs_overflow:
        return as_int64(OVERFLOW), full_motion
    if status == OPTIMAL and (count > 0 or world.problem.dense_rows > 0):
        full_motion, share = _clip_target(method, only_restores(method.options, state, done), state)
        if full_motion != WHOLE_TARGET:
            status = solve_with_pairs(method, count, as_bool(True), state, qp)
            two_hands = hands > 1 and not is_still(world.problem)
            if status == OPTIMAL and two_hands and allowed_share(method)[0] < LEAST_SHARE:
                # A contact that is reached with the whole step has no load on a part of the way: what it bore would
                # draw the hand all the way there, and a small share of that mends no clearance.
                _write_anew(method, state)
                world.problem.share = share
                status = solve_with_pairs(method, count, as_bool(True), state, qp)
    return status, full_motion
