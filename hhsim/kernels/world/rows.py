"""Rows of a program of hands and free objects: non-penetration, friction, torsion, and the table.

The program of one hand and one object has 27 variables: the palm's 6, the object's 6, then 3 of each finger. With Δ the
displacement of a contact point of the hand relative to the object's in this step, n the normal, t_k four directions
around it and φ the relative rotation,

    n · Δ                   >= ε - d,
    n · Δ - e_k · s         >= ε - d - Γ,        s = (μ Δ_t, γ n · φ),

with γ the torsional moment that a contact bears per newton of its force. The second kind is Anitescu's cone, with
torsion as a third direction beside the two along the surface. Its multipliers push along n and against s; with
Γ = |s| at the solution, which is de Saxcé's correction, that is Coulomb's law, and with torsion the ellipsoid
(f_t / μ)² + (τ / γ)² <= f_n². Whatever Γ is, the first row keeps the contact from penetrating. The directions e_k are
pairs ± e_1, ± e_2, ± e_3 at right angles, turned so that e_1 lies against the load: along that their cone is as wide as
the law's.

Only a contact that is as good as closed has rows of friction. A contact of object and table is one of a point or a
sphere of the object's hull with a plane, and has columns of the object alone.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from hhsim.kernels.contact.hand_pairs import HAND_PAIR_ROWS
from hhsim.kernels.contact.linearise import LIMIT_ROWS, ROW_CAPACITY
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Array, Record, Triple, as_bool, as_int64, jit, jit_inline
from hhsim.kernels.world.body import OBJECT_DOF
from hhsim.kernels.world.columns import (
    ROW_KINDS,
    States,
    coefficient,
    first_finger,
    name_row,
    relative_motion,
    torsion_radius,
    write_row,
)
from hhsim.kernels.world.hand_contact import dense_rows
from hhsim.kernels.world.joints import joint_rows

HAND_FRICTION = 48
TABLE_CONTACTS = 24
DIRECTIONS = 3
PER_CONTACT = 2 * DIRECTIONS
FREE_ROWS = ROW_CAPACITY + HAND_FRICTION * PER_CONTACT + TABLE_CONTACTS * (1 + PER_CONTACT) + 138
"""Room: contacts with friction of hands and of bodies with each other, contacts of a body's table, and all rows. Rows
lie 13 cache lines apart but for whole pages: in a multiple of those they would share few places of the first cache."""
SECOND_ROWS = ROW_CAPACITY + 490
"""Room for the contacts and limits of a second hand; as many cache lines more."""
OTHER_ROWS = 1536
"""Room for the contacts of up to six further bodies with a table, and for dense rows: whole pages."""

HAND_GROUPS = 3 * FINGER_COUNT + 2
"""Of a hand and its first body: palm and fingers, and their limits; then palm and fingers with friction."""

SLACKS = 6
"""Columns of slack variables, one of each body, if there are any: rows are read in strips of so many."""
TABLE_KEYS = -1000
"""Keys of the table's rows go down from here; those of joint limits from -1."""
PAIR_KEYS = 1 << 40
"""Keys of the contacts of a pair, and of a body's table, are those that it has alone and this times its number."""

NEAR_POINTS = 2048
"""Room for the points of the hull within reach of the table."""
ENTRIES = 7
"""Room for the points of the hull that entered the table in a tick: what TABLE_CONTACTS leaves."""

STANDS_BACK = 0.5
"""Share of the clearance by which the normal row of a contact with friction is loosened. The rows of friction then
carry the load even if Γ is too large by that much."""

TINY = 1e-9
"""A slip [m] or a share that gives no direction."""


