"""Hhsim-tree file: a sphere tree in HDF5, sealed, with units of every number."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
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
SCHEMA_VERSION = 2

_WORTH_PACKING = 1000
"""Number of values from which on a dataset is compressed."""

_DATASETS = {
    "center": ("m", "sphere centres, frame of the mesh"),
    "radius": ("m", "sphere radii"),
    "level": ("1", "depth of each sphere, 0 is the root"),
    "parent": ("1", "index of the parent, -1 for the root"),
}
_COVER_DATASETS = {
    "center": ("m", "sphere centres, frame of the mesh"),
    "radius": ("m", "sphere radii"),
    "depth": ("m", "how deep each centre lies inside the mesh, negative outside"),
    "proof": (
        "1",
        "proof that the spheres, grown by the gap, cover the mesh; a binary tree of triangles for each face, preorder: "
        "j >= 0: its three corners lie in sphere j; -1 - k: it is halved at the middle m of the edge from its corner k "
        "to the next; with the corners turned to make that ab, the halves are a m c, whole, then m b c",
    ),
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
        for name, (units, long_name) in _COVER_DATASETS.items():
            _write_dataset(group, name, _narrow(getattr(cover, name)), units, long_name)
    group = file.create_group("errors")
    for name, long_name in _ERROR_NAMES.items():
        kind = np.float64 if name in LENGTHS else np.int64
        values = np.array([getattr(error, name) for error in tree.errors], dtype=kind)
        _write_dataset(group, name, values, "m" if name in LENGTHS else "1", long_name)


def _narrow(data: AnyArray) -> AnyArray:
    """Return a proof's codes, numbers of spheres of a level, in two bytes each where these hold them; else the data."""
    fits = data.dtype.kind == "i" and data.size > 0 and np.abs(data).max() < np.iinfo(np.int16).max
    return data.astype(np.int16) if fits else data


def _write_dataset(group: h5py.Group, name: str, data: AnyArray, units: str, long_name: str) -> None:
    # Bytes in turn help where the values are of one magnitude; the codes of a proof repeat as they are.
    packing = {"compression": "gzip", "shuffle": data.dtype.kind == "f"} if data.size > _WORTH_PACKING else {}
    put_dataset(group, name, data, units, long_name, **packing)


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
    columns = {name: file["errors"][name][()] for name in _ERROR_NAMES}
    if len({len(column) for column in columns.values()}) != 1:
        raise InputError("the errors of the levels have different lengths")
    names = [item.name for item in fields(LevelError)]
    errors = tuple(LevelError(*(columns[name][row].item() for name in names)) for row in range(len(columns["level"])))
    if not all(np.isfinite(list(asdict(error).values())).all() for error in errors):
        raise InputError("an error of a level is not finite")
    covers = file["covers"]
    if set(covers) != {str(level) for level in range(len(covers))}:
        raise InputError(f"covers of the levels {', '.join(covers)}; expected one for each level from 0 on")
    return SphereTree(
        center=read_numbers(file["center"]),
        radius=read_numbers(file["radius"]),
        level=file["level"][()],
        parent=file["parent"][()],
        errors=errors,
        mesh_sha256=str(file.attrs["mesh_sha256"]),
        options=dict(json.loads(file.attrs["options"])),
        covers=tuple(
            LevelCover(**{name: read_numbers(data[name]) for name in _COVER_DATASETS}, gap=float(data.attrs["gap"]))
            for data in (covers[str(level)] for level in range(len(covers)))
        ),
    )
