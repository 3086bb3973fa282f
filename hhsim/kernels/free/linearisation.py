"""One linearisation of a tick of the world: contacts of all pairs, the program that they make, and its solution.

Two hands keep out of each other, and each out of itself, by rows of pairs of their bodies, added where a step would
bring them together until none does.
"""

import numpy as np

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.linearise import LIMIT_ROWS, build_rows, clamp_to_limits
from hhsim.kernels.contact.own_parts import add_own_rows, foresee_own_rows
from hhsim.kernels.contact.redundant_contacts import drop_redundant_contacts
from hhsim.kernels.contact.self_pairs import BROKEN, begin_rows, choose_bends
from hhsim.kernels.contact.surface_code import SurfaceCode, find_surface_contacts
from hhsim.kernels.free.body import OBJECT_DOF, body_target, see_hand
from hhsim.kernels.free.bound import damped_target
from hhsim.kernels.free.columns import (
    body_column,
    body_count,
    first_finger,
    hand_count,
    is_still,
    object_columns,
    pair_count,
    palm_column,
)
from hhsim.kernels.free.joints import has_joint_rows
from hhsim.kernels.free.meeting import (
    DEEP,
    UNITS_ROUND,
    add_meetings,
    keep_meetings,
    may_meet,
    part_targets,
    share_of_meetings,
    spread_fingers,
)
from hhsim.kernels.free.pairs import Free, find_turns, mover_of, record_edges_of, surface_at
from hhsim.kernels.free.program import begin_search, clip_shifts, scale_target, solve_free, take_steps, take_targets
from hhsim.kernels.free.rows import PAIR_KEYS, begin_frictions, bends, find_frictions
from hhsim.kernels.free.support import find_table_contacts, keep_lowest
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit, jit_noinline
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.evaluation import least_distance
from hhsim.kernels.tick.linearisation import count_linearisation, find_program_contacts, step_to_haptic
from hhsim.kernels.tick.method import OVERFLOW, solve_linearisation
from hhsim.kernels.tick.restoration import only_restores
from hhsim.kernels.tick.second_order import FLAT_PROGRAMS
from hhsim.kernels.tick.state import WORK_LINEARISATIONS, WORK_ROWS, WORK_UNITS
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_PALM
from hhsim.kernels.tick.step_length import CLEAR, LEAST_SHARE, WHOLE_TARGET, allowed_fraction

CLOSE = 20.0
FLOATS = 2.0
"""Contacts up to CLOSE offsets, plus FLOATS times the residual of Γ of the tick before, have rows of friction."""
ROUNDS = 12
"""Most programs of a linearisation, each with rows of two hands' pairs that the step of the one before would break."""
SEARCHED = 2
"""Programs of a tick in which Γ and directions are sought; in the later ones they stand."""


@jit
def _aim(state: Record, world: Record, h: int, target_out: Array, abduction_out: Array) -> None:
    haptic = state.haptic
    place, turn = world.palm_position[h], world.palm_orientation[h]
    see_hand(world.bodies[0], place, turn, haptic.position[:], haptic.orientation[:])
    step_to_haptic(state, target_out, abduction_out)
    damped_target(world, h, as_int64(0), as_int64(6))


@jit
def _find_contacts(method: Free, near: float, state: Record) -> int:
    """Find each pair's contacts and their rows, further pairs' behind the first one's limits; return how many or -1.

    They are those within reach, or all up to `near` [m] where that is above 0.
    """
    world = method.world[0]
    problem, joined = world.problem, state.contacts
    row, kept = as_int64(0), as_int64(0)
    for p in range(pair_count(problem)):
        each, arrays = method.states[p], mover_of(method, p)
        contacts = each.contacts
        if near > 0.0:
            if find_surface_contacts(surface_at(method, p), arrays, each.pose, each.candidates, near, contacts) != 0:
                return as_int64(-1)
        elif not find_program_contacts(arrays, surface_at(method, p), method.options, each):
            return as_int64(-1)
        record_edges_of(method, p)
        world.found[p] = contacts.start[FINGER_COUNT + 1]
        if near == 0.0:
            reach = min(each.trust.reach, each.trust.radius)
            drop_redundant_contacts(arrays, reach, contacts, each.open_distance[:])
        if problem.other[p] >= 0:
            keep_lowest(contacts, each.open_distance[:], world.friction)
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
        row += count + (LIMIT_ROWS if p < hand_count(problem) else 0)
        kept += count
    return kept


