"""Claims of a file of its sphere trees, without the builder's code; the spheres near a point come from a k-d tree."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.mesh.mesh import LARGEST_NUMBER, require_usable_arrays
from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.verify.claim import NOT_CLAIMED, Claim, judged

ON_SPHERE = 1e-12
"""Depth below which a point of a sphere is on it [m]: rounding."""
NEIGHBOURS = 24
"""Spheres near a point that are tried first."""
SAMPLES = 10_000
"""Number of random points on the mesh, uniform by area, besides vertices and edge midpoints."""
COVER = 1e-9
"""Tolerance of a point outside all leaves [m]."""


def depth_in_spheres(center: FloatArray, radius: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return a function from points (n, 3) to their greatest depth in spheres [m], (n,), exact below `ON_SPHERE`."""
    from scipy.spatial import cKDTree
    from scipy.spatial.distance import cdist

    nearest, count = cKDTree(center), min(NEIGHBOURS, len(radius))

    def depth(points: FloatArray) -> FloatArray:
        away, which = (np.reshape(found, (-1, count)) for found in nearest.query(points, k=count))
        best = (radius[which] - away).max(axis=1)
        # Of spheres of different sizes, the one that holds a point need not be among the nearest.
        unsure = np.flatnonzero(best < ON_SPHERE)
        for part in np.array_split(unsure, max(1, len(unsure) // 1000)):
            if part.size:
                best[part] = (radius - cdist(points[part], center)).max(axis=1)
        return np.asarray(best, np.float64)

    return depth


def _tree(body: Body) -> tuple[Any, ...]:
    return tuple(np.array(body.static[f"tree/{name}"]) for name in ("center", "radius", "level", "parent"))


def leaves(body: Body) -> tuple[FloatArray, FloatArray]:
    """Centres (L, 3) and radii (L,) of a body's leaf spheres [m], where its mesh is stored."""
    center, radius, level, _ = _tree(body)
    last = level == level.max(initial=0)
    return center[last], radius[last]


def tree_encloses(result: Result) -> Claim:
    """Judge whether no leaf sticks out of a sphere above it, which a descent of a tree relies on."""
    found = []
    for body in result.bodies.values():
        center, radius, level, parent = _tree(body)
        leaf = np.flatnonzero(level == level.max(initial=0))
        out = np.zeros(len(leaf))
        above = leaf.copy()
        # At most as many steps as there are spheres, whatever levels a damaged file states.
        for _ in range(min(int(level.max(initial=0)), len(radius) - 1)):
            above = np.clip(parent[above], 0, len(radius) - 1)
            away = np.linalg.norm(center[leaf] - center[above], axis=1)
            out = np.maximum(out, away + radius[leaf] - radius[above])
        found.append(out)
    says = "every leaf lies inside of the spheres above it"
    return judged("tree encloses", says, np.concatenate(found), 1e-9, "m", "rounding of a world frame")


def cover(result: Result) -> Claim:
    """Judge whether the leaves cover the meshes: their vertices, edge midpoints and random points."""
    surfaces = [(np.array(body.vertices), np.array(body.faces), *leaves(body)) for body in result.bodies.values()]
    claim = covered("cover", "the leaf spheres cover the surfaces of all bodies", *surfaces)
    if claim.note or covers(result):
        return claim
    note = "this tree was not built to cover the mesh, or the file does not say how it was"
    return replace(claim, verdict=NOT_CLAIMED, tick=None, note=note)


def covered(name: str, says: str, *surfaces: tuple[Any, ...]) -> Claim:
    """Judge whether spheres cover meshes: `surfaces` are the arguments of `outside_spheres` of each."""
    try:
        outside = np.concatenate([outside_spheres(*surface) for surface in surfaces])
        return judged(name, says, outside, COVER, "m", "less than any figure is stated to")
    except MeshError as error:
        return judged(name, says, [np.inf], COVER, "m", "exact", note=str(error))


def outside_spheres(vertices: FloatArray, faces: IntArray, center: FloatArray, radius: FloatArray) -> FloatArray:
    """Distance [m] of a mesh's vertices, edge midpoints and random points outside spheres, 0 inside, shape (N,).

    Raises:
        MeshError: Arrays that are no mesh.
    """
    require_usable_arrays(vertices, faces, "its mesh")
    # Squares of areas would overflow.
    if np.abs(vertices).max() > LARGEST_NUMBER:
        return np.array([np.inf])
    a, b, c = vertices[faces].transpose(1, 0, 2)
    rng = np.random.default_rng(0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    which = rng.choice(len(faces), SAMPLES, p=area / area.sum())
    s, t = rng.random((2, SAMPLES, 1))
    s, t = np.where(s + t > 1.0, 1.0 - s, s), np.where(s + t > 1.0, 1.0 - t, t)
    inner = a[which] + s * (b - a)[which] + t * (c - a)[which]
    points = np.concatenate([vertices[np.unique(faces)], 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a), inner])
    return np.asarray(np.maximum(-depth_in_spheres(center, radius)(points), 0.0))


def covers(result: Result) -> bool:
    """True if hhsim built the tree to cover the mesh."""
    options = result.scene.get("tree_options") or {}
    return result.scene.get("tree") is None and options.get("cover") == "outer"


def palm_claim(result: Result) -> Claim:
    """Judge the spheres of the palm."""
    static = result.static
    center, radius = static["hand/palm_center"], static["hand/palm_radius"]
    level = static["hand/palm_tree/level"]
    leaf = level == level.max(initial=0)
    says = "the palm's spheres are the leaves of its tree, and cover its mesh"
    of_tree = static["hand/palm_tree/center"][leaf], static["hand/palm_tree/radius"][leaf]
    if not (np.array_equal(of_tree[0], center) and np.array_equal(of_tree[1], radius)):
        return judged("palm", says, [np.inf], COVER, "m", "exact", note="its tree has other leaves")
    vertices, faces = static["hand/palm_mesh/vertices"], static["hand/palm_mesh/faces"]
    return covered("palm", says, tuple(map(np.array, (vertices, faces, center, radius))))
