"""Tables of `hhsim bench`: JSON of format `hhsim-bench`, and the same as CSV beside it; SI units.

The JSON file has the columns with their units, those that people read, and meanings, the rows, the options, versions
and machine. The header of the CSV file names each column and, in brackets, its unit. A missing number is null in JSON
and an empty cell in CSV.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hhsim.errors import OutputError
from hhsim.system import environment as info
from hhsim.system.atomic_write import write_together
from hhsim.system.output_path import check_output_path, holds
from hhsim.system.plain_json import plain_json
from hhsim.table.table import Column, Table, stored_unit

FORMAT, VERSION = "hhsim-bench", 1
SUFFIX = ".json"
ALL = "all"
"""Object or motion of a row that sums up."""


def check_table_path(output_path: Path) -> None:
    """Check before the work that a table can be written.

    Raises OutputError as `hhsim.system.output_path.check_output_path`, for either of the two files; for a name that
    does not end in .json; or for an existing file that is no table.
    """
    if output_path.suffix != SUFFIX:
        raise OutputError(f"{output_path} must end in {SUFFIX}: the CSV file of the same name goes beside it")
    kind = "table of hhsim bench"
    check_output_path(output_path, kind, holds(f'"format": "{FORMAT}"'.encode()))
    check_output_path(output_path.with_suffix(".csv"), kind, lambda _: output_path.exists())


def write_table(
    output_path: Path, suite: str, columns: Sequence[Column], rows: Sequence[Any], options: Mapping[str, Any]
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
    write_together({output_path.with_suffix(".csv"): table.csv().encode(), output_path: f"{text}\n".encode()})