@jit
def _write_contacts(method: Free, state: Record) -> None:
    """Write the rows of all contacts and joint limits, but for the bodies' columns."""
    problem, relaxed, offset = method.world[0].problem, state.program.is_relaxed, method.options.offset
    build_rows(method.movers[0], state.pose, state.contacts, offset, relaxed, problem)
    problem.is_fresh, problem.share = 1, 1.0
    for p in range(1, pair_count(problem)):
        each, first, last = method.states[p], problem.first[p], problem.last[p]
        own, palm = each.problem, palm_column(problem, problem.hand[p])
        if problem.other[p] >= 0:
            for i in range(last - first):
                rhs = offset - each.contacts.distance[i]
                problem.rhs[first + i] = min(rhs, 0.0) if relaxed and each.contacts.distance[i] >= 0.0 else rhs
                for j in range(PHALANX_COUNT):
                    problem.block[j, first + i] = 0.0
            continue
        for f in range(FINGER_COUNT):
            own.abduction_step[f] = problem.abduction_step[FINGER_COUNT * problem.hand[p] + f]
        build_rows(mover_of(method, p), each.pose, each.contacts, offset, relaxed, own)
        for i in range(last - first + (LIMIT_ROWS if p < hand_count(problem) else 0)):
            for j in range(6):
                problem.common[palm + j, first + i] = own.common[j, i]
            for j in range(PHALANX_COUNT):
                problem.block[j, first + i] = own.block[j, i]
            problem.rhs[first + i] = own.rhs[i]


@jit
def _foresee_own(method: Free, near: float, world: Record) -> int:
    """Begin with the rows of each hand's own pairs: those of the last program, or all up to `near` [m]; return a count.

    The abduction, which is given, is reduced to what they have room for.
    """
    problem, options, count = world.problem, method.options, as_int64(0)
    spread_fingers(method.states, problem)
    for h in range(hand_count(problem)):
        each, hand = method.states[h], method.movers[h]
        own, step = each.self_contact, each.problem.abduction_step
        if near > 0.0:
            add_own_rows(options.own, hand, near, options, each)
        else:
            foresee_own_rows(options.own, hand, each.warm, options, each)
        for r in range(own.count):
            problem.own_multiplier[h, r] = 1.0
        for f in range(FINGER_COUNT):
            problem.abduction_step[FINGER_COUNT * h + f] = step[f]
        count += own.count
    return count


@jit
def _aim_fingers(method: Free, world: Record) -> None:
    """Let the targets of fingers that no row may bend be within the joints' limits, and all others the user's own."""
    problem = world.problem
    for h in range(hand_count(problem) if world.kept_apart >= -DEEP else 0):
        each, target = method.states[h], problem.hand_target[DOF * h : DOF * h + DOF]
        for f in range(FINGER_COUNT):
            for k in range(PHALANX_COUNT):
                target[6 + PHALANX_COUNT * f + k] = each.haptic.flexion[f, k] - each.pose.flexion[f, k]
            if not bends(method.states, problem, world.meeting, as_int64(h), f):
                clamp_to_limits(mover_of(method, h), each.pose, f, target)
        damped_target(world, as_int64(h), as_int64(6), as_int64(DOF))


