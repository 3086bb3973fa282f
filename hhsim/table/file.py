"""Tables of `hhsim bench`: JSON of format `hhsim-bench`, and the same as CSV beside it; SI units.

The JSON file has the columns with their units, those that people read, and meanings, the rows, the options, versions
and machine. The header of the CSV file names each column and, in brackets, its unit. A missing number is null in JSON
and an empty cell in CSV.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from hhsim.errors import InputError, OutputError
from hhsim.system import environment as info
from hhsim.system.atomic_write import write_together
from hhsim.system.input_file import read_input_text
from hhsim.system.output_path import check_output_path
from hhsim.system.plain_json import plain_json
from hhsim.table.table import Column, Table, stored_unit

FORMAT, VERSION = "hhsim-bench", 1
SUFFIX = ".json"
ALL = "all"
"""Object or motion of a row that sums up."""

Row: TypeAlias = Mapping[str, Any]


def csv_path(output_path: Path) -> Path:
    """Return the path of the CSV file beside the JSON file of a table."""
    return output_path.with_suffix(".csv")


def check_table_path(output_path: Path) -> None:
    """Check before the work that a table can be written.

    Raises OutputError as `hhsim.system.output_path.check_output_path`, for either of the two files; for a name that
    does not end in .json; or for an existing file that is no table.
    """
    if output_path.suffix != SUFFIX:
        raise OutputError(f"{output_path} must end in {SUFFIX}: the CSV file of the same name goes beside it")
    kind = "table of hhsim bench"
    check_output_path(output_path, kind, is_table)
    check_output_path(csv_path(output_path), kind, lambda _: output_path.exists())


def write_table(
    output_path: Path, suite: str, columns: Sequence[Column], rows: Sequence[Row], options: Mapping[str, Any]
) -> None:
    """Write a table as `output_path` (.json) and as CSV beside it, both or none.

    Each row has the values of the columns, by their names, one kind in a column: str, bool, int or float; None is a
    missing number, or a missing word. The options are JSON-able values. Raises OutputError as `check_table_path`, or
    for a full disk: an existing table then stays as it is.
    """
    check_table_path(output_path)
    table = Table([replace(column, of=column.name) for column in columns], rows)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "suite": suite,
        **info.file_attributes(),
        "options": options,
        "columns": [
            {"name": one.name, "unit": stored_unit(one.unit), "shown": one.unit, "says": one.says} for one in columns
        ],
        "rows": table.records,
    }
    text = json.dumps(
        plain_json(document), indent=1, allow_nan=False, ensure_ascii=False, default=lambda one: one.item()
    )
    write_together({csv_path(output_path): table.csv().encode(), output_path: f"{text}\n".encode()})


def table_document(path: Path, columns: Sequence[Column], options: Mapping[str, Any], **more: object) -> dict[str, Any]:
    """Return paths, options and units of a table for JSON; `more` stands after the paths."""
    units = {column.name: stored_unit(column.unit) for column in columns}
    return {"table": str(path), "csv": str(csv_path(path)), **more, "options": options, "units": units}


def is_table(path: Path) -> bool:
    """Return True for a table of `hhsim bench`; False for any other file, or one that cannot be read."""
    try:
        found = json.loads(read_input_text(path)) if path.suffix == SUFFIX else None
    except (InputError, OSError, ValueError):
        return False
    return isinstance(found, dict) and found.get("format") == FORMAT
