"""Spheres of every link of a robot: each link's collision geometry as a mesh, its tree, and how that fits."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, MeshError, named
from hhsim.linkage.file import link_mesh
from hhsim.linkage.linkage import Link, Robot
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import ellipsoid
from hhsim.mesh.topology import face_areas, merged_vertices
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import Workers
from hhsim.trees.cache import cache_path, kept_sphere_tree
from hhsim.trees.error import prove_cover
from hhsim.trees.fit import Fit, measure_fit
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import TreeOptions, needed_level
from hhsim.trees.sphere_tree import SphereTree

MOST_TRIANGLES = 500_000
"""Most triangles of a link: more take minutes, and no planner's collision mesh has them."""
WIDEST = 64
"""Most spheres below one inner sphere."""


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
        # What is refused is refused before the first mesh is looked into, which compiles kernels.
        links = [_merged(link) for link in ([robot.link(name)] if name else robot.solid)]
        return {link.name: link_mesh(link, str(path), None) for link in links}


def _merged(link: Link) -> Link:
    """Return a link whose triangles have every place once; MeshError for too many triangles or those of no area."""
    # Files of some kinds give each triangle corners of its own.
    vertices, faces = merged_vertices(*link.triangles)
    about = f"link '{link.name}'"
    if len(faces) > MOST_TRIANGLES:
        raise MeshError(
            f"{about}: {len(faces):,} triangles; expected {MOST_TRIANGLES:,} at most: simplify its collision mesh"
        )
    if not face_areas(vertices, faces).max(initial=0.0) > 0.0:
        raise MeshError(f"{about}: its triangles have no area; expected a surface")
    return replace(link, shapes=((vertices, faces),))


def build_link(link: Link, mesh: Mesh, options: TreeOptions) -> LinkSpheres:
    """Return the spheres of a link, from the cache or built; where all its shapes are spheres that suffice, those."""
    start = time.thread_time()
    cached = False
    if link.balls is not None and len(link.balls) <= options.leaf_limit:
        mesh, tree = _inside_balls(link.balls, mesh), tree_of_spheres(link.balls)
    else:
        # The fit is measured below; of spheres by number or error nobody sees a level above.
        bare = replace(options, seed=None)
        if options.leaves is not None or options.max_error is not None:
            bare = replace(bare, level=None, branching=WIDEST, leaves=options.leaf_limit)
        cached = cache_path(mesh, bare).exists()
        tree = kept_sphere_tree(mesh, bare)
    return _measured(mesh, tree, start, cached, options.seed or 0)


def judge_link(link: Link, mesh: Mesh, spheres: FloatArray, seed: int = 0) -> LinkSpheres:
    """Return spheres from elsewhere, centres and radii [m], shape (n, 4), as those of a link, measured."""
    start = time.thread_time()
    mesh = mesh if link.balls is None else _inside_balls(link.balls, mesh)
    return _measured(mesh, tree_of_spheres(spheres), start, False, seed)


def _inside_balls(balls: FloatArray, mesh: Mesh) -> Mesh:
    """Return the surface of spheres, whose triangles lie in them, while those of the link's mesh lie around them."""
    shapes = [ellipsoid(ball[3] * np.ones(3)) for ball in balls]
    inner = Link(mesh.name, tuple((points + ball[:3], faces) for ball, (points, faces) in zip(balls, shapes)))
    return link_mesh(_merged(inner), mesh.source, None)


def _measured(mesh: Mesh, tree: SphereTree, start: float, cached: bool, seed: int) -> LinkSpheres:
    fit = measure_fit(mesh, tree.leaf_center, tree.leaf_radius, seed)
    if tree.covers:
        proved = tree.covers[-1].gap == 0.0 and not tree.check(mesh)
    else:
        # Of corners that lie on a sphere, rounding decides.
        grown = tree.leaf_radius + 1e-9 * float(mesh.extent.max())
        proved = not prove_cover(mesh, tree.leaf_center, grown)[0].size
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
    """Build the spheres of the links that have options, several at once; errors name the link."""
    done = 0

    def build(name: str) -> LinkSpheres:
        nonlocal done
        with named(f"link '{name}'"):
            found = build_link(robot.link(name), meshes[name], options[name])
        done += 1
        progress("links", done, len(options))
        return found

    # The largest first, so that no thread ends long after the others.
    order = sorted(options, key=lambda name: -len(meshes[name].faces))
    with Workers(threads) as workers:
        found = dict(zip(order, workers.each(build, [(name,) for name in order])))
    return {name: found[name] for name in options}