@jit_noinline
def prepare(method: Free, near: float, state: Record) -> int:
    """Build the program at the present poses; return how many rows contacts have, -1 where they do not fit.

    Contacts are those of `_find_contacts`.
    """
    world = method.world[0]
    began = monotonic_ns()
    options, contacts, problem, friction, bodies = (
        method.options,
        state.contacts,
        world.problem,
        world.friction,
        world.bodies,
    )
    find_turns(problem, bodies)
    total = _find_contacts(method, near, state)
    if total < 0:
        return -1
    for k in range(body_count(problem)):
        body_target(bodies[k], problem.body_target[OBJECT_DOF * k : OBJECT_DOF * k + OBJECT_DOF])
        bodies[k].clipped[:] = 0.0
    for h in range(hand_count(problem)):
        target = problem.hand_target[DOF * h : DOF * h + DOF]
        abduction = problem.abduction_step[FINGER_COUNT * h : FINGER_COUNT * h + FINGER_COUNT]
        _aim(method.states[h], world, h, target, abduction)
        begin_rows(method.states[h].self_contact)
    if hand_count(problem) > 1:
        if world.meeting.count > 0:
            keep_meetings(method.movers, method.states, world)
        if world.kept_apart < -DEEP:
            part_targets(method.states, problem, world.kept_apart)
    own = _foresee_own(method, near, world)
    _aim_fingers(method, world)
    _write_contacts(method, state)
    object_columns(method.states, bodies, contacts, problem)
    # A contact floats by what Γ was short of its slip, and goes on rubbing.
    close = CLOSE * options.offset + FLOATS * world.borne.residual
    find_frictions(bodies, contacts, problem, close, friction)
    joints = as_int64(0)
    for k in range(body_count(problem)):
        joints += 1 if has_joint_rows(bodies[k]) else 0
        alone = problem.body_target[OBJECT_DOF * k : OBJECT_DOF * k + OBJECT_DOF]
        find_table_contacts(bodies[k], k, method.supports[k], options.margin, close, alone, friction)
    programs = state.work[WORK_LINEARISATIONS] - state.progress.restarted
    if programs == 0:
        step, abduction = problem.before[:], problem.before_abduction[:]
    else:
        step, abduction = problem.total[:], problem.abduction_total[:]
    # Directions that went on turning would give each program another one, and the tick no end.
    turns = as_bool(programs < SEARCHED)
    begin_frictions(method.states, bodies, step, abduction, problem, world.held, turns, friction)
    scale_target(bodies, problem)
    count = total + friction.count - friction.of_hand + joints + own
    for p in range(pair_count(problem) if near == 0.0 else 0):
        each = method.states[p]
        given = mover_of(method, p), surface_at(method, p), options
        count_linearisation(*given, world.found[p], count, each)
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return count


@jit_noinline
def _add_own(method: Free, h: int, world: Record) -> bool:
    """Add rows of a hand's own pairs that the step at hand would bring together; return whether one is new."""
    problem, each = world.problem, method.states[h]
    share, before, first = each.self_contact.share, problem.scratch, each.self_contact.count
    for f in range(FINGER_COUNT):
        before[f] = share[f]
    if not add_own_rows(method.options.own, method.movers[h], BROKEN, method.options, each):
        return False
    for r in range(first, each.self_contact.count):
        problem.own_multiplier[h, r] = 0.0
    for f in range(FINGER_COUNT):
        if before[f] > 0.0:
            problem.abduction_step[FINGER_COUNT * h + f] *= share[f] / before[f]
    return True


@jit
def _add_rows(method: Free, clipped: bool, state: Record) -> bool:
    """Add rows of pairs of hands' bodies that the step at hand would bring together; return whether one is new."""
    world = method.world[0]
    problem, met, own = world.problem, False, False
    if hand_count(problem) > 1 and may_meet(method.options.offset, method.states, world):
        met = add_meetings(method.movers, method.options, method.states, world)
        if is_still(problem):
            for h in range(hand_count(problem)):
                each = method.states[h]
                each.work[WORK_UNITS] += UNITS_ROUND
                rows = problem.last[h] - problem.first[h] + world.meeting.count + each.self_contact.count
                each.work[WORK_ROWS] = max(each.work[WORK_ROWS], rows)
    if not world.settles:
        spread_fingers(method.states, problem)
        for h in range(hand_count(problem)):
            own = _add_own(method, as_int64(h), world) or own
    if own:
        share = problem.share
        _write_anew(method, state)
        problem.share = share
    if (met or own) and not clipped:
        _aim_fingers(method, world)
        scale_target(world.bodies, problem)
    return met or own


@jit
def solve_with_pairs(method: Free, count: int, clipped: bool, state: Record, qp: QpWork) -> int:
    """Solve a program, and again with rows of hands' pairs that its step would bring together; return a status."""
    status = _solve_program(method, count, clipped, state, qp)
    for _ in range(ROUNDS):
        if status != OPTIMAL or not _add_rows(method, clipped, state):
            break
        status = _solve_rows(method, clipped, state, qp)
    return status


@jit
def _solve_program(method: Free, count: int, clipped: bool, state: Record, qp: QpWork) -> int:
    world = method.world[0]
    problem = world.problem
    if count == 0 and (hand_count(problem) < 2 or world.meeting.count == 0):
        problem.dense_rows = 0
        take_targets(problem)
        world.loaded.count = 0
        problem.gamma_error = 0.0
        take_steps(method.states, world.bodies, 1.0, problem)
        return OPTIMAL
    return _solve_rows(method, clipped, state, qp)