def free_problem_dtype(hands: int, bodies: int) -> "np.dtype[Any]":
    """Build the dtype of the rows of up to so many hands and bodies, in the layout of `kernels.qp.active_set`."""
    common, fingers, pairs = 6 * (hands + bodies), FINGER_COUNT * hands, bodies * (hands + bodies - 1)
    common += SLACKS if bodies > 1 else 0
    dof = common + PHALANX_COUNT * fingers
    # Fixed bodies have columns that no program reads.
    whole = dof + OBJECT_DOF if bodies > 1 else dof
    rows = FREE_ROWS + SECOND_ROWS * (hands - 1) + (OTHER_ROWS if bodies > 1 else 0)
    groups = HAND_GROUPS * hands + 2 * (FINGER_COUNT + 1) * (pairs - hands) + 2
    return np.dtype(
        [
            ("hands", np.int64),  # numbers of those that there are
            ("bodies", np.int64),
            ("pairs", np.int64),
            ("slacks", np.int64),  # SLACKS where a joint of two free bodies has friction, else 0
            ("width", np.int64),  # columns of palms and bodies
            ("palm", np.int64, (hands,)),  # first column of each palm
            ("column", np.int64, (bodies,)),  # first column of each body
            ("common", np.float64, (common if bodies == 1 else whole, rows)),  # of palms, bodies and slacks, scaled
            ("dense", np.float64, (HAND_PAIR_ROWS, PHALANX_COUNT * fingers)),  # finger columns of dense rows, scaled
            ("dense_row", np.int64),  # first of these
            ("dense_rows", np.int64),  # number of these
            ("block", np.float64, (PHALANX_COUNT, rows)),  # columns of the row's own finger, scaled
            ("rhs", np.float64, (rows,)),  # [m] for contacts, [rad] for limits
            ("share", np.float64),  # share of a free distance that a step may use up
            ("is_fresh", np.int64),  # 1 while the rows of contacts are as they were written
            ("key", np.int64, (rows,)),  # names the same row at every tick
            ("owner", np.int64, (rows,)),  # its place in the contacts with friction, or -1
            ("kind", np.int64, (rows,)),  # 0 normal, 1 to 3 for e_1 to e_3, 4 to 6 for their opposites
            ("first", np.int64, (pairs,)),  # first row of each pair's contacts
            ("last", np.int64, (pairs,)),  # row behind them, where a hand's joint limits begin
            ("hand", np.int64, (pairs,)),  # of each pair; 0 for two bodies
            ("other", np.int64, (pairs,)),  # body that meets the pair's one; -1 for a hand
            ("body", np.int64, (pairs,)),  # in whose frame the pair is
            ("surface", np.int64, (pairs,)),  # number of the pair's surface
            ("turn", np.float64, (pairs, 3, 3)),  # from the frame of the first body to that of the pair's
            ("hand_target", np.float64, (DOF * hands,)),  # step to each of the user's hands, unscaled
            ("body_target", np.float64, (OBJECT_DOF * bodies,)),  # step to where each body would go by itself, unscaled
            ("target", np.float64, (whole,)),  # all targets, scaled, in the program's order
            ("abduction_total", np.float64, (fingers,)),  # of the fingers in this tick so far [rad]
            ("inverse_root", np.float64, (DOF,)),  # 1 / √G of a hand's variables
            ("rows", np.int64),  # number of rows
            ("groups", np.int64),  # number of groups of rows that are not empty
            ("group_start", np.int64, (groups,)),
            ("group_stop", np.int64, (groups,)),
            ("group_block", np.int64, (groups,)),
            ("delta", np.float64, (whole,)),  # the program's step, unscaled, in its order
            ("total", np.float64, (whole,)),  # the same of this tick so far
            ("before", np.float64, (whole,)),  # the step of the tick before
            ("before_abduction", np.float64, (fingers,)),
            ("whole", np.float64, (whole,)),  # the tick's step with the program's
            ("whole_abduction", np.float64, (fingers,)),
            ("scratch", np.float64, (6,)),
            # the most by which Γ e_1 is off the slip of a contact that bears a force [m]
            ("gamma_error", np.float64),
        ],
        align=True,
    )


def friction_count(bodies: int) -> int:
    """Return the room for contacts with friction of so many bodies."""
    return HAND_FRICTION + TABLE_CONTACTS * bodies


@cache
def friction_dtype(bodies: int) -> "np.dtype[Any]":
    """Build the dtype of the contacts with friction: of hands and of bodies with each other, then all of the table."""
    count = friction_count(bodies)
    return np.dtype(
        [
            ("count", np.int64),
            ("room", np.int64),  # for so many
            ("of_hand", np.int64),  # the first so many are not of the table
            ("contact", np.int64, (count,)),  # its contact record, or the number of the point of the hull
            ("contact_code", np.int64, (count,)),  # see `kernels.world.columns.body_of`
            ("key", np.int64, (count,)),
            ("has_friction", np.int64, (count,)),  # 1 where it has rows of friction, 0 for some of the table
            ("point", np.float64, (count, 3)),  # [m], frame of its body, as all that follows
            ("normal", np.float64, (count, 3)),  # out of the body, of the table into it
            ("along", np.float64, (count, DIRECTIONS, 3)),  # parts of e_1 to e_3 along the surface
            ("about", np.float64, (count, DIRECTIONS)),  # parts of e_1 to e_3 about the normal
            ("distance", np.float64, (count,)),  # d [m]
            ("shift", np.float64, (count,)),  # Γ [m]
            ("start", np.float64, (count, 3)),  # s of the tick before the program: along the surface [m]
            ("start_spin", np.float64, (count,)),  # and about the normal [m]
            ("row", np.int64, (count,)),  # its first row of friction
            ("slip", np.float64, (count, 3)),  # s of the tick with the last solution: μ Δ_t [m]
            ("spin", np.float64, (count,)),  # γ n · φ [m]
            ("length", np.float64, (count,)),  # |s| [m]
            ("plain_load", np.float64, (count,)),  # multiplier of the normal row [N]
            ("cone_load", np.float64, (count,)),  # multiplier of friction [N]
            ("loaded_contacts", np.int64),  # number of contacts with rows of friction that bear a force
            ("loaded_contact", np.int64, (count,)),  # their places here
            ("entries", np.int64, (bodies,)),  # number of points of the hull that a step had in the table
            ("entry", np.int64, (bodies, ENTRIES)),  # which points
            ("near", np.int64, (NEAR_POINTS,)),  # points of the hull within reach of the table
            ("near_distance", np.float64, (NEAR_POINTS,)),  # how far they are [m]
            ("near_point", np.float64, (3, NEAR_POINTS)),
            ("lowest", np.int64, (NEAR_POINTS,)),  # places in `near` of those chosen
            ("plane", np.float64, (2, 3)),  # axes of the plane
        ],
        align=True,
    )


