"""Sphere trees of other programs, brought into the mesh's frame and measured against the mesh.

A `.sph` file has neither unit nor frame. Its centres count from the centre of the mesh's bounding box or from the
mesh's own origin: whichever leaves less of the mesh outside.

The text format is that of Bradshaw's sphere-tree toolkit. First line: number of levels including the root, and
branching factor B. Then one line for each slot of the complete tree, `x y z radius importance`, breadth first: the
children of slot n are the slots n·B + 1 to n·B + B. A radius that is not positive marks an unused slot. Further
columns, and lines after the last slot, are ignored.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, named
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.signed_bvh import signed_bvh
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text
from hhsim.system.progress import Progress, silent
from hhsim.trees.error import distance_outside, measure_levels, protrusion_bound, prove_cover, sample_mesh
from hhsim.trees.file import load_tree
from hhsim.trees.fit import OFF_PLACE, doubt
from hhsim.trees.sphere_tree import SphereTree, enclosing_radius

SUFFIXES = (".h5", ".sph")

_SAMPLES = 4000
_SAME = 1e-6
"""Frames that differ by less than this share of the mesh's extent are one; gaps too."""
_OFF_SIZE = 5.0

_MOST_SLOTS = 20_000_000
_ROUNDING = 1e-9


class ImportedTree(NamedTuple):
    """A tree from a file, in the mesh's frame and in metres, with the measured errors of its levels."""

    tree: SphereTree  # tree, with the hash of the mesh that it was measured against
    frame: str  # origin of its centres: "mesh" or "centred"
    notes: tuple[str, ...]  # assumptions, repairs, and what its leaves do not prove, a sentence each
    unproved: int  # number of faces of the mesh that the leaves are not proved to cover


def import_tree(
    path: str | Path, mesh: Mesh, unit_length: float = 1.0, seed: int = 0, progress: Progress = silent
) -> ImportedTree:
    """Read a tree of any program, and measure its distance from a mesh.

    Args:
        path: A `.sph` file, or a `.h5` file of hhsim, which is in metres and in the frame of its mesh.
        mesh: Watertight and wound outward.
        unit_length: Length of the unit of the `.sph` file [m].
        seed: Seed of the samples that measure the errors.

    Raises:
        InputError: No sphere tree, or spheres that are not on this mesh.
    """
    source = Path(path)
    if source.suffix not in SUFFIXES:
        raise InputError(f"{source}: a sphere tree is a .h5 or a .sph file")
    notes: list[str] = []
    if source.suffix == ".h5":
        tree, chosen = load_tree(source), "mesh"
        if tree.mesh_sha256 not in ("", mesh.sha256):
            notes.append(f"{source.name} was built for another mesh than {mesh.name}, and is measured against this one")
    else:
        tree, chosen, placement_notes = _placed(source, mesh, unit_length)
        notes += placement_notes
    return judge_tree(source, tree, mesh, chosen, notes, seed, progress)


def judge_tree(
    source: Path,
    tree: SphereTree,
    mesh: Mesh,
    chosen: str = "mesh",
    notes: Iterable[str] = (),
    seed: int = 0,
    progress: Progress = silent,
) -> ImportedTree:
    """Return a tree of a file, in metres and in the mesh's frame, measured; arguments, errors as of `import_tree`."""
    notes = list(notes)
    spheres, extent = float(np.ptp(tree.bounds, axis=0).max()), float(mesh.extent.max())
    gap = _mean_gap(sample_mesh(mesh, _SAMPLES, np.random.default_rng(0)), tree)
    if not extent / _OFF_SIZE <= spheres <= extent * _OFF_SIZE:
        spans = f"its spheres span {1e3 * spheres:.4g} mm, but {mesh.name} {1e3 * extent:.4g} mm"
        raise InputError(f"{source}: {spans}: is it in another unit, or of another mesh?")
    if gap > OFF_PLACE * extent:
        raise InputError(f"{source}: {doubt(mesh, 0.0, gap)}")
    bvh = signed_bvh(mesh)
    unproved = prove_cover(mesh, tree.leaf_center, tree.leaf_radius)[0].size
    errors = measure_levels(mesh, bvh, tree, seed, progress)
    with named(source):
        in_doubt = doubt(mesh, errors[-1].protrusion_max, gap)
    if in_doubt:
        notes.append(in_doubt)
    if unproved:
        share = f"{unproved:,} of {len(mesh.faces):,}"
        notes.append(
            f"the leaves are not proved to cover {share} triangles: a hand that stays out "
            f"of them can be inside the mesh; gap {1e3 * errors[-1].gap_max:.3g} mm at most, as sampled"
        )
    options = {**tree.options, "imported": source.name, "frame": chosen}
    tree = replace(tree, errors=errors, mesh_sha256=mesh.sha256, options=options)
    return ImportedTree(tree, chosen, tuple(notes), int(unproved))


