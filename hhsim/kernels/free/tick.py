"""One tick of hands and free objects: the loop of `kernels.tick.tick`, with all steps in one program.

A hand is kept as each thing sees it, and so is each thing as another one sees it: as a palm without fingers, of spheres
or points (`kernels.free.columns` says what a pair is). A program's step moves all; the thing's is taken out of what
moves past it, and what is left is what is bounded by the pairs at hand and judged by true distances. A step of which
anything would be entered is taken back like any other, and the last pose of all that was free is what is shown. The
table is a half-space: nothing can be behind it, so that the end of a step says all.

All make the same share of a step, and the tick ends where all have arrived. Two hands keep out of each other, and each
out of itself, by rows of pairs of their bodies, added where a step would bring them together until none does.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.contact.detection import find_contacts, pairs_near
from hhsim.kernels.contact.linearise import LIMIT_ROWS, build_rows, clamp_to_limits
from hhsim.kernels.contact.redundant_contacts import drop_redundant_contacts
from hhsim.kernels.contact.self_pairs import BROKEN, SELF_ROWS, add_rows, begin_rows, foresee_rows
from hhsim.kernels.copy import copy_values
from hhsim.kernels.free.body import (
    OBJECT_DOF,
    Support,
    body_target,
    drive_body,
    keep_body,
    move_body,
    predict,
    see_hand,
    show_hand,
    take_body_back,
    take_velocity,
    turn_back,
)
from hhsim.kernels.free.columns import (
    States,
    first_finger,
    hand_count,
    is_one,
    is_still,
    object_columns,
    other_in,
    pair_count,
    palm_column,
    thing_column,
    thing_count,
    variable_count,
)
from hhsim.kernels.free.edges import Edges, measure_edges, record_edges
from hhsim.kernels.free.joints import begin_joints, has_joint_rows, joints_hold
from hhsim.kernels.free.meeting import (
    DEEP,
    UNITS_ROUND,
    add_meetings,
    bear_meetings,
    bear_own,
    keep_meetings,
    may_meet,
    measure_hands,
    part_targets,
    share_of_meetings,
    spread_fingers,
    stay_apart,
)
from hhsim.kernels.free.program import begin_search, clip_shifts, scale_target, solve_free, take_steps, take_targets
from hhsim.kernels.free.record import copy_borne, find_borne, turn_loads
from hhsim.kernels.free.rows import PAIR_KEYS, begin_frictions, bends, find_frictions
from hhsim.kernels.free.support import find_table_contacts, keep_entry, keep_lowest, table_distances
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import move, update_kinematics
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.rotation import turned_back
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_object, record_tick
from hhsim.kernels.tick.evaluation import (
    REACH_FLOOR,
    end_work,
    evaluate_pose,
    is_budget_spent,
    least_distance,
    rebuild_candidates,
    usual_reach,
)
from hhsim.kernels.tick.force import FORCE_PAPER, hand_forces
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
from hhsim.kernels.tick.settled_forces import ON_THE_WAY
from hhsim.kernels.tick.state import (
    STATUS_CAPACITY_EXCEEDED,
    STATUS_LAG,
    WORK_LINEARISATIONS,
    WORK_ROWS,
    WORK_TOUCHING,
    WORK_UNITS,
)
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FORCE, DURATION_PALM, copy_active
from hhsim.kernels.tick.step_length import CLEAR, LEAST_SHARE, WHOLE_TARGET, allowed_fraction
from hhsim.kernels.tick.tick import MOST_FAILED_STEPS, accept, begin_tick, converge, tick_status, update_reach

CLOSE = 20.0
FLOATS = 2.0
"""Contacts up to CLOSE offsets, plus FLOATS times the residual of Γ of the tick before, have rows of friction."""
ROUNDS = 12
"""Most programs of a linearisation, each with rows of two hands' pairs that the step of the one before would break."""
SEARCHED = 2
"""Programs of a tick in which Γ and directions are sought; in the later ones they stand."""


