"""Hhsim-tree file: a sphere tree in HDF5, sealed, with units of every number."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

import h5py
import numpy as np

from hhsim.arrays import AnyArray
from hhsim.errors import InputError
from hhsim.system.atomic_write import put_dataset, sealed_hdf5, write_atomically
from hhsim.system.hdf5_input import DAMAGE, open_hdf5, read_numbers
from hhsim.trees.sphere_tree import LENGTHS, LevelCover, LevelError, SphereTree

T = TypeVar("T")
FORMAT = "hhsim-tree"
SEVERAL = "hhsim-robot-trees"
"""Format of a file whose groups are such trees by name."""
SCHEMA_VERSION = 3

_WORTH_PACKING = 1000
"""Number of values from which on a dataset is compressed."""

_DATASETS = {
    "center": ("m", "sphere centres, frame of the mesh"),
    "radius": ("m", "sphere radii"),
    "level": ("1", "depth of each sphere, 0 is the root"),
    "parent": ("1", "index of the parent, -1 for the root"),
}
_COVER_DATASETS = {
    "center": ("m", "sphere centres, frame of the mesh; the last level's are the leaves"),
    "radius": ("m", "sphere radii; the last level's are the leaves"),
    "depth": ("m", "how deep each centre lies inside the mesh, negative outside"),
    "proof": (
        "1",
        "proof that the spheres, grown by the gap, cover the mesh; a binary tree of triangles for each face, preorder: "
        "0: its three corners lie in the next sphere of `owner`; k > 0: it is halved at the middle m of the edge from "
        "its k-th corner to the next; with the corners turned to make that ab, the halves are a m c, whole, then m b c",
    ),
    "owner": ("1", "sphere of each triangle that the proof does not halve, in its order"),
}
_ERROR_NAMES = {
    "level": "level that the errors belong to",
    "spheres": "number of spheres of the level",
    "gap_max": "farthest that the mesh lies outside the spheres",
    "gap_mean": "mean distance of the mesh outside the spheres",
    "gap_p99": "99th percentile of the distance of the mesh outside the spheres",
    "protrusion_max": "farthest that the spheres lie outside the mesh, sampled",
    "protrusion_mean": "mean distance of the spheres' union outside the mesh",
    "protrusion_p99": "99th percentile of the distance of the spheres' union outside the mesh",
    "bound": "proved upper bound of the protrusion",
}


def save_tree(tree: SphereTree, path: str | Path) -> None:
    """Write a tree, in place of an existing file in one step; OutputError if it cannot be written."""
    write_atomically(Path(path), sealed_hdf5(lambda file: _write(tree, file)))


def trees_file(trees: Mapping[str, SphereTree]) -> bytes:
    """Return the bytes of a file of several trees by name, each in a group of its name."""

    def write(file: h5py.File) -> None:
        file.attrs["format"] = SEVERAL
        for name, tree in trees.items():
            _write(tree, file.create_group(name))

    return sealed_hdf5(write)


def _write(tree: SphereTree, file: h5py.Group) -> None:
    file.attrs["format"] = FORMAT
    file.attrs["schema_version"] = SCHEMA_VERSION
    file.attrs["mesh_sha256"] = tree.mesh_sha256
    file.attrs["options"] = json.dumps(dict(tree.options), sort_keys=True)
    for name, (units, long_name) in _DATASETS.items():
        _write_dataset(file, name, getattr(tree, name), units, long_name)
    covers = file.create_group("covers")
    for level, cover in enumerate(tree.covers):
        group = covers.create_group(str(level))
        group.attrs["gap"], group.attrs["bound"] = cover.gap, cover.bound
        for name, data in _arrays(cover, is_last=cover is tree.covers[-1]).items():
            _write_dataset(group, name, data, *_COVER_DATASETS[name])
    group = file.create_group("errors")
    for name, long_name in _ERROR_NAMES.items():
        kind = np.float64 if name in LENGTHS else np.int64
        values = np.array([getattr(error, name) for error in tree.errors], dtype=kind)
        _write_dataset(group, name, values, "m" if name in LENGTHS else "1", long_name)


def _arrays(cover: LevelCover, is_last: bool) -> dict[str, AnyArray]:
    """Return the datasets of a cover: the spheres of the last level are the leaves, which the tree has."""
    spheres = {} if is_last else {"center": cover.center, "radius": cover.radius}
    owner = cover.proof[cover.proof >= 0]
    halved = np.where(cover.proof < 0, -cover.proof, 0).astype(np.int8)
    numbers = owner.astype(np.min_scalar_type(len(cover.radius)))
    return {**spheres, "depth": cover.depth, "proof": halved, "owner": numbers}


def _read_cover(group: h5py.Group, leaves: dict[str, AnyArray]) -> LevelCover:
    proof, owner = -group["proof"][()].astype(np.int32), group["owner"][()]
    ends = proof == 0
    if len(owner) != np.count_nonzero(ends):
        raise InputError(f"{group.name}: the proof needs {np.count_nonzero(ends):,} owners, and has {len(owner):,}")
    proof[ends] = owner
    spheres = leaves | {name: read_numbers(group[name]) for name in leaves if name in group}
    return LevelCover(**spheres, depth=read_numbers(group["depth"]), proof=proof, gap=float(group.attrs["gap"]))


def _write_dataset(group: h5py.Group, name: str, data: AnyArray, units: str, long_name: str) -> None:
    # Bytes in turn help where the values are of one magnitude; the codes of a proof repeat as they are.
    packing = {"compression": "gzip", "chunks": data.shape, "shuffle": data.dtype.kind == "f"}
    put_dataset(group, name, data, units, long_name, **(packing if data.size > _WORTH_PACKING else {}))


def load_tree(path: str | Path, shipped: bool = False) -> SphereTree:
    """Read and check a user's or shipped tree; InputError for no hhsim-tree of a known version, or an invalid tree."""
    return _opened(Path(path), shipped, _read)


