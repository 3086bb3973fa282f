"""Surface of parts that move as recorded, and the ways by which a hand leaves them.

From inside, where a part has moved over the axis of a phalanx or over the centre of a sphere of the palm, the distances
to its features have the wrong side. Of each body with such a point the part then has one plane instead: that of the
nearest feature of one of these points, the one that the body is least deep below. Of a convex part such a plane has all
of it below, so that a body above it is free.

Every part has lists of its own, and is looked at by the kernels of a surface that stands still, with the hand as the
part sees it; what that finds is turned. The slack of its lists falls by what the hand has moved past it, whichever of
the two moved.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference, declare_row
from hhsim.kernels.contact.detection import ListDistances, evaluate_pairs, evaluate_rigid
from hhsim.kernels.contact.surface import (
    SHARED_CANDIDATES,
    at_distance,
    cone_distance,
    pairs_within,
    record_pairs,
    shared_first,
    write_contact,
)
from hhsim.kernels.hand.kinematics import BODY_COUNT, FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays, seen_cone
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.kernels.jit import Array, Indices, Record, jit, jit_inline, jit_noinline
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.rotation import turned, turned_back
from hhsim.kernels.round_cone import RoundCone
from hhsim.kernels.surfaces.mesh import way_out

AXIS_POINTS = 9
"""Points of a phalanx's axis that are looked at, at most 6 mm apart."""
NEAR_AXIS = 0.5
"""A body whose axis is nearer to a part than this multiple of its least radius may have it over its axis soon: in a
sub-step a part passes it by the margin at most."""
OPPOSITE = -0.5
"""Cosine of the angle with its way out so far beyond which a body takes no other: it leaves a part where it came in."""
DEPTH_ROUNDING = 1e-12
"""Error of a depth [m]."""
KEY = 1 << 40
"""Least key of a way out: more than the keys of the features of a part."""

Plane = tuple[float, float, float, float]
"""Unit normal, outward, and n · x [m] of its points."""


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
    solid: MeshFeatures, hand: HandArrays, part: Record, body: int, shortest: float, opposite: float, least: float
) -> float:
    """Write the plane of a point in the part that the body is least deep below, if less than before; return the depth.

    Left out are planes that the body is less deep below than `shortest` [m], which lead nowhere, and those whose normal
    has a cosine below `opposite` with the way out so far.
    """
    before = _plane(part, body)
    for i in range(_point_count(hand, body)):
        x, y, z, _ = _sphere(hand, part.hand, body, i)
        height, nx, ny, nz = way_out(solid, x, y, z, part.near.stack[:])
        height -= part.sticks_out
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
def _seek(solid: MeshFeatures, hand: HandArrays, part: Record, body: int) -> float:
    """Write the way out of a body that the part is over, and return its depth [m], infinite of any other body."""
    # No way out of a part is shorter than that of one of the body's spheres alone.
    shortest, least = 0.0, np.inf
    for i in range(_point_count(hand, body)):
        x, y, z, radius = _sphere(hand, part.hand, body, i)
        height = way_out(solid, x, y, z, part.near.stack[:])[0] - part.sticks_out
        if height <= 0.0:
            shortest = max(shortest, radius - height - DEPTH_ROUNDING)
    if shortest == 0.0:
        return np.inf
    if part.is_over[body] == 1:
        depth = _deepest(hand, part.hand, body, _plane(part, body))
        least = depth if depth >= shortest else np.inf
        least = _try_planes(solid, hand, part, body, shortest, OPPOSITE, least)
    if least == np.inf:
        least = _try_planes(solid, hand, part, body, shortest, -np.inf, least)
    return least


@jit_noinline
def find_ways_out(solid: MeshFeatures, hand: HandArrays, part: Record) -> None:
    """Find the bodies that a part is over, and their ways out; their distance from it is the depth there, negative.

    The way leads out of the part's mesh, and of what its surface sticks out of it: between spheres there may be none.
    """
    near = part.near
    for body in range(BODY_COUNT):
        radius = np.inf
        for i in range(_point_count(hand, body)):
            radius = min(radius, _sphere(hand, part.hand, body, i)[3])
        if part.is_over[body] == 0 and near.nearest[body] >= -NEAR_AXIS * radius:
            continue
        depth = _seek(solid, hand, part, body)
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
        normal = plane[0], plane[1], plane[2]
        point, key = at_distance((x, y, z), normal, -radius), KEY + BODY_COUNT * i + body
        write_contact(contacts, row, point, normal, -depth, (radius, np.inf), key)
        contacts.body[row] = body
        row += 1
    return row


