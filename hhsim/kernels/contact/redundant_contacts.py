"""Removal of contacts whose rows follow from another one.

A patch of a sphere tree brings many contacts with nearly the same normal, one above the other. Let contact j be on the
same rigid body as contact i, x the points of the body's axis (or of the palm's sphere) that are nearest to the two
spheres, n their normals, d their distances. A step turns the body by a rotation vector w, and moves x_j by v_j, so that
v_i = v_j + w × (x_i - x_j). If the program holds row j, d_j + n_j · v_j >= ε, then

    d_i + n_i · v_i = d_i + n_j · v_j + n_i · (w × (x_i - x_j)) + (n_i - n_j) · v_j
                   >= ε + (d_i - d_j) - |w| |x_i - x_j| - |n_i - n_j| |v_j|,

and no step is longer than `reach` at any axis point of a body that has contacts: |v_j| <= reach, and |w| <= reach over
the body's turning lever, of a phalanx across its axis, along which x_i - x_j lies. Hence row i follows from row j where

    d_i - d_j >= reach · (|x_i - x_j| / lever + |n_i - n_j|).

The first reference is the body's nearest contact, which a step is most likely to meet; then the nearest of those that
do not follow from it, and so on.
"""

import numpy as np

from hhsim.kernels.arithmetic import fused, least_above, product
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Array, Record, jit_inline

REFERENCES = 3
"""Number of reference contacts of a body: most that follow from any do so from the first ones."""
REFERENCE = -np.inf
"""Mark of a reference contact; infinity marks one that follows, and any other number, its distance [m], an open one."""
FEWEST = 8
"""Least number of contacts of a body to thin: fewer rows cost less than the search."""


@jit_inline
def _open_all(start: int, stop: int, distance: Array, open_distance: Array) -> None:
    for i in range(np.uint64(start), np.uint64(stop)):
        open_distance[i] = distance[i]


@jit_inline
def _drop_implied(
    start: int,
    stop: int,
    reference: int,
    per_metre: float,
    reach: float,
    point: Array,
    normal: Array,
    distance: Array,
    hand_radius: Array,
    open_distance: Array,
) -> None:
    r = hand_radius[reference]
    ax, ay, az = normal[0, reference], normal[1, reference], normal[2, reference]
    bx, by = fused(r, ax, point[0, reference]), fused(r, ay, point[1, reference])
    bz = fused(r, az, point[2, reference])
    d, lever, turn = distance[reference], per_metre * per_metre, reach * reach
    for i in range(np.uint64(start), np.uint64(stop)):
        nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
        ri = hand_radius[i]
        x, y, z = fused(ri, nx, point[0, i]) - bx, fused(ri, ny, point[1, i]) - by, fused(ri, nz, point[2, i]) - bz
        nx, ny, nz = nx - ax, ny - ay, nz - az
        # √p + √q <= gap, without the roots.
        p, q = lever * product(x, y, z, x, y, z), turn * product(nx, ny, nz, nx, ny, nz)
        gap = distance[i] - d
        rest = fused(gap, gap, -p - q)
        before = open_distance[i]
        implied = (gap >= 0.0) & (rest >= 0.0) & (4.0 * p * q <= rest * rest) & (before > REFERENCE)
        open_distance[i] = np.inf if implied else before


@jit_inline
def move_contact(contacts: Record, source: int, target: int) -> None:
    """Copy a contact to another row."""
    contacts.body[target] = contacts.body[source]
    contacts.key[target] = contacts.key[source]
    for j in range(3):
        contacts.point[j, target] = contacts.point[j, source]
        contacts.normal[j, target] = contacts.normal[j, source]
        contacts.straight[j, target] = contacts.straight[j, source]
    contacts.distance[target] = contacts.distance[source]
    contacts.hand_radius[target] = contacts.hand_radius[source]
    contacts.object_radius[target] = contacts.object_radius[source]
    contacts.slides[target] = contacts.slides[source]


@jit_inline
def _thin(start: int, stop: int, row: int, lever: float, reach: float, contacts: Record, open_distance: Array) -> int:
    """Move those of the contacts [start, stop) that do not follow to `row` and on; return the row after them."""
    thins = stop - start >= FEWEST
    if thins:
        point, normal, distance, hand_radius = contacts.point, contacts.normal, contacts.distance, contacts.hand_radius
        _open_all(start, stop, distance, open_distance)
        for _ in range(REFERENCES):
            least = least_above(open_distance, start, stop, REFERENCE)
            if least == np.inf:
                break
            nearest = start
            while open_distance[nearest] != least:
                nearest += 1
            open_distance[nearest] = REFERENCE
            _drop_implied(
                start, stop, nearest, reach / lever, reach, point, normal, distance, hand_radius, open_distance
            )
    for i in range(start, stop):
        if not thins or open_distance[i] < np.inf:
            if row < i:
                move_contact(contacts, i, row)
            row += 1
    return row


@jit_inline
def drop_redundant_contacts(hand: HandArrays, reach: float, contacts: Record, open_distance: Array) -> None:
    """Keep, in order, the contacts that do not follow from others of their body in a step of up to `reach` [m]."""
    start = contacts.start[0]
    stop = contacts.start[1]
    row = _thin(start, stop, start, hand.turning_lever[PALM_BODY], reach, contacts, open_distance)
    contacts.start[1] = row
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            start = stop
            stop = contacts.phalanx_end[f, k]
            row = _thin(start, stop, row, hand.turning_lever[3 * f + k], reach, contacts, open_distance)
            contacts.phalanx_end[f, k] = row
        contacts.start[f + 2] = row
