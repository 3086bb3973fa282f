"""Tables of `hhsim bench`: HDF5 of format `hhsim-bench`, and the same as CSV beside it; SI units.

The HDF5 file has one dataset a column, with its `units` and `long_name`; its root has the options, versions and
machine. The header of the CSV file names each column and, in brackets, its unit. A missing number is NaN in HDF5 and an
empty cell in CSV.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import numpy as np

from hhsim.arrays import AnyArray
from hhsim.errors import DamagedFileError, InputError, OutputError
from hhsim.system import environment as info
from hhsim.system.atomic_write import put_dataset, sealed_hdf5, write_atomically
from hhsim.system.hdf5_input import DAMAGE, hdf5_format, open_hdf5
from hhsim.system.output_path import check_output_path
from hhsim.table.table import BARE, Column, Table, stored_unit

FORMAT = "hhsim-bench"
SCHEMA_VERSION = 1
ALL = "all"
"""Object or motion of a row that sums up."""

Cell: TypeAlias = str | bool | int | float
Row: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True)
class BenchTable(Table):
    """A table that was read back: suite, options, and other attributes (versions, machine, revision, time).

    Each row is a dictionary by column name, of str, bool, int or float.
    """

    suite: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    attributes: Mapping[str, Any] = field(default_factory=dict)


def csv_path(output_path: Path) -> Path:
    """Return the path of the CSV file beside the HDF5 file of a table."""
    return output_path.with_suffix(".csv")


def check_table_path(output_path: Path) -> None:
    """Check before the work that a table can be written.

    Raises OutputError as `hhsim.system.output_path.check_output_path`, for either of the two files; for a name that
    does not end in .h5; or for an existing file that is no table.
    """
    if output_path.suffix != ".h5":
        raise OutputError(f"{output_path} must end in .h5: the CSV file of the same name goes beside it")
    kind = "table of hhsim bench"
    check_output_path(output_path, kind, lambda path: hdf5_format(path) == FORMAT)
    check_output_path(csv_path(output_path), kind, lambda _: output_path.exists())


def write_table(
    output_path: Path, suite: str, columns: Sequence[Column], rows: Sequence[Row], options: Mapping[str, Any]
) -> None:
    """Write a table as `output_path` (.h5) and as CSV beside it; files of those names are replaced in one step each.

    Each row has the values of exactly the columns, by their names. The values of a column have one type: str, bool, int
    or float; None is a missing number (NaN), or a missing word (empty) in a column of words. The options are JSON-able
    values. Raises OutputError as `check_table_path`, or for a full disk: an existing table then stays as it is.
    """
    names = [column.name for column in columns]
    if len(set(names)) != len(names):
        raise ValueError(f"two columns have one name: {names}")
    for number, row in enumerate(rows):
        if row.keys() != set(names):
            raise ValueError(f"row {number}: missing {set(names) - row.keys()}, not a column {row.keys() - set(names)}")
    check_table_path(output_path)
    arrays = {name: _array(name, [row[name] for row in rows]) for name in names}
    attributes = {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "suite": suite,
        "columns": json.dumps(names),
        "options": json.dumps(dict(options), sort_keys=True),
        **info.file_attributes(),
    }

    def fill(file: h5py.File) -> None:
        file.attrs.update(attributes)
        for column in columns:
            values = arrays[column.name]
            kind = h5py.string_dtype() if values.dtype == object else values.dtype
            put_dataset(file, column.name, values, stored_unit(column.unit), column.says, dtype=kind)
        file.attrs["complete"] = 1

    image = sealed_hdf5(fill)
    plain = [dict(zip(names, row)) for row in zip(*(array.tolist() for array in arrays.values()))]
    named = [replace(column, of=column.name) for column in columns]
    write_atomically(csv_path(output_path), Table(named, plain).csv().encode())
    write_atomically(output_path, image)


def table_document(path: Path, columns: Sequence[Column], options: Mapping[str, Any], **more: object) -> dict[str, Any]:
    """Return paths, options and units of a table for JSON; `more` stands after the paths."""
    units = {column.name: stored_unit(column.unit) for column in columns}
    return {"table": str(path), "csv": str(csv_path(path)), **more, "options": options, "units": units}


def is_table(path: Path) -> bool:
    """Return True for a table of `hhsim bench`; False for any other file, or one that cannot be read."""
    try:
        return hdf5_format(path) == FORMAT
    except OSError:
        # The reader of results reports what is wrong with it.
        return False


def load_table(path: Path) -> BenchTable:
    """Read a table from its HDF5 file; InputError: there is none, it is another file, of a newer schema, or damaged."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected a table of hhsim bench (.h5)")
    try:
        with open_hdf5(path) as file:
            return _read(file, path)
    except DamagedFileError as error:
        raise InputError(f"{path}: {error}") from error
    except DAMAGE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path} is no readable table of hhsim bench: {reason}") from error


def rows_of(path: Path, suite: str) -> list[dict[str, Cell]]:
    """Return the rows of a table of one suite; InputError as `load_table`, or for another suite's."""
    table = load_table(path)
    if table.suite != suite:
        raise InputError(f"{path} is a table of hhsim bench {table.suite}: expected one of hhsim bench {suite}")
    return list(table.rows)


def _read(file: h5py.File, path: Path) -> BenchTable:
    attributes = {name: value.item() if isinstance(value, np.generic) else value for name, value in file.attrs.items()}
    if attributes.get("format") != FORMAT:
        raise InputError(f"{path} is no table of hhsim bench: its format is {attributes.get('format')!r}")
    if not 1 <= attributes["schema_version"] <= SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema version {attributes['schema_version']}, this hhsim reads 1 to {SCHEMA_VERSION}"
        )
    columns, values = [], []
    for name in json.loads(attributes.pop("columns")):
        dataset = file[name]
        unit = str(dataset.attrs["units"])
        columns.append(Column(name, str(dataset.attrs["long_name"]), "" if unit in BARE else unit))
        is_text = h5py.check_string_dtype(dataset.dtype) is not None
        values.append((dataset.asstr()[...] if is_text else dataset[...]).tolist())
    if len({len(column) for column in values}) > 1:
        raise InputError(f"{path} is damaged: its columns have different lengths")
    names = [column.name for column in columns]
    return BenchTable(
        columns=tuple(columns),
        rows=tuple(dict(zip(names, row)) for row in zip(*values)),
        suite=str(attributes.pop("suite")),
        options=json.loads(attributes.pop("options")),
        attributes=attributes,
    )


def _array(name: str, values: Sequence[Any]) -> AnyArray:
    """Values of a column as one array: object (of str), bool, int64 or float64."""
    plain = [value.item() if isinstance(value, np.generic) else value for value in values]
    kinds = {type(value) for value in plain if value is not None}
    missing = None in plain
    if kinds == {str}:
        return np.array(["" if value is None else value for value in plain], dtype=object)
    if kinds in ({bool}, {int}) and not missing:
        return np.array(plain, dtype=bool if kinds == {bool} else np.int64)
    if kinds <= {int, float}:
        return np.array([np.nan if value is None else value for value in plain], dtype=np.float64)
    mixed = sorted(kind.__name__ for kind in kinds | ({type(None)} if missing else set()))
    raise ValueError(f"column {name} mixes {' and '.join(mixed)}: give it values of one kind")