def _placed(source: Path, mesh: Mesh, unit_length: float) -> tuple[SphereTree, str, list[str]]:
    """A .sph tree in metres and in the mesh's frame, the origin of its centres, and notes."""
    tree = load_sph(source).scaled(unit_length)
    notes = []
    grown, repeated = tree.options["parents_grown"], tree.options["repeated"]
    if grown:
        most, which = 1e3 * unit_length * tree.options["parents_grown_most"], f"{grown:,} of {tree.leaf_start:,}"
        notes.append(f"{which} inner spheres did not enclose the leaves below them: grown by up to {most:.3g} mm")
    if repeated:
        notes.append(f"{repeated:,} spheres without children above the last level stand for their own children")
    middle = mesh.bounds.mean(axis=0)
    shifted = tree.transformed(np.eye(3), middle)
    extent = float(mesh.extent.max())
    if np.abs(middle).max() <= _SAME * extent:
        return tree, "mesh", notes
    points = sample_mesh(mesh, _SAMPLES, np.random.default_rng(0))
    given, centred = (_mean_gap(points, placed) for placed in (tree, shifted))
    if abs(given - centred) <= _SAME * extent:
        # Both cover the mesh: the one that sticks out less is where it belongs.
        bvh = signed_bvh(mesh)
        first, second = (protrusion_bound(bvh, t.leaf_center, t.leaf_radius) for t in (tree, shifted))
        chosen = "mesh" if first <= second else "centred"
        reason = f"the spheres protrude by {1e3 * min(first, second):.3g} mm, else by {1e3 * max(first, second):.3g} mm"
    else:
        chosen = "mesh" if given < centred else "centred"
        reason = f"mean gap {1e3 * min(given, centred):.3g} mm, else {1e3 * max(given, centred):.3g} mm"
    where = "the mesh's own origin" if chosen == "mesh" else "the centre of the mesh's bounding box"
    notes.append(f"taken to count from {where}: {reason}")
    return (tree if chosen == "mesh" else shifted), chosen, notes


def _mean_gap(points: FloatArray, tree: SphereTree) -> float:
    return float(distance_outside(points, tree.leaf_center, tree.leaf_radius).mean())


def load_tree_for(path: str | Path, mesh: Mesh, unit_length: float = 1.0) -> ImportedTree:
    """Read the tree of a mesh for a replay, as `import_tree`; a `.h5` file of another mesh is an InputError."""
    source = Path(path)
    if source.suffix == ".h5":
        sha256 = load_tree(source).mesh_sha256
        if sha256 not in ("", mesh.sha256):
            other = f"built for the mesh {sha256[:12]}…, but {mesh.name} is {mesh.sha256[:12]}…"
            raise InputError(
                f"{source}: {other}; name the object, unit and size of the tree, or build it again, with --solid"
            )
    return import_tree(source, mesh, unit_length)


def save_sph(tree: SphereTree, path: str | Path) -> None:
    """Write a tree in metres, with every digit; OutputError if it cannot be written."""
    count = np.bincount(tree.parent[1:], minlength=len(tree.radius))
    branching = max(2, int(count.max()))
    levels = tree.depth + 1
    slot = np.zeros(len(tree.radius), np.int64)
    rank = np.arange(1, len(tree.radius)) - np.searchsorted(tree.parent, tree.parent[1:])
    for node in range(1, len(tree.radius)):
        slot[node] = slot[tree.parent[node]] * branching + 1 + rank[node - 1]
    lines = ["0.0 0.0 0.0 -1.0 0.0"] * _slots(levels, branching)
    for where, (x, y, z), radius in zip(slot.tolist(), tree.center.tolist(), tree.radius.tolist(), strict=True):
        lines[where] = f"{x!r} {y!r} {z!r} {radius!r} 1.0"
    write_atomically(Path(path), ("\n".join([f"{levels} {branching}", *lines]) + "\n").encode("ascii"))