@jit
def _solve_rows(method: Free, clipped: bool, state: Record, qp: QpWork) -> int:
    began = monotonic_ns()
    rounds = as_int64(1)
    if state.work[WORK_LINEARISATIONS] - state.progress.restarted <= SEARCHED and not clipped:
        rounds = begin_search(method.world[0].coulomb)
    status = solve_free(method.options, method.states, method.world[0], rounds, clipped, qp)
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    return status


@jit
def allowed_share(method: Free) -> tuple[float, float]:
    """Compute the share of the step that all listed pairs allow, and how far the farthest mover goes in it [m]."""
    world = method.world[0]
    problem, fraction, longest = world.problem, 1.0, 0.0
    for p in range(pair_count(problem)):
        each = method.states[p]
        for f in range(FINGER_COUNT if problem.other[p] < 0 else 0):
            each.problem.abduction_step[f] = problem.abduction_step[FINGER_COUNT * problem.hand[p] + f]
        share, motion = allowed_fraction(mover_of(method, p), method.options, each)
        world.longest[p] = motion
        fraction, longest = min(fraction, share), max(longest, motion)
    return min(fraction, share_of_meetings(method.states, world)), longest


@jit
def _clip_target(method: Free, only_restore: bool, state: Record) -> tuple[float, float]:
    """Bring a far target nearer, see `kernels.tick.step_length.clip_target`, which returns the same.

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
        away = world.apart if hand_count(problem) > 1 else np.inf
        for h in range(hand_count(problem)):
            away = min(away, least_distance(method.states[h]))
        least = LEAST_SHARE if away >= CLEAR * method.options.offset else least
    if only_restore:
        fraction = 0.0
    elif fraction >= least:
        return WHOLE_TARGET, 1.0
    off = 1.0 - fraction
    for h in range(hand_count(problem)):
        palm, fingers = palm_column(problem, h), first_finger(problem, h)
        for j in range(DOF):
            # Where nothing else moves a part of the target brings a part of the forces (`kernels.tick.step_length`).
            made = problem.delta[palm + j if j < 6 else fingers - 6 + j]
            problem.hand_target[DOF * h + j] -= off * (problem.hand_target[DOF * h + j] if still else made)
    for k in range(body_count(world.problem)):
        body, column = world.bodies[k], body_column(problem, k)
        for j in range(OBJECT_DOF):
            body.clipped[j] = off * problem.delta[column + j]
            problem.body_target[OBJECT_DOF * k + j] -= body.clipped[j]
    for f in range(FINGER_COUNT * hand_count(problem)):
        problem.abduction_step[f] *= fraction
    _write_anew(method, state)
    scale_target(world.bodies, problem)
    clip_shifts(fraction, world.friction)
    return longest, fraction


@jit
def _write_anew(method: Free, state: Record) -> None:
    """Write the rows of contacts and limits once more."""
    world = method.world[0]
    _write_contacts(method, state)
    if pair_count(world.problem) > hand_count(world.problem):
        # What this writes anew has not been turned to the frame of the first body.
        object_columns(method.states, world.bodies, state.contacts, world.problem)


@solve_linearisation.of(Free)
@jit
def _solve_linearisation(
    method: Free, hand: HandArrays, surface: SurfaceCode, done: int, state: Record, qp: QpWork
) -> tuple[int, float]:
    world = method.world[0]
    hands = hand_count(world.problem)
    for h in range(hands):
        each, curved = method.states[h], as_bool(done >= FLAT_PROGRAMS)
        choose_bends(method.options.own.pairs, curved, mover_of(method, h), each.pose, each.self_contact)
    count, full_motion = prepare(method, 0.0, state), WHOLE_TARGET
    if count < 0:
        return as_int64(OVERFLOW), full_motion
    status = solve_with_pairs(method, count, as_bool(False), state, qp)
    if status == OPTIMAL and (count > 0 or world.problem.dense_rows > 0):
        full_motion, share = _clip_target(method, only_restores(method.options, state, done), state)
        if full_motion != WHOLE_TARGET:
            status = solve_with_pairs(method, count, as_bool(True), state, qp)
            two = hands > 1 and not is_still(world.problem)
            if status == OPTIMAL and two and allowed_share(method)[0] < LEAST_SHARE:
                # A contact that is reached with the whole step has no load on a part of the way: what it bore would
                # draw the hand all the way there, and a small share of that mends no clearance.
                _write_anew(method, state)
                world.problem.share = share
                status = solve_with_pairs(method, count, as_bool(True), state, qp)
    return status, full_motion