def load_trees(path: str | Path) -> dict[str, SphereTree]:
    """Read the trees of a file of several by name, or the tree of a file of one as that of no name; as `load_tree`."""

    def read(file: h5py.File) -> dict[str, SphereTree]:
        if file.attrs.get("format") != SEVERAL:
            return {"": _read(file)}
        return {name: _read(file[name]) for name in file}

    return _opened(Path(path), False, read)


def _opened(source: Path, shipped: bool, read: Callable[[h5py.File], T]) -> T:
    if not source.exists():
        raise InputError(f"{source}: no such file; expected a sphere tree (.h5)")
    try:
        with open_hdf5(source, shipped) as file:
            return read(file)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    except DAMAGE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{source}: not a readable hhsim-tree file ({reason})") from error


def _read(file: h5py.Group) -> SphereTree:
    kind = file.attrs.get("format")
    if kind != FORMAT:
        raise InputError(f"format is {kind!r}, expected '{FORMAT}'")
    version = int(file.attrs.get("schema_version", 0))
    if version != SCHEMA_VERSION:
        raise InputError(f"schema version {version}, this hhsim reads {SCHEMA_VERSION}")
    columns = [file["errors"][name][()].tolist() for name in _ERROR_NAMES]
    if len(set(map(len, columns))) != 1:
        raise InputError("the errors of the levels have different lengths")
    errors = tuple(LevelError(**dict(zip(_ERROR_NAMES, row))) for row in zip(*columns))
    if not all(np.isfinite(list(asdict(error).values())).all() for error in errors):
        raise InputError("an error of a level is not finite")
    covers = file["covers"]
    if set(covers) != {str(level) for level in range(len(covers))}:
        raise InputError(f"covers of the levels {', '.join(covers)}; expected one for each level from 0 on")
    center, radius, level = read_numbers(file["center"]), read_numbers(file["radius"]), file["level"][()]
    first = int(np.searchsorted(level, level.max(initial=0)))
    leaves = {"center": center[first:], "radius": radius[first:]}
    return SphereTree(
        center=center,
        radius=radius,
        level=level,
        parent=file["parent"][()],
        errors=errors,
        mesh_sha256=str(file.attrs["mesh_sha256"]),
        options=dict(json.loads(file.attrs["options"])),
        covers=tuple(_read_cover(covers[str(at)], leaves) for at in range(len(covers))),
    )
