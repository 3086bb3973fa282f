"""Spheres of every link of a robot: each link's collision geometry as a mesh, its tree, and how that fits."""

import hashlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, MeshError, named
from hhsim.linkage.linkage import Link, Robot
from hhsim.mesh.mesh import Mesh, with_inside
from hhsim.mesh.shapes import Triangles, ellipsoid
from hhsim.mesh.topology import merged_vertices
from hhsim.reproducible import matmul
from hhsim.robots.share_out import best_shares, share_out
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import Workers
from hhsim.trees.cache import cache_path, kept_sphere_tree
from hhsim.trees.error import prove_cover
from hhsim.trees.fit import Fit, measure_fit
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import TreeOptions, needed_level
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.surface_cover import CanonicalFrame, canonical_frame, greedy_bound

MOST_TRIANGLES = 500_000
"""Most triangles of a link: more take minutes, and no planner's collision mesh has them."""
WIDEST = 64
"""Most spheres of a foreign set below one inner sphere."""


@dataclass(frozen=True, eq=False)
class LinkSpheres:
    """Spheres of one link, in its frame."""

    name: str
    mesh: Mesh  # the link's collision geometry [m]
    tree: SphereTree  # its leaves are the spheres
    fit: Fit
    proved: bool  # True if it is proved that the spheres cover every triangle
    cpu_seconds: float  # CPU time of building, proving and measuring them [s]
    cached: bool  # True if the tree was built before

    @property
    def spheres(self) -> FloatArray:
        """Centres and radii [m], shape (n, 4)."""
        return np.column_stack([self.tree.leaf_center, self.tree.leaf_radius])


def link_meshes(robot: Robot, path: Path, name: str = "") -> dict[str, Mesh]:
    """Return the surface of each link that has shapes, or of one of a name, in its frame, by its name.

    Raises InputError for a robot without collision geometry, or no such link; MeshError for triangles of no area.
    """
    with named(path):
        if not robot.solid:
            raise InputError(
                "no link has collision geometry; expected <collision> elements (URDF) or geoms that collide (MJCF), or "
                "--visual for what is seen"
            )
        links = [robot.link(name)] if name else robot.solid
        # What is refused is refused before the first mesh is looked into, which compiles kernels.
        surfaces = {link.name: _triangles(link.triangles, link.name) for link in links}
        return {link: _surface(*triangles, link, str(path)) for link, triangles in surfaces.items()}