@by_reference
class Free(NamedTuple):
    """Method that solves hands and things together; tuples are padded to their capacity with their last entry."""

    options: TickOptions
    supports: tuple[Support, ...]  # of each thing, its parts that can stand on a table
    states: States  # of each pair; a tick is given the first one
    world: NDArray[np.void]  # one record of `kernels.free.state.world_dtype`
    edge_pairs: NDArray[np.void]  # of each pair
    movers: tuple[HandArrays, ...]  # of each hand; then, of several things, each as a palm without fingers
    surfaces: Any  # of each thing; of each hand where parts of a thing have lists of their own
    edges: tuple[Edges, ...]  # of each thing


@jit_inline
def _mover(method: Free, p: int) -> HandArrays:
    """Return the arrays of what moves in a pair: of a hand, or of a thing as a palm without fingers."""
    problem = method.world[0].problem
    if is_one(problem):
        return method.movers[0]
    other = problem.other[p]
    return method.movers[problem.hand[p] if other < 0 else hand_count(problem) + other]


@jit_inline
def _surface(method: Free, p: int) -> Any:
    """Return the surface of the thing of a pair."""
    problem = method.world[0].problem
    return method.surfaces[as_int64(0) if is_one(problem) else problem.surface[p]]


@jit
def _measure_edges(method: Free, p: int) -> None:
    """Measure a pair's edges, if two things meet in it, after its other distances."""
    world = method.world[0]
    each, options = method.states[p], method.options
    problem = world.problem
    other, thing = other_in(problem, p), problem.thing[p]
    # Each two things meet in two pairs: their edges once.
    if 0 <= other < thing and each.modelled[PALM_BODY] == 1:
        needed = max(options.listed, max(each.trust.reach, usual_reach(options, each)))
        far = options.margin + options.skin
        measure_edges(
            method.movers[hand_count(problem) + other],
            method.edges[other],
            method.edges[thing],
            world.bodies[thing].center[:],
            each.pose,
            needed,
            far,
            each.candidates,
            method.edge_pairs[p],
            problem.scratch[:],
        )


@jit
def _record_edges(method: Free, p: int) -> None:
    """Add a pair's edges within reach to its contact records, if two things meet in it."""
    each, problem = method.states[p], method.world[0].problem
    other, thing = other_in(problem, p), problem.thing[p]
    if 0 <= other < thing and each.modelled[PALM_BODY] == 1:
        record_edges(method.edges[thing], min(each.trust.reach, each.trust.radius), method.edge_pairs[p], each.contacts)


@jit
def _see_haptic(hand: HandArrays, world: Record, h: int, state: Record) -> None:
    haptic = state.haptic
    place, turn = world.palm_position[h], world.palm_orientation[h]
    see_hand(world.bodies[0], place, turn, haptic.position[:], haptic.orientation[:])
    update_kinematics(hand, haptic)


@jit
def _aim(state: Record, world: Record, h: int, target_out: Array, abduction_out: Array) -> None:
    haptic = state.haptic
    place, turn = world.palm_position[h], world.palm_orientation[h]
    see_hand(world.bodies[0], place, turn, haptic.position[:], haptic.orientation[:])
    step_to_haptic(state, target_out, abduction_out)


@jit
def _place_pairs(method: Free) -> None:
    """Place what moves in each pair but the first ones where it is: there it was moved along, step by step."""
    world = method.world[0]
    problem, bodies, scratch = world.problem, world.bodies, world.problem.scratch
    for p in range(hand_count(problem), pair_count(problem)):
        each, other = method.states[p], problem.other[p]
        pose = each.pose
        if other >= 0:
            copy_values(bodies[other].position[:], scratch[0:3])
            copy_values(bodies[other].orientation[:], pose.orientation[:])
        else:
            first = method.states[problem.hand[p]].pose
            show_hand(bodies[0], first.position[:], first.orientation[:], scratch[0:3], pose.orientation[:])
            copy_values(first.flexion[:], pose.flexion[:])
            copy_values(first.abduction[:], pose.abduction[:])
        turn_here = world.scratch_turn
        copy_values(pose.orientation[:], turn_here[:])
        see_hand(bodies[problem.thing[p]], scratch[0:3], turn_here[:], pose.position[:], pose.orientation[:])
        update_kinematics(_mover(method, p), pose)


