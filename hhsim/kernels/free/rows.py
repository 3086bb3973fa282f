"""Rows of a program of hand and free object: non-penetration, friction, torsion, and the table.

The program has 27 variables: the palm's 6, the object's 6, then 3 of each finger. With two hands it has 48: those of
the second palm follow the object's, those of its fingers the first one's. With Δ the displacement of a contact point of
the hand relative to the object's in this step, n the normal, t_k four directions around it and φ the
relative rotation,

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
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.linearise import LIMIT_ROWS, ROW_CAPACITY
from hhsim.kernels.elementary import sine_cosine
from hhsim.kernels.free.body import OBJECT_DOF, Support
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit, jit_once
from hhsim.kernels.rotation import turned, turned_back

States: TypeAlias = NDArray[np.void]
"""State of each hand; the first one's has what is of the object."""

FREE_DOF = DOF + OBJECT_DOF
COMMON = 6 + OBJECT_DOF
"""Columns that all rows have: the palm's and the object's."""

HAND_FRICTION = 48
TABLE_CONTACTS = 24
FRICTIONS = HAND_FRICTION + TABLE_CONTACTS
DIRECTIONS = 3
PER_CONTACT = 2 * DIRECTIONS
FREE_ROWS = ROW_CAPACITY + HAND_FRICTION * PER_CONTACT + TABLE_CONTACTS * (1 + PER_CONTACT) + 138
"""Room: hand contacts with friction, contacts of the table, and all rows.

A row's columns lie 13 cache lines apart but for whole pages of 4096 bytes: a multiple of those would have all of them
share few places in the processor's first cache, and drive each other out of it.
"""
SECOND_ROWS = ROW_CAPACITY + 490
"""Room for the contacts and limits of a second hand; as many cache lines more."""

HAND_GROUPS = 3 * FINGER_COUNT + 2
FREE_GROUPS = HAND_GROUPS + 1
"""Of each hand palm and fingers, and their limits; then of each palm and fingers with friction; at last the table."""
ON_TABLE = -1
"""Stands for the table where others name a body of the hand; those of a second hand are BODY_COUNT more."""

KINDS = 8
"""Keys of rows: that of their contact times this, plus 0 for its normal row, or 1 and on for those of friction."""
TABLE_KEYS = -1000
"""Keys of the table's rows go down from here; those of joint limits from -1."""
SECOND_KEYS = 1 << 40
"""Keys of the contacts of a second hand are those that it has alone plus this."""

NEAR_POINTS = 2048
"""Room for the points of the hull within reach of the table."""
ENTRIES = 7
"""Room for the points of the hull that entered the table in a tick: what TABLE_CONTACTS leaves."""

STANDS_BACK = 0.5
"""Share of its clearance that the normal row of a contact with friction does not ask for.

So much may Γ be too large and the rows of friction still bear the load. Were it not so, the normal row would bear it
with any Γ that is too large, nothing would rub, and what slips would be right about its Γ.
"""

TINY = 1e-9
"""A slip [m] or a share that gives no direction."""


