"""Bodies of a scene in the kernels' form: what of them meets others, and how they move."""

from collections.abc import Sequence
from contextlib import suppress
from itertools import count
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.model import palm_arrays
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.world.body import HINGE, SLIDER, Support
from hhsim.kernels.world.edges import Edges
from hhsim.reproducible import across, matmul, principal_axes
from hhsim.scene.body import Body, Driven, Fixed, HalfSpace, Joint
from hhsim.trees.contact_surface import ContactSurface
from hhsim.trees.hierarchy import build_hierarchy

MOST_POINTS = 1024
"""Most corners or spheres by which a body meets another one: as many as a palm may have."""
FLAT = 1e-9
"""Faces that turn by less than this at an edge go on in one plane, or are a groove."""
BRANCHING = 8
NO_SUPPORT = Support(np.zeros((0, 3)), np.zeros(0))
NO_EDGES = Edges(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 2, 3)))
BELOW = 1e-6
"""Largest depth [m] of an object in the table at the start: rounding."""
HEAVY = 1e6
"""Mass [kg] and moment of inertia [kg·m²] of a driven body: 100 N move it by 0.1 nm in a tick of 1 ms."""


def body_shapes(
    hand: HandArrays, bodies: Sequence[Body], surfaces: Sequence[ContactSurface], centers: Sequence[FloatArray]
) -> tuple[list[Support], list[HandArrays], list[Edges]]:
    """Return what of each body can stand on a plane, and what meets the others: itself as a palm, and its edges.

    `hand` has what is not of the palm; `centers` are the points about which the bodies turn [m], world, shape (3,).
    """
    supports = [support_of(surface) if body.is_free else NO_SUPPORT for body, surface in zip(bodies, surfaces)]
    if len(bodies) < 2:
        return supports or [NO_SUPPORT], [], [NO_EDGES]
    placed = [(surface.arrays, center) for surface, center in zip(surfaces, centers)]
    return supports, [_as_palm(hand, *shape) for shape in placed], [_edges_of(*shape) for shape in placed]


def support_of(surface: ContactSurface) -> Support:
    """Return the points that can stand on a plane: the corners of the mesh's convex hull; spheres without a mesh."""
    arrays, mesh = surface.arrays, surface.mesh
    if mesh is not None:
        from scipy.spatial import ConvexHull, QhullError

        points = mesh.vertices[np.unique(mesh.faces)]
        # All of its vertices where it is flat.
        with suppress(QhullError):
            points = points[np.sort(ConvexHull(points).vertices)]
    elif isinstance(arrays, TreeArrays):
        leaves = arrays.child_count == 0
        points = np.stack([arrays.x[leaves], arrays.y[leaves], arrays.z[leaves]], axis=1)
        return Support(points, np.array(arrays.radius[leaves]))
    else:
        points = arrays.vertex
    return Support(np.ascontiguousarray(points), np.zeros(len(points)))


def _as_palm(hand: HandArrays, surface: Any, center: FloatArray) -> HandArrays:
    """Return a body as a palm about its centre: its leaf spheres, or the corners of its mesh."""
    points, radius = support_of(ContactSurface(surface))
    if len(points) > MOST_POINTS:
        expected = f"expected up to {MOST_POINTS:,}, of a tree of a lower level, or the surface mesh"
        raise InputError(f"a body beside others has {len(points):,} corners or spheres; {expected}")
    level = next(level for level in count(1) if BRANCHING**level >= len(points))
    return hand._replace(**palm_arrays(build_hierarchy(points - center, radius, level, BRANCHING), hand.length))


def _edges_of(surface: Any, center: FloatArray) -> Edges:
    """Return the convex edges of a mesh between two faces; none of spheres."""
    if isinstance(surface, TreeArrays):
        return NO_EDGES
    first = surface.wing_start[:-1]
    whole = np.flatnonzero(np.diff(surface.wing_start) == 2)
    first, second = first[whole], first[whole] + 1
    normal = np.stack([surface.face[surface.wing_face[which], :3] for which in (first, second)], axis=1)
    convex = (surface.wing[first] * normal[:, 1]).sum(axis=1) < -FLAT
    edge = surface.edge[whole[convex]]
    parts = edge[:, :3] - center, edge[:, 3:6], edge[:, 6], normal[convex]
    return Edges(*(np.ascontiguousarray(part) for part in parts))


