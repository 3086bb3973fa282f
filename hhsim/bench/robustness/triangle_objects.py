"""Objects made of triangles by formula: balls, boxes, rings, sheets, edges, soups."""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.sphere_objects import BALL_RADIUS
from hhsim.mesh.mesh import Mesh

SECTIONS = 96
"""Sides of round objects."""
UPPER = 0.5
"""Angle from the top to which the upper side of a tube reaches [rad]."""
ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation from the z axis to the x axis."""


@cache
def ball_mesh(radius: float = BALL_RADIUS, subdivisions: int = 4) -> Mesh:
    """Return a ball about the origin [m], 20 · 4ⁿ triangles."""
    return _made("icosphere", subdivisions=subdivisions, radius=radius)


def disc_mesh(radius: float, thickness: float) -> Mesh:
    """Return a round leaf about the plane z = 0 and the origin [m]."""
    return _made("cylinder", radius=radius, height=thickness, sections=SECTIONS)


def tube_mesh(radius: float, length: float, facets: int) -> Mesh:
    """Return a closed cylinder about the x axis and the origin [m].

    Its upper side, up to `UPPER` from the top, is as fine as with so many facets around; the rest has a dozen facets.
    """
    fine, most = 2.0 * np.pi / facets, int(UPPER * facets / (2.0 * np.pi))
    upper = fine * np.arange(-most, most + 1)
    turn = np.concatenate([upper, np.linspace(upper[-1], 2.0 * np.pi + upper[0], 13)[1:-1]])
    rim = radius * np.stack([-np.sin(turn), np.cos(turn)], axis=1)
    count, x = len(turn), 0.5 * length
    ends = [np.column_stack([np.full(count, end), rim]) for end in (-x, x)]
    here = np.arange(count)
    after = (here + 1) % count
    low, high = np.full(count, 2 * count), np.full(count, 2 * count + 1)
    sides = (here, count + here, count + after), (here, count + after, after)
    lids = (low, here, after), (high, count + after, count + here)
    faces = np.concatenate([np.column_stack(corners) for corners in (*sides, *lids)])
    vertices = np.concatenate([*ends, [[-x, 0.0, 0.0], [x, 0.0, 0.0]]])
    return outward(Mesh(vertices, faces, name="tube"))


def globe_mesh(radius: float, facets: int) -> Mesh:
    """Return a ball about the origin [m], poles on the x axis; `facets` around, half as many from pole to pole."""
    # trimesh makes twice as many around as the second number says.
    return _made("uv_sphere", radius=radius, count=(facets // 2, facets // 2)).transformed(ALONG_X, np.zeros(3))


def ring_mesh(center: ArrayLike, axis: ArrayLike, inner: float, thickness: float = 3e-3) -> Mesh:
    """Return a ring about an axis [m]: `inner` is the radius of the hole, `thickness` of the round profile."""
    from trimesh import geometry

    align: Any = geometry.align_vectors
    sections = {"major_sections": SECTIONS, "minor_sections": SECTIONS // 4}
    made = _made("torus", major_radius=inner + thickness, minor_radius=thickness, **sections)
    return made.transformed(align([0.0, 0.0, 1.0], axis)[:3, :3], center)


def _made(shape: str, **sizes: Any) -> Mesh:
    from trimesh import creation

    made = getattr(creation, shape)(**sizes)
    return Mesh(made.vertices, made.faces, name=shape)


def roof_mesh(length: float, half_width: float, height: float) -> Mesh:
    """Return a closed prism whose ridge is the x axis [m]; the roof falls off to both sides."""
    x = 0.5 * length
    profile = [(0.0, 0.0), (-half_width, -height), (half_width, -height)]
    vertices = np.array([(end, y, z) for end in (-x, x) for y, z in profile])
    sides = [(i, j, 3 + j, 3 + i) for i, j in ((0, 1), (1, 2), (2, 0))]
    faces = [face for a, b, c, d in sides for face in ((a, c, b), (a, d, c))]
    return outward(Mesh(vertices, np.array([*faces, (0, 1, 2), (3, 5, 4)]), name="roof"))


def cone_mesh(radius: float, height: float, sides: int) -> Mesh:
    """Return a cone [m] whose apex is the origin; every side is a triangle. A negative height is a pit."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(sides, -height)], axis=1)
    after = 1 + (np.arange(sides) + 1) % sides
    faces = np.stack([np.zeros(sides, np.int64), 1 + np.arange(sides), after], axis=1)
    return Mesh(np.concatenate([np.zeros((1, 3)), rim]), faces, name="cone")


def sheet_mesh(width: float, depth: float) -> Mesh:
    """Return a sheet of no thickness, two triangles in the plane z = 0 about the origin [m]."""
    return strips_mesh([-0.5 * width, 0.5 * width], [[-0.5 * depth, 0.5 * depth]])


def strips_mesh(columns: Sequence[float], rows: Sequence[ArrayLike]) -> Mesh:
    """Return rectangles in the plane z = 0, two triangles each; columns of different rows meet at T-junctions.

    The borders of the columns along x, and of the rectangles of each column along y, ascend [m].
    """
    corners: list[tuple[float, float, float]] = []
    for left, right, ys in zip(columns[:-1], columns[1:], rows, strict=True):
        y = np.asarray(ys, np.float64)
        for low, high in pairwise(y):
            corners += [(left, low, 0.0), (right, low, 0.0), (right, high, 0.0)]
            corners += [(left, low, 0.0), (right, high, 0.0), (left, high, 0.0)]
    return loose_mesh(np.array(corners).reshape(-1, 3, 3))


def loose_mesh(corners: FloatArray) -> Mesh:
    """Return triangles that share no vertices, corners of shape (F, 3, 3) [m]."""
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), name="triangles")


def joined_mesh(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one."""
    return loose_mesh(np.concatenate([mesh.triangles for mesh in meshes]))


def outward(mesh: Mesh) -> Mesh:
    """Return the mesh with its triangles wound counter-clockwise from outside."""
    return mesh if mesh.volume > 0.0 else Mesh(mesh.vertices, mesh.faces[:, ::-1], name=mesh.name)