@jit
def _find_turns(problem: Record, bodies: Record) -> None:
    """Find how the frame of the first thing is turned to that of each pair's."""
    base = bodies[0].rotation
    for p in range(hand_count(problem), pair_count(problem)):
        own = bodies[problem.thing[p]].rotation
        for j in range(3):
            x, y, z = turned_back(own, base[0, j], base[1, j], base[2, j])
            problem.turn[p, 0, j], problem.turn[p, 1, j], problem.turn[p, 2, j] = x, y, z


@jit
def _find_contacts(method: Free, near: float, state: Record) -> int:
    """Find each pair's contacts and their rows, further pairs' behind the first one's limits; return how many or -1.

    They are those within reach, or all up to `near` [m] where that is above 0.
    """
    world = method.world[0]
    problem, joined = world.problem, state.contacts
    row, kept = as_int64(0), as_int64(0)
    for p in range(pair_count(problem)):
        each, arrays = method.states[p], _mover(method, p)
        contacts = each.contacts
        if near > 0.0:
            if find_contacts(_surface(method, p), arrays, each.pose, each.candidates, near, contacts) != 0:
                return as_int64(-1)
        elif not find_program_contacts(arrays, _surface(method, p), method.options, each):
            return as_int64(-1)
        _record_edges(method, p)
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
    """Write the rows of all contacts and joint limits, but for the things' columns."""
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
        build_rows(_mover(method, p), each.pose, each.contacts, offset, relaxed, own)
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
            add_rows(options.own, hand, near, options, each)
        else:
            foresee_rows(options.own, hand, each.warm, options, each)
        for r in range(own.count):
            problem.own_multiplier[h, r] = 1.0
        for r in range(own.count, SELF_ROWS):
            problem.own_multiplier[h, r] = 0.0
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
                clamp_to_limits(_mover(method, h), each.pose, f, target)


@jit_noinline
def _prepare(method: Free, near: float, state: Record) -> int:
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
    _find_turns(problem, bodies)
    total = _find_contacts(method, near, state)
    if total < 0:
        return -1
    for k in range(thing_count(problem)):
        body_target(bodies[k], problem.body_target[OBJECT_DOF * k : OBJECT_DOF * k + OBJECT_DOF])
        bodies[k].clipped[:] = 0.0
    for h in range(hand_count(problem)):
        target = problem.hand_target[DOF * h : DOF * h + DOF]
        abduction = problem.abduction_step[FINGER_COUNT * h : FINGER_COUNT * h + FINGER_COUNT]
        _aim(method.states[h], world, h, target, abduction)
        begin_rows(method.states[h].self_contact)
    own = as_int64(0)
    if not is_one(problem):
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
    for k in range(thing_count(problem)):
        joints += 1 if has_joint_rows(bodies[k]) else 0
        alone = problem.body_target[OBJECT_DOF * k : OBJECT_DOF * k + OBJECT_DOF]
        find_table_contacts(bodies[k], k, method.supports[k], options.margin, close, alone, friction)
    if state.work[WORK_LINEARISATIONS] == 0:
        step, abduction = problem.before[:], problem.before_abduction[:]
    else:
        step, abduction = problem.total[:], problem.abduction_total[:]
    # Directions that went on turning would give each program another one, and the tick no end.
    turns = as_bool(state.work[WORK_LINEARISATIONS] < SEARCHED)
    begin_frictions(method.states, bodies, step, abduction, problem, world.held, turns, friction)
    scale_target(bodies, problem)
    count = total + friction.count - friction.of_hand + joints + own
    for p in range(pair_count(problem) if near == 0.0 else 0):
        each = method.states[p]
        given = _mover(method, p), _surface(method, p), options
        count_linearisation(*given, world.found[p], count, each)
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return count


