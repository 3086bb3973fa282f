"""Sources of a sphere tree: shipped, cached, or built; only then are the builder and its kernels imported."""

import hashlib
import json
from contextlib import suppress
from dataclasses import replace
from importlib.resources import as_file, files
from importlib.resources.abc import Traversable
from pathlib import Path

from hhsim.errors import InputError, OutputError
from hhsim.kernels.cache_folder import cache_root
from hhsim.mesh.catalogue import BODIES
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress, silent
from hhsim.trees.file import load_tree, save_tree
from hhsim.trees.hierarchy import at_level
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

SHIPPED_SUFFIX = "-tree.h5"

_SOURCES = (
    *("trees", "kernels/cover", "kernels/mesh", "kernels/enclosing_sphere.py", "kernels/kd_tree.py"),
    *("kernels/round_cone.py", "kernels/triangle.py", "kernels/rotation.py"),
    *("kernels/arithmetic.py", "mesh/own_triangles.py", "mesh/signed_bvh.py", "mesh/topology.py", "reproducible.py"),
)
"""Folders and files of hhsim that a built tree depends on: a change of one makes cached trees stale."""


def cached_sphere_tree(
    mesh: Mesh, options: TreeOptions | None = None, progress: Progress = silent, threads: int = 1
) -> SphereTree:
    """Return the tree of `hhsim.trees.builder.build_sphere_tree`, shipped, cached or built; arguments, errors as it."""
    options = TreeOptions() if options is None else options
    return shipped_tree(mesh, options) or kept_sphere_tree(mesh, options, progress, threads)


def shipped_tree(mesh: Mesh, options: TreeOptions) -> SphereTree | None:
    """Return a mesh's shipped tree, or a coarser level of it; None without one of this mesh, options and builder."""
    folder = files("hhsim.objects")
    for file in (folder / f"{mesh.name}{SHIPPED_SUFFIX}", folder / BODIES / shipped_name(mesh)):
        if file.is_file() and (tree := _of_mesh(file, mesh, options)) is not None:
            return tree
    return None


def shipped_name(mesh: Mesh) -> str:
    """Return the name of the file of a body's tree, in the folder of bodies: several have a body of the same name."""
    return f"{mesh.sha256[:16]}{SHIPPED_SUFFIX}"


def _of_mesh(file: Traversable, mesh: Mesh, options: TreeOptions) -> SphereTree | None:
    try:
        with as_file(file) as path:
            tree = load_tree(path, shipped=True)
    except InputError:
        return None
    if tree.mesh_sha256 != mesh.sha256 or options.leaf_level > tree.depth:
        return None
    if tree.options != replace(options, level=tree.depth).recorded():
        return None
    # Each level of a tree is the tree that is built for it.
    return at_level(tree, options.leaf_level)


def kept_sphere_tree(mesh: Mesh, options: TreeOptions, progress: Progress = silent, threads: int = 1) -> SphereTree:
    """Return the tree from the cache, or build and cache it; arguments as for `cached_sphere_tree`.

    A damaged file in the cache is built again; a cache that cannot be written is done without.
    """
    path = cache_path(mesh, options)
    if path.is_file():
        with suppress(InputError):
            return load_tree(path)
    from hhsim.trees.builder import build_sphere_tree

    tree = build_sphere_tree(mesh, options, progress, threads)
    with suppress(OSError, OutputError):
        path.parent.mkdir(parents=True, exist_ok=True)
        save_tree(tree, path)
    return tree


def cache_path(mesh: Mesh, options: TreeOptions) -> Path:
    """Return the path of a mesh's tree in the cache."""
    digest = hashlib.sha256(mesh.sha256.encode())
    if mesh.shell is not None:
        for part in mesh.shell:
            digest.update(part.tobytes())
    digest.update(json.dumps(options.recorded(), sort_keys=True).encode())
    for source in _SOURCES:
        place = Path(str(files("hhsim"))) / source
        for path in sorted(place.glob("*.py")) if place.is_dir() else (place,):
            digest.update(path.read_bytes())
    return cache_root() / "trees" / f"{digest.hexdigest()[:32]}.h5"
