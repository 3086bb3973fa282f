"""Record of the ticks of free objects: their motion, the forces on them, and the contacts that bear them."""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.arithmetic import hypotenuse
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.hand.kinematics import BODY_COUNT
from hhsim.kernels.jit import Array, Indices, Record, Triple, as_int64, jit, jit_noinline
from hhsim.kernels.memory import copy_values
from hhsim.kernels.rotation import turned, turned_back
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.kernels.world.body import HINGE, OBJECT_DOF
from hhsim.kernels.world.columns import States, body_of, coefficient, other_of, relative_motion, torsion_radius
from hhsim.kernels.world.joints import JOINT_KEYS, PAIR_JOINT_KIND, PAIR_JOINT_ROWS, free_value
from hhsim.kernels.world.rows import DIRECTIONS, TABLE_KEYS

STICKS = 1e-9
"""A contact that slips by no more than this in a tick [m] sticks."""


@cache
def contact_forces_dtype(bodies: int) -> "np.dtype[Any]":
    """Build the dtype of the contacts that bear a force, each in the frame of its body."""
    return np.dtype(
        [
            ("count", np.int64),
            # its row or place among the contacts with friction, to put together what several rows bear
            ("contact", np.int64, (ACTIVE_CAPACITY,)),
            ("contact_code", np.int64, (ACTIVE_CAPACITY,)),  # see `kernels.world.columns.body_of`
            ("point", np.float64, (ACTIVE_CAPACITY, 3)),  # [m]
            # from the body to what touches it, of the table from the table to the body
            ("normal", np.float64, (ACTIVE_CAPACITY, 3)),
            ("normal_force", np.float64, (ACTIVE_CAPACITY,)),  # on what touches it, of the table on the body [N]
            ("friction_force", np.float64, (ACTIVE_CAPACITY, 3)),  # tangential force [N]
            ("torsional_moment", np.float64, (ACTIVE_CAPACITY,)),  # about the normal [N·m]
            ("slip", np.float64, (ACTIVE_CAPACITY,)),  # tangential way of the contact in the tick [m]
            ("lever", np.float64, (ACTIVE_CAPACITY, 3)),  # point from the centre of another body, in its frame [m]
            # of hands on each body: force [N], moment about its centre of mass [N·m]
            ("hand_wrench", np.float64, (bodies, 6)),
            ("table_wrench", np.float64, (bodies, 6)),  # the same of the table
            ("body_wrench", np.float64, (bodies, 6)),  # and of the other bodies
            # the most by which the slip that friction is balanced against is off the slip of a contact here [m]
            ("residual", np.float64),
            # the most that a contact slips that bears a force without rows of friction: it came from too far [m]
            ("frictionless_slip", np.float64),
        ],
        align=True,
    )


@by_reference
class WorldRecord(NamedTuple):
    """Results of a block of B ticks for K bodies, world: motion and wrenches of each, and the contacts in rows.

    The shapes are those of `hhsim.result.schema.body_fields`.
    """

    turn: Array  # body's frame to the world, at the end of the tick: x ↦ turn · x + shift, (K, B, 4)
    shift: Array  # [m], (K, B, 3)
    velocity: Array  # of the centre of mass [m/s], (K, B, 3)
    angular_velocity: Array  # [rad/s], (K, B, 3)
    hand_wrench: Array  # of the hands on the body: force [N], moment about its centre [N·m], (K, B, 6)
    table_wrench: Array  # likewise of the table
    body_wrench: Array  # likewise of the other bodies
    table_distance: Array  # lowest point above the table [m], infinite without one, (K, B)
    friction_residual: Array  # of the first body: larger of `residual` and `frictionless_slip` [m], (K, B)
    contact: Indices  # first contact of each tick, and the end of the last one's, (B + 1,)
    # What touches the body: 16 h + b for hand body b of hand h, -1 for the table, -2 - k for body k, (rows,)
    body: Indices
    point: Array  # at the end of the tick [m], (rows, 3)
    normal: Array  # from the body to what touches it; of the table, from the table to the body, (rows, 3)
    normal_force: Array  # on what touches the body; of the table, on the body [N], (rows,)
    friction_force: Array  # tangential force on the same [N], (rows, 3)
    torsional_moment: Array  # about the normal [N·m], (rows,)
    slip: Array  # tangential way of the contact in the tick [m], (rows,)
    contact_body: Indices  # body that is touched, (rows,)
    other_point: Array  # point as it goes with the other body [m], (rows, 3)

    @property
    def bodies(self) -> tuple["WorldRecord", ...]:
        """Record of each body: its own motion and wrenches, without the axis of bodies, and all contacts."""
        moving = self._fields.index("contact")
        return tuple(WorldRecord(*own, *self[moving:]) for own in zip(*self[:moving]))