@jit_noinline
def _add_own(method: Free, h: int, world: Record) -> bool:
    """Add rows of a hand's own pairs that the step at hand would bring together; return whether one is new."""
    problem, each = world.problem, method.states[h]
    share, before = each.self_contact.share, problem.scratch
    for f in range(FINGER_COUNT):
        before[f] = share[f]
    if not add_rows(method.options.own, method.movers[h], BROKEN, method.options, each):
        return False
    for f in range(FINGER_COUNT):
        if before[f] > 0.0:
            problem.abduction_step[FINGER_COUNT * h + f] *= share[f] / before[f]
    return True


@jit
def _add_rows(method: Free, clipped: bool, state: Record) -> bool:
    """Add rows of pairs of hands' bodies that the step at hand would bring together; return whether one is new."""
    world = method.world[0]
    problem, met, own = world.problem, False, False
    if is_one(problem):
        return False
    if hand_count(problem) > 1 and may_meet(method.options.offset, method.states, world):
        met = add_meetings(method.movers, method.options, method.states, world)
        if is_still(problem):
            state.work[WORK_UNITS] += UNITS_ROUND
            for h in range(hand_count(problem)):
                each = method.states[h]
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
def _solve(method: Free, count: int, clipped: bool, state: Record, qp: QpWork) -> int:
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
    if state.work[WORK_LINEARISATIONS] <= SEARCHED and not clipped:
        rounds = begin_search(method.world[0].coulomb)
    status = solve_free(method.options, method.states, method.world[0], rounds, clipped, qp)
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    return status


@jit
def _take_back(method: Free) -> None:
    """Return to the last poses without penetration."""
    world = method.world[0]
    for p in range(pair_count(world.problem)):
        take_back(method.states[p])
        method.states[p].progress.failed_steps = 0
    world.apart = 0.0
    for k in range(thing_count(world.problem)):
        take_body_back(world.bodies[k])
    copy_values(world.safe_total[:], world.problem.total[:])
    copy_values(world.safe_abduction[:], world.problem.abduction_total[:])


@jit
def measure(method: Free) -> bool:
    """Compute the distances of each pair; False where they do not fit into the arrays."""
    fits = True
    for p in range(pair_count(method.world[0].problem)):
        arrays, its = _mover(method, p), _surface(method, p)
        fits = evaluate_pose(arrays, its, method.options, method.states[p]) and fits
        _measure_edges(method, p)
    method.states[0].progress.pairs_overflow = not fits
    return fits


@jit
def _retry(method: Free) -> bool:
    """Return to the last poses without penetration with a smaller trust radius; False where the pairs do not fit."""
    _take_back(method)
    for p in range(pair_count(method.world[0].problem)):
        method.states[p].trust.radius *= TRUST_DECAY
    return measure(method)


@recover.of(Free)
@jit
def _recover(method: Free, hand: HandArrays, surface: Any, state: Record) -> bool:
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


@jit
def _allowed(method: Free) -> tuple[float, float]:
    """Compute the share of the step that all pairs at hand vouch for, and how far the farthest mover goes in it [m]."""
    world = method.world[0]
    problem, fraction, longest = world.problem, 1.0, 0.0
    for p in range(pair_count(problem)):
        each = method.states[p]
        for f in range(FINGER_COUNT if problem.other[p] < 0 else 0):
            each.problem.abduction_step[f] = problem.abduction_step[FINGER_COUNT * problem.hand[p] + f]
        share, motion = allowed_fraction(_mover(method, p), method.options, each)
        world.longest[p] = motion
        fraction, longest = min(fraction, share), max(longest, motion)
    return min(fraction, share_of_meetings(method.states, world)), longest


