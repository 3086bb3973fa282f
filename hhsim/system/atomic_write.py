"""Atomic writing of files: a reader finds the old file or the new one, never half of one.

HDF5 files are made in memory first: the library cannot go on after a failed write, not even to close the file.
"""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import h5py

from hhsim.errors import HhsimError, OutputError
from hhsim.system.checksummed_file import sealed
from hhsim.system.output_path import check_output_path, require_apart


def sealed_hdf5(fill: Callable[[h5py.File], object]) -> bytes:
    """Return the bytes of an HDF5 file whose content `fill` writes, followed by their seal."""
    with h5py.File("image", "w", driver="core", backing_store=False) as file:
        fill(file)
        file.flush()
        return sealed(bytes(file.id.get_file_image()))


def put_dataset(group: h5py.Group, name: str, data: Any, units: str, long_name: str, **options: Any) -> Any:
    """Write a dataset with its unit and meaning, and return it; `options` as of `h5py.Group.create_dataset`."""
    dataset = group.create_dataset(name, data=data, track_times=False, **options)
    dataset.attrs["units"], dataset.attrs["long_name"] = units, long_name
    return dataset


@contextmanager
def partial_file(path: Path, suffix: str = ".tmp") -> Iterator[Path]:
    """Yield a path beside a file, whose content replaces it at the end in one step; after an error it is removed.

    Raises OutputError as `hhsim.system.output_path.require_apart`.
    """
    require_apart(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}{suffix}")
    # A link of this name is no place to write.
    partial.unlink(missing_ok=True)
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def new_files(path: Path) -> Iterator[Path]:
    """Yield an empty folder beside `path`, whose files move to that place at the end: all of them, or none.

    A process that is killed leaves the folder, whose name begins with a dot. Raises OutputError where one of the files
    is there already, or cannot be written. An error of the block names the files as they would have been called, and no
    file that is gone.
    """
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".new", dir=path.parent))
    except OSError as error:
        raise OutputError(f"cannot write in {path.parent}: {error.strerror or error}; name another place") from error
    moved: list[Path] = []
    try:
        yield folder
        targets = {each: path.with_name(each.name) for each in sorted(folder.iterdir())}
        for target in targets.values():
            check_output_path(target)
        for each, target in targets.items():
            moved.append(each.rename(target))
    except BaseException as error:
        for target in moved:
            target.unlink()
        if isinstance(error, HhsimError):
            error.args = (str(error).replace(f"{folder.name}{os.sep}", ""),)
        if hasattr(error, "__notes__"):
            error.__notes__[:] = [each for each in error.__notes__ if folder.name not in each]
        raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write_atomically(path: Path, content: bytes) -> None:
    """Write or replace a file in one step; raise OutputError, with the old file unchanged, if that fails."""
    write_together({path: content})


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write or replace files in their order, none before all are on the disk; OutputError as of `write_atomically`."""
    path = Path()
    try:
        with ExitStack() as partials:
            # The last one that is opened is the first that takes its place.
            for path, content in reversed(list(contents.items())):
                partials.enter_context(partial_file(path)).write_bytes(content)
    except OSError as error:
        raise OutputError(f"cannot write {error.filename2 or path}: {error.strerror or error}") from error