@jit
def _push(r: Triple, m: Triple, size: float, turn: float, n: Any, wrench: Array) -> None:
    # Add a force along m at a point by its place from the centre, and a moment along n, to the wrench on a body.
    rx, ry, rz = r
    mx, my, mz = m
    wrench[0] += size * mx
    wrench[1] += size * my
    wrench[2] += size * mz
    wrench[3] += size * (ry * mz - rz * my) + turn * n[0]
    wrench[4] += size * (rz * mx - rx * mz) + turn * n[1]
    wrench[5] += size * (rx * my - ry * mx) + turn * n[2]


@jit
def _add_hand_force(states: States, problem: Record, contact_code: int, force: float, p: Array, m: Triple) -> None:
    # Add a force to those on a hand, which are in the frame of the first body.
    pair = contact_code // BODY_COUNT
    hand = problem.hand[pair]
    x, y, z = p[0], p[1], p[2]
    mx, my, mz = m
    if problem.body[pair] > 0:
        near, far, turn = states[pair].pose, states[hand].pose, problem.turn[pair]
        x, y, z = turned_back(turn, x - near.position[0], y - near.position[1], z - near.position[2])
        x, y, z = x + far.position[0], y + far.position[1], z + far.position[2]
        mx, my, mz = turned_back(turn, mx, my, mz)
    active = states[hand].warm
    place = active.count
    active.key[place] = 0
    active.body[place] = contact_code % BODY_COUNT
    active.multiplier[place] = force
    active.point[0, place], active.point[1, place], active.point[2, place] = x, y, z
    active.normal[0, place], active.normal[1, place], active.normal[2, place] = mx, my, mz
    active.count += 1


@jit_noinline
def _add_joint_forces(states: States, world: Record, forces: Record) -> None:
    """Add the loads of rows of joints of two free bodies to the wrenches on both."""
    bodies, problem, loaded = world.bodies, world.problem, world.loaded
    for i in range(loaded.count):
        row, force = loaded.row[i], loaded.multiplier[i]
        if problem.kind[row] != PAIR_JOINT_KIND:
            continue
        number = JOINT_KEYS - problem.key[row]
        k, r = number // PAIR_JOINT_ROWS, number % PAIR_JOINT_ROWS
        pair = bodies[k].pair
        value = free_value(bodies[k]) if r // 2 == OBJECT_DOF else r // 2
        number, pose, p = problem.body[pair], states[pair].pose, bodies[k].joint_origin
        e = bodies[k].joint_axes[value % 3]
        size = force if r % 2 == 0 else -force
        along = size if value < 3 else 0.0
        center, place, turn, m = bodies[number].center, pose.position, pose.rotation, (e[0], e[1], e[2])
        away = (p[0] - center[0], p[1] - center[1], p[2] - center[2])
        _push(away, m, -along, along - size, m, forces.body_wrench[number])
        m = turned_back(turn, e[0], e[1], e[2])
        away = turned_back(turn, p[0] - place[0], p[1] - place[1], p[2] - place[2])
        _push(away, m, along, size - along, m, forces.body_wrench[k])


@jit
def clear_contact_forces(bodies: int, forces: Record) -> None:
    """Remove all contacts, and the wrenches on so many bodies."""
    forces.count = 0
    forces.residual = forces.frictionless_slip = 0.0
    for k in range(bodies):
        for j in range(OBJECT_DOF):
            forces.hand_wrench[k, j] = forces.table_wrench[k, j] = forces.body_wrench[k, j] = 0.0


