"""A second opinion on a sphere tree: gap, protrusion and enclosure of every level.

python -m tools.tree_checks bunny --size 100 --level 3

No code is the builder's: spheres and triangles near a point come from scipy's k-d trees. Gap and protrusion are lower
bounds from samples; each search refines its worst samples on their triangle or sphere.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh, load_mesh
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import load_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.mesh_distance import TrueSurface
from hhsim.verify.tree_checks import ON_SPHERE, depth_in_spheres

MESH_POINTS = 200_000
SPHERE_POINTS = 200_000
LEAST_EACH = 40
"""Minimum number of points on each sphere."""
WORST = 200
CHILDREN = 40
ROUNDS = 5
FIRST_STEP = 0.2
SHRINK = 0.35
"""Search parameters: `CHILDREN` new points around each of the `WORST`, for `ROUNDS` rounds, each closer."""


@dataclass(frozen=True)
class Verdict:
    """Measures of one level of a tree."""

    level: int  # level, 0 for the root
    spheres: int  # number of its spheres
    gap: float  # maximum distance of a point of the mesh outside the spheres [m]; 0 for none
    slack: float  # minimum depth of a point of the mesh inside the spheres [m]; negative for a gap
    protrusion: float  # maximum distance of a point of the spheres' union outside the mesh [m]
    protrusion_mean: float  # mean over the part of the union's surface that is outside [m]


def referee(
    mesh: Mesh,
    tree: SphereTree,
    levels: Sequence[int] | None = None,
    *,
    mesh_points: int = MESH_POINTS,
    sphere_points: int = SPHERE_POINTS,
    seed: int = 0,
) -> tuple[Verdict, ...]:
    """Measure the levels of a tree.

    Args:
        mesh: Watertight and wound outward [m].
        tree: In the frame of the mesh.
        levels: None for all.
        mesh_points: Random points on the mesh, uniform by area; as many again on its edges, and all its vertices.
        sphere_points: Random points on the spheres of a level, uniform by area, at least `LEAST_EACH` on each.
        seed: Seed of the points.

    Raises:
        MeshError: The mesh is not watertight: there is no outside to measure in.
    """
    surface = TrueSurface(mesh)
    verdicts = []
    for level in range(tree.depth + 1) if levels is None else levels:
        rng = np.random.default_rng([seed, level])
        spheres = tree.spheres(level)
        slack = _least_slack(mesh, depth_in_spheres(*spheres), mesh_points, rng)
        protrusion, mean = _protrusion(surface, *spheres, sphere_points, rng)
        verdicts.append(Verdict(level, len(spheres[1]), max(0.0, -slack), slack, protrusion, mean))
    return tuple(verdicts)


def _least_slack(
    mesh: Mesh, depth_of: Callable[[FloatArray], FloatArray], count: int, rng: np.random.Generator
) -> float:
    """Minimum depth of the mesh inside the spheres [m]."""
    triangles = mesh.triangles
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    face = rng.choice(len(triangles), size=count, p=area / area.sum())
    weight = rng.dirichlet(np.ones(3), size=count)
    # As many on the edges, by their length: where a cover is weakest, and where no random point of a face lies.
    length = np.linalg.norm(triangles[:, [1, 2, 0]] - triangles, axis=2).ravel()
    edge = rng.choice(length.size, size=count, p=length / length.sum())
    along = rng.random(count)
    on_edge = np.zeros((count, 3))
    on_edge[np.arange(count), edge % 3], on_edge[np.arange(count), (edge + 1) % 3] = 1.0 - along, along
    face = np.concatenate([face, edge // 3, np.repeat(np.arange(len(triangles)), 3)])
    weight = np.concatenate([weight, on_edge, np.tile(np.eye(3), (len(triangles), 1))])

    def depth(face: IntArray, weight: FloatArray) -> FloatArray:
        return -depth_of((weight[:, :, None] * triangles[face]).sum(axis=1))

    def moved(weight: FloatArray, step: float) -> FloatArray:
        there = np.maximum(weight + step * rng.normal(size=weight.shape), 0.0)
        # Clipped weights are points on edges and corners; where nothing is left, it stays where it was.
        there = np.where(there.any(axis=1, keepdims=True), there, weight)
        return np.asarray(there / there.sum(axis=1, keepdims=True), np.float64)

    return -_search(face, weight, depth(face, weight), depth, moved)


def _protrusion(
    surface: TrueSurface, center: FloatArray, radius: FloatArray, count: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Maximum and mean distance of the spheres' union outside the mesh [m]."""
    area, depth_of = radius**2, depth_in_spheres(center, radius)
    each = np.maximum(LEAST_EACH, np.floor(count * area / area.sum())).astype(np.int64)
    owner = np.repeat(np.arange(len(each)), each)
    direction = rng.normal(size=(len(owner), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]

    def height(owner: IntArray, direction: FloatArray) -> FloatArray:
        points = center[owner] + radius[owner, None] * direction
        found = np.full(len(owner), -np.inf)
        # What lies on its own sphere and in no other one is on the surface of the union.
        free = depth_of(points) < ON_SPHERE
        found[free] = surface.signed_distance(points[free])
        return found

    first = height(owner, direction)
    outside = first > 0.0
    share = (area / each)[owner][outside]
    mean = float((first[outside] * share).sum() / share.sum()) if outside.any() else 0.0

    def moved(direction: FloatArray, step: float) -> FloatArray:
        there = direction + step * rng.normal(size=direction.shape)
        return np.asarray(there / np.linalg.norm(there, axis=1)[:, None], np.float64)

    return max(0.0, _search(owner, direction, first, height, moved)), mean


def _search(
    key: IntArray,
    place: FloatArray,
    found: FloatArray,
    value: Callable[[IntArray, FloatArray], FloatArray],
    moved: Callable[[FloatArray, float], FloatArray],
) -> float:
    """Maximum of `value`, which is `found` at some places, refined around the best of them."""
    step = FIRST_STEP
    best = np.argsort(-found, kind="stable")[:WORST]
    key, place, found = key[best], place[best], found[best]
    for _ in range(ROUNDS):
        wide_key = np.repeat(key, CHILDREN)
        there = moved(np.repeat(place, CHILDREN, axis=0), step)
        tried = value(wide_key, there).reshape(-1, CHILDREN)
        pick = tried.argmax(axis=1)
        top = tried[np.arange(len(key)), pick]
        better = top > found
        place = np.where(better[:, None], there.reshape(len(key), CHILDREN, -1)[np.arange(len(key)), pick], place)
        found = np.maximum(found, top)
        step *= SHRINK
    return float(found.max())


def moved_at_random(mesh: Mesh, seed: int) -> tuple[Mesh, float]:
    """The mesh turned anyhow, 0.1 to 10 times as large and shifted by up to about its size; and the scale."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    scale = float(10.0 ** rng.uniform(-1.0, 1.0))
    shift = scale * float(mesh.extent.max()) * rng.normal(size=3)
    return mesh.scaled(scale).transformed(Rotation.random(rng=rng).as_matrix(), shift), scale


def sticking_out(tree: SphereTree, level: int, *, leaves_only: bool = False) -> float:
    """Return the maximum by which a deeper sphere sticks out of its ancestor on a level [m]; negative for none."""
    worst = -np.inf
    nodes = np.flatnonzero(tree.level > level)
    if leaves_only:
        nodes = nodes[tree.level[nodes] == tree.depth]
    ancestor = nodes.copy()
    while (tree.level[ancestor] > level).any():
        ancestor = np.where(tree.level[ancestor] > level, tree.parent[ancestor], ancestor)
    if nodes.size:
        away = np.linalg.norm(tree.center[nodes] - tree.center[ancestor], axis=1)
        worst = float((away + tree.radius[nodes] - tree.radius[ancestor]).max())
    return worst


def table(tree: SphereTree, verdicts: Sequence[Verdict], scale: float = 1.0) -> str:
    """The verdicts on a tree as a table for people, all lengths divided by `scale`."""
    lines = ["level  spheres  protrusion max [mm]  mean [mm]  gap [nm]  deepest leaf outside an ancestor [nm]"]
    for item in verdicts:
        most, mean, gap = (x / scale for x in (item.protrusion, item.protrusion_mean, item.gap))
        leaf = sticking_out(tree, item.level, leaves_only=True)
        out = "—" if leaf == -np.inf else f"{1e9 * max(0.0, leaf) / scale:.3f}"
        lines.append(
            f"{item.level:5d}  {item.spheres:7,d}  {1e3 * most:19.4f}  {1e3 * mean:9.4f}  {1e9 * gap:8.2f}  {out:>37s}"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tools.tree_checks", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("object", metavar="OBJECT|MESH")
    parser.add_argument("--size", type=float, metavar="MM", help="scale to this longest extent first [mm]")
    parser.add_argument("--level", type=int, default=3, help="of the leaves; default: 3")
    parser.add_argument("--leaves", type=int, metavar="N", help="most leaves; default: 8 to the level")
    parser.add_argument(
        "--moved",
        type=int,
        metavar="SEED",
        help="turn, shift and scale the mesh at random first; the table then is of the original size",
    )
    parser.add_argument("--tree", type=Path, metavar="FILE.h5", help="judge this tree instead of building one")
    parser.add_argument("--points", type=int, default=MESH_POINTS, help="on the mesh, and on the spheres of a level")
    parser.add_argument("--seed", type=int, default=0, help="of the points; default: 0")
    options = parser.parse_args(arguments)
    try:
        named = load_mesh(options.object) if "." in options.object else load_object(options.object).mesh
        mesh = named if options.size is None else named.scaled(1e-3 * options.size / float(named.extent.max()))
        scale = 1.0
        if options.moved is not None:
            mesh, scale = moved_at_random(mesh, options.moved)
        if options.tree is None:
            tree = cached_sphere_tree(mesh, TreeOptions(level=options.level, leaves=options.leaves))
        else:
            tree = load_tree(options.tree)
        count = options.points
        print(table(tree, referee(mesh, tree, mesh_points=count, sphere_points=count, seed=options.seed), scale))
    except HhsimError as error:
        raise SystemExit(str(error)) from error


if __name__ == "__main__":
    main(sys.argv[1:])
