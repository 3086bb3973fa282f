""".sph text format of Bradshaw's sphere-tree toolkit.

First line: number of levels including the root, and branching factor B. Then one line for each slot of the complete
tree, `x y z radius importance`, breadth first: the children of slot n are the slots n·B + 1 to n·B + B. A radius that
is not positive marks an unused slot. Further columns, and lines after the last slot, are ignored. The format has no
unit; the toolkit's centres count from the centre of the mesh's bounding box, see `hhsim.trees.foreign_tree`.
"""

from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, named
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text
from hhsim.trees.sphere_tree import SphereTree, enclosing_radius

_MOST_SLOTS = 20_000_000
_ROUNDING = 1e-9


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
