"""Merge of two results of one hand each, whose hands were not run together, to one file of both."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from hhsim.arrays import AnyArray
from hhsim.errors import InputError
from hhsim.result.schema import BETWEEN_COLUMNS, BODIES, HANDS, SUMMARY, TICK
from hhsim.result.writer import describe_dataset, output_errors, split_scenes
from hhsim.system.atomic_write import partial_file
from hhsim.system.checksummed_file import seal_file
from hhsim.system.hdf5_input import open_hdf5


def merge_hands(parts: Sequence[Path], path: Path, between: Mapping[str, AnyArray]) -> Path:
    """Merge the complete results of the right and the left hand in the same ticks in one file, and delete them.

    `between` has the arrays of `BETWEEN_COLUMNS` by name. Raises InputError for results of two objects, OutputError
    where the file cannot be written; the parts stay.
    """
    with output_errors(path):
        with partial_file(path) as partial:
            with h5py.File(partial, "w") as file, open_hdf5(parts[0]) as one, open_hdf5(parts[1]) as other:
                if not _equal(one[BODIES], other[BODIES]):
                    raise InputError(f"{parts[0]} and {parts[1]} have not the same bodies: each keeps its own file")
                file.attrs.update(one.attrs)
                for name in one:
                    one.copy(name, file)
                hands = {name: of for of in (one, other) for name in of[HANDS]}
                for name, of in hands.items():
                    if of is other:
                        of.copy(f"{HANDS}/{name}", file[HANDS])
                        of.copy(f"{SUMMARY}/{name}", file[SUMMARY])
                for column in BETWEEN_COLUMNS:
                    values = np.asarray(between[column.name], column.dtype)
                    describe_dataset(file.create_dataset(f"{TICK}/{column.name}", data=values), column)
                common, own = split_scenes({name: _scene(of, name) for name, of in hands.items()})
                file.attrs["scene"] = json.dumps(common, sort_keys=True)
                for name, scene in own.items():
                    file[HANDS][name].attrs["scene"] = json.dumps(scene, sort_keys=True)
                file.flush()
                size = int(file.id.get_filesize())
            seal_file(partial, size)
        for part in parts:
            part.unlink()
    return path


def _scene(file: h5py.File, name: str) -> dict[str, Any]:
    return {**json.loads(file.attrs["scene"]), **json.loads(file[HANDS][name].attrs["scene"])}


def _equal(one: h5py.Group, other: h5py.Group) -> bool:
    """Return True if two groups hold the same arrays."""
    if isinstance(one, h5py.Dataset) or isinstance(other, h5py.Dataset):
        return isinstance(one, h5py.Dataset) and isinstance(other, h5py.Dataset) and np.array_equal(one, other)
    return one.keys() == other.keys() and all(_equal(one[name], other[name]) for name in one)