KEY_STRIDE = 1 << 48
"""More than the keys of a part's pairs: the part of a contact is its key over this."""


def part_dtype(candidates: "np.dtype[Any] | None" = None) -> "np.dtype[Any]":
    """Return the record of a part whose surface has these candidates; without, what is the same for all surfaces."""
    return np.dtype(
        [
            ("position", np.float64, (3,)),  # origin of the part's frame [m], in the body's
            ("orientation", np.float64, (4,)),  # part to body, (w, x, y, z)
            ("rotation", np.float64, (3, 3)),  # the same as a matrix
            ("sticks_out", np.float64),  # `JointedSurface.sticks_out`
            ("yields", np.int64),  # 1 if the part has moved since the hand last had a place
            ("hand", HAND_POSE),  # the hand in the part's frame; its axes of rotation are not written
            ("is_over", np.int64, (BODY_COUNT,)),  # 1 if the part is over a point of the body's axis
            ("plane", np.float64, (BODY_COUNT, 4)),  # way out of these, part's frame
            # Last: their size is the surface's own.
            ("near", shared_first(candidates)),
        ],
        align=True,
    )


def whole_dtype(candidates: "np.dtype[Any]") -> "np.dtype[Any]":
    """Return the candidates of a body whose parts have these: the least of them, and the workspace of a walk."""
    assert candidates.fields is not None
    walk = [(name, candidates.fields[name][0]) for name in ("scratch", "stack")]
    return np.dtype([*SHARED_CANDIDATES, *walk], align=True)


@by_reference
class PartsMotion(NamedTuple):
    """P parts that move, of any kind of surface."""

    path: Array  # position [m] and orientation (w, x, y, z) of each part in the body's frame at each tick, (T, P, 7)
    tick: Indices  # number of ticks begun, (1,)
    part: NDArray[np.void]  # records of `part_dtype()`, of `JointedSurface.part`; two or more


@by_reference
class JointedSurface(NamedTuple):
    """P parts of one kind of surface, each in its own frame, and their motion."""

    pieces: Any  # `TreeArrays` or `MeshFeatures` of the first part
    written: Indices  # those of each part for kernels, see `by_reference.write_rows`, (P, ·)
    solid: MeshFeatures  # mesh of the first part
    solids: Indices  # those of each part, likewise
    sticks_out: Array  # how far the surface of each part is outside its mesh at most [m], (P,)
    part: NDArray[np.void]  # records of `part_dtype`, (P,)
    motion: PartsMotion


_row = cast(Callable[[Any, Indices, int], Any], intrinsic(declare_row))


@jit_inline
def _pieces_of(surface: JointedSurface, p: int) -> Any:
    return _row(surface.pieces, surface.written, p)


@jit_inline
def _see_hand(pose: Record, part: Record) -> None:
    """Write the hand as the part sees it."""
    r, p, seen = part.rotation, part.position, part.hand
    x, y, z = turned_back(r, pose.position[0] - p[0], pose.position[1] - p[1], pose.position[2] - p[2])
    seen.position[0], seen.position[1], seen.position[2] = x, y, z
    for j in range(3):
        x, y, z = turned_back(r, pose.rotation[0, j], pose.rotation[1, j], pose.rotation[2, j])
        seen.rotation[0, j], seen.rotation[1, j], seen.rotation[2, j] = x, y, z
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT + 1):
            joint, joint_out = pose.joints[f, k], seen.joints[f, k]
            x, y, z = turned_back(r, joint[0] - p[0], joint[1] - p[1], joint[2] - p[2])
            joint_out[0], joint_out[1], joint_out[2] = x, y, z
        for k in range(PHALANX_COUNT):
            axis, axis_out = pose.direction[f, k], seen.direction[f, k]
            x, y, z = turned_back(r, axis[0], axis[1], axis[2])
            axis_out[0], axis_out[1], axis_out[2] = x, y, z


