"""A table of `hhsim bench` as a part of a report."""

import json
import math
from collections.abc import Sequence

from hhsim.bench.table import Cell, Column, Table
from hhsim.report.html import Html, joined, paragraph, table


def bench_section(found: Table, name: str) -> Html:
    """The table, and what it was run with.

    Args:
        found: The table.
        name: Of its file.
    """
    made = {str(key): str(value) for key, value in found.attributes.items()}
    machine = json.loads(made.get("machine", "{}"))
    about = f"{name}, written {made.get('created_utc', 'at an unknown time')} by hhsim {made.get('hhsim_version', '')}"
    where = f", on {machine['cpu']}" if machine.get("cpu") else ""
    options = [(key, json.dumps(value, ensure_ascii=False)) for key, value in found.options.items()]
    rows = [[shown_cell(row[column.name]) for column in found.columns] for row in found.rows]
    numbers = [i for i, column in enumerate(found.columns) if _is_number(column, found.rows)]
    caption = f"{len(found.rows):,} rows of hhsim bench {found.suite}, SI units"
    return joined(
        [
            paragraph(f"{about}{where}."),
            table(caption, [_heading(column) for column in found.columns], rows, numbers=numbers),
            table("Its options", ("option", "value"), options) if options else Html(""),
        ]
    )


def shown_cell(value: Cell) -> str:
    """A cell for people: numbers with four digits, whole ones in full."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return "—" if math.isnan(value) else f"{value:.4g}"
    return value


def _heading(column: Column) -> str:
    unit = "" if column.unit == "1" else f" [{column.unit}]"
    return f"{column.long_name}{unit}"


def _is_number(column: Column, rows: Sequence[dict[str, Cell]]) -> bool:
    return any(isinstance(row[column.name], int | float) and not isinstance(row[column.name], bool) for row in rows)
