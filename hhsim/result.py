"""Result files: one replay or session, every tick of it, in HDF5 (format `hhsim-result`, see `hhsim.result_schema`).

A result grows block by block, and each block is flushed, so that a run that is killed leaves a readable file whose
attribute `complete` is 0; it becomes 1 as the very last thing. Where a result of that name exists already, the new one
grows beside it as NAME.partial.h5 and takes its place when it is complete: nothing of the old one is lost before.

The space of each block is claimed from the file system before HDF5 writes into it. A full disk is thus found while the
file is still sound; HDF5 itself cannot go on after a write that failed, not even to close the file.
"""

import contextlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeAlias

import h5py
import numpy as np
from numpy.typing import NDArray

from hhsim import info
from hhsim.destination import check_destination, free_name
from hhsim.errors import InputError, OutputError
from hhsim.result_schema import FORMAT, SCHEMA_VERSION, STATIC_COLUMNS, TICK_COLUMNS, Column
from hhsim.trajectory import TickPhase

Array: TypeAlias = NDArray[Any]
Scalar: TypeAlias = str | int | float | bool

CHUNK_TICKS = 512
"""Ticks in a chunk of the file; blocks of this size fill it best."""

_OVERHEAD = 512 * 1024
"""More than HDF5's own bookkeeping grows by in a block [bytes]."""