def last_friction_dtype(bodies: int) -> "np.dtype[Any]":
    """Build the dtype of the last program's contacts with friction: Γ [m], e_1, and the better direction for e_1."""
    count = friction_count(bodies)
    return np.dtype(
        [
            ("count", np.int64),
            ("key", np.int64, (count,)),
            ("shift", np.float64, (count,)),
            ("along", np.float64, (count, 3)),
            ("about", np.float64, (count,)),
            ("next_direction", np.float64, (count, 4)),
        ],
        align=True,
    )


@jit
def find_frictions(world: Record, contacts: Record, close: float) -> None:
    """Say which contacts, but for those of the table, have friction: those up to `close` [m]."""
    problem, friction, distance = world.problem, world.friction, contacts.distance
    within = close
    count = as_int64(HAND_FRICTION + 1)
    while count > HAND_FRICTION:
        count = as_int64(0)
        for p in range(problem.pairs):
            for i in range(problem.first[p], problem.last[p]):
                if distance[i] <= within:
                    count += 1
        if count > HAND_FRICTION:
            within *= 0.5
            if within < 1e-9:
                break
    count = as_int64(0)
    for p in range(problem.pairs):
        body = world.bodies[problem.body[p]]
        if problem.other[p] < 0 and body.friction == 0.0 and body.torsion == 0.0:
            continue
        for i in range(problem.first[p], problem.last[p]):
            if distance[i] <= within and count < HAND_FRICTION:
                friction.contact[count] = i
                friction.contact_code[count] = contacts.body[i]
                friction.key[count] = contacts.key[i]
                friction.has_friction[count] = 1
                friction.distance[count] = distance[i]
                for j in range(3):
                    friction.point[count, j] = contacts.point[j, i]
                    friction.normal[count, j] = contacts.normal[j, i]
                count += 1
    friction.of_hand = count
    friction.count = count


@jit_inline
def any_tangent(nx: float, ny: float, nz: float) -> Triple:
    """Return a unit vector at right angles to a unit normal."""
    x, y, z = (0.0, nz, -ny) if abs(nx) < 0.7 else (-nz, 0.0, nx)
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@jit
def orient(friction: Record, i: int, x: float, y: float, z: float, spin: float) -> bool:
    """Turn a contact's directions: e_1 along a tangential vector and a spin about the normal; False if both are 0."""
    nx, ny, nz = friction.normal[i, 0], friction.normal[i, 1], friction.normal[i, 2]
    normal = x * nx + y * ny + z * nz
    tx, ty, tz = x - normal * nx, y - normal * ny, z - normal * nz
    flat = math.sqrt(tx * tx + ty * ty + tz * tz)
    length = math.sqrt(flat * flat + spin * spin)
    if not length > TINY:
        return False
    if flat > 1e-6 * length:
        scale = 1.0 / flat
        tx, ty, tz = tx * scale, ty * scale, tz * scale
    else:
        # Any direction along the surface is as good.
        flat = 0.0
        tx, ty, tz = any_tangent(nx, ny, nz)
    c, w = flat / length, spin / length
    along, about = friction.along, friction.about
    along[i, 0, 0], along[i, 0, 1], along[i, 0, 2], about[i, 0] = c * tx, c * ty, c * tz, w
    along[i, 1, 0] = ny * tz - nz * ty
    along[i, 1, 1] = nz * tx - nx * tz
    along[i, 1, 2] = nx * ty - ny * tx
    about[i, 1] = 0.0
    along[i, 2, 0], along[i, 2, 1], along[i, 2, 2], about[i, 2] = -w * tx, -w * ty, -w * tz, c
    return True


