"""A table of `hhsim bench` as a part of a report."""

import json
import math
from collections.abc import Sequence

from hhsim.bench.table import BenchTable, Cell
from hhsim.report.bench_chart import bench_figure
from hhsim.report.bench_units import Unit, shown_unit
from hhsim.report.figure import Album
from hhsim.report.html import Html, details, joined, paragraph, table
from hhsim.system.counted import counted
from hhsim.table.table import Column


def bench_section(found: BenchTable, name: str, album: Album, prefix: str = "") -> Html:
    """A chart, then the table and what it was run with, folded.

    Args:
        prefix: Before the name of its chart.
    """
    made = {str(key): str(value) for key, value in found.attributes.items()}
    machine = json.loads(made.get("machine", "{}"))
    about = f"{name}, written {made.get('created_utc', 'at an unknown time')} by hhsim {made.get('hhsim_version', '')}"
    where = f", on {machine['cpu']}" if machine.get("cpu") else ""
    options = [(key, json.dumps(value, ensure_ascii=False)) for key, value in found.options.items()]
    chart = bench_figure(found)
    units = {column.name: shown_unit(found, column.name) for column in found.columns}
    same = [column for column in found.columns if len(found.rows) > 1 and _is_the_same(column, found.rows)]
    told = [column for column in found.columns if column not in same]
    rows = [[shown_cell(_scaled(row[column.name], units[column.name])) for column in told] for row in found.rows]
    numbers = [i for i, column in enumerate(told) if _is_number(column, found.rows)]
    caption = f"{counted(len(found.rows), 'row')} of hhsim bench {found.suite}"
    parts = [paragraph(f"{about}{where}.")]
    if chart is not None:
        parts.append(album.shown(chart, prefix))
    whole = table(caption, [_heading(column, units[column.name]) for column in told], rows, numbers=numbers)
    parts.append(details("The table", whole, is_open=chart is None))
    if same:
        alike = [
            (_heading(column, units[column.name]), shown_cell(_scaled(found.rows[0][column.name], units[column.name])))
            for column in same
        ]
        parts.append(details("The same in all rows", table("Columns with one value", ("column", "value"), alike)))
    meanings = [(column.name.replace("_", " "), column.says) for column in found.columns]
    parts.append(details("What the columns mean", table("Columns", ("column", "meaning"), meanings)))
    if options:
        parts.append(details("Its options", table("Its options", ("option", "value"), options)))
    return joined(parts)


def shown_cell(value: Cell) -> str:
    """A cell for people: numbers with four digits, whole ones in full."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return "—" if math.isnan(value) else f"{value:.4g}"
    return value


def _heading(column: Column, unit: Unit) -> str:
    name = column.name.replace("_", " ")
    return f"{name} [{unit.name}]" if unit.name else name


def _scaled(value: Cell, unit: Unit) -> Cell:
    return value / unit.factor if isinstance(value, float) and unit.factor != 1.0 else value


def _is_the_same(column: Column, rows: Sequence[dict[str, Cell]]) -> bool:
    return len({shown_cell(row[column.name]) for row in rows}) == 1


def _is_number(column: Column, rows: Sequence[dict[str, Cell]]) -> bool:
    return any(isinstance(row[column.name], int | float) and not isinstance(row[column.name], bool) for row in rows)
