"""Table of `hhsim bench` on a page: its picture if it sets cost against error, and what its columns mean."""

import json
import math
from dataclasses import replace
from typing import Any

from hhsim.report.figure import Album
from hhsim.report.trade_off import bench_trade_off, has_trade_off
from hhsim.system.counted import counted
from hhsim.table.file import BenchTable
from hhsim.table.table import Column, Table, unit_size, words

SMALLER = {"s": ("s", "ms", "µs", "ns"), "m": ("m", "mm", "µm")}
"""Units that may stand for an SI unit."""


def shown_unit(found: BenchTable, name: str) -> str:
    """Return the unit of a column that keeps its largest number at 1 or more; its own where there is none."""
    own = next(column.unit for column in found.columns if column.name == name)
    sizes = [abs(float(row[name])) for row in found.rows if isinstance(row[name], int | float)]
    largest = max((size for size in sizes if math.isfinite(size)), default=0.0)
    return next((unit for unit in SMALLER.get(own, ()) if largest >= unit_size(unit)), own)


def bench_section(found: BenchTable, name: str, album: Album, prefix: str = "") -> dict[str, Any]:
    """Return what the page shows of a table, by the names of its template; `prefix` goes before its chart's name."""
    made = {str(key): str(value) for key, value in found.attributes.items()}
    machine = json.loads(made.get("machine", "{}"))
    about = f"{name}, written {made.get('created_utc', 'at an unknown time')} by hhsim {made.get('hhsim_version', '')}"
    where = f", on {machine['cpu']}" if machine.get("cpu") else ""
    chart = bench_trade_off(found.suite, found.rows) if has_trade_off(found) else None
    columns = [_shown(column, found) for column in found.columns]
    same = [column for column in columns if len({*map(column.shown, found.rows)}) == 1 < len(found.rows)]
    alike = (words("column", "heading"), words("value", lambda column: column.shown(found.rows[0])))
    options = [(key, json.dumps(value, ensure_ascii=False)) for key, value in found.options.items()]
    caption = f"{counted(len(found.rows), 'row')} of hhsim bench {found.suite}"
    return {
        "heading": f"hhsim bench {found.suite}",
        "about": f"{about}{where}.",
        "chart": None if chart is None else album.shown(chart, prefix),
        "whole": Table([column for column in columns if column not in same], found.rows, caption),
        "more": {
            "The same in all rows": Table(alike, same, "Columns with one value"),
            "What the columns mean": Table((words("column", "name"), words("meaning", "says")), columns, "Columns"),
            "Its options": Table.of_cells(("option", "value"), options, "Its options"),
        },
    }


def _shown(column: Column, found: BenchTable) -> Column:
    """Return a column as people read it."""
    values = [row[column.name] for row in found.rows]
    is_number = any(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    unit = shown_unit(found, column.name)
    return replace(column, name=column.name.replace("_", " "), of=column.name, unit=unit, is_number=is_number)