@evaluate_pairs.of(JointedSurface)
@jit_inline
def _evaluate(
    surface: JointedSurface, hand: HandArrays, pose: Record, reach: ListDistances, candidates: Record, work: Indices
) -> int:
    status = 0
    candidates.needed = reach.needed
    for body in range(BODY_COUNT):
        candidates.nearest[body] = candidates.slack[body] = np.inf
        candidates.count[body] = 0
    for p in range(surface.part.shape[0]):
        part = surface.part[p]
        near = part.near
        for body in range(BODY_COUNT):
            # The lists of the whole have no slack that falls: a negative infinity asks for all of them anew.
            if candidates.gathered_slack[body] != 0.0:
                near.gathered_slack[body] = candidates.gathered_slack[body]
                near.count[body] = 0
        near.allowed_deficit = candidates.allowed_deficit
        _see_hand(pose, part)
        pieces = _pieces_of(surface, p)
        status |= evaluate_rigid(pieces, hand, part.hand, reach, near, work)
        if part.yields == 1:
            find_ways_out(_row(surface.solid, surface.solids, p), hand, part)
        for body in range(BODY_COUNT):
            candidates.nearest[body] = min(candidates.nearest[body], near.nearest[body])
            candidates.slack[body] = min(candidates.slack[body], near.slack[body])
            candidates.count[body] += near.count[body]
    for body in range(BODY_COUNT):
        if candidates.gathered_slack[body] < np.inf:
            candidates.gathered_slack[body] = 0.0
    return status


@pairs_within.of(JointedSurface)
@jit_inline
def _within(surface: JointedSurface, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    within = 0
    for p in range(surface.part.shape[0]):
        near = surface.part[p].near
        if surface.part[p].is_over[body] == 1:
            within += 1
        elif near.nearest[body] <= limit:
            pieces = _pieces_of(surface, p)
            within += pairs_within(pieces, hand, near, body, limit)
    return within


@jit_inline
def _turn_column(rotation: Array, vectors: Array, i: int) -> None:
    x, y, z = turned(rotation, vectors[0, i], vectors[1, i], vectors[2, i])
    vectors[0, i], vectors[1, i], vectors[2, i] = x, y, z


@record_pairs.of(JointedSurface)
@jit_inline
def _record(
    surface: JointedSurface,
    hand: HandArrays,
    pose: Record,
    body: int,
    candidates: Record,
    limit: float,
    row: int,
    contacts: Record,
) -> int:
    for p in range(surface.part.shape[0]):
        part = surface.part[p]
        if part.near.nearest[body] > limit:
            continue
        first = row
        pieces = _pieces_of(surface, p)
        if part.is_over[body] == 1:
            row = record_way_out(hand, part, body, limit, row, contacts)
        else:
            row = record_pairs(pieces, hand, part.hand, body, part.near, limit, row, contacts)
        if row < 0:
            return -1
        for i in range(first, row):
            contacts.key[i] += p * KEY_STRIDE
            _turn_column(part.rotation[:], contacts.normal[:], i)
            _turn_column(part.rotation[:], contacts.straight[:], i)
            _turn_column(part.rotation[:], contacts.point[:], i)
            for j in range(3):
                contacts.point[j, i] += part.position[j]
    return row


@cone_distance.of(JointedSurface)
@jit_noinline
def _cone_distance(surface: JointedSurface, cone: RoundCone, limit: float, stack: Indices) -> float:
    for p in range(surface.part.shape[0]):
        pieces = _pieces_of(surface, p)
        limit = cone_distance(pieces, seen_cone(surface.part[p], cone), limit, stack)
    return limit


@jit_inline
def passing(part: Record, goal: Array, point: Array) -> float:
    """Compute how far a point, shape (3,), moves past a part [m] that goes to a pose, shape (7,): its own motion."""
    w, x, y, z = goal[3], goal[4], goal[5], goal[6]
    p = part.position
    a = turned_back(part.rotation, point[0] - p[0], point[1] - p[1], point[2] - p[2])
    dx, dy, dz = point[0] - goal[0], point[1] - goal[1], point[2] - goal[2]
    # Turned back by the goal's quaternion: v - 2 w (u × v) + 2 u × (u × v).
    cx, cy, cz = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
    bx = dx + 2.0 * (y * cz - z * cy - w * cx)
    by = dy + 2.0 * (z * cx - x * cz - w * cy)
    bz = dz + 2.0 * (x * cy - y * cx - w * cz)
    return math.sqrt((a[0] - bx) ** 2 + (a[1] - by) ** 2 + (a[2] - bz) ** 2)
