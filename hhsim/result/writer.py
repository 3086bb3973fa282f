"""Writer of result files (format `hhsim-result`, see `hhsim.result.schema`), block by block.

Each block is flushed, so that a killed run leaves a readable file with `complete` = 0; it becomes 1 right before the
file is sealed (`hhsim.system.checksummed_file`). A new result grows as NAME.partial.h5 beside an older one and replaces
it when complete. The space of each block is claimed before HDF5 writes, since HDF5 cannot even close a file after a
failed write.
"""

import contextlib
import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeAlias

import h5py
import numpy as np

from hhsim.arrays import AnyArray
from hhsim.errors import OutputError
from hhsim.motion.trajectory import TickPhase
from hhsim.result import schema
from hhsim.result.body import Body, contact_names
from hhsim.result.reader import CHUNK_TICKS, check_result_path
from hhsim.system import environment as info
from hhsim.system.atomic_write import partial_file, put_dataset
from hhsim.system.checksummed_file import seal_file
from hhsim.system.counted import counted
from hhsim.system.output_path import free_name, require_apart
from hhsim.system.posix import allocate

Scalar: TypeAlias = str | int | float | bool

_OVERHEAD = 512 * 1024
"""Upper bound of HDF5's own growth in a block [bytes]."""


@dataclass(frozen=True)
class HandPart:
    """A hand of a file: description, model, and the tables of a live session."""

    scene: Mapping[str, Any]  # every option of the run, as JSON-able values; what hands have in common is written once
    static: Mapping[str, AnyArray]  # arrays of `HAND_STATIC` by name
    tables: Mapping[str, Sequence[schema.Column]] = field(default_factory=dict)  # of a session, such as `live/tick`
    attributes: Mapping[str, Scalar] = field(default_factory=dict)  # of `live`