def free_problem_dtype(hands: int) -> "np.dtype[Any]":
    """Build the dtype of the rows of so many hands, in the layout of `kernels.qp.active_set`, and of the steps."""
    common, dof, fingers = COMMON + 6 * (hands - 1), FREE_DOF + DOF * (hands - 1), FINGER_COUNT * hands
    rows, groups = FREE_ROWS + SECOND_ROWS * (hands - 1), HAND_GROUPS * hands + 1
    return np.dtype(
        [
            ("common", np.float64, (common, rows)),  # columns of palms and object, scaled
            ("block", np.float64, (PHALANX_COUNT, rows)),  # columns of the row's own finger, scaled
            ("rhs", np.float64, (rows,)),  # [m] for contacts, [rad] for limits
            ("key", np.int64, (rows,)),  # names the same row at every tick
            ("owner", np.int64, (rows,)),  # its place in FRICTION, or -1
            ("kind", np.int64, (rows,)),  # 0 normal, 1 to 3 for e_1 to e_3, 4 to 6 for their opposites
            ("first", np.int64, (hands,)),  # first row of each hand's contacts
            ("last", np.int64, (hands,)),  # row behind them, where its joint limits begin
            ("hand_target", np.float64, (DOF * hands,)),  # step to each of the user's hands, unscaled
            ("body_target", np.float64, (OBJECT_DOF,)),  # step to where the body would go by itself, unscaled
            ("target", np.float64, (dof,)),  # all targets, scaled, in the program's order
            ("abduction_step", np.float64, (fingers,)),  # of the fingers, as delta [rad]
            ("abduction_total", np.float64, (fingers,)),  # of the fingers, as total [rad]
            ("inverse_root", np.float64, (DOF,)),  # 1 / √G of a hand's variables
            ("group_start", np.int64, (groups,)),
            ("group_stop", np.int64, (groups,)),
            ("group_block", np.int64, (groups,)),
            ("delta", np.float64, (dof,)),  # the program's step, unscaled, in its order
            ("total", np.float64, (dof,)),  # the same of this tick so far
            ("before", np.float64, (dof,)),  # the step of the tick before
            ("before_abduction", np.float64, (fingers,)),
            ("whole", np.float64, (dof,)),  # the tick's step with the program's
            ("whole_abduction", np.float64, (fingers,)),
            ("solutions", np.int64),  # of programs in this tick
            # the most by which Γ e_1 is off the slip of a contact that bears a force [m]
            ("gamma_error", np.float64),
        ],
        align=True,
    )


FRICTION = np.dtype(
    [
        ("count", np.int64),
        ("of_hand", np.int64),  # the first so many are of the hand
        ("contact", np.int64, (FRICTIONS,)),  # its contact record, or the number of the point of the hull
        ("body", np.int64, (FRICTIONS,)),  # of the hand, or ON_TABLE
        ("key", np.int64, (FRICTIONS,)),
        ("has_friction", np.int64, (FRICTIONS,)),  # 1 where it has rows of friction, 0 for some of the table
        ("point", np.float64, (FRICTIONS, 3)),  # [m], object's frame
        ("normal", np.float64, (FRICTIONS, 3)),  # out of the object, of the table into it; object's frame
        ("along", np.float64, (FRICTIONS, DIRECTIONS, 3)),  # parts of e_1 to e_3 along the surface, object's frame
        ("about", np.float64, (FRICTIONS, DIRECTIONS)),  # parts of e_1 to e_3 about the normal
        ("distance", np.float64, (FRICTIONS,)),  # d [m]
        ("shift", np.float64, (FRICTIONS,)),  # Γ [m]
        ("start", np.float64, (FRICTIONS, 3)),  # s of the tick before the program: along the surface [m]
        ("start_spin", np.float64, (FRICTIONS,)),  # and about the normal [m]
        ("row", np.int64, (FRICTIONS,)),  # its first row of friction
        ("slip", np.float64, (FRICTIONS, 3)),  # s of the tick with the last solution: μ Δ_t [m]
        ("spin", np.float64, (FRICTIONS,)),  # γ n · φ [m]
        ("length", np.float64, (FRICTIONS,)),  # |s| [m]
        ("plain", np.float64, (FRICTIONS,)),  # multiplier of the normal row [N]
        ("cone", np.float64, (FRICTIONS,)),  # multiplier of friction [N]
        ("bearings", np.int64),  # number of contacts with rows of friction that bear a force
        ("bearing", np.int64, (FRICTIONS,)),  # their places here
        ("entries", np.int64),  # number of points of the hull that a step of this tick would have had in the table
        ("entry", np.int64, (ENTRIES,)),  # which points
        ("near", np.int64, (NEAR_POINTS,)),  # points of the hull within reach of the table
        ("near_distance", np.float64, (NEAR_POINTS,)),  # how far they are [m]
    ],
    align=True,
)
"""Contacts with friction, the hand's first, then all of the table."""

HELD = np.dtype(
    [
        ("count", np.int64),
        ("key", np.int64, (FRICTIONS,)),
        ("shift", np.float64, (FRICTIONS,)),
        ("along", np.float64, (FRICTIONS, 3)),
        ("about", np.float64, (FRICTIONS,)),
        ("leaning", np.float64, (FRICTIONS, 4)),
    ],
    align=True,
)
"""Contacts with friction of the last program, object's frame: Γ [m], e_1, and the better direction for e_1."""