class ResultWriter:
    """Writes a result file block by block; use it in a `with`, and call `finish` last.

    Leaving the `with` by an exception keeps what has been written, with complete = 0, and adds a note to the exception
    that says where it is; a file without any tick is removed.

    Args:
        path: where the result goes; an existing result there is replaced when the new one is complete.
        scene: every option of the run, as JSON-able values.
        static: the arrays of `STATIC_COLUMNS` by name.
        phases: phases of the trajectory, where they are known already.

    Raises:
        OutputError: the file cannot be made: a folder in the way, no permission, a full disk, a file that is no result.
    """

    path: Path
    """Where the file is now: NAME.partial.h5 while an older result of the name still stands."""
    ticks: int
    """Ticks written so far."""

    def __init__(
        self, path: Path, *, scene: Mapping[str, Any], static: Mapping[str, Array], phases: Sequence[TickPhase] = ()
    ) -> None:
        check_result_destination(path)
        self._destination = path
        self.path = path
        if path.exists():
            self.path = free_name(path.with_name(f"{path.stem}.partial{path.suffix}"))
        self.ticks = 0
        self._complete = False
        with _output_errors(self.path), contextlib.ExitStack() as undo:
            self.path.touch(exist_ok=False)
            undo.callback(self.path.unlink, missing_ok=True)
            self._file = h5py.File(self.path, "w")
            undo.callback(self._close)
            self._write_header(scene, static, phases)
            undo.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._complete:
            return
        self._drop_half_a_block()
        self._close()
        if self.ticks == 0:
            self.path.unlink(missing_ok=True)
        elif error is not None:
            error.add_note(f"the {self.ticks:,} ticks so far are in {self.path} (complete = 0)")

    def append(self, block: Mapping[str, Array]) -> None:
        """Write the next ticks and flush them.

        Args:
            block: one array for each of `TICK_COLUMNS`, by its name; each of shape (ticks, *column.shape).

        Raises:
            OutputError: the disk is full or gone; the ticks before stay readable.
        """
        arrays = _checked(block, TICK_COLUMNS)
        counts = {len(array) for array in arrays.values()}
        if len(counts) != 1:
            raise ValueError(f"a block's arrays hold different numbers of ticks: {sorted(counts)}")
        count = counts.pop()
        end = self.ticks + count
        new_chunks = -(-end // CHUNK_TICKS) - -(-self.ticks // CHUNK_TICKS)
        row = sum(array.dtype.itemsize * array[0].size for array in arrays.values()) if count else 0
        with _output_errors(self.path):
            self._claim(new_chunks * CHUNK_TICKS * row + _OVERHEAD)
            for name, array in arrays.items():
                dataset = self._file["tick"][name]
                dataset.resize(end, axis=0)
                dataset[self.ticks :] = array
            self._file.flush()
        self.ticks = end

    def finish(self, summary: Mapping[str, Scalar], phases: Sequence[TickPhase] | None = None) -> Path:
        """Write the summary, mark the file complete and give it its final name.

        Args:
            summary: the figures of the table that `hhsim replay` prints, by name.
            phases: phases of the trajectory, where they were not known at the start.

        Returns:
            Where the result is.
        """
        with _output_errors(self.path):
            self._claim(_OVERHEAD)
            if phases is not None:
                self._write_phases(phases)
            self._file["summary"].attrs.update(summary)
            self._file.flush()
            self._file.attrs["complete"] = 1
            self._file.flush()
            size = self._file.id.get_filesize()
            self._file.close()
            if self.path.stat().st_size > size:
                os.truncate(self.path, size)
            self._complete = True
            if self.path != self._destination:
                self.path.replace(self._destination.resolve())
                self.path = self._destination
        return self.path

    def _write_header(self, scene: Mapping[str, Any], static: Mapping[str, Array], phases: Sequence[TickPhase]) -> None:
        arrays = _checked(static, STATIC_COLUMNS)
        scene_json = json.dumps(scene, sort_keys=True)
        self._claim(sum(array.nbytes for array in arrays.values()) + len(scene_json) + 2 * _OVERHEAD)
        self._file.attrs.update(
            {
                "format": FORMAT,
                "schema_version": SCHEMA_VERSION,
                "complete": 0,
                **info.file_attributes(),
                "scene": scene_json,
            }
        )
        for column in STATIC_COLUMNS:
            _describe(self._file.create_dataset(column.name, data=arrays[column.name]), column)
        tick = self._file.create_group("tick")
        for column in TICK_COLUMNS:
            dataset = tick.create_dataset(
                column.name,
                shape=(0, *column.shape),
                maxshape=(None, *column.shape),
                chunks=(CHUNK_TICKS, *column.shape),
                dtype=column.dtype,
            )
            _describe(dataset, column)
        self._file.create_group("summary")
        self._write_phases(phases)
        self._file.flush()

    def _write_phases(self, phases: Sequence[TickPhase]) -> None:
        if "phase" in self._file:
            del self._file["phase"]
        group = self._file.create_group("phase")
        names = group.create_dataset("name", data=[phase.name for phase in phases], dtype=h5py.string_dtype())
        _describe(names, Column("name", (-1,), "", "1", "name of each phase of the trajectory"))
        for name, ticks in (
            ("first_tick", [phase.first_tick for phase in phases]),
            ("last_tick", [phase.last_tick for phase in phases]),
        ):
            dataset = group.create_dataset(name, data=np.array(ticks, dtype="<i8"))
            _describe(dataset, Column(name, (-1,), "<i8", "1", f"{name.split('_')[0]} tick of each phase, from 0"))

    def _claim(self, size: int) -> None:
        """Make the file system set `size` bytes aside behind what HDF5 has allocated."""
        if not hasattr(os, "posix_fallocate"):
            return
        descriptor = os.open(self.path, os.O_RDWR)
        try:
            os.posix_fallocate(descriptor, self._file.id.get_filesize(), size)
        finally:
            os.close(descriptor)

    def _drop_half_a_block(self) -> None:
        # An interrupt may have come between two datasets, or between the growth of one and its values.
        with contextlib.suppress(OSError, RuntimeError, KeyError):
            for column in TICK_COLUMNS:
                dataset = self._file["tick"][column.name]
                if len(dataset) > self.ticks:
                    dataset.resize(self.ticks, axis=0)

    def _close(self) -> None:
        with contextlib.suppress(OSError, RuntimeError):
            self._file.close()


@dataclass(frozen=True)
class Result:
    """A result file that has been opened and checked; the ticks are read when they are asked for, and kept.

    `result["graphic/joints"]` is that dataset of /tick as a read-only array, shape (ticks, *column.shape).
    """

    path: Path
    complete: bool
    """False where the run was stopped; the ticks before are sound."""
    ticks: int
    """Ticks that every dataset has."""
    schema_version: int
    hhsim_version: str
    created_utc: str
    scene: dict[str, Any]
    """Every option of the run."""
    machine: dict[str, Any]
    packages: dict[str, str]
    phases: tuple[TickPhase, ...]
    """Phases that begin within the ticks."""
    summary: dict[str, Any]
    static: Mapping[str, Array] = field(repr=False)
    """The arrays of `STATIC_COLUMNS` by name."""
    _loaded: dict[str, Array] = field(default_factory=dict, repr=False, compare=False)

    def __getitem__(self, name: str) -> Array:
        if name not in self._loaded:
            since = {column.name: column.since for column in TICK_COLUMNS}.get(name, 1)
            if since > self.schema_version:
                raise InputError(f"{self.path} has no dataset {name}: its schema is {self.schema_version}, not {since}")
            with _opened(self.path) as file:
                self._loaded[name] = _frozen(file["tick"][name][: self.ticks])
        return self._loaded[name]

    def phase(self, name: str) -> slice:
        """Ticks of the first phase of that name.

        Raises:
            InputError: the result has no such phase.
        """
        for phase in self.phases:
            if phase.name == name:
                return slice(phase.first_tick, min(phase.last_tick + 1, self.ticks))
        known = ", ".join(phase.name for phase in self.phases) or "none"
        raise InputError(f"{self.path} has no phase '{name}': it has {known}")


def load_result(path: Path) -> Result:
    """Open a result file, complete or not.

    Raises:
        InputError: no such file, no HDF5, no result, a newer schema, or datasets that are missing or misshapen.
    """
    with _opened(path) as file:
        _check_format(file, path)
        tick = file.get("tick", {})
        stored = [column for column in TICK_COLUMNS if column.since <= file.attrs["schema_version"]]
        for column in stored:
            _check_dataset(tick, column, (-1, *column.shape), path)
        for column in STATIC_COLUMNS:
            _check_dataset(file, column, column.shape, path)
        ticks = min(len(tick[column.name]) for column in stored)
        attributes = file.attrs
        return Result(
            path=path,
            complete=bool(attributes["complete"]),
            ticks=ticks,
            schema_version=int(attributes["schema_version"]),
            hhsim_version=str(attributes["hhsim_version"]),
            created_utc=str(attributes["created_utc"]),
            scene=json.loads(attributes["scene"]),
            machine=json.loads(attributes["machine"]),
            packages=json.loads(attributes["packages"]),
            phases=tuple(phase for phase in _read_phases(file) if phase.first_tick < ticks),
            summary={name: _plain(value) for name, value in file["summary"].attrs.items()},
            static={column.name: _frozen(file[column.name][...]) for column in STATIC_COLUMNS},
        )


def check_result_destination(path: Path) -> None:
    """Look, before the work, for what would keep a result from being written to `path`.

    Raises:
        OutputError: as `hhsim.destination.check_destination`; or a file is there that is no result, which a slip of the
            pen must not destroy.
    """
    check_destination(path)
    if not path.exists():
        return
    try:
        with h5py.File(path, "r") as file:
            is_result = file.attrs.get("format") == FORMAT
    except BlockingIOError as error:
        raise OutputError(f"{path} is being written by another process: name another file with --out") from error
    except OSError:
        is_result = False
    if not is_result:
        raise OutputError(f"{path} exists and is no result file, so it is not replaced: name another file with --out")


def _read_phases(file: h5py.File) -> Iterator[TickPhase]:
    group = file["phase"]
    for name, first, last in zip(group["name"].asstr()[...], group["first_tick"], group["last_tick"]):
        yield TickPhase(str(name), int(first), int(last))


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open for reading, with every failure of the file told as an `InputError`."""
    if not path.exists():
        raise InputError(f"there is no file {path}")
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a result file")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except BlockingIOError as error:
        raise InputError(f"{path} is still being written by another process: wait for it to end") from error
    except PermissionError as error:
        raise InputError(f"no permission to read {path}") from error
    except KeyError as error:
        raise InputError(f"{path} is damaged or no result file: {error.args[0]}") from error
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path} is no HDF5 file, or one that is cut short or damaged") from error


def _check_format(file: h5py.File, path: Path) -> None:
    found = file.attrs.get("format")
    if found != FORMAT:
        what = f"its format is '{found}'" if isinstance(found, str) else "it states no format"
        raise InputError(f"{path} is no result file: {what}, not '{FORMAT}'")
    version = file.attrs.get("schema_version", 0)
    if version > SCHEMA_VERSION:
        here = f"schema {version}; this one reads up to {SCHEMA_VERSION}"
        raise InputError(f"{path} was written by a newer hhsim ({here}): upgrade hhsim")


def _check_dataset(group: Mapping[str, Any], column: Column, shape: tuple[int, ...], path: Path) -> None:
    dataset = group.get(column.name)
    if dataset is None:
        raise InputError(f"{path} is damaged or no result file: it lacks the dataset {column.name}")
    if not _fits(dataset.shape, shape):
        raise InputError(f"{path}: {column.name} has shape {dataset.shape}, expected {_spelled(shape)}")


def _checked(arrays: Mapping[str, Array], columns: Sequence[Column]) -> dict[str, Array]:
    """Give each column its array in the file's type; a caller that hands over the wrong ones has a bug."""
    names = {column.name for column in columns}
    if arrays.keys() != names:
        raise ValueError(
            f"missing: {sorted(names - arrays.keys())}; not in the schema: {sorted(arrays.keys() - names)}"
        )
    checked = {}
    for column in columns:
        array = np.ascontiguousarray(arrays[column.name], dtype=column.dtype)
        shape = column.shape if columns is STATIC_COLUMNS else (-1, *column.shape)
        if not _fits(array.shape, shape):
            raise ValueError(f"{column.name} has shape {array.shape}, expected {_spelled(shape)}")
        checked[column.name] = array
    return checked


def _fits(shape: tuple[int, ...], expected: tuple[int, ...]) -> bool:
    return len(shape) == len(expected) and all(want in (-1, have) for have, want in zip(shape, expected))


def _spelled(shape: tuple[int, ...]) -> str:
    return f"({', '.join('any' if size == -1 else str(size) for size in shape)})"


def _describe(dataset: h5py.Dataset, column: Column) -> None:
    dataset.attrs["units"] = column.units
    dataset.attrs["long_name"] = column.long_name


def _frozen(array: Array) -> Array:
    array.flags.writeable = False
    return array


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


@contextlib.contextmanager
def _output_errors(path: Path) -> Iterator[None]:
    """Tell a failure of the file system as an `OutputError`."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error).splitlines()[0]
        raise OutputError(f"cannot write {path}: {reason[:1].lower()}{reason[1:]}") from error
