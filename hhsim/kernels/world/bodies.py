"""What bodies that move add to a tick: their own motion, the frames that go with them, friction, table and joints.

The tick of `kernels.world.tick` asks for it by `do_bodies`, stage by stage. A scene in which all bodies stand still has
and compiles none of it.
"""

import numpy as np

from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY
from hhsim.kernels.hand.pose import update_kinematics
from hhsim.kernels.jit import Record, as_bool, as_int64, jit
from hhsim.kernels.memory import copy_values
from hhsim.kernels.rotation import turned_back
from hhsim.kernels.tick.state import WORK_LINEARISATIONS
from hhsim.kernels.tick.tick import begin_tick
from hhsim.kernels.world.body import (
    OBJECT_DOF,
    along_axis,
    body_target,
    body_to_world,
    keep_body,
    move_body,
    predict,
    restore_body,
    take_velocity,
    turn_back,
    world_to_body,
)
from hhsim.kernels.world.columns import object_columns, variable_count
from hhsim.kernels.world.edges import measure_edges, record_edges
from hhsim.kernels.world.joints import begin_joints, has_joint_rows, joints_hold
from hhsim.kernels.world.pairs import (
    AIMED,
    LEAST_RAISE,
    MOST_DAMPING,
    MOST_RAISES,
    STAGE,
    World,
    begin_bounds,
    beyond_bound,
    damp,
    mark_snap,
    mover_of,
    take_hands,
)
from hhsim.kernels.world.program import SEARCHED, clip_shifts, take_steps
from hhsim.kernels.world.record import clear_contact_forces, find_contact_forces, turn_loads
from hhsim.kernels.world.rows import begin_frictions, find_frictions
from hhsim.kernels.world.support import find_table_contacts, keep_entry, keep_lowest, table_distances

CLOSE = 20.0
FLOATS = 2.0
"""Contacts up to CLOSE offsets, plus FLOATS times the residual of Γ of the tick before, have rows of friction."""


@jit
def _measure_edges(method: World) -> None:
    """Measure the edges of pairs in which two bodies meet, after their other distances."""
    world, options = method.world[0], method.options
    problem = world.problem
    for p in range(problem.hands, problem.pairs):
        each, other, number = method.states[p], problem.other[p], problem.body[p]
        # Each two bodies meet in two pairs: their edges once.
        if not 0 <= other < number or each.modelled[PALM_BODY] == 0:
            continue
        far, center = options.margin + options.skin, world.bodies[number].center[:]
        mover, edges, others = method.movers[problem.hands + other], method.edges[other], method.edges[number]
        measure_edges(mover, edges, others, center, far, each, method.edge_pairs[p])


@jit
def _record_edges(method: World, p: int) -> None:
    """Add a pair's edges within reach to its contact records, if two bodies meet in it."""
    each, problem = method.states[p], method.world[0].problem
    other, number = problem.other[p], problem.body[p]
    if 0 <= other < number and each.modelled[PALM_BODY] == 1:
        record_edges(
            method.edges[number], min(each.trust.reach, each.trust.radius), method.edge_pairs[p], each.contacts
        )


@jit
def _place_pairs(method: World) -> None:
    """Place what moves in each pair but the first ones where it is: there it was moved along, step by step."""
    world = method.world[0]
    problem, bodies, scratch = world.problem, world.bodies, world.problem.scratch
    for p in range(problem.hands, problem.pairs):
        each, other = method.states[p], problem.other[p]
        pose = each.pose
        if other >= 0:
            copy_values(bodies[other].position[:], scratch[0:3])
            copy_values(bodies[other].orientation[:], pose.orientation[:])
        else:
            first = method.states[problem.hand[p]].pose
            body_to_world(bodies[0], first.position[:], first.orientation[:], scratch[0:3], pose.orientation[:])
            copy_values(first.flexion[:], pose.flexion[:])
            copy_values(first.abduction[:], pose.abduction[:])
        turn_here = world.scratch_turn
        copy_values(pose.orientation[:], turn_here[:])
        world_to_body(bodies[problem.body[p]], scratch[0:3], turn_here[:], pose.position[:], pose.orientation[:])
        update_kinematics(mover_of(method, p), pose)


@jit
def _measure_table(method: World) -> tuple[float, int, int]:
    """Compute the distance [m] of bodies and table; also returns the lowest body, and its lowest point."""
    world = method.world[0]
    least, number, lowest = np.inf, as_int64(0), as_int64(-1)
    for k in range(world.problem.bodies):
        body = world.bodies[k]
        body.measured_distance = np.inf
        if body.has_table == 1:
            distance, point = table_distances(body, method.supports[k])
            body.measured_distance = distance
            if distance < least:
                least, number, lowest = distance, as_int64(k), point
    return least, number, lowest


