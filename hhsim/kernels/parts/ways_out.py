"""Ways out of a part that has moved over the axis of a phalanx, or over the centre of a sphere of the palm.

From inside, the distances to a part's features have the wrong side. Of each body with such a point the part then has
one plane instead: that of the nearest feature of one of these points, the one that the body is least deep below. Of a
convex part such a plane has all of it below, so that a body above it is free.
"""

from typing import Any

import numpy as np

from hhsim.kernels.contact.surface import way_out
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.kernels.jit import Record, jit, jit_inline, jit_noinline
from hhsim.kernels.rotation import turned

AXIS_POINTS = 9
"""Points of a phalanx's axis that are looked at, at most 6 mm apart."""
DEEP = 0.5
"""A body whose axis is nearer to a part than this multiple of its least radius may have it over its axis soon: in a
sub-step a part passes it by the margin at most."""
OPPOSITE = -0.5
"""Cosine of the angle with its way out so far beyond which a body takes no other: it leaves a part where it came in."""
ROUNDING = 1e-12
"""Error of a depth [m]."""
KEY = 1 << 40
"""Least key of a way out: more than the keys of the features of a part."""

Plane = tuple[float, float, float, float]
"""Unit normal, outward, and n · x [m] of its points."""

WAYS_OUT = [
    ("hand", HAND_POSE),  # the hand in the part's frame; its axes of rotation are not written
    ("is_over", np.int64, (BODY_COUNT,)),  # 1 if the part is over a point of the body's axis
    ("plane", np.float64, (BODY_COUNT, 4)),  # way out of these, part's frame
]
"""Fields of a part's record."""


@jit_inline
def _point_count(hand: HandArrays, body: int) -> int:
    return AXIS_POINTS if body < PALM_BODY else hand.palm_radius.shape[0]


@jit_inline
def _sphere(hand: HandArrays, pose: Record, body: int, i: int) -> tuple[float, float, float, float]:
    """Return a sphere of the palm, or that around a point of a phalanx's axis: its centre and radius [m]."""
    if body < PALM_BODY:
        f, k, t = body // PHALANX_COUNT, body % PHALANX_COUNT, i / (AXIS_POINTS - 1)
        a, b = pose.joints[f, k], pose.joints[f, k + 1]
        radius = hand.radius[f, k] + t * (hand.radius[f, k + 1] - hand.radius[f, k])
        return (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]), radius)
    x, y, z = turned(pose.rotation, hand.palm_x[i], hand.palm_y[i], hand.palm_z[i])
    p = pose.position
    return (x + p[0], y + p[1], z + p[2], hand.palm_radius[i])


@jit_inline
def _depth(hand: HandArrays, pose: Record, body: int, i: int, plane: Plane) -> float:
    """Compute how deep a sphere of a body is below a plane [m]."""
    x, y, z, radius = _sphere(hand, pose, body, i)
    return radius + plane[3] - (plane[0] * x + plane[1] * y + plane[2] * z)


@jit_inline
def _deepest(hand: HandArrays, pose: Record, body: int, plane: Plane) -> float:
    deepest = 0.0
    for i in range(_point_count(hand, body)):
        deepest = max(deepest, _depth(hand, pose, body, i, plane))
    return deepest


@jit_inline
def _plane(part: Record, body: int) -> Plane:
    n = part.plane[body]
    return (n[0], n[1], n[2], n[3])


@jit_inline
def _try_planes(
    pieces: Any, hand: HandArrays, part: Record, body: int, shortest: float, opposite: float, least: float
) -> float:
    """Write the plane of a point in the part that the body is least deep below, if less than before; return the depth.

    Left out are planes that the body is less deep below than `shortest` [m], which lead nowhere, and those whose normal
    has a cosine below `opposite` with the way out so far.
    """
    before = _plane(part, body)
    for i in range(_point_count(hand, body)):
        x, y, z, _ = _sphere(hand, part.hand, body, i)
        height, nx, ny, nz = way_out(pieces, x, y, z, part.near.stack[:])
        if height > 0.0 or nx * before[0] + ny * before[1] + nz * before[2] < opposite:
            continue
        plane = (nx, ny, nz, nx * x + ny * y + nz * z - height)
        depth = _deepest(hand, part.hand, body, plane)
        if shortest <= depth < least:
            least = depth
            for j in range(4):
                part.plane[body, j] = plane[j]
    return least


@jit
def _seek(pieces: Any, hand: HandArrays, part: Record, body: int) -> float:
    """Write the way out of a body that the part is over, and return its depth [m], infinite of any other body."""
    # No way out of a part is shorter than that of one of the body's spheres alone.
    shortest, least = 0.0, np.inf
    for i in range(_point_count(hand, body)):
        x, y, z, radius = _sphere(hand, part.hand, body, i)
        height, _, _, _ = way_out(pieces, x, y, z, part.near.stack[:])
        if height <= 0.0:
            shortest = max(shortest, radius - height - ROUNDING)
    if shortest == 0.0:
        return np.inf
    if part.is_over[body] == 1:
        depth = _deepest(hand, part.hand, body, _plane(part, body))
        least = depth if depth >= shortest else np.inf
        least = _try_planes(pieces, hand, part, body, shortest, OPPOSITE, least)
    if least == np.inf:
        least = _try_planes(pieces, hand, part, body, shortest, -np.inf, least)
    return least


@jit_noinline
def find_ways_out(pieces: Any, hand: HandArrays, part: Record) -> None:
    """Find the bodies that a part is over, and their ways out; their distance from it is the depth there, negative."""
    near = part.near
    for body in range(BODY_COUNT):
        radius = np.inf
        for i in range(_point_count(hand, body)):
            radius = min(radius, _sphere(hand, part.hand, body, i)[3])
        if part.is_over[body] == 0 and near.nearest[body] >= -DEEP * radius:
            continue
        depth = _seek(pieces, hand, part, body)
        part.is_over[body] = 1 if depth < np.inf else 0
        if depth < np.inf:
            near.nearest[body] = -depth


@jit
def record_way_out(hand: HandArrays, part: Record, body: int, limit: float, row: int, contacts: Record) -> int:
    """Write the contacts of a body with the plane of its way out, part's frame; return the row after, or -1."""
    plane = _plane(part, body)
    points = _point_count(hand, body)
    # A phalanx is as deep as one of its ends.
    for i in range(0, points, points - 1 if body < PALM_BODY else 1):
        depth = _depth(hand, part.hand, body, i, plane)
        if -depth > limit:
            continue
        if row >= contacts.key.shape[0]:
            return -1
        x, y, z, radius = _sphere(hand, part.hand, body, i)
        for j in range(3):
            contacts.normal[j, row] = plane[j]
            contacts.point[j, row] = (x, y, z)[j] - radius * plane[j]
            contacts.straight[j, row] = 0.0
        contacts.body[row], contacts.key[row] = body, KEY + BODY_COUNT * i + body
        contacts.distance[row], contacts.hand_radius[row], contacts.object_radius[row] = -depth, radius, np.inf
        contacts.slides[row] = 0
        row += 1
    return row
