"""Record of a free object's ticks: its motion, the forces on it, and the contacts that bear them."""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.copy import copy_values
from hhsim.kernels.elementary import hypotenuse
from hhsim.kernels.free.rows import (
    DIRECTIONS,
    ON_TABLE,
    TABLE_KEYS,
    States,
    coefficient,
    displacement,
    relative_turn,
    torsion_radius,
)
from hhsim.kernels.hand.kinematics import BODY_COUNT
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_once
from hhsim.kernels.rotation import turned, turned_back
from hhsim.kernels.tick.block import record_object
from hhsim.kernels.tick.step import ACTIVE_CAPACITY

STICKS = 1e-9
"""A contact that slips by no more than this in a tick [m] sticks."""


BORNE = np.dtype(
    [
        ("count", np.int64),
        # its row or place in FRICTION, to put together what several rows bear
        ("contact", np.int64, (ACTIVE_CAPACITY,)),
        ("body", np.int64, (ACTIVE_CAPACITY,)),  # of a hand as in `kernels.free.rows`, ON_TABLE for the table
        ("point", np.float64, (ACTIVE_CAPACITY, 3)),  # [m]
        # from the object to the hand, of the table from the table to the object
        ("normal", np.float64, (ACTIVE_CAPACITY, 3)),
        ("load", np.float64, (ACTIVE_CAPACITY,)),  # normal force on the hand, of the table on the object [N]
        ("friction", np.float64, (ACTIVE_CAPACITY, 3)),  # tangential force [N]
        ("moment", np.float64, (ACTIVE_CAPACITY,)),  # about the normal [N·m]
        ("slip", np.float64, (ACTIVE_CAPACITY,)),  # tangential way of the contact in the tick [m]
        # of the hand on the object: force [N], moment about its centre of mass [N·m]
        ("hand_wrench", np.float64, (6,)),
        ("table_wrench", np.float64, (6,)),  # the same of the table
        # the most by which the slip that friction is balanced against is off the slip of a contact here [m]
        ("residual", np.float64),
        # the most that a contact slips that bears a force without rows of friction: it came from too far [m]
        ("bare", np.float64),
    ],
    align=True,
)
"""Contacts that bear a force; object's frame."""


class ObjectRecord(NamedTuple):
    """Results of a block of ticks for the object; first axis the tick, world unless said otherwise.

    | field | meaning | shape |
    |---|---|---|
    | turn, shift | the object's frame to the world, at the end of the tick: x ↦ turn · x + shift [m] | (B, 4), (B, 3) |
    | velocity, angular_velocity | of the centre of mass [m/s], [rad/s] | (B, 3) |
    | hand_wrench, table_wrench | on the object: force [N], moment about its centre [N·m] | (B, 6) |
    | table_distance | lowest point above the table [m], infinite without one | (B,) |
    | friction_residual | the larger of `residual` and `bare` of BORNE [m] | (B,) |
    | contact | the first row of each tick's, and of one more | (B + 1,) |
    | body, point, normal, normal_force, friction_force, torsional_moment, slip | as BORNE has them | (rows, ...) |
    """

    turn: Array
    shift: Array
    velocity: Array
    angular_velocity: Array
    hand_wrench: Array
    table_wrench: Array
    table_distance: Array
    friction_residual: Array
    contact: Indices
    body: Indices
    point: Array
    normal: Array
    normal_force: Array
    friction_force: Array
    torsional_moment: Array
    slip: Array