def may_meet(body: Body, other: Body) -> bool:
    """Return True if one of two bodies moves freely, and no joint bears one on the other, through which it goes."""
    if body is other:
        return False
    joined = any(a.free_joint is not None and a.free_joint.on == b.name for a, b in ((body, other), (other, body)))
    return not joined and (body.is_free or other.is_free)


def bearer_of(body: Body, bodies: Sequence[Body]) -> int | None:
    """Return the number of the body that bears a body's joint; None for a fixed one, or the world."""
    on = body.free_joint.on if body.free_joint else ""
    return next((k for k, other in enumerate(bodies) if other.name == on and other.motion != Fixed()), None)


def write_body(
    record: Any, body: Body, center: FloatArray, support: Support, plane: HalfSpace | None, offset: float
) -> None:
    """Write a body, which turns about `center` and keeps an `offset` from the plane [m], to a record with a period."""
    free, period = body.solid, record.period
    # Right-handed, or the gyroscopic term would have the other sign.
    moment, axes = principal_axes(free.inertia)
    fixed, record.is_driven = body.motion == Fixed(), isinstance(body.motion, Driven)
    record.is_free = not fixed
    record.center[:] = record.position[:] = center
    record.axes[:] = axes.T
    record.moment[:] = moment
    # Damping at the end of the step weighs as mass: forces balance as they would without it.
    damped = 0.0 if fixed else period / np.sqrt(1.0 + free.damping * period)
    record.inverse_root[:3] = damped / np.sqrt(free.mass)
    record.inverse_root[3:] = damped / np.sqrt(moment)
    record.gravity[:] = free.gravity
    record.damping = free.damping
    record.friction = record.table_friction = body.friction
    record.torsion = body.torsion
    if record.is_driven:
        record.inverse_root[:] = period / np.sqrt(HEAVY)
    record.velocity[:] = free.velocity
    record.spin[:] = matmul(axes.T, free.angular_velocity)
    if plane is None:
        return
    record.table_friction = body.friction if plane.friction is None else plane.friction
    if not body.is_free:
        return
    record.has_table, record.table = True, plane.height
    lowest = float((support.point[:, 2] - support.radius).min()) - record.table
    if lowest < -BELOW:
        depth, height = f"{-1e3 * lowest:.3g} mm below", f"z = {1e3 * (lowest + record.table):.6g} mm or lower"
        raise InputError(f"the object begins {depth} the table: put the table at {height}")
    record.position[2] += max(0.0, offset - lowest)


def write_joint(record: Any, body: Body, joint: Joint, pair: int | None) -> None:
    """Let the record of a body move about or along the axis of its joint alone.

    It moves in the world, or against the one that bears it, with which it is the `pair` of this number.
    """
    axis, turns = joint.direction, joint.type == "hinge"
    free, axes = body.solid, np.vstack([across(axis), axis])
    record.limits[:] = body.limits or (-np.inf, np.inf)
    record.joint_friction = joint.friction
    if pair is not None:
        record.pair, record.pair_joint = pair, HINGE if turns else SLIDER
        record.joint_origin[:] = joint.origin if turns else free.center
        record.joint_axes[:] = axes
        return
    record.axes[:] = axes
    if not turns:
        record.joint = SLIDER
        record.inverse_root[3:] = record.spin[:] = 0.0
        for vector in (record.gravity, record.velocity):
            vector[:] = (axis * vector).sum() * axis
        return
    record.joint = HINGE
    record.lever[:] = free.center - body.pivot
    moment = (axis * matmul(np.array(free.inertia), axis)).sum() + free.mass * (record.lever**2).sum()
    record.moment[:] = moment
    record.inverse_root[:] = 0.0
    record.inverse_root[5] = record.period / np.sqrt((1.0 + free.damping * record.period) * moment)
    record.pull[:] = free.mass / moment * np.cross(free.gravity, axis)
    record.gravity[:] = record.velocity[:] = 0.0
    record.spin[:] = matmul(record.axes, free.angular_velocity) * (0.0, 0.0, 1.0)