@jit
def _object_columns(
    start: int, stop: int, point: Array, normal: Array, center: Array, axes: Array, inverse_root: Array, common: Array
) -> None:
    cx, cy, cz = center[0], center[1], center[2]
    translation = -inverse_root[0]
    a, b, c = -inverse_root[3], -inverse_root[4], -inverse_root[5]
    a0, a1, a2 = a * axes[0, 0], a * axes[0, 1], a * axes[0, 2]
    b0, b1, b2 = b * axes[1, 0], b * axes[1, 1], b * axes[1, 2]
    c0, c1, c2 = c * axes[2, 0], c * axes[2, 1], c * axes[2, 2]
    for i in range(start, stop):
        nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
        rx, ry, rz = point[0, i] - cx, point[1, i] - cy, point[2, i] - cz
        mx, my, mz = ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx
        common[6, i] = nx * translation
        common[7, i] = ny * translation
        common[8, i] = nz * translation
        common[9, i] = a0 * mx + a1 * my + a2 * mz
        common[10, i] = b0 * mx + b1 * my + b2 * mz
        common[11, i] = c0 * mx + c1 * my + c2 * mz


@jit_once
def object_columns(body: Record, contacts: Record, problem: Record) -> None:
    """Write the object's columns of the hands' normal rows and of the joint limits, and the keys of both.

    Args:
        body: The object.
        contacts: Contacts of the first hand, and behind its joint limits those of a second one.
        problem: The program.
    """
    width = problem.common.shape[0]
    for h in range(problem.first.shape[0]):
        first, last = problem.first[h], problem.last[h]
        _object_columns(
            first,
            last,
            contacts.point,
            contacts.normal,
            body.center[:],
            body.axes[:],
            body.inverse_root[:],
            problem.common,
        )
        for i in range(first, last):
            problem.key[i] = KINDS * contacts.key[i]
            problem.owner[i] = -1
            problem.kind[i] = 0
        for i in range(last, last + LIMIT_ROWS):
            problem.key[i] = last - i - 1 - LIMIT_ROWS * h
            problem.owner[i] = -1
            problem.kind[i] = 0
            for j in range(6, COMMON):
                problem.common[j, i] = 0.0
        # Columns of the other palm.
        for j in range(COMMON if h == 0 else 0, width if h == 0 else 6):
            for i in range(first, last + LIMIT_ROWS):
                problem.common[j, i] = 0.0


@jit
def _columns(of: int, hands: int) -> tuple[int, int, int]:
    # First variable of a body's palm and of its hand's fingers, and its number in its hand.
    if hands == 1:
        return as_int64(0), as_int64(COMMON), of
    h = of // BODY_COUNT
    return 2 * 6 * h, COMMON + 6 + PHALANX_COUNT * FINGER_COUNT * h, of - BODY_COUNT * h