def _triangles(triangles: Triangles, name: str) -> Triangles:
    """Return triangles with every place once; MeshError for too many or those of no area."""
    # Files of some kinds give each triangle corners of its own.
    vertices, faces = merged_vertices(*triangles)
    about = f"link '{name}'"
    if len(faces) > MOST_TRIANGLES:
        raise MeshError(
            f"{about}: {len(faces):,} triangles; expected {MOST_TRIANGLES:,} at most: simplify its collision mesh"
        )
    corner = vertices[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    if not area.max(initial=0.0) > 0.0:
        raise MeshError(f"{about}: its triangles have no area; expected a surface")
    return vertices, faces


def _surface(vertices: FloatArray, faces: IntArray, name: str, source: str) -> Mesh:
    about = f"link '{name}'"
    mesh = with_inside(Mesh(vertices, faces, name=name, source=about), hint="is its scale wrong?", solid=None)
    return replace(mesh, source=source)


def build_link(link: Link, mesh: Mesh, options: TreeOptions) -> LinkSpheres:
    """Return the spheres of a link, from the cache or built; where all its shapes are spheres that suffice, those."""
    start = time.thread_time()
    cached = False
    if link.balls is not None and len(link.balls) <= options.leaf_limit:
        mesh, tree = _inside_balls(link.balls, mesh), tree_of_spheres(link.balls)
    else:
        cached = cache_path(mesh, options).exists()
        tree = kept_sphere_tree(mesh, options)
    return _measured(mesh, tree, start, cached, options.seed)


def judge_link(link: Link, mesh: Mesh, spheres: FloatArray, seed: int = 0) -> LinkSpheres:
    """Return spheres from elsewhere, centres and radii [m], shape (n, 4), as those of a link, measured."""
    start = time.thread_time()
    mesh = mesh if link.balls is None else _inside_balls(link.balls, mesh)
    return _measured(mesh, tree_of_spheres(spheres), start, False, seed)


def _inside_balls(balls: FloatArray, mesh: Mesh) -> Mesh:
    """Return the surface of spheres, whose triangles lie in them, while those of the link's mesh lie around them."""
    shapes = [ellipsoid(ball[3] * np.ones(3)) for ball in balls]
    inner = Link(mesh.name, tuple((points + ball[:3], faces) for ball, (points, faces) in zip(balls, shapes)))
    return _surface(*_triangles(inner.triangles, mesh.name), mesh.name, mesh.source)


def _measured(mesh: Mesh, tree: SphereTree, start: float, cached: bool, seed: int) -> LinkSpheres:
    fit = measure_fit(mesh, tree.leaf_center, tree.leaf_radius, seed)
    if tree.covers:
        proved = tree.covers[-1].gap == 0.0 and not tree.check(mesh)
    else:
        # Of corners that lie on a sphere, rounding decides.
        grown = tree.leaf_radius + 1e-9 * float(mesh.extent.max())
        proved = not prove_cover(mesh.vertices, mesh.faces, tree.leaf_center, grown)[0].size
    return LinkSpheres(mesh.name, mesh, tree, fit, proved, time.thread_time() - start, cached)


def tree_of_spheres(spheres: FloatArray) -> SphereTree:
    """Return a tree whose leaves are spheres, centres and radii [m], shape (n, 4), in an order of its own."""
    return build_hierarchy(spheres[:, :3], spheres[:, 3], needed_level(len(spheres), WIDEST), WIDEST)


def build_links(
    robot: Robot,
    meshes: Mapping[str, Mesh],
    options: Mapping[str, TreeOptions],
    threads: int = 1,
    progress: Progress = silent,
) -> dict[str, LinkSpheres]:
    """Build the spheres of the links that have options, several at once; errors name the link.

    Links of one mesh, wherever it is in them, have the same spheres, which are built once.
    """
    done = 0

    def build(alike: list[tuple[str, CanonicalFrame]]) -> list[LinkSpheres]:
        nonlocal done
        found: list[LinkSpheres] = []
        for name, frame in alike:
            moved = _moved(found[0], alike[0][1], meshes[name], frame) if found else None
            if moved is None:
                with named(f"link '{name}'"):
                    moved = build_link(robot.link(name), meshes[name], options[name])
            found.append(moved)
            done += 1
            progress("links", done, len(options))
        return found

    groups: dict[object, list[tuple[str, CanonicalFrame]]] = {}
    for name, each in options.items():
        mesh = meshes[name]
        frame = canonical_frame(mesh.vertices[np.unique(mesh.faces)])
        # Adding zero takes the sign off a zero.
        corners = hashlib.sha256((frame.into(mesh.vertices)[mesh.faces] + 0.0).tobytes()).hexdigest()
        key = name if robot.link(name).balls is not None else (corners, f"{frame.size:.9g}", each)
        groups.setdefault(key, []).append((name, frame))
    # The largest first, so that no thread ends long after the others.
    order = sorted(groups.values(), key=lambda alike: -len(meshes[alike[0][0]].faces))
    with Workers(threads) as workers:
        built = workers.each(build, [(alike,) for alike in order])
    found = {each.name: each for links in built for each in links}
    return {name: found[name] for name in options}


def _moved(built: LinkSpheres, frame: CanonicalFrame, mesh: Mesh, place: CanonicalFrame) -> LinkSpheres | None:
    """Return the spheres of a link for one of the same mesh at another place, by the canonical frames of both.

    None if the proof does not hold there, by rounding.
    """
    start = time.thread_time()
    rotation = matmul(place.rotation.T, frame.rotation)
    tree = built.tree.transformed(rotation, place.origin - matmul(rotation, frame.origin))
    if tree.check(mesh):
        return None
    tree = replace(tree, mesh_sha256=mesh.sha256)
    return replace(built, name=mesh.name, mesh=mesh, tree=tree, cpu_seconds=time.thread_time() - start)


def build_in_all(
    robot: Robot,
    meshes: Mapping[str, Mesh],
    total: int,
    options: TreeOptions,
    threads: int = 1,
    progress: Progress = silent,
) -> dict[str, LinkSpheres]:
    """Build spheres for links, so many in all, shared out so that the largest error is as small as it can be.

    An error is the proved bound of the distance of the spheres from the link; InputError for fewer spheres than links.
    """
    if total < len(meshes):
        raise InputError(f"{total} spheres for {len(meshes)} links; expected at least one for each (--total)")
    built: dict[str, dict[int, LinkSpheres]] = {name: {} for name in meshes}
    seconds = dict.fromkeys(meshes, 0.0)

    def rough(shares: Mapping[str, int]) -> dict[str, float]:
        with Workers(threads) as workers:
            bounds = workers.each(lambda name: greedy_bound(meshes[name], shares[name]), [(name,) for name in shares])
        return dict(zip(shares, bounds))

    def measure(shares: Mapping[str, int]) -> dict[str, float]:
        each = {name: replace(options, level=None, leaves=count) for name, count in shares.items()}
        for name, found in build_links(robot, meshes, each, threads, progress).items():
            built[name][shares[name]] = found
            seconds[name] += found.cpu_seconds
        return {name: built[name][count].fit.bound for name, count in shares.items()}

    shares = best_shares(share_out(list(meshes), total, rough, measure), total)
    return {name: replace(built[name][count], cpu_seconds=seconds[name]) for name, count in shares.items()}