@jit
def _clip_target(method: Free, only_restore: bool, state: Record) -> tuple[float, float]:
    """Bring a far target nearer, see `kernels.tick.step_length.clip_target`, which returns the same.

    The motions of hands and things are shortened alike: a hand that was short of its motion past the object alone would
    be carried along by it, for no force, and its springs drawn out by nobody. The targets are moved by what is taken
    off, so that springs and inertia pull as they did.
    """
    world = method.world[0]
    problem = world.problem
    fraction, longest = _allowed(method)
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
    for k in range(thing_count(world.problem)):
        body, column = world.bodies[k], thing_column(problem, k)
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
        # What this writes anew has not been turned to the frame of the first thing.
        object_columns(method.states, world.bodies, state.contacts, world.problem)


@solve_linearisation.of(Free)
@jit
def _solve_linearisation(
    method: Free, hand: HandArrays, surface: Any, done: int, state: Record, qp: QpWork
) -> tuple[int, float]:
    world = method.world[0]
    count, full_motion = _prepare(method, 0.0, state), WHOLE_TARGET
    if count < 0:
        return as_int64(OVERFLOW), full_motion
    status = _solve(method, count, as_bool(False), state, qp)
    if status == OPTIMAL and (count > 0 or world.problem.dense_rows > 0):
        full_motion, share = _clip_target(method, only_restores(method.options, state, done), state)
        if full_motion != WHOLE_TARGET:
            status = _solve(method, count, as_bool(True), state, qp)
            two = hand_count(world.problem) > 1 and not is_still(world.problem)
            if status == OPTIMAL and two and _allowed(method)[0] < LEAST_SHARE:
                # A contact that is reached with the whole step has no load on a part of the way: what it bore would
                # draw the hand all the way there, and a small share of that mends no clearance.
                _write_anew(method, state)
                world.problem.share = share
                status = _solve(method, count, as_bool(True), state, qp)
    return status, full_motion


@jit
def _table(method: Free) -> tuple[float, int, int]:
    """Compute the distance [m] of things and table; also returns the lowest thing, and its lowest point."""
    world = method.world[0]
    least, thing, lowest = np.inf, as_int64(0), as_int64(-1)
    for k in range(thing_count(world.problem)):
        body = world.bodies[k]
        body.measured_distance = np.inf
        if body.has_table == 1:
            distance, point = table_distances(body, method.supports[k])
            body.measured_distance = distance
            if distance < least:
                least, thing, lowest = distance, as_int64(k), point
    return least, thing, lowest


@jit_noinline
def _find_loads(method: Free, state: Record) -> None:
    """Find the forces of the solution on things and hands."""
    world, states = method.world[0], method.states
    problem, contacts = world.problem, state.contacts
    find_borne(states, world.bodies, contacts, problem, world.friction, world.loaded, world.tried)
    if hand_count(problem) > 1:
        bear_meetings(states, world)
    for h in range(0 if is_one(problem) else hand_count(problem)):
        bear_own(method.options.own, states[h], as_int64(h), problem)


@jit
def _move_all(method: Free, fraction: float, state: Record) -> None:
    """Make a share of the step of hands and things, and find what bears it."""
    world = method.world[0]
    problem, bodies, states = world.problem, world.bodies, method.states
    for j in range(variable_count(problem)):
        problem.total[j] += fraction * problem.delta[j]
    for f in range(FINGER_COUNT * hand_count(problem)):
        problem.abduction_total[f] += fraction * problem.abduction_step[f]
    _find_loads(method, state)
    # What comes next in the tick is added to it in the frame of each thing as it then stands.
    first = thing_column(problem, as_int64(0))
    for h in range(hand_count(problem)):
        palm = palm_column(problem, h)
        for j in (palm, palm + 3):
            turn_back(bodies[0], problem.delta[first : first + OBJECT_DOF], fraction, problem.total[j : j + 3])
    for k in range(thing_count(problem)):
        j = thing_column(problem, k)
        turn_back(bodies[k], problem.delta[j : j + OBJECT_DOF], fraction, problem.total[j : j + 3])
    if 0.0 < fraction < 1.0:
        take_steps(states, bodies, fraction, problem)
    for p in range(pair_count(problem)):
        each = states[p]
        move(each.pose, each.step.delta, each.problem.abduction_step, fraction)
    for k in range(thing_count(problem)):
        j = thing_column(problem, k)
        move_body(bodies[k], problem.delta[j : j + OBJECT_DOF], fraction)