@jit
def measure_slip(states: States, world: Record, step: Array, abduction: Array, i: int) -> float:
    """Set s of a contact for a step, unscaled and in the program's order; returns its length [m]."""
    friction = world.friction
    contact_code, p, n = friction.contact_code[i], friction.point[i], friction.normal[i]
    mu = coefficient(world, contact_code)
    x, y, z, wx, wy, wz = relative_motion(states, world, abduction, step, contact_code, p)
    normal = x * n[0] + y * n[1] + z * n[2]
    x, y, z = mu * (x - normal * n[0]), mu * (y - normal * n[1]), mu * (z - normal * n[2])
    radius = torsion_radius(world, contact_code)
    spin = radius * (wx * n[0] + wy * n[1] + wz * n[2]) if radius > 0.0 else 0.0
    friction.slip[i, 0], friction.slip[i, 1], friction.slip[i, 2], friction.spin[i] = x, y, z, spin
    return math.sqrt(x * x + y * y + z * z + spin * spin)


@jit
def begin_frictions(states: States, world: Record, step: Array, abduction: Array, turns: bool) -> None:
    """Set what the contacts slipped in this tick so far, and Γ and directions as they were in the program before.

    A contact that is new begins with its slip in `step`, unscaled and in the program's order, with `abduction` [rad] of
    all fingers. With `turns` the directions are those that turned out better.
    """
    problem, last, friction = world.problem, world.last_friction, world.friction
    for i in range(friction.count):
        friction.shift[i] = 0.0
        if friction.has_friction[i] == 0:
            continue
        measure_slip(states, world, problem.total[:], problem.abduction_total[:], i)
        friction.start_spin[i] = friction.spin[i]
        for j in range(3):
            friction.start[i, j] = friction.slip[i, j]
        key = TABLE_KEYS - friction.key[i] if friction.contact_code[i] < 0 else friction.key[i]
        place = as_int64(-1)
        for j in range(last.count):
            if last.key[j] == key:
                place = as_int64(j)
                break
        if place >= 0:
            direction, along = last.next_direction[place], last.along[place]
            if turns and orient(friction, i, direction[0], direction[1], direction[2], direction[3]):
                friction.shift[i] = last.shift[place]
                continue
            if orient(friction, i, along[0], along[1], along[2], last.about[place]):
                friction.shift[i] = last.shift[place]
                continue
        else:
            slip = measure_slip(states, world, step, abduction, i)
            if orient(friction, i, friction.slip[i, 0], friction.slip[i, 1], friction.slip[i, 2], friction.spin[i]):
                friction.shift[i] = slip
                continue
        if abs(friction.normal[i, 0]) > 0.7:
            orient(friction, i, 0.0, 1.0, 0.0, 0.0)
        else:
            orient(friction, i, 1.0, 0.0, 0.0, 0.0)


@jit_inline
def _add_group(problem: Record, start: int, stop: int, block: int) -> None:
    """Add a group of rows with the finger whose first variable is `block`, unless there are none."""
    if stop > start:
        g = problem.groups
        problem.group_start[g], problem.group_stop[g], problem.group_block[g] = start, stop, block
        problem.groups += 1


@jit
def bends(states: States, problem: Record, hand: int, finger: int) -> bool:
    """Return whether a program has rows that may bend a finger: of its contacts, or of pairs of hands' parts."""
    found = as_bool(states[hand].hand_contact.has_row[finger] == 1)
    for p in range(problem.pairs):
        begin = states[p].contacts.start
        found = found or (problem.hand[p] == hand and problem.other[p] < 0 and begin[finger + 2] > begin[finger + 1])
    return found


@jit
def contact_groups(states: States, problem: Record) -> int:
    """Begin the groups of rows with those of contacts and of joint limits; return the row behind these."""
    pairs, hands = problem.pairs, problem.hands
    problem.groups = 0
    for p in range(pairs):
        first, limits, fingers = problem.first[p], problem.last[p], first_finger(problem, problem.hand[p])
        begin = states[p].contacts.start
        _add_group(problem, first, first + begin[1], -1)
        if problem.other[p] >= 0:
            continue
        for f in range(FINGER_COUNT):
            _add_group(problem, first + begin[f + 1], first + begin[f + 2], fingers + PHALANX_COUNT * f)
        for f in range(FINGER_COUNT):
            if p < hands and bends(states, problem, p, f):
                start = limits + 2 * PHALANX_COUNT * f
                _add_group(problem, start, start + 2 * PHALANX_COUNT, fingers + PHALANX_COUNT * f)
    return as_int64(problem.last[pairs - 1] + (LIMIT_ROWS if pairs == hands else 0))