@jit_once
def find_borne(
    states: States, body: Record, contacts: Record, problem: Record, friction: Record, loaded: Record, borne: Record
) -> None:
    """Write the loads of the rows: as forces on each hand in its `warm`, and contact by contact in `borne`."""
    borne.hand_wrench[:] = 0.0
    borne.table_wrench[:] = 0.0
    count = as_int64(0)
    for h in range(problem.first.shape[0]):
        states[h].warm.count = 0
    for i in range(loaded.count):
        row = loaded.row[i]
        force = loaded.multiplier[i]
        if TABLE_KEYS < problem.key[row] < 0 or force <= 0.0:
            continue
        owner, kind = problem.owner[row], problem.kind[row]
        contact = owner if owner >= 0 else -1 - row
        at = as_int64(-1)
        for j in range(count):
            if borne.contact[j] == contact:
                at = as_int64(j)
        if at < 0:
            at = count
            count += 1
            borne.contact[at] = contact
            borne.load[at] = borne.moment[at] = borne.slip[at] = 0.0
            for j in range(3):
                borne.friction[at, j] = 0.0
                borne.point[at, j] = friction.point[owner, j] if owner >= 0 else contacts.point[j, row]
                borne.normal[at, j] = friction.normal[owner, j] if owner >= 0 else contacts.normal[j, row]
            borne.body[at] = friction.body[owner] if owner >= 0 else contacts.body[row]
        of = borne.body[at]
        n, p = borne.normal[at], borne.point[at]
        mx, my, mz = n[0], n[1], n[2]
        borne.load[at] += force
        moment = 0.0
        if kind > 0:
            e = (kind - 1) % DIRECTIONS
            sign = -1.0 if kind <= DIRECTIONS else 1.0
            push = sign * coefficient(body, of)
            t = friction.along[owner, e]
            mx, my, mz = mx + push * t[0], my + push * t[1], mz + push * t[2]
            for j in range(3):
                borne.friction[at, j] += force * push * t[j]
            moment = sign * torsion_radius(body, of) * friction.about[owner, e] * force
            borne.moment[at] += moment
        rx, ry, rz = p[0] - body.center[0], p[1] - body.center[1], p[2] - body.center[2]
        wrench = borne.table_wrench if of == ON_TABLE else borne.hand_wrench
        size = force if of == ON_TABLE else -force
        turn = moment if of == ON_TABLE else -moment
        wrench[0] += size * mx
        wrench[1] += size * my
        wrench[2] += size * mz
        wrench[3] += size * (ry * mz - rz * my) + turn * n[0]
        wrench[4] += size * (rz * mx - rx * mz) + turn * n[1]
        wrench[5] += size * (rx * my - ry * mx) + turn * n[2]
        if of != ON_TABLE:
            active = states[of // BODY_COUNT].warm
            bearing = active.count
            active.key[bearing] = 0
            active.body[bearing] = of % BODY_COUNT
            active.multiplier[bearing] = force
            active.point[0, bearing], active.point[1, bearing], active.point[2, bearing] = p[0], p[1], p[2]
            active.normal[0, bearing], active.normal[1, bearing], active.normal[2, bearing] = mx, my, mz
            active.count += 1
    borne.count = count
    borne.bare = 0.0
    for i in range(count):
        p, n = borne.point[i], borne.normal[i]
        x, y, z = displacement(
            states, body, problem.abduction_total[:], problem.total[:], borne.body[i], p[0], p[1], p[2]
        )
        along = x * n[0] + y * n[1] + z * n[2]
        x, y, z = x - along * n[0], y - along * n[1], z - along * n[2]
        borne.slip[i] = math.sqrt(x * x + y * y + z * z)
        place = borne.contact[i]
        if place < 0 or friction.has_friction[place] == 0:
            of = borne.body[i]
            turn = relative_turn(states, body, problem.abduction_total[:], problem.total[:], of, n[0], n[1], n[2])
            spin = torsion_radius(body, of) * turn
            borne.bare = max(borne.bare, hypotenuse(coefficient(body, of) * borne.slip[i], spin))


@jit_once
def copy_borne(source: Record, target: Record) -> None:
    """Copy what is borne."""
    target.count = source.count
    target.residual = source.residual
    target.bare = source.bare
    copy_values(source.hand_wrench[:], target.hand_wrench[:])
    copy_values(source.table_wrench[:], target.table_wrench[:])
    for i in range(source.count):
        target.body[i] = source.body[i]
        target.load[i] = source.load[i]
        target.moment[i] = source.moment[i]
        target.slip[i] = source.slip[i]
        for j in range(3):
            target.point[i, j] = source.point[i, j]
            target.normal[i, j] = source.normal[i, j]
            target.friction[i, j] = source.friction[i, j]


@jit
def _out(body: Record, vector: Array, vector_out: Array) -> None:
    # Forces are in the directions that the object had when they were solved for.
    vector_out[0], vector_out[1], vector_out[2] = turned(body.pushed, vector[0], vector[1], vector[2])


@jit_once
def turn_loads(body: Record, active: Record) -> None:
    """Take the directions of the forces on the hand to the object's frame at the end of the tick."""
    normal = active.normal
    for i in range(active.count):
        x, y, z = turned(body.pushed, normal[0, i], normal[1, i], normal[2, i])
        normal[0, i], normal[1, i], normal[2, i] = turned_back(body.rotation, x, y, z)


@record_object.of(ObjectRecord)
@jit
def _record_object(record: ObjectRecord, state: Record, i: int) -> None:
    body, borne = state.body, state.borne
    copy_values(body.orientation[:], record.turn[i])
    center = body.center
    x, y, z = turned(body.rotation, center[0], center[1], center[2])
    record.shift[i, 0] = body.position[0] - x
    record.shift[i, 1] = body.position[1] - y
    record.shift[i, 2] = body.position[2] - z
    copy_values(body.velocity[:], record.velocity[i])
    x, y, z = turned_back(body.axes, body.spin[0], body.spin[1], body.spin[2])
    x, y, z = turned(body.rotation, x, y, z)
    record.angular_velocity[i, 0], record.angular_velocity[i, 1], record.angular_velocity[i, 2] = x, y, z
    for half in range(2):
        _out(body, borne.hand_wrench[3 * half : 3 * half + 3], record.hand_wrench[i, 3 * half : 3 * half + 3])
        _out(body, borne.table_wrench[3 * half : 3 * half + 3], record.table_wrench[i, 3 * half : 3 * half + 3])
    record.table_distance[i] = state.table_distance
    record.friction_residual[i] = max(borne.residual, borne.bare)
    row = record.contact[i]
    for k in range(borne.count):
        record.body[row] = borne.body[k]
        for j in range(3):
            borne.point[k, j] -= center[j]
        _out(body, borne.point[k], record.point[row])
        for j in range(3):
            record.point[row, j] += body.position[j]
        _out(body, borne.normal[k], record.normal[row])
        _out(body, borne.friction[k], record.friction_force[row])
        record.normal_force[row] = borne.load[k]
        record.torsional_moment[row] = borne.moment[k]
        record.slip[row] = borne.slip[k]
        row += 1
    record.contact[i + 1] = row