def load_sph(path: str | Path) -> SphereTree:
    """Read a tree.

    Parents that do not enclose all below them grow until they do. A sphere without children above the last level is
    repeated down to it, so that all leaves lie at one depth. The tree's options state both: `parents_grown`, the
    largest growth `parents_grown_most` [unit of the file], and `repeated`. Raises InputError for no such file or tree.
    """
    source = Path(path)
    try:
        lines = read_input_text(source, "ascii", "replace").splitlines()
    except OSError as error:
        raise InputError(f"{source}: {error.strerror or error}; expected a sphere tree (.sph)") from error
    with named(source):
        levels, branching = _header(lines)
        slots = _slots(levels, branching)
        spheres = _spheres([line for line in lines[1:] if line.strip()], slots)
        used = spheres[:, 3] > 0.0
        if not used[0]:
            raise InputError("the root sphere is unused; expected a positive radius in the first slot")
        orphans = np.flatnonzero(used[1:] & ~used[(np.arange(1, slots) - 1) // branching]) + 1
        if orphans.size:
            raise InputError(f"the sphere in slot {orphans[0]} hangs under an unused slot")
    center, radius, level, parent = [spheres[0, :3]], [spheres[0, 3]], [0], [-1]
    # Slot of each node of the level above; None below a sphere that is repeated.
    above: list[tuple[int, int | None]] = [(0, 0)]
    repeated = 0
    for depth in range(1, levels):
        here: list[tuple[int, int | None]] = []
        for node, slot in above:
            first = slots if slot is None else slot * branching + 1
            children: list[int | None] = [k for k in range(first, min(first + branching, slots)) if used[k]]
            repeated += not children
            for child in children or [None]:
                here.append((len(radius), child))
                center.append(center[node] if child is None else spheres[child, :3])
                radius.append(radius[node] if child is None else spheres[child, 3])
                level.append(depth)
                parent.append(node)
        above = here
    centers, levels_array, parents = np.array(center), np.array(level), np.array(parent)
    read = np.array(radius)
    radii = enclosing_radius(centers, read, levels_array, parents)
    growth = radii - read
    options = {
        "source": source.name,
        "parents_grown": int((growth > _ROUNDING * radii).sum()),
        "parents_grown_most": float(growth.max()),
        "repeated": repeated,
    }
    return SphereTree(centers, radii, levels_array, parents, options=options)


def _slots(levels: int, branching: int) -> int:
    return sum(branching**depth for depth in range(levels))


def _header(lines: list[str]) -> tuple[int, int]:
    words = lines[0].split() if lines else []
    if len(words) < 2 or not (words[0].isdecimal() and words[1].isdecimal()):
        raise InputError("the first line must hold the number of levels and the branching factor")
    levels, branching = int(words[0]), int(words[1])
    if not (1 <= levels <= 32 and 1 <= branching <= 4096 and _slots(levels, branching) <= _MOST_SLOTS):
        raise InputError(f"{levels} levels with branching {branching}; expected a tree that fits in memory")
    return levels, branching


def _spheres(lines: list[str], slots: int) -> FloatArray:
    if len(lines) < slots:
        raise InputError(f"{len(lines)} spheres, but the first line promises {slots}")
    spheres = np.empty((slots, 4))
    for slot, line in enumerate(lines[:slots]):
        try:
            spheres[slot] = [float(word) for word in line.split()[:4]]
        except ValueError as error:
            raise InputError(f"slot {slot} reads '{line.strip()[:60]}', expected x y z radius") from error
    if not np.isfinite(spheres[spheres[:, 3] > 0.0]).all():
        raise InputError("a sphere is not finite")
    return spheres
