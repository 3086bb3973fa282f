"""Atomic writing of files: a reader finds the old file or the new one, never half of one.

HDF5 files are made in memory first: the library cannot go on after a failed write, not even to close the file.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from hhsim.errors import OutputError
from hhsim.system.checksummed_file import sealed


def sealed_hdf5(fill: Callable[[h5py.File], object]) -> bytes:
    """Return the bytes of an HDF5 file whose content `fill` writes, followed by their seal."""
    with h5py.File("image", "w", driver="core", backing_store=False) as file:
        fill(file)
        file.flush()
        return sealed(bytes(file.id.get_file_image()))


def put_dataset(group: h5py.Group, name: str, data: Any, units: str, long_name: str, **options: Any) -> None:
    """Write a dataset with its unit and meaning; `options` as of `h5py.Group.create_dataset`."""
    dataset = group.create_dataset(name, data=data, track_times=False, **options)
    dataset.attrs["units"], dataset.attrs["long_name"] = units, long_name


@contextmanager
def partial_file(path: Path, suffix: str = ".tmp") -> Iterator[Path]:
    """Yield a path beside a file, whose content replaces it at the end in one step; after an error it is removed."""
    partial = path.with_name(f".{path.name}.{os.getpid()}{suffix}")
    try:
        yield partial
        partial.replace(Path(os.path.realpath(path)))
    finally:
        partial.unlink(missing_ok=True)


def write_atomically(path: Path, content: bytes) -> None:
    """Write or replace a file in one step; raise OutputError, with the old file unchanged, if that fails."""
    write_together({path: content})


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write or replace files in their order, none before all are on the disk; OutputError as of `write_atomically`."""
    targets = {path: Path(os.path.realpath(path)) for path in contents}
    partials = {path: target.with_name(f".{target.name}.{os.getpid()}.tmp") for path, target in targets.items()}
    path = Path()
    try:
        for path, content in contents.items():
            partials[path].write_bytes(content)
        for path, partial in partials.items():
            partial.replace(targets[path])
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        for partial in partials.values():
            partial.unlink(missing_ok=True)