class ResultWriter:
    """Writes a result file block by block in a `with`; call `finish` last.

    Leaving the `with` by an exception keeps the blocks with complete = 0, and notes their place on the exception; a
    file without any tick is removed.

    Args:
        path: Result; an existing one is replaced when the new one is complete.
        hands: Each hand, by its name.
        bodies: Each body, by its name; the first one's contacts are recorded if it is free.
        columns: Columns of /tick beside the time.
        phases: Phases of the trajectory, where they are known already.
        command: Command as it was typed; empty for a call of the library.

    Raises:
        OutputError: The file cannot be made: a folder in the way, no permission, a full disk, a file that is no result.
    """

    def __init__(
        self,
        path: Path,
        *,
        hands: Mapping[str, HandPart],
        bodies: Mapping[str, Body],
        columns: Sequence[schema.Column] = (),
        phases: Sequence[TickPhase] = (),
        command: Sequence[str] = (),
    ) -> None:
        check_result_path(path)
        self._output_path = path
        self.path = free_name(path.with_name(f"{path.stem}.partial{path.suffix}")) if path.exists() else path
        self._tables = {schema.TICK: _Table((schema.TIME, *columns))}
        for name, hand in hands.items():
            group = f"{schema.HANDS}/{name}"
            self._tables[f"{group}/{schema.TICK}"] = _Table(schema.hand_columns())
            self._tables |= {f"{group}/{table}": _Table(of) for table, of in hand.tables.items()}
        for name, body in bodies.items():
            if body.columns:
                self._tables[f"{schema.BODIES}/{name}/{schema.TICK}"] = _Table(body.columns)
        if next(iter(bodies.values())).kind == "free":
            self._tables[schema.CONTACT] = _Table(schema.CONTACT_COLUMNS)
        self._complete = False
        with _output_errors(self.path), contextlib.ExitStack() as undo:
            self.path.touch(exist_ok=False)
            undo.callback(self.path.unlink, missing_ok=True)
            self._file = h5py.File(self.path, "w")
            undo.callback(self._close)
            self._file.attrs["command"] = json.dumps(list(command), ensure_ascii=False)
            self._write_header(hands, bodies, phases)
            undo.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._complete:
            return
        # An interrupt may have come between two datasets, or between the growth of one and its values.
        with contextlib.suppress(OSError, RuntimeError, KeyError):
            for table in self._tables.values():
                for dataset in table.datasets.values():
                    if len(dataset) > table.rows:
                        dataset.resize(table.rows, axis=0)
        size = self._close()
        if self.ticks == 0:
            self.path.unlink(missing_ok=True)
            if isinstance(error, OutputError):
                needed = CHUNK_TICKS * sum(table.row_bytes for table in self._tables.values()) + _OVERHEAD
                error.add_note(f"not one tick is recorded: the first {CHUNK_TICKS} need {1e-6 * needed:.1f} MB")
            return
        if size:
            # An unsealed file is still read, by a child process.
            with contextlib.suppress(OSError):
                seal_file(self.path, size)
        if error is not None:
            verb = "is" if self.ticks == 1 else "are"
            error.add_note(f"the {counted(self.ticks, 'tick')} so far {verb} in {self.path} (complete = 0)")

    @property
    def ticks(self) -> int:
        """Number of ticks written so far."""
        return self._tables[schema.TICK].rows

    def append(
        self, tables: Mapping[str, Mapping[str, AnyArray]], attributes: Mapping[str, Mapping[str, Scalar]] | None = None
    ) -> None:
        """Write the next ticks, and rows of other tables, and flush them.

        Args:
            tables: Rows of the tables by their groups (`hhsim.result.schema.hand_tables`): arrays of the columns by
                name, each of shape (rows, *column.shape); empty without rows.
            attributes: Attributes of groups, to set or to replace.

        Raises:
            OutputError: The disk is full or gone; the ticks before stay readable.
        """
        counts = {group: len(next(iter(arrays.values()))) for group, arrays in tables.items() if arrays}
        with _output_errors(self.path):
            self._claim(sum(self._tables[group].growth(count) for group, count in counts.items()) + _OVERHEAD)
            for group, count in counts.items():
                table = self._tables[group]
                for name, array in tables[group].items():
                    dataset = table.datasets[name]
                    dataset.resize(table.rows + count, axis=0)
                    dataset[table.rows :] = np.asarray(array, dataset.dtype)
            for group, values in (attributes or {}).items():
                self._file[group].attrs.update(values)
            self._file.flush()
        for group, count in counts.items():
            self._tables[group].rows += count

    def finish(self, hands: Mapping[str, Mapping[str, Scalar]], shared: Mapping[str, Scalar] | None = None) -> Path:
        """Write figures of each hand by its name, and shared ones, mark the file complete, return its final path."""
        with _output_errors(self.path):
            self._claim(_OVERHEAD)
            self._file[schema.SUMMARY].attrs.update(shared or {})
            for name, figures in hands.items():
                self._file[schema.SUMMARY][name].attrs.update(figures)
            self._file.flush()
            self._file.attrs["complete"] = 1
            self._file.flush()
            size = self._file.id.get_filesize()
            self._file.close()
            seal_file(self.path, size)
            self._complete = True
            if self.path != self._output_path:
                require_apart(self._output_path)
                self.path.replace(self._output_path)
                self.path = self._output_path
        return self.path

    def _write_header(
        self, hands: Mapping[str, HandPart], bodies: Mapping[str, Body], phases: Sequence[TickPhase]
    ) -> None:
        first = next(iter(hands.values())).scene
        common = {
            key: value
            for key, value in first.items()
            # Sizes are each hand's own.
            if key != "hand" and all(key in hand.scene and hand.scene[key] == value for hand in hands.values())
        }
        scene_json = json.dumps(common, sort_keys=True)
        self._claim(len(scene_json) + 2 * _OVERHEAD)
        about = {"format": schema.FORMAT, "schema_version": schema.SCHEMA_VERSION, "complete": 0}
        self._file.attrs.update({**about, **info.file_attributes(), "scene": scene_json})
        for name, hand in hands.items():
            group = self._write_static(f"{schema.HANDS}/{name}", hand.static, schema.HAND_STATIC)
            own = {key: value for key, value in hand.scene.items() if key not in common}
            group.attrs["scene"] = json.dumps(own, sort_keys=True)
            self._file.create_group(f"{schema.SUMMARY}/{name}")
        for name, body in bodies.items():
            group = self._write_static(f"{schema.BODIES}/{name}", body.static, schema.BODY_STATIC)
            group.attrs.update({"kind": body.kind, "properties": json.dumps(body.properties, sort_keys=True)})
        # HDF5 has groups by the alphabet.
        self._file[schema.BODIES].attrs["names"] = json.dumps(list(bodies), ensure_ascii=False)
        for path, table in self._tables.items():
            for column in table.columns:
                is_text = column.dtype.startswith("S")
                table.datasets[column.name] = put_dataset(
                    *(self._file, f"{path}/{column.name}", None, column.units, column.long_name),
                    shape=(0, *column.shape),
                    maxshape=(None, *column.shape),
                    chunks=(CHUNK_TICKS, *column.shape),
                    dtype=h5py.string_dtype("utf-8", int(column.dtype[1:])) if is_text else column.dtype,
                )
        for name, hand in hands.items():
            if hand.attributes:
                self._file[f"{schema.HANDS}/{name}/{schema.LIVE}"].attrs.update(hand.attributes)
        if schema.CONTACT in self._tables:
            names = json.dumps(contact_names(list(hands), list(bodies)), ensure_ascii=False)
            self._file[schema.CONTACT].attrs["names"] = names
        group = self._file.create_group("phase")
        called, text = [phase.name for phase in phases], h5py.string_dtype()
        put_dataset(group, "name", called, "1", "name of each phase of the trajectory", dtype=text)
        for name in ("first_tick", "last_tick"):
            ticks = np.array([getattr(phase, name) for phase in phases], dtype="<i8")
            put_dataset(group, name, ticks, "1", f"{name.split('_')[0]} tick of each phase, from 0")
        self._file.flush()

    def _write_static(self, group: str, static: Mapping[str, AnyArray], columns: Sequence[schema.Column]) -> h5py.Group:
        """Write arrays that do not change with time, and return their group."""
        self._claim(sum(array.nbytes for array in static.values()) + _OVERHEAD)
        for column in columns:
            values = np.asarray(static[column.name], column.dtype)
            put_dataset(self._file, f"{group}/{column.name}", values, column.units, column.long_name)
        return self._file[group]

    def _claim(self, size: int) -> None:
        """Allocate `size` bytes of the file system behind HDF5's own."""
        allocate(self.path, self._file.id.get_filesize(), size)

    def _close(self) -> int:
        """Close the file and return its size in bytes, 0 for a failure."""
        size = 0
        with contextlib.suppress(OSError, RuntimeError):
            self._file.flush()
            size = int(self._file.id.get_filesize())
        try:
            self._file.close()
        except (OSError, RuntimeError):
            return 0
        return size