@jit
def _keep(world: Record) -> None:
    """Keep the things' poses, and what bears them, as those of an accepted step."""
    problem = world.problem
    for k in range(thing_count(problem)):
        keep_body(world.bodies[k])
        world.bodies[k].table_distance = world.bodies[k].measured_distance
    copy_values(problem.total[:], world.safe_total[:])
    copy_values(problem.abduction_total[:], world.safe_abduction[:])
    world.tried.residual = problem.gamma_error
    copy_borne(world.tried, world.borne)


@advance.of(Free)
@jit
def _advance(method: Free, hand: HandArrays, surface: Any, full_motion: float, state: Record) -> bool:
    """Make the step as far as the pairs at hand vouch for, and judge it by the true distances and the table's."""
    world = method.world[0]
    began = monotonic_ns()
    options, problem, progress, states = method.options, world.problem, state.progress, method.states
    pairs = pair_count(problem)
    for p in range(pairs):
        for f in range(FINGER_COUNT if problem.other[p] < 0 else 0):
            clamp_to_limits(_mover(method, p), states[p].pose, f, states[p].step.delta[:])
    fraction, longest = _allowed(method)
    _move_all(method, fraction, state)
    least = np.inf
    for p in range(pairs):
        motion = world.longest[p]
        # Where nothing else moves as of a hand alone, see `kernels.tick.tick`.
        foreseen = REACH_FLOOR * max(options.step_tolerance, motion)
        if not is_still(problem):
            foreseen = max(REACH_FLOOR * options.step_tolerance, motion)
        update_reach(options, fraction, motion, full_motion, foreseen, states[p])
    fits = measure(method)
    for p in range(pairs):
        least = min(least, least_distance(states[p]))
    if hand_count(problem) > 1 and not stay_apart(fraction, states, world):
        apart = measure_hands(method.movers, states, world)
        least = min(least, apart - world.kept_apart if world.kept_apart >= -DEEP else 0.0)
    table, thing, lowest = _table(method)
    if table < 0.0:
        keep_entry(thing, lowest, world.friction)
    done = False
    if not fits:
        progress.lag = max(full_motion, longest) - fraction * longest
        done = True
    elif least >= 0.0 and table >= 0.0:
        _keep(world)
        if world.kept_apart < 0.0:
            world.kept_apart = min(world.apart, 0.0)
        done = held = joints_hold(states, world.bodies, problem)
        for p in range(pairs):
            done = accept(options, fraction, world.longest[p], full_motion, states[p]) and done
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
    count = _prepare(method, near, state)
    if count >= 0 and _solve(method, count, as_bool(False), state, qp) == OPTIMAL:
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
def _finish_tick(method: Free, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
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
            _see_haptic(_mover(method, p), world, p, each)
        world.status[p] = tick_status(cut_short, as_bool(False), each)
        if pairs_overflow:
            world.status[p] |= STATUS_CAPACITY_EXCEEDED
        if p >= hand_count(problem):
            # A thing that has distance still to go past another one has it whatever the hand has.
            world.status[0] |= world.status[p] & STATUS_LAG
    if progress.is_accepted:
        for k in range(thing_count(problem)):
            take_velocity(bodies[k])
    else:
        borne.count = 0
        borne.residual = 0.0
        borne.bare = 0.0
        borne.hand_wrench[:] = 0.0
        borne.table_wrench[:] = 0.0
        borne.thing_wrench[:] = 0.0
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
                given = _surface(method, p), _mover(method, p), states[p].candidates
                _, near = pairs_near(*given, options.touch)
                each.work[WORK_TOUCHING] += near
        if options.force_model == FORCE_PAPER:
            shown = _surface(method, h), _mover(method, h), each.pose, each.candidates
            find_contacts(*shown, options.touch, each.contacts)
        detected = monotonic_ns()
        turn_loads(bodies[0], each.active)
        hand_forces(options, each)
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
def _tick(method: Free, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
    """Take the user's hands, which are the world's, and converge; they are then as the object sees them."""
    world = method.world[0]
    for h in range(hand_count(world.problem)):
        each = method.states[h]
        if each.input.is_valid:
            copy_values(each.haptic.position[:], world.palm_position[h])
            copy_values(each.haptic.orientation[:], world.palm_orientation[h])
    return converge(method, hand, surface, state, qp)


@begin_motion.of(Free)
@jit
def _begin_motion(method: Free, hand: HandArrays, surface: Any, state: Record) -> None:
    """Let the things go on by their velocity and their weight."""
    world = method.world[0]
    problem = world.problem
    _place_pairs(method)
    begin_joints(method.states, world.bodies, problem)
    for p in range(1, pair_count(problem)):
        begin_tick(method.options, method.states[p])
    for k in range(thing_count(world.problem)):
        predict(world.bodies[k])
        keep_body(world.bodies[k])
    copy_values(world.safe_total[:], problem.before[:])
    copy_values(world.safe_abduction[:], problem.before_abduction[:])
    problem.total[:] = 0.0
    problem.abduction_total[:] = 0.0
    problem.solutions = 0
    world.friction.entries[:] = 0
    world.safe_total[:] = 0.0
    world.safe_abduction[:] = 0.0


@jit
def rebuild(method: Free, states: States) -> bool:
    """Take the poses of hands and things as they now stand, as each sees what is near; returns whether pairs fit."""
    world = method.world[0]
    fits = True
    world.apart = 0.0
    _place_pairs(method)
    _table(method)
    for k in range(thing_count(world.problem)):
        world.bodies[k].table_distance = world.bodies[k].measured_distance
    for p in range(pair_count(world.problem)):
        given = _mover(method, p), _surface(method, p), method.options
        fits = rebuild_candidates(*given, states[p : p + 1]) and fits
        if p >= hand_count(world.problem):
            # A hand's own pairs are looked at in its first pair alone.
            states[p].self_contact.floor = states[p].self_contact.least = np.inf
        _measure_edges(method, p)
    return fits


@jit
def run_many(
    method: Free,
    states: States,
    qp: QpWork,
    haptic: tuple[HapticBlock, ...],
    record: tuple[TickRecord, ...],
    object_record: Any,
    driven: Array,
) -> int:
    """Run one tick for each row of the haptic inputs of the hands, as `kernels.tick.block.run_block` does of one.

    `driven` has position [m] and orientation of each thing's centre at each tick, (K, B, 7), read of driven ones.
    """
    world = method.world[0]
    state = states[0]
    hands = hand_count(world.problem)
    for i in range(haptic[0].position.shape[0]):
        cpu = thread_cpu_ns()
        wall = monotonic_ns()
        for h in range(hands):
            given = haptic[h]
            world.taken[h] = set_haptic(
                method.movers[h],
                given.position[i],
                given.orientation[i],
                given.flexion[i],
                given.abduction[i],
                states[h],
            )
        for k in range(thing_count(world.problem)):
            if world.bodies[k].is_driven == 1:
                drive_body(world.bodies[k], driven[k, i])
        tick(method, method.movers[0], method.surfaces[0], state, qp)
        wall = monotonic_ns() - wall
        cpu = thread_cpu_ns() - cpu
        for h in range(hands):
            record_tick(states[h], world.taken[h] | world.status[h], wall, cpu, i, record[h])
        record_object(object_record, method, i)
        if world.status[0] & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return haptic[0].position.shape[0]
