"""Contacts by which a body stands on the table or on another body: of many the lowest, however it tilts a little."""

import math

import numpy as np

from hhsim.kernels.arithmetic import sine_cosine
from hhsim.kernels.contact.linearise import FEWEST, move_contact
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit
from hhsim.kernels.rotation import turned_back
from hhsim.kernels.world.body import Support
from hhsim.kernels.world.rows import ENTRIES, NEAR_POINTS, PAIR_KEYS, any_tangent

SLOPES = (0.0, 0.002, 0.03)
"""Planes of these slopes, in eight directions, choose the points that may touch the table in this step."""
HEADINGS = 8
ALIKE = 1e-6
"""Contacts of two bodies whose normals have a product of no less than 1 less this lie on one plane."""


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


@jit
def _choose_lowest(count: int, along: Array, across: Array, most: int, friction: Record) -> int:
    """Choose, of the points in `near`, those that are lowest over planes a little inclined; returns how many.

    That is what a small turn may bring to the plane. Their places go to `lowest`, at most `most`; `along` and `across`
    are the plane's axes, shape (3,).
    """
    point, distance, lowest = friction.near_point, friction.near_distance, friction.lowest
    chosen = as_int64(0)
    for s in range(3):
        slope = SLOPES[s]
        for heading in range(HEADINGS if s > 0 else 1):
            angle = 2.0 * math.pi * (heading + 0.5) / HEADINGS
            sine, cosine = sine_cosine(angle)
            cx, cy = slope * cosine, slope * sine
            ux, uy, uz = (
                cx * along[0] + cy * across[0],
                cx * along[1] + cy * across[1],
                cx * along[2] + cy * across[2],
            )
            least, place = np.inf, as_int64(-1)
            for j in range(count):
                d = distance[j] + ux * point[0, j] + uy * point[1, j] + uz * point[2, j]
                if d < least:
                    least, place = d, as_int64(j)
            known = place < 0
            for j in range(chosen):
                known = known or lowest[j] == place
            if not known and chosen < most:
                lowest[chosen] = place
                chosen += 1
    return chosen


@jit
def _choose_support(body: Record, support: Support, reach: float, number: int, friction: Record) -> None:
    # The lowest points; and those by which this tick has entered the table: of points less inclined to each other the
    # lowest is another one at each program, and what only one of them holds goes into the table by the others in turn.
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
                    for j in range(3):
                        friction.near_point[j, found] = point[i, j]
                found += 1
        reach *= 0.5
    first, most = friction.count, friction.room
    chosen = _choose_lowest(found, r[0], r[1], most - first, friction)
    for j in range(chosen):
        friction.contact[first + j] = near[friction.lowest[j]]
        friction.distance[first + j] = near_distance[friction.lowest[j]]
    count = first + chosen
    for k in range(friction.entries[number]):
        i = friction.entry[number, k]
        known = as_bool(False)
        for j in range(first, count):
            known = known or friction.contact[j] == i
        if not known and count < most:
            friction.contact[count] = i
            friction.distance[count] = base + ux * point[i, 0] + uy * point[i, 1] + uz * point[i, 2] - radius[i]
            count += 1
    friction.count = count


@jit
def keep_lowest(contacts: Record, open_distance: Array, friction: Record) -> None:
    """Keep, in their order, of the contacts of two bodies that lie on one plane those that are lowest over it.

    What a step brings in by another one is found by its distances, as is what enters the table. `open_distance` is
    workspace of shape (CONTACT_ROWS,): infinity marks a contact to leave out, -infinity one to keep.
    """
    count, near, point, normal = contacts.start[1], friction.near, contacts.point, contacts.normal
    if count < FEWEST:
        return
    for i in range(count):
        open_distance[i] = contacts.distance[i]
    while True:
        seed = as_int64(-1)
        for i in range(count):
            if -np.inf < open_distance[i] < np.inf and (seed < 0 or open_distance[i] < open_distance[seed]):
                seed = as_int64(i)
        if seed < 0:
            break
        nx, ny, nz = normal[0, seed], normal[1, seed], normal[2, seed]
        found = as_int64(0)
        for i in range(count):
            if not -np.inf < open_distance[i] < np.inf or found == NEAR_POINTS:
                continue
            if normal[0, i] * nx + normal[1, i] * ny + normal[2, i] * nz >= 1.0 - ALIKE:
                near[found] = i
                friction.near_distance[found] = contacts.distance[i]
                for j in range(3):
                    friction.near_point[j, found] = point[j, i]
                found += 1
        along, across = friction.plane[0], friction.plane[1]
        along[0], along[1], along[2] = any_tangent(nx, ny, nz)
        across[0] = ny * along[2] - nz * along[1]
        across[1] = nz * along[0] - nx * along[2]
        across[2] = nx * along[1] - ny * along[0]
        chosen = _choose_lowest(found, along, across, found, friction)
        for j in range(found):
            open_distance[near[j]] = np.inf
        for j in range(chosen):
            open_distance[near[friction.lowest[j]]] = -np.inf
    row = as_int64(0)
    for i in range(count):
        if open_distance[i] == -np.inf:
            if row < i:
                move_contact(contacts, i, row)
            row += 1
    for owner in range(1, contacts.start.shape[0]):
        contacts.start[owner] = row


@jit
def keep_entry(number: int, lowest: int, friction: Record) -> None:
    """Have a point of a body's hull, which a step had in the table, in all further programs of the tick."""
    known = as_bool(friction.entries[number] == ENTRIES)
    for k in range(friction.entries[number]):
        known = known or friction.entry[number, k] == lowest
    if not known:
        friction.entry[number, friction.entries[number]] = lowest
        friction.entries[number] += 1


@jit
def find_table_contacts(
    body: Record, number: int, support: Support, reach: float, close: float, step: Array, friction: Record
) -> None:
    """Say which points of a body may touch the table: those up to `reach` [m].

    They have friction where they would come close in the step, shape (6,), that the body makes by itself: what lands
    rubs at once.
    """
    if body.has_table == 0:
        return
    first = friction.count
    _choose_support(body, support, reach, number, friction)
    r = body.rotation
    wx, wy, wz = turned_back(body.axes, step[3], step[4], step[5])
    for i in range(first, friction.count):
        lowest = friction.contact[i]
        friction.contact_code[i] = -1 - number
        friction.key[i] = lowest + PAIR_KEYS * number
        n, p = friction.normal[i], friction.point[i]
        for j in range(3):
            n[j] = r[2, j]
            p[j] = support.point[lowest, j] - support.radius[lowest] * r[2, j]
        rx, ry, rz = p[0] - body.center[0], p[1] - body.center[1], p[2] - body.center[2]
        x, y, z = step[0] + wy * rz - wz * ry, step[1] + wz * rx - wx * rz, step[2] + wx * ry - wy * rx
        lands = friction.distance[i] + min(0.0, x * n[0] + y * n[1] + z * n[2]) <= close
        friction.has_friction[i] = 1 if lands and body.table_friction > 0.0 else 0