@jit
def _begin_tick(method: World) -> None:
    """Take the user's hands, and let the bodies go on by their velocity and their weight."""
    world = method.world[0]
    problem = world.problem
    take_hands(method.states, world)
    _place_pairs(method)
    begin_joints(method.states, world)
    for p in range(problem.pairs):
        begin_tick(method.options, method.states[p])
    begin_bounds(method.options, method.states, world)
    for k in range(problem.bodies):
        predict(world.bodies[k])
        keep_body(world.bodies[k])
    variables = variable_count(problem)
    copy_values(world.safe_total[:variables], problem.before[:variables])
    copy_values(world.safe_abduction[:], problem.before_abduction[:])
    problem.total[:variables] = 0.0
    problem.abduction_total[:] = 0.0
    world.friction.entries[:] = 0
    world.safe_total[:variables] = 0.0
    world.safe_abduction[:] = 0.0


@jit
def _transform_hands(method: World) -> None:
    """Take the user's hands to the frame of the first body."""
    world = method.world[0]
    for h in range(world.problem.hands):
        haptic = method.states[h].haptic
        place, turn = world.palm_position[h], world.palm_orientation[h]
        world_to_body(world.bodies[0], place, turn, haptic.position[:], haptic.orientation[:])


@jit
def _set_targets(method: World) -> None:
    """Find where hands and bodies want to go, and how the frame of the first body is turned to that of each pair's."""
    world = method.world[0]
    problem, bodies = world.problem, world.bodies
    base = bodies[0].rotation
    for p in range(problem.hands, problem.pairs):
        own = bodies[problem.body[p]].rotation
        for j in range(3):
            x, y, z = turned_back(own, base[0, j], base[1, j], base[2, j])
            problem.turn[p, 0, j], problem.turn[p, 1, j], problem.turn[p, 2, j] = x, y, z
    _transform_hands(method)
    for k in range(problem.bodies):
        body_target(bodies[k], problem.body_target[OBJECT_DOF * k : OBJECT_DOF * k + OBJECT_DOF])
        bodies[k].clipped[:] = 0.0


@jit
def _write_columns(method: World) -> int:
    """Write the bodies' columns, and find the contacts with friction or the table; return how many rows these add."""
    world, state, options = method.world[0], method.states[0], method.options
    problem, bodies, friction = world.problem, world.bodies, world.friction
    object_columns(method.states, world)
    # A contact floats by what Γ was short of its slip, and goes on rubbing.
    close = CLOSE * options.offset + FLOATS * world.contact_forces[world.accepted].residual
    find_frictions(world, state.contacts, close)
    joints = as_int64(0)
    for k in range(problem.bodies):
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
    begin_frictions(method.states, world, step, abduction, turns)
    return as_int64(friction.count - friction.of_hand + joints)


@jit
def _clip_targets(method: World, fraction: float) -> None:
    """Leave the bodies' targets, and Γ, a fraction of their steps."""
    world = method.world[0]
    problem, off = world.problem, 1.0 - fraction
    for k in range(problem.bodies):
        body, column = world.bodies[k], problem.column[k]
        for j in range(OBJECT_DOF):
            body.clipped[j] = off * problem.delta[column + j]
            problem.body_target[OBJECT_DOF * k + j] -= body.clipped[j]
    clip_shifts(fraction, world.friction)


@jit
def _move_bodies(method: World, fraction: float) -> None:
    """Move the bodies by a share of their step, give the hands theirs past them, and find what bears both."""
    world = method.world[0]
    problem, bodies, total, delta = world.problem, world.bodies, world.problem.total, world.problem.delta
    for k in range(problem.bodies):
        body, j = bodies[k], problem.column[k]
        if body.joint > 0:
            # The whole way: what a clipped program leaves out, the next one makes.
            body.joint_motion = along_axis(body, total[j:]) + along_axis(body, delta[j:])
            body.joint_motion += along_axis(body, body.clipped[:])
    for j in range(variable_count(problem)):
        total[j] += fraction * delta[j]
    for h in range(problem.hands):
        for f in range(FINGER_COUNT):
            problem.abduction_total[FINGER_COUNT * h + f] += fraction * method.states[h].problem.abduction_step[f]
    find_contact_forces(method.states, world)
    # What comes next in the tick is added to it in the frame of each body as it then stands.
    first = problem.column[0]
    for h in range(problem.hands):
        palm = problem.palm[h]
        for j in (palm, palm + 3):
            turn_back(bodies[0], delta[first : first + OBJECT_DOF], fraction, total[j : j + 3])
    for k in range(problem.bodies):
        j = problem.column[k]
        turn_back(bodies[k], delta[j : j + OBJECT_DOF], fraction, total[j : j + 3])
    if 0.0 < fraction < 1.0:
        take_steps(method.states, bodies, fraction, problem)
    for k in range(problem.bodies):
        j = problem.column[k]
        move_body(bodies[k], delta[j : j + OBJECT_DOF], fraction)


