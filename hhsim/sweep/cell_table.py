"""Table of a sweep: a row for each cell of its plan that is done or has failed."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary import digits_with
from hhsim.sweep.folder import SweepFolder
from hhsim.sweep.plan import Cell, SweepPlan
from hhsim.table.table import Column, Table, number, shown, words

TABLE = "table.csv"
"""File of the table in the folder of a sweep."""
FAILED = "failed"
NOTE = "~ before a time: its cell had no core of its own, so that it compares with no other time"
CellRow: TypeAlias = dict[str, Any]
"""Values of a cell by the names of `COLUMNS`."""
NAMES = tuple(map(words, ("object", "motion", "method", "surface", "options")))
COLUMNS: tuple[Column, ...] = (
    *NAMES,
    Column("seed"),
    words("machine"),
    words("verdict"),
    Column("times_comparable", "whether its ticks had a core of their own: else its times say little"),
    Column("runs"),
    # Times are means over the runs.
    *(Column(name, metric.label, metric.unit) for name, metric in run_metrics().items()),
    *(Column(f"{name}_std", unit=metric.stored_unit) for name, metric in run_metrics().items() if metric.noise),
    words("reason"),
)
"""Every figure, SI or %: for programs."""


def cell_rows(plan: SweepPlan, folder: SweepFolder, failed: Mapping[str, str]) -> list[CellRow]:
    """Return the rows of the cells that are done or have `failed` (reasons by digest), in the order of the plan."""
    rows = []
    for planned in plan.cells:
        if reason := failed.get(planned.digest):
            rows.append(failed_row(planned.cell, reason))
        elif row := folder.row(planned):
            rows.append(done_row(planned.cell, row))
    return rows


def failed_row(cell: Cell, reason: str) -> CellRow:
    """Return the row of a cell without a result."""
    options = f"{cell.options_name}: {cell.stated}" if cell.stated else cell.options_name
    names = {"object": cell.object.name, "motion": cell.motion.name, "method": cell.method, "surface": cell.surface}
    about = {"options": options, "seed": cell.seed, "machine": "", "verdict": FAILED, "runs": 1, "reason": reason}
    return {**dict.fromkeys(column.name for column in COLUMNS), **names, **about, "times_comparable": False}


def done_row(cell: Cell, row: Mapping[str, Any]) -> CellRow:
    """Return the row of a cell that was run, from its file."""
    repeated = row.get("repeated", {})
    times = repeated.get("times", {})
    found = {**row["summary"], **{name: time["mean"] for name, time in times.items()}}
    return {
        **failed_row(cell, ", ".join(row["missed"])),
        **{name: found.get(name) for name in run_metrics()},
        **{f"{name}_std": time["std"] for name, time in times.items()},
        "verdict": row["verdict"],
        "machine": str(row["machine"].get("cpu", "")),
        "times_comparable": bool(row["own_core"]),
        "runs": repeated.get("runs", 1),
    }


def shown_table(rows: Sequence[CellRow]) -> Table:
    """Return the table as people read it."""
    columns = (
        *NAMES,
        words("verdict", lambda row: f"{row['verdict']}: {row['reason']}" if row["reason"] else row["verdict"]),
        number("depth", "penetration_max", "µm", 3),
        number("off the mesh", "contact_error_max", "mm", 3),
        number("over optimum", "tracking_excess", "%", 2),
        number("force", "force_contact_mean", "N", 2),
        number("stuck", "stuck_ticks"),
        number("p50", lambda row: _time(row, "tick_cpu_p50"), "µs"),
        number("p99", lambda row: _time(row, "tick_cpu_p99"), "µs"),
    )
    alone = all(row["times_comparable"] for row in rows if row["verdict"] != FAILED)
    return Table(columns, rows, notes=() if alone else (NOTE,))


def _time(row: CellRow, name: str) -> str:
    """Return a time in µs, with ± standard deviation where there is one."""
    seconds, deviation = (math.nan if row[key] is None else row[key] for key in (name, f"{name}_std"))
    digits = digits_with(1e6 * deviation, 1)
    text = shown(1e6 * seconds, digits)
    text += f" ± {shown(1e6 * deviation, digits)}" if deviation == deviation else ""
    return text if row["times_comparable"] or seconds != seconds else f"~{text}"