@jit
def displacement(
    states: States, body: Record, abduction_step: Array, step: Array, of: int, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """Compute the displacement of a point of a hand body, or of the object on the table, relative to what it touches.

    Object's frame [m]; the step is unscaled, in the program's order, shape (27,); `states` are those of the hands.
    """
    wx, wy, wz = turned_back(body.axes, step[9], step[10], step[11])
    rx, ry, rz = px - body.center[0], py - body.center[1], pz - body.center[2]
    x = step[6] + wy * rz - wz * ry
    y = step[7] + wz * rx - wx * rz
    z = step[8] + wx * ry - wy * rx
    if of == ON_TABLE:
        return x, y, z
    palm, fingers, of = _columns(of, states.shape[0])
    pose = states[palm // 12].pose
    rx, ry, rz = px - pose.position[0], py - pose.position[1], pz - pose.position[2]
    x = step[palm] + step[palm + 4] * rz - step[palm + 5] * ry - x
    y = step[palm + 1] + step[palm + 5] * rx - step[palm + 3] * rz - y
    z = step[palm + 2] + step[palm + 3] * ry - step[palm + 4] * rx - z
    if of == PALM_BODY:
        return x, y, z
    f = of // PHALANX_COUNT
    ax, ay, az = pose.axis[f, 0], pose.axis[f, 1], pose.axis[f, 2]
    for k in range(of % PHALANX_COUNT + 1):
        turn = step[fingers + PHALANX_COUNT * f + k]
        rx, ry, rz = px - pose.joints[f, k, 0], py - pose.joints[f, k, 1], pz - pose.joints[f, k, 2]
        x += turn * (ay * rz - az * ry)
        y += turn * (az * rx - ax * rz)
        z += turn * (ax * ry - ay * rx)
    turn = abduction_step[FINGER_COUNT * (palm // 12) + f]
    if turn != 0.0:
        ax, ay, az = pose.abduction_axis[f, 0], pose.abduction_axis[f, 1], pose.abduction_axis[f, 2]
        rx, ry, rz = px - pose.joints[f, 0, 0], py - pose.joints[f, 0, 1], pz - pose.joints[f, 0, 2]
        x += turn * (ay * rz - az * ry)
        y += turn * (az * rx - ax * rz)
        z += turn * (ax * ry - ay * rx)
    return x, y, z


@jit
def relative_turn(
    states: States, body: Record, abduction_step: Array, step: Array, of: int, nx: float, ny: float, nz: float
) -> float:
    """Compute the relative rotation about a direction [rad], of the bodies as in `displacement`."""
    wx, wy, wz = turned_back(body.axes, step[9], step[10], step[11])
    if of == ON_TABLE:
        return wx * nx + wy * ny + wz * nz
    palm, fingers, of = _columns(of, states.shape[0])
    wx, wy, wz = step[palm + 3] - wx, step[palm + 4] - wy, step[palm + 5] - wz
    if of < PALM_BODY:
        pose = states[palm // 12].pose
        f = of // PHALANX_COUNT
        total = 0.0
        for k in range(of % PHALANX_COUNT + 1):
            total += step[fingers + PHALANX_COUNT * f + k]
        turn = abduction_step[FINGER_COUNT * (palm // 12) + f]
        wx += total * pose.axis[f, 0] + turn * pose.abduction_axis[f, 0]
        wy += total * pose.axis[f, 1] + turn * pose.abduction_axis[f, 1]
        wz += total * pose.axis[f, 2] + turn * pose.abduction_axis[f, 2]
    return wx * nx + wy * ny + wz * nz


@jit
def write_row(
    states: States,
    body: Record,
    problem: Record,
    of: int,
    row: int,
    point: Array,
    m: tuple[float, float, float],
    w: tuple[float, float, float],
    rhs: float,
) -> None:
    """Write a row for the displacement along m plus the rotation along w."""
    common, block, weight, root = problem.common, problem.block, problem.inverse_root, body.inverse_root
    px, py, pz = point[0], point[1], point[2]
    mx, my, mz = m
    wx, wy, wz = w
    sign = -1.0
    palm = as_int64(0)
    width = common.shape[0]
    if of == ON_TABLE or width > COMMON:
        for j in range(6):
            common[j, row] = 0.0
        for j in range(COMMON, width):
            common[j, row] = 0.0
    if of == ON_TABLE:
        sign = 1.0
    else:
        palm, _, of = _columns(of, states.shape[0])
        pose = states[palm // 12].pose
        rx, ry, rz = px - pose.position[0], py - pose.position[1], pz - pose.position[2]
        translation, rotation = weight[0], weight[3]
        common[palm, row] = mx * translation
        common[palm + 1, row] = my * translation
        common[palm + 2, row] = mz * translation
        common[palm + 3, row] = (ry * mz - rz * my + wx) * rotation
        common[palm + 4, row] = (rz * mx - rx * mz + wy) * rotation
        common[palm + 5, row] = (rx * my - ry * mx + wz) * rotation
    rx, ry, rz = px - body.center[0], py - body.center[1], pz - body.center[2]
    common[6, row] = sign * mx * root[0]
    common[7, row] = sign * my * root[1]
    common[8, row] = sign * mz * root[2]
    x, y, z = turned(body.axes, ry * mz - rz * my + wx, rz * mx - rx * mz + wy, rx * my - ry * mx + wz)
    common[9, row] = sign * x * root[3]
    common[10, row] = sign * y * root[4]
    common[11, row] = sign * z * root[5]
    for k in range(PHALANX_COUNT):
        block[k, row] = 0.0
    if 0 <= of < PALM_BODY:
        pose = states[palm // 12].pose
        f = of // PHALANX_COUNT
        ax, ay, az = pose.axis[f, 0], pose.axis[f, 1], pose.axis[f, 2]
        for k in range(of % PHALANX_COUNT + 1):
            rx, ry, rz = px - pose.joints[f, k, 0], py - pose.joints[f, k, 1], pz - pose.joints[f, k, 2]
            lever = ax * (ry * mz - rz * my + wx) + ay * (rz * mx - rx * mz + wy) + az * (rx * my - ry * mx + wz)
            block[k, row] = lever * weight[6 + PHALANX_COUNT * f + k]
        turn = problem.abduction_step[FINGER_COUNT * (palm // 12) + f]
        if turn != 0.0:
            ax, ay, az = pose.abduction_axis[f, 0], pose.abduction_axis[f, 1], pose.abduction_axis[f, 2]
            rx, ry, rz = px - pose.joints[f, 0, 0], py - pose.joints[f, 0, 1], pz - pose.joints[f, 0, 2]
            rate = ax * (ry * mz - rz * my + wx) + ay * (rz * mx - rx * mz + wy) + az * (rx * my - ry * mx + wz)
            rhs -= rate * turn
    problem.rhs[row] = rhs


@jit
def table_distances(body: Record, support: Support) -> tuple[float, int]:
    """Signed distance [m] of the lowest point of the object from the table, and which one it is."""
    r, center = body.rotation, body.center
    ux, uy, uz = r[2, 0], r[2, 1], r[2, 2]
    base = body.position[2] - body.table - (ux * center[0] + uy * center[1] + uz * center[2])
    point, radius = support.point, support.radius
    least, lowest = np.inf, as_int64(-1)
    for i in range(radius.shape[0]):
        d = base + ux * point[i, 0] + uy * point[i, 1] + uz * point[i, 2] - radius[i]
        if d < least:
            least, lowest = d, as_int64(i)
    return least, lowest


SLOPES = (0.0, 0.002, 0.03)
"""Planes of these slopes, in eight directions, choose the points that may touch the table in this step."""
HEADINGS = 8


@jit_once
def _choose_support(body: Record, support: Support, reach: float, friction: Record) -> None:
    # The points that are lowest over planes a little inclined: what a small turn of the object may bring to the table.
    # And those by which this tick has entered it: of points less inclined to each other the lowest is another one at
    # each program, and what only one of them holds goes into the table by the others in turn.
    r, center = body.rotation, body.center
    base = body.position[2] - body.table - (r[2, 0] * center[0] + r[2, 1] * center[1] + r[2, 2] * center[2])
    point, radius, near, near_distance = support.point, support.radius, friction.near, friction.near_distance
    ux, uy, uz = r[2, 0], r[2, 1], r[2, 2]
    found = as_int64(NEAR_POINTS + 1)
    while found > NEAR_POINTS:
        found = as_int64(0)
        for i in range(radius.shape[0]):
            d = base + ux * point[i, 0] + uy * point[i, 1] + uz * point[i, 2] - radius[i]
            if d <= reach:
                if found < NEAR_POINTS:
                    near[found] = i
                    near_distance[found] = d
                found += 1
        reach *= 0.5
    first = friction.of_hand
    count = first
    for s in range(3):
        slope = SLOPES[s]
        for heading in range(HEADINGS if s > 0 else 1):
            angle = 2.0 * math.pi * (heading + 0.5) / HEADINGS
            sine, cosine = sine_cosine(angle)
            cx, cy = slope * cosine, slope * sine
            ux, uy, uz = cx * r[0, 0] + cy * r[1, 0], cx * r[0, 1] + cy * r[1, 1], cx * r[0, 2] + cy * r[1, 2]
            least, lowest = np.inf, as_int64(-1)
            for j in range(found):
                i = near[j]
                d = near_distance[j] + ux * point[i, 0] + uy * point[i, 1] + uz * point[i, 2]
                if d < least:
                    least, lowest = d, as_int64(j)
            known = lowest < 0
            for j in range(first, count):
                known = known or friction.contact[j] == near[lowest]
            if not known and count < FRICTIONS:
                friction.contact[count] = near[lowest]
                friction.distance[count] = near_distance[lowest]
                count += 1
    ux, uy, uz = r[2, 0], r[2, 1], r[2, 2]
    for k in range(friction.entries):
        i = friction.entry[k]
        known = as_bool(False)
        for j in range(first, count):
            known = known or friction.contact[j] == i
        if not known and count < FRICTIONS:
            friction.contact[count] = i
            friction.distance[count] = base + ux * point[i, 0] + uy * point[i, 1] + uz * point[i, 2] - radius[i]
            count += 1
    friction.count = count


@jit
def keep_entry(lowest: int, friction: Record) -> None:
    """Have a point of the hull, which a step had in the table, in all further programs of the tick."""
    known = as_bool(friction.entries == ENTRIES)
    for k in range(friction.entries):
        known = known or friction.entry[k] == lowest
    if not known:
        friction.entry[friction.entries] = lowest
        friction.entries += 1


@jit_once
def find_frictions(
    body: Record,
    contacts: Record,
    problem: Record,
    support: Support,
    reach: float,
    close: float,
    step: Array,
    friction: Record,
) -> None:
    """Say which contacts have friction: those of the hands up to `close` [m], and which points may touch the table.

    Of the table those up to `reach` [m], with friction where they would come close in the step, shape (6,), that the
    object makes by itself: what lands rubs at once.
    """
    distance = contacts.distance
    within = close
    count = as_int64(HAND_FRICTION + 1)
    while count > HAND_FRICTION:
        count = as_int64(0)
        for h in range(problem.first.shape[0]):
            for i in range(problem.first[h], problem.last[h]):
                if distance[i] <= within:
                    count += 1
        if count > HAND_FRICTION:
            within *= 0.5
            if within < 1e-9:
                break
    count = as_int64(0)
    for h in range(problem.first.shape[0]):
        for i in range(problem.first[h], problem.last[h]):
            if distance[i] <= within and count < HAND_FRICTION:
                friction.contact[count] = i
                friction.body[count] = contacts.body[i]
                friction.key[count] = contacts.key[i]
                friction.has_friction[count] = 1
                friction.distance[count] = distance[i]
                for j in range(3):
                    friction.point[count, j] = contacts.point[j, i]
                    friction.normal[count, j] = contacts.normal[j, i]
                count += 1
    friction.of_hand = count
    friction.count = count
    if body.friction == 0.0 and body.torsion == 0.0:
        friction.of_hand = as_int64(0)
        friction.count = as_int64(0)
    if body.has_table == 1:
        _choose_support(body, support, reach, friction)
    r = body.rotation
    wx, wy, wz = turned_back(body.axes, step[3], step[4], step[5])
    for i in range(friction.of_hand, friction.count):
        lowest = friction.contact[i]
        friction.body[i] = ON_TABLE
        friction.key[i] = lowest
        n, p = friction.normal[i], friction.point[i]
        for j in range(3):
            n[j] = r[2, j]
            p[j] = support.point[lowest, j] - support.radius[lowest] * r[2, j]
        rx, ry, rz = p[0] - body.center[0], p[1] - body.center[1], p[2] - body.center[2]
        x, y, z = step[0] + wy * rz - wz * ry, step[1] + wz * rx - wx * rz, step[2] + wx * ry - wy * rx
        lands = friction.distance[i] + min(0.0, x * n[0] + y * n[1] + z * n[2]) <= close
        friction.has_friction[i] = 1 if lands and body.table_friction > 0.0 else 0


@jit
def orient(friction: Record, i: int, x: float, y: float, z: float, spin: float) -> bool:
    """Turn the directions of a contact so that e_1 is along s, a vector's tangential part and a spin about the normal.

    False where s is none.
    """
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
        if abs(nx) < 0.7:
            tx, ty, tz = 0.0, nz, -ny
        else:
            tx, ty, tz = -nz, 0.0, nx
        scale = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz)
        tx, ty, tz = tx * scale, ty * scale, tz * scale
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
def own_columns(problem: Record, of: int) -> int:
    """Return the first variable of the finger of a hand body; -1 for a palm and the table."""
    if of == ON_TABLE:
        return -1
    _, fingers, of = _columns(of, problem.first.shape[0])
    return fingers + PHALANX_COUNT * (of // PHALANX_COUNT) if of < PALM_BODY else -1


@jit
def coefficient(body: Record, of: int) -> float:
    """μ of a contact."""
    return body.table_friction if of == ON_TABLE else body.friction


@jit
def torsion_radius(body: Record, of: int) -> float:
    """γ of a contact [m]."""
    return 0.0 if of == ON_TABLE else body.torsion


@jit
def measure_slip(states: States, body: Record, step: Array, abduction: Array, friction: Record, i: int) -> float:
    """Set s of a contact for a step, unscaled and in the program's order; returns its length [m]."""
    of, p, n = friction.body[i], friction.point[i], friction.normal[i]
    mu = coefficient(body, of)
    x, y, z = displacement(states, body, abduction, step, of, p[0], p[1], p[2])
    normal = x * n[0] + y * n[1] + z * n[2]
    x, y, z = mu * (x - normal * n[0]), mu * (y - normal * n[1]), mu * (z - normal * n[2])
    spin = 0.0
    radius = torsion_radius(body, of)
    if radius > 0.0:
        spin = radius * relative_turn(states, body, abduction, step, of, n[0], n[1], n[2])
    friction.slip[i, 0], friction.slip[i, 1], friction.slip[i, 2], friction.spin[i] = x, y, z, spin
    return math.sqrt(x * x + y * y + z * z + spin * spin)


@jit_once
def begin_frictions(
    states: States,
    body: Record,
    step: Array,
    abduction: Array,
    problem: Record,
    held: Record,
    turns: bool,
    friction: Record,
) -> None:
    """Set what the contacts slipped in this tick so far, and Γ and directions as they were in the program before.

    A contact that is new begins with what it would slip in a step, shape (27,), of hand and object, and its abduction.
    With `turns` the directions are those that turned out better.
    """
    for i in range(friction.count):
        friction.shift[i] = 0.0
        if friction.has_friction[i] == 0:
            continue
        measure_slip(states, body, problem.total[:], problem.abduction_total[:], friction, i)
        friction.start_spin[i] = friction.spin[i]
        for j in range(3):
            friction.start[i, j] = friction.slip[i, j]
        key = TABLE_KEYS - friction.key[i] if friction.body[i] == ON_TABLE else friction.key[i]
        at = as_int64(-1)
        for j in range(held.count):
            if held.key[j] == key:
                at = as_int64(j)
                break
        if at >= 0:
            lean, along = held.leaning[at], held.along[at]
            if turns and orient(friction, i, lean[0], lean[1], lean[2], lean[3]):
                friction.shift[i] = held.shift[at]
                continue
            if orient(friction, i, along[0], along[1], along[2], held.about[at]):
                friction.shift[i] = held.shift[at]
                continue
        else:
            slip = measure_slip(states, body, step, abduction, friction, i)
            if orient(friction, i, friction.slip[i, 0], friction.slip[i, 1], friction.slip[i, 2], friction.spin[i]):
                friction.shift[i] = slip
                continue
        if abs(friction.normal[i, 0]) > 0.7:
            orient(friction, i, 0.0, 1.0, 0.0, 0.0)
        else:
            orient(friction, i, 1.0, 0.0, 0.0, 0.0)


@jit
def friction_rows(
    states: States, body: Record, offset: float, relaxed: bool, problem: Record, friction: Record
) -> None:
    """Write the rows of friction and of the table, and the groups of all rows."""
    start, stop, block = problem.group_start, problem.group_stop, problem.group_block
    hands, table = problem.first.shape[0], start.shape[0] - 1
    row = problem.last[hands - 1] + LIMIT_ROWS
    for h in range(hands):
        fingers = own_columns(problem, BODY_COUNT * h)
        begin, limits = states[h].contacts.start, problem.last[h]
        first_group = (2 * FINGER_COUNT + 1) * h
        for owner in range(FINGER_COUNT + 1):
            g = first_group + owner
            start[g], stop[g] = problem.first[h] + begin[owner], problem.first[h] + begin[owner + 1]
            block[g] = fingers + PHALANX_COUNT * (owner - 1) if owner > 0 else -1
        for f in range(FINGER_COUNT):
            touched = begin[f + 2] > begin[f + 1]
            g = first_group + FINGER_COUNT + 1 + f
            start[g] = limits + 2 * PHALANX_COUNT * f
            stop[g] = start[g] + (2 * PHALANX_COUNT if touched else 0)
            block[g] = fingers + PHALANX_COUNT * f
        first_group = (2 * FINGER_COUNT + 1) * hands + (FINGER_COUNT + 1) * h
        for owner in range(FINGER_COUNT + 1):
            g = first_group + owner
            start[g] = row
            block[g] = fingers + PHALANX_COUNT * (owner - 1) if owner > 0 else -1
            for i in range(friction.of_hand):
                of = friction.body[i] - BODY_COUNT * h
                if 0 <= of < BODY_COUNT and (0 if of == PALM_BODY else 1 + of // PHALANX_COUNT) == owner:
                    row = contact_rows(states, body, offset, relaxed, i, row, problem, friction)
            stop[g] = row
    start[table], block[table] = row, -1
    for i in range(friction.of_hand, friction.count):
        n = friction.normal[i]
        rhs = offset - friction.distance[i]
        if friction.has_friction[i] == 1:
            rhs -= STANDS_BACK * offset
        if relaxed and friction.distance[i] >= 0.0:
            rhs = min(rhs, 0.0)
        write_row(states, body, problem, ON_TABLE, row, friction.point[i], (n[0], n[1], n[2]), (0.0, 0.0, 0.0), rhs)
        problem.key[row] = TABLE_KEYS - KINDS * friction.key[i]
        problem.owner[row] = i
        problem.kind[row] = 0
        row += 1
        if friction.has_friction[i] == 1:
            row = contact_rows(states, body, offset, relaxed, i, row, problem, friction)
    stop[table] = row
    for i in range(friction.of_hand):
        row = friction.contact[i]
        problem.owner[row] = i
        problem.rhs[row] -= STANDS_BACK * offset


@jit
def contact_rows(
    states: States, body: Record, offset: float, relaxed: bool, i: int, row: int, problem: Record, friction: Record
) -> int:
    """Write the rows of friction of a contact from a row on; returns the one behind them."""
    of, point, n = friction.body[i], friction.point[i], friction.normal[i]
    mu, radius, d = coefficient(body, of), torsion_radius(body, of), friction.distance[i]
    friction.row[i] = row
    start = friction.start[i]
    for k in range(PER_CONTACT):
        e = k % DIRECTIONS
        if e == DIRECTIONS - 1 and radius == 0.0:
            continue
        sign = 1.0 if k < DIRECTIONS else -1.0
        t, w = friction.along[i, e], -sign * radius * friction.about[i, e]
        push = sign * mu
        begun = start[0] * t[0] + start[1] * t[1] + start[2] * t[2] + friction.start_spin[i] * friction.about[i, e]
        rhs = offset - d - friction.shift[i] + sign * begun
        if relaxed and d >= 0.0:
            rhs = min(rhs, 0.0)
        m = (n[0] - push * t[0], n[1] - push * t[1], n[2] - push * t[2])
        write_row(states, body, problem, of, row, point, m, (w * n[0], w * n[1], w * n[2]), rhs)
        if of == ON_TABLE:
            problem.key[row] = TABLE_KEYS - KINDS * friction.key[i] - 1 - k
        else:
            problem.key[row] = KINDS * friction.key[i] + 1 + k
        problem.owner[row] = i
        problem.kind[row] = 1 + k
        row += 1
    return row