@jit
def end_rows(states: States, offset: float, row: int, problem: Record, pairs: Record) -> None:
    """Write the last rows, those of pairs of hands' parts, from a row on."""
    problem.rows = dense_rows(states, pairs, offset, row, problem)
    _add_group(problem, row, problem.rows, -1)


@jit
def friction_rows(states: States, world: Record, offset: float, relaxed: bool) -> None:
    """Write the rows of friction, of the table, of joints and of pairs of hands' parts, and the groups of all rows.

    The rows of contacts, which are there, are changed once: those with friction stand back, and all have their share.
    """
    problem, friction = world.problem, world.friction
    row = contact_groups(states, problem)
    changed = 0 if problem.is_fresh == 1 else row
    for p in range(problem.pairs):
        fingers = first_finger(problem, problem.hand[p])
        for owner in range(FINGER_COUNT + 1 if problem.other[p] < 0 else 1):
            start = row
            for i in range(friction.of_hand):
                hand_body = friction.contact_code[i] - BODY_COUNT * p
                hand_owner = 0 if hand_body == PALM_BODY else 1 + hand_body // PHALANX_COUNT
                if 0 <= hand_body < BODY_COUNT and hand_owner == owner:
                    row = contact_rows(states, world, offset, relaxed, i, row)
            _add_group(problem, start, row, fingers + PHALANX_COUNT * (owner - 1) if owner > 0 else -1)
    table = row
    for i in range(friction.of_hand, friction.count):
        n = friction.normal[i]
        rhs = offset - friction.distance[i]
        if friction.has_friction[i] == 1:
            rhs -= STANDS_BACK * offset
        if relaxed and friction.distance[i] >= 0.0:
            rhs = min(rhs, 0.0)
        contact_code, m = friction.contact_code[i], (n[0], n[1], n[2])
        write_row(states, world, contact_code, row, friction.point[i], m, (0.0, 0.0, 0.0), rhs)
        row = name_row(problem, row, TABLE_KEYS - ROW_KINDS * friction.key[i], i, as_int64(0))
        if friction.has_friction[i] == 1:
            row = contact_rows(states, world, offset, relaxed, i, row)
    joints = row
    row = joint_rows(states, world, relaxed, row)
    _add_group(problem, table, row, -1)
    dense = row
    end_rows(states, offset, row, problem, world.hand_pairs)
    row = problem.rows
    for i in range(friction.of_hand if problem.is_fresh == 1 else 0):
        problem.owner[friction.contact[i]] = i
        problem.rhs[friction.contact[i]] -= STANDS_BACK * offset
    problem.is_fresh = 0
    for i in range(changed if problem.share < 1.0 else row, row):
        if problem.rhs[i] < 0.0 and (i >= dense or (i < joints and problem.kind[i] == 0)):
            problem.rhs[i] *= problem.share


@jit
def contact_rows(states: States, world: Record, offset: float, relaxed: bool, i: int, row: int) -> int:
    """Write the rows of friction of a contact from a row on; returns the one behind them."""
    friction = world.friction
    contact_code, point, n = friction.contact_code[i], friction.point[i], friction.normal[i]
    mu, radius, d = coefficient(world, contact_code), torsion_radius(world, contact_code), friction.distance[i]
    friction.row[i] = row
    start = friction.start[i]
    for k in range(PER_CONTACT):
        e = k % DIRECTIONS
        if e == DIRECTIONS - 1 and radius == 0.0:
            continue
        sign = 1.0 if k < DIRECTIONS else -1.0
        t, w = friction.along[i, e], -sign * radius * friction.about[i, e]
        push = sign * mu
        start_slip = start[0] * t[0] + start[1] * t[1] + start[2] * t[2] + friction.start_spin[i] * friction.about[i, e]
        rhs = offset - d - friction.shift[i] + sign * start_slip
        if relaxed and d >= 0.0:
            rhs = min(rhs, 0.0)
        m = (n[0] - push * t[0], n[1] - push * t[1], n[2] - push * t[2])
        write_row(states, world, contact_code, row, point, m, (w * n[0], w * n[1], w * n[2]), rhs)
        key = ROW_KINDS * friction.key[i] + 1 + k
        row = name_row(world.problem, row, TABLE_KEYS - key if contact_code < 0 else key, i, 1 + k)
    return row
