"""Table of a sweep: a row for each cell of its plan that is done or has failed."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary import digits_with
from hhsim.sweep.folder import SweepFolder
from hhsim.sweep.plan import Cell, SweepPlan
from hhsim.table.table import Column, Table, number, shown, words

TABLE = "table.csv"
"""File of the table in the folder of a sweep."""
FAILED = "failed"
NOTE = "~ before a time: its cell had no core of its own, so that it compares with no other time"


@dataclass(frozen=True)
class CellRow:
    """A cell that was run."""

    cell: Cell
    verdict: str  # word of the verdict; `FAILED` where there is no result
    machine: str = ""  # processor
    own_core: bool = False  # True if its ticks had a core of their own: else its times say little
    runs: int = 1
    # SI or %, by the names of `hhsim.metrics.run.registry.run_metrics`; times are means over the runs.
    figures: Mapping[str, float] = field(default_factory=dict)
    deviations: Mapping[str, float] = field(default_factory=dict)  # standard deviations of times, by the same names
    reason: str = ""  # why it failed, or the figures over their limits

    @property
    def options(self) -> str:
        """Name of the set of options, and what it states."""
        name = self.cell.options_name
        return f"{name}: {self.cell.stated}" if self.cell.stated else name


def cell_rows(plan: SweepPlan, folder: SweepFolder) -> list[CellRow]:
    """Return the rows of the cells that are done or have failed, in the order of the plan."""
    rows = []
    for planned in plan.cells:
        row, reason = folder.row(planned), folder.failure(planned)
        if row and not reason:
            rows.append(done_row(planned.cell, row))
        elif reason:
            rows.append(CellRow(planned.cell, FAILED, reason=reason))
    return rows


def done_row(cell: Cell, row: Mapping[str, Any]) -> CellRow:
    """Return the row of a cell that was run, from its file."""
    repeated = row.get("repeated", {})
    times = repeated.get("times", {})
    found = {**row["summary"], **{name: time["mean"] for name, time in times.items()}}
    return CellRow(
        cell=cell,
        verdict=row["verdict"],
        machine=str(row["machine"].get("cpu", "")),
        own_core=bool(row["own_core"]),
        runs=repeated.get("runs", 1),
        figures={name: found[name] for name in run_metrics() if found.get(name) is not None},
        deviations={name: time["std"] for name, time in times.items()},
        reason=", ".join(row["missed"]),
    )


def shown_table(rows: Sequence[CellRow]) -> Table:
    """Return the table as people read it."""

    def figure(name: str) -> Callable[[CellRow], float | None]:
        return lambda row: row.figures.get(name)

    def time(name: str) -> Callable[[CellRow], str]:
        return lambda row: _time(row.figures.get(name, math.nan), row.deviations.get(name, math.nan), row.own_core)

    columns = (
        *_names(),
        words("verdict", lambda row: f"{row.verdict}: {row.reason}" if row.reason else row.verdict),
        number("depth", figure("penetration_max"), "µm", 3),
        number("off the mesh", figure("contact_error_max"), "mm", 3),
        number("over optimum", figure("tracking_excess"), "%", 2),
        number("force", figure("force_contact_mean"), "N", 2),
        number("stuck", figure("stuck_ticks")),
        number("p50", time("tick_cpu_p50"), "µs"),
        number("p99", time("tick_cpu_p99"), "µs"),
    )
    alone = all(row.own_core for row in rows if row.verdict != FAILED)
    return Table(columns, rows, notes=() if alone else (NOTE,))


def figure_table(rows: Sequence[CellRow]) -> Table:
    """Return the table with every figure: for programs."""

    def taken(attribute: str, name: str) -> Callable[[CellRow], float | None]:
        return lambda row: getattr(row, attribute).get(name)

    metrics = run_metrics()
    columns = (
        *_names(),
        Column("seed", of="cell.seed"),
        words("machine"),
        words("verdict"),
        Column("times_comparable", of="own_core"),
        Column("runs"),
        *(Column(name, metric.label, metric.unit, taken("figures", name)) for name, metric in metrics.items()),
        *(
            Column(f"{name}_std", unit=metric.stored_unit, of=taken("deviations", name))
            for name, metric in metrics.items()
            if metric.noise
        ),
        words("reason"),
    )
    return Table(columns, rows)


def _names() -> tuple[Column, ...]:
    return (
        words("object", "cell.object.name"),
        words("motion", "cell.motion.name"),
        words("method", "cell.method"),
        words("surface", "cell.surface"),
        words("options"),
    )


def _time(seconds: float, deviation: float, comparable: bool) -> str:
    """Return a time in µs, with ± standard deviation where there is one."""
    digits = digits_with(1e6 * deviation, 1)
    text = shown(1e6 * seconds, digits)
    text += f" ± {shown(1e6 * deviation, digits)}" if deviation == deviation else ""
    return text if comparable or seconds != seconds else f"~{text}"