def add_document(path: Path, name: str, document: Mapping[str, Any]) -> None:
    """Add a JSON document as an attribute (`repeated`, `score`) to a complete result, and seal it anew.

    Of several runs, `repeated` has `runs`, how many, and `times`: mean and std by the name of the figure, SI or %.
    Raises OutputError where the file cannot be written.
    """
    with _output_errors(path), _amended(path) as file:
        file.attrs[name] = json.dumps(document)


def add_skin(path: Path, vertices: AnyArray, faces: AnyArray) -> None:
    """Add the skin of the shown hand to a complete result of one hand, or replace it, and seal it anew.

    Vertices [m], world, have shape (T, V, 3), triangles (F, 3). OutputError leaves the file as it was.
    """
    with _output_errors(path), partial_file(path) as partial:
        shutil.copyfile(path, partial)
        with _amended(partial) as file:
            (hand,) = file[schema.HANDS].values()
            hand.pop(schema.SKIN, None)
            for column, values in zip(schema.SKIN_COLUMNS, (vertices, faces), strict=True):
                data = np.asarray(values, column.dtype)
                put_dataset(hand, f"{schema.SKIN}/{column.name}", data, column.units, column.long_name)


@contextlib.contextmanager
def _amended(path: Path) -> Iterator[h5py.File]:
    """Open a complete result for a change, and seal it anew after it."""
    with h5py.File(path, "r+") as file:
        yield file
        file.flush()
        size = int(file.id.get_filesize())
    seal_file(path, size)


@dataclass
class _Table:
    """Group whose datasets grow together."""

    columns: Sequence[schema.Column]
    rows: int = 0
    datasets: dict[str, h5py.Dataset] = field(default_factory=dict)  # by the name of their column

    def growth(self, count: int) -> int:
        """Upper bound of the datasets' growth by some rows [bytes]."""
        new_chunks = -(-(self.rows + count) // CHUNK_TICKS) - -(-self.rows // CHUNK_TICKS)
        return new_chunks * CHUNK_TICKS * self.row_bytes

    @property
    def row_bytes(self) -> int:
        return sum(np.dtype(column.dtype).itemsize * math.prod(column.shape) for column in self.columns)


@contextlib.contextmanager
def _output_errors(path: Path) -> Iterator[None]:
    """Raise OutputError for a failure of the file system."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error).splitlines()[0]
        raise OutputError(f"cannot write {path}: {reason[:1].lower()}{reason[1:]}") from error