@jit
def _accept_step(world: Record) -> None:
    """Keep the bodies' poses, and what bears them, as those of an accepted step."""
    problem = world.problem
    for k in range(problem.bodies):
        keep_body(world.bodies[k])
        world.bodies[k].table_distance = world.bodies[k].measured_distance
    variables = variable_count(problem)
    copy_values(problem.total[:variables], world.safe_total[:variables])
    copy_values(problem.abduction_total[:], world.safe_abduction[:])
    world.accepted = 1 - world.accepted
    world.contact_forces[world.accepted].residual = problem.gamma_error


@jit
def _restore_poses(world: Record) -> None:
    """Return to the bodies' last poses without penetration."""
    for k in range(world.problem.bodies):
        restore_body(world.bodies[k])
    variables = variable_count(world.problem)
    copy_values(world.safe_total[:variables], world.problem.total[:variables])
    copy_values(world.safe_abduction[:], world.problem.abduction_total[:])


@jit
def _damp_hands(method: World, state: Record) -> float:
    """Damp hands that are beyond their bound; 1 if the program is then to be solved anew from the safe poses."""
    world, options = method.world[0], method.options
    ratio = beyond_bound(method.states, world)
    can_raise = world.raises < MOST_RAISES and world.damping < MOST_DAMPING
    programs, progress = state.work[WORK_LINEARISATIONS], state.progress
    # A tick that ended without a step would stop the bodies.
    left, needed = options.linearisations - programs, 2 if progress.is_accepted else programs - progress.restarted
    if ratio <= 1.0 or not can_raise or left < needed:
        return 0.0
    # A motion of so many bounds becomes shorter than the bound.
    factor = max(LEAST_RAISE, ratio / AIMED)
    damp(method.states, world, min(MOST_DAMPING, (1.0 + world.damping) * factor - 1.0))
    world.raises += 1
    progress.restarted = programs
    return 1.0


@jit
def _end_tick(method: World) -> None:
    """Take velocities and forces on hands, none where no step was accepted, and see the user's hands from here."""
    world, accepted = method.world[0], method.states[0].progress.is_accepted
    problem = world.problem
    if not accepted:
        clear_contact_forces(problem.bodies, world.contact_forces[world.accepted])
    for k in range(problem.bodies if accepted else 0):
        take_velocity(world.bodies[k])
    _transform_hands(method)
    for h in range(problem.hands):
        each = method.states[h]
        each.active.count = each.active.count if accepted else 0
        turn_loads(world.bodies[0], each.active)
        update_kinematics(mover_of(method, h), each.haptic)


@jit
def do_bodies(method: World, asked: int, value: float) -> float:
    """Do one stage of a tick for the bodies, with a share of the step, a distance or the number of a pair.

    Returns a distance [m], a number of rows, or 1 for yes; else 0.
    """
    world, state, p = method.world[0], method.states[0], as_int64(int(value))
    problem = world.problem
    if asked == STAGE.BEGIN_TICK:
        _begin_tick(method)
    elif asked == STAGE.PLACE_PAIRS:
        _place_pairs(method)
        _measure_table(method)
        for k in range(problem.bodies):
            world.bodies[k].table_distance = world.bodies[k].measured_distance
    elif asked == STAGE.MEASURE_EDGES:
        _measure_edges(method)
    elif asked == STAGE.SET_TARGETS:
        _set_targets(method)
    elif asked == STAGE.RECORD_EDGES:
        _record_edges(method, p)
    elif asked == STAGE.KEEP_LOWEST:
        keep_lowest(method.states[p].contacts, method.states[p].open_distance[:], world.friction)
    elif asked == STAGE.WRITE_COLUMNS:
        return float(_write_columns(method))
    elif asked == STAGE.REWRITE_COLUMNS:
        object_columns(method.states, world)
    elif asked == STAGE.CLIP_TARGETS:
        _clip_targets(method, value)
    elif asked == STAGE.TAKE_STEPS:
        take_steps(method.states, world.bodies, 1.0, problem)
    elif asked == STAGE.MOVE_BODIES:
        _move_bodies(method, value)
    elif asked == STAGE.MEASURE_TABLE:
        table, number, lowest = _measure_table(method)
        if table < 0.0:
            keep_entry(number, lowest, world.friction)
        return table
    elif asked == STAGE.DAMP_HANDS:
        return _damp_hands(method, state)
    elif asked == STAGE.ACCEPT_STEP:
        _accept_step(world)
        return 1.0 if joints_hold(method.states, world) else 0.0
    elif asked == STAGE.RESTORE_POSES:
        _restore_poses(world)
    elif asked == STAGE.END_TICK:
        _end_tick(method)
    elif asked == STAGE.MARK_SNAP:
        mark_snap(method.states[p], world)
    return 0.0
