"""Arrays in HDF5 files of any maker, read without following what refers to other files."""

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from hhsim.errors import DamagedFileError, InputError, TrajectoryError
from hhsim.recordings.joint_names import kind_of
from hhsim.system.hdf5_input import DAMAGE, open_hdf5, require_own_data


@contextmanager
def opened_hdf5(data: bytes, path: Path | None = None, mode: str = "r") -> Iterator[tuple[io.BytesIO, h5py.File]]:
    """Open a file in memory, after a child process has read that of the path; TrajectoryError for a damaged one."""
    image = io.BytesIO(data)
    try:
        if path is not None:
            open_hdf5(path).close()
        with h5py.File(image, mode) as file:
            require_own_data(file)
            yield image, file
    except (DamagedFileError, *DAMAGE) as error:
        raise TrajectoryError(f"a damaged HDF5 file: {' '.join(str(error).split())}") from None


def hdf5_arrays(data: bytes, path: Path | None = None) -> dict[str, Any]:
    """Return the arrays of numbers and texts in a file by their names, and attributes that state a field.

    Names of groups and names in them have slashes between. Raises TrajectoryError for a damaged file.
    """
    arrays: dict[str, Any] = {}

    def add(name: str, value: Any) -> None:
        with suppress(TypeError, ValueError):
            array = np.asarray(value)
            array = array.astype(str) if array.dtype.kind == "O" else array
            if array.dtype.kind in "fiubUS":
                arrays[name] = array

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            add(name, item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()])
        for key, value in item.attrs.items():
            if kind_of(key):
                add(f"{name}/{key}".lstrip("/"), value)

    with opened_hdf5(data, path) as (_, file):
        visit("", file)
        file.visititems(visit)
    return arrays


def hdf5_with(data: bytes, new: Mapping[str, Any]) -> bytes:
    """Return a file with other numbers in its arrays; InputError for whole numbers, which hold no correction."""
    with opened_hdf5(data, mode="r+") as (image, file):
        for name, values in new.items():
            dataset = file.get(name)
            if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiu":
                continue
            if not np.array_equal(dataset[()], values, equal_nan=dataset.dtype.kind == "f"):
                if dataset.dtype.kind != "f":
                    kind = f"'{name}' is of {dataset.dtype}"
                    raise InputError(f"{kind}, which does not hold a correction; expected floating-point")
                dataset[...] = values
    return image.getvalue()