@jit
def find_contact_forces(states: States, world: Record) -> None:
    """Write the loads of the rows: as forces on each hand in its `warm`, and contact by contact."""
    bodies, problem, friction, loaded = world.bodies, world.problem, world.friction, world.loaded
    contacts, forces = states[0].contacts, world.contact_forces[1 - world.accepted]
    clear_contact_forces(problem.bodies, forces)
    count = as_int64(0)
    for p in range(problem.pairs):
        states[p].warm.count = 0
    _add_joint_forces(states, world, forces)
    for i in range(loaded.count):
        row = loaded.row[i]
        force = loaded.multiplier[i]
        owner, kind = problem.owner[row], problem.kind[row]
        if TABLE_KEYS < problem.key[row] < 0 or force <= 0.0:
            continue
        contact = owner if owner >= 0 else -1 - row
        place = as_int64(-1)
        for j in range(count):
            if forces.contact[j] == contact:
                place = as_int64(j)
        if place < 0:
            place = count
            count += 1
            forces.contact[place] = contact
            forces.normal_force[place] = forces.torsional_moment[place] = forces.slip[place] = 0.0
            for j in range(3):
                forces.friction_force[place, j] = 0.0
                forces.point[place, j] = friction.point[owner, j] if owner >= 0 else contacts.point[j, row]
                forces.normal[place, j] = friction.normal[owner, j] if owner >= 0 else contacts.normal[j, row]
            forces.contact_code[place] = friction.contact_code[owner] if owner >= 0 else contacts.body[row]
        contact_code = forces.contact_code[place]
        number, other = body_of(problem, contact_code), other_of(problem, contact_code)
        n, p = forces.normal[place], forces.point[place]
        mx, my, mz = n[0], n[1], n[2]
        forces.normal_force[place] += force
        moment = 0.0
        if kind > 0:
            e = (kind - 1) % DIRECTIONS
            sign = -1.0 if kind <= DIRECTIONS else 1.0
            push = sign * coefficient(world, contact_code)
            t = friction.along[owner, e]
            mx, my, mz = mx + push * t[0], my + push * t[1], mz + push * t[2]
            for j in range(3):
                forces.friction_force[place, j] += force * push * t[j]
            moment = sign * torsion_radius(world, contact_code) * friction.about[owner, e] * force
            forces.torsional_moment[place] += moment
        m, center = (mx, my, mz), bodies[number].center
        r = (p[0] - center[0], p[1] - center[1], p[2] - center[2])
        if contact_code < 0:
            _push(r, m, force, moment, n, forces.table_wrench[number])
        elif other >= 0:
            pose = states[contact_code // BODY_COUNT].pose
            _push(r, m, -force, -moment, n, forces.body_wrench[number])
            r = turned_back(pose.rotation, p[0] - pose.position[0], p[1] - pose.position[1], p[2] - pose.position[2])
            forces.lever[place, 0], forces.lever[place, 1], forces.lever[place, 2] = r
            _push(r, turned_back(pose.rotation, mx, my, mz), force, 0.0, n, forces.body_wrench[other])
        else:
            _push(r, m, -force, -moment, n, forces.hand_wrench[number])
            _add_hand_force(states, problem, contact_code, force, p, m)
    forces.count = count
    for i in range(count):
        p, n, contact_code = forces.point[i], forces.normal[i], forces.contact_code[i]
        way, spread = problem.total[:], problem.abduction_total[:]
        x, y, z, wx, wy, wz = relative_motion(states, world, spread, way, contact_code, p)
        along = x * n[0] + y * n[1] + z * n[2]
        x, y, z = x - along * n[0], y - along * n[1], z - along * n[2]
        forces.slip[i] = math.sqrt(x * x + y * y + z * z)
        contact = forces.contact[i]
        if contact < 0 or friction.has_friction[contact] == 0:
            mu, radius = coefficient(world, contact_code), torsion_radius(world, contact_code)
            spin = radius * (wx * n[0] + wy * n[1] + wz * n[2]) if radius > 0.0 else 0.0
            forces.frictionless_slip = max(forces.frictionless_slip, hypotenuse(mu * forces.slip[i], spin))


@jit
def _out(body: Record, vector: Array, vector_out: Array) -> None:
    # Forces are in the directions that the object had when they were solved for.
    vector_out[0], vector_out[1], vector_out[2] = turned(body.pushed, vector[0], vector[1], vector[2])


@jit
def turn_loads(body: Record, active: Record) -> None:
    """Take the directions of the forces on the hand to the object's frame at the end of the tick."""
    normal = active.normal
    for i in range(active.count):
        x, y, z = turned(body.pushed, normal[0, i], normal[1, i], normal[2, i])
        normal[0, i], normal[1, i], normal[2, i] = turned_back(body.rotation, x, y, z)


@jit
def _record_wrench(body: Record, wrench: Array, wrench_out: Array) -> None:
    # Of a hinged body it is about the hinge, and goes to the centre of mass.
    if body.joint == HINGE:
        x, y, z = wrench[0], wrench[1], wrench[2]
        rx, ry, rz = body.lever[0], body.lever[1], body.lever[2]
        wrench[3] -= ry * z - rz * y
        wrench[4] -= rz * x - rx * z
        wrench[5] -= rx * y - ry * x
    for half in range(2):
        _out(body, wrench[3 * half : 3 * half + 3], wrench_out[3 * half : 3 * half + 3])


@jit
def _record_point(body: Record, place: Array, point_out: Array) -> None:
    # A point by its place from the centre, object's frame, goes with the centre of mass to the end of the tick.
    lever = body.lever
    for j in range(3):
        place[j] -= lever[j]
    _out(body, place, point_out)
    x, y, z = turned(body.rotation, lever[0], lever[1], lever[2])
    point_out[0] += body.position[0] + x
    point_out[1] += body.position[1] + y
    point_out[2] += body.position[2] + z


@jit
def record_bodies(record: WorldRecord, world: Record, i: int) -> None:
    """Copy what became of the bodies in the last tick to row i of their record."""
    forces, problem, bodies = world.contact_forces[world.accepted], world.problem, world.bodies
    for t in range(problem.bodies):
        body, shift, rate = bodies[t], record.shift[t, i], record.angular_velocity[t, i]
        copy_values(body.orientation[:], record.turn[t, i])
        x, y, z = turned(body.rotation, body.center[0], body.center[1], body.center[2])
        shift[0], shift[1], shift[2] = body.position[0] - x, body.position[1] - y, body.position[2] - z
        copy_values(body.velocity[:], record.velocity[t, i])
        x, y, z = turned_back(body.axes, body.spin[0], body.spin[1], body.spin[2])
        rate[0], rate[1], rate[2] = turned(body.rotation, x, y, z)
        _record_wrench(body, forces.hand_wrench[t], record.hand_wrench[t, i])
        _record_wrench(body, forces.table_wrench[t], record.table_wrench[t, i])
        _record_wrench(body, forces.body_wrench[t], record.body_wrench[t, i])
        record.table_distance[t, i] = body.table_distance
    record.friction_residual[0, i] = max(forces.residual, forces.frictionless_slip)
    row = record.contact[i]
    for k in range(forces.count):
        contact_code = forces.contact_code[k]
        number, other = body_of(problem, contact_code), other_of(problem, contact_code)
        body = bodies[number]
        if other >= 0:
            record.body[row] = -2 - other
            _record_point(bodies[other], forces.lever[k], record.other_point[row])
        elif contact_code >= 0:
            record.body[row] = contact_code % BODY_COUNT + BODY_COUNT * problem.hand[contact_code // BODY_COUNT]
        else:
            record.body[row] = -1
        for j in range(3):
            forces.point[k, j] -= body.center[j]
        _record_point(body, forces.point[k], record.point[row])
        _out(body, forces.normal[k], record.normal[row])
        _out(body, forces.friction_force[k], record.friction_force[row])
        record.normal_force[row] = forces.normal_force[k]
        record.torsional_moment[row] = forces.torsional_moment[k]
        record.slip[row] = forces.slip[k]
        record.contact_body[row] = number
        row += 1
    record.contact[i + 1] = row
