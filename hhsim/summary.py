"""The table that `hhsim replay` prints: our figures beside the paper's."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim import metrics
from hhsim.kernels.tick_state import STATUS_HELD, STATUS_LAG, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.metrics import HandPoses, Statistics
from hhsim.scene import Scene
from hhsim.solver_options import SolverOptions
from hhsim.tracking_reference import reference_excess
from hhsim.tremor_hold import is_frozen, tremor_variation
from hhsim.warm_up import WarmUp

Array = NDArray[Any]

HOLD = "hold"
"""Phases of this name are held; the others move."""
PAPER_RATE = 1000.0
"""Ticks per second of the paper's haptic loop [Hz]."""
REFERENCE_TICKS = 16
"""Ticks of the hold at which the reference optimum is computed."""


SERIES = (
    *("status", "lag", "force/total", "force_variation_rate", "penetration_depth"),
    *("duration/total", "duration/total_cpu"),
    *("graphic/position", "graphic/orientation", "graphic/flexion", "graphic/abduction"),
    *("contacts/candidates", "contacts/touching", "work/node_tests", "work/pair_tests"),
    *("work/rows", "work/bodies", "work/units"),
)
"""Datasets of the result file that the table is made from."""


class TickSeries:
    """What the table needs of every tick: some of the result file's datasets.

    Args:
        ticks: How many there will be.
    """

    def __init__(self, ticks: int) -> None:
        """Nothing is kept yet."""
        self.ticks = ticks
        self._columns: dict[str, Array] = {}

    def keep(self, part: slice, block: dict[str, Array]) -> None:
        """Keep the ticks of a block, a slice of all ticks."""
        for name in SERIES:
            values = block[name]
            if name not in self._columns:
                self._columns[name] = np.zeros((self.ticks, *values.shape[1:]), values.dtype)
            self._columns[name][part] = values

    def __getitem__(self, name: str) -> Array:
        return self._columns[name]


@dataclass(frozen=True)
class SummaryRow:
    """One line of the table.

    Attributes:
        name: Of the attribute in the result file and the JSON document.
        label: For people.
        value: In SI units, or % where the metric is defined so; NaN where it is undefined.
        shown: As the table shows it.
        unit: Of `shown`.
        paper: The paper's figure as printed there, or "".
    """

    name: str
    label: str
    value: float
    shown: str
    unit: str
    paper: str = ""


@dataclass(frozen=True)
class ReplaySummary:
    """What a replay found.

    Attributes:
        rows: The table.
        notes: What a reader should know besides, a sentence each.
        ticks: How many.
        warm_up: What preparing the kernels took; no part of any tick.
        path: The result file.
    """

    rows: tuple[SummaryRow, ...]
    notes: tuple[str, ...]
    ticks: int
    warm_up: WarmUp
    path: Path | None = None

    def attributes(self) -> dict[str, float | int]:
        """The table as attributes of the result file: deterministic figures and timings by name."""
        return {"ticks": self.ticks, **{row.name: row.value for row in self.rows}}

    def at(self, path: Path) -> "ReplaySummary":
        """The same, with the file's place."""
        return replace(self, path=path)

    def to_json(self) -> dict[str, Any]:
        """For machines: SI units."""
        return {
            "result": str(self.path) if self.path else None,
            **self.attributes(),
            "kernels_prepared_s": self.warm_up.seconds,
            "kernels_compiled": self.warm_up.compiled,
            "notes": list(self.notes),
        }


def summarise(scene: Scene, options: SolverOptions, series: TickSeries, prepared: WarmUp) -> ReplaySummary:
    """Compute the table."""
    ticks = series.ticks
    holds = [(p.first_tick, p.last_tick) for p in scene.ticks.phases if p.name == HOLD]
    hold = np.zeros(ticks, bool)
    for first, last in holds:
        hold |= metrics.phase_mask(ticks, first, last)
    force = series["force/total"]
    contact = series["contacts/candidates"] > 0
    cpu = metrics.tick_statistics(series["duration/total_cpu"])
    busy = metrics.tick_statistics(series["duration/total_cpu"][contact])
    wall = metrics.tick_statistics(series["duration/total"])
    busy_wall = metrics.tick_statistics(series["duration/total"][contact])
    variation = metrics.statistics(series["force_variation_rate"], hold)
    haptic = HandPoses(scene.ticks.position, scene.ticks.orientation, scene.ticks.flexion)
    graphic = HandPoses(series["graphic/position"], series["graphic/orientation"], series["graphic/flexion"])
    off = metrics.tracking_error(haptic, graphic)
    excess = np.full(1, np.nan)
    trembling: Statistics | None = None
    if hold.any():
        held = np.flatnonzero(hold)
        chosen = np.unique(held[np.linspace(0, held.size - 1, min(REFERENCE_TICKS, held.size)).astype(int)])
        tree = scene.tree.arrays()
        excess = reference_excess(
            scene.hand, tree, options, haptic, graphic, series["graphic/abduction"], np.asarray(chosen)
        )
        trembling = _repeated_with_tremor(scene, options, haptic, graphic, series["graphic/abduction"], holds[0])
    ripple = max((metrics.force_ripple(force[a : b + 1], scene.ticks.rate) for a, b in holds), default=float("nan"))
    tests = series["work/node_tests"] + series["work/pair_tests"]
    status = series["status"]
    stuck, lagging = int(np.sum(status & STATUS_STUCK > 0)), int(np.sum(status & STATUS_LAG > 0))
    size = np.linalg.norm(force, axis=1)
    rows = (
        _row("candidates_max", "candidate pairs, most", series["contacts/candidates"].max(initial=0), 0, "", "≈ 250"),
        _row("touching_max", "touching pairs, most", series["contacts/touching"].max(initial=0), 0),
        _row("tick_cpu_p50", "tick in contact, CPU, p50", busy.p50, 1, "µs", "310 to ≈ 1,000", 1e-6),
        _row("tick_cpu_p99", "tick in contact, CPU, p99", busy.p99, 1, "µs", "< 1,500", 1e-6),
        _row("tick_cpu_max", "tick, CPU, max", cpu.max, 1, "µs", "< 1,500", 1e-6),
        _row("tick_wall_p50", "tick in contact, wall, p50", busy_wall.p50, 1, "µs", "", 1e-6),
        _row("tick_wall_over_1ms", "ticks over 1 ms, wall", 100.0 * wall.over_budget, 2, "%"),
        _row(
            "penetration_max",
            "penetration, max",
            1e6 * series["penetration_depth"].max(initial=0.0),
            3,
            "µm",
            "≈ 100",
            1e-6,
        ),
        _row("force_hold_mean", "force in the hold, mean", metrics.statistics(size, hold).mean, 2, "N"),
        *_variation_rows(variation, trembling, scene.ticks.rate),
        _row("force_ripple_hold", "force ripple in the hold, 50 to 400 Hz", ripple, 5, "N"),
        _row("force_step", "largest force step while moving", metrics.force_step(force, ~hold, hold), 1, "% of hold"),
        _row(
            "tracking_excess", "coupling energy over the local optimum", 100.0 * metrics.statistics(excess).mean, 3, "%"
        ),
        _row(
            "tracking_palm",
            "palm off the user's in the hold, mean",
            metrics.statistics(off.position_mm, hold).mean,
            2,
            "mm",
            "",
            1e-3,
        ),
        _row("fingers_modelled", "fingers modelled, of 5", len(options.fingers), 0),
        _row(
            "bodies_near",
            "bodies near the object in contact, of 16",
            _mean(series["work/bodies"], contact),
            1,
        ),
        _row(
            "rows_max",
            "contacts in a program, most",
            series["work/rows"].max(initial=0),
            0,
        ),
        _row("tests_mean", "distances computed a tick, mean", tests.mean(), 0),
        _row("tests_share", "share of all pairs of body and sphere", 100.0 * tests.mean() / scene.all_pairs, 3, "%"),
        _row("work_mean", "work a tick, mean", series["work/units"].mean(), 0, "units"),
        _row("stuck_ticks", "stuck ticks", stuck, 0),
        _row("lag_ticks", "ticks with lag", lagging, 0),
        _row("lag_max", "lag, max", 1e3 * series["lag"].max(initial=0.0), 2, "mm", "", 1e-3),
    )
    return ReplaySummary(rows, _notes(scene, options, status, prepared), ticks, prepared)


def _repeated_with_tremor(
    scene: Scene, options: SolverOptions, haptic: HandPoses, graphic: HandPoses, abduction: Array, hold: tuple[int, int]
) -> Statistics | None:
    part = slice(hold[0], hold[1] + 1)
    held = HandPoses(*(values[part] for values in haptic))
    if not is_frozen(held):
        return None
    shown = HandPoses(*(values[part] for values in graphic))
    return tremor_variation(scene.hand, scene.tree.arrays(), options, held, shown, abduction[part], scene.ticks.rate)


def _variation_rows(variation: Statistics, trembling: Statistics | None, rate: float) -> tuple[SummaryRow, ...]:
    """Of a hold with frozen input and its repetition with tremor; of a live hold where the input is not frozen."""
    # A change per tick depends on how long a tick is: the paper's figure is one of 1 kHz.
    mean, spread = ("0.18", "0.32") if rate == PAPER_RATE else ("", "")
    if trembling is None:
        return (
            _row("force_variation_hold", "force variation in the hold, mean", variation.mean, 4, "%", mean),
            _row("force_variation_hold_std", "force variation in the hold, std", variation.std, 4, "%", spread),
        )
    label = "force variation in the hold, trembling hand"
    return (
        _row("force_variation_hold", "force variation in the hold, frozen input", variation.mean, 6, "%"),
        _row("force_variation_tremor", f"{label}, mean", trembling.mean, 4, "%", mean),
        _row("force_variation_tremor_std", f"{label}, std", trembling.std, 4, "%", spread),
    )


def _row(
    name: str, label: str, value: float, digits: int, unit: str = "", paper: str = "", scale: float = 1.0
) -> SummaryRow:
    number = float(value)
    # Rounded first: what rounds to nothing has no sign.
    shown = "—" if np.isnan(number) else f"{round(number, digits) + 0.0:,.{digits}f}"
    return SummaryRow(name, label, number * scale, shown, unit, paper)


def _mean(values: Array, where: Array) -> float:
    return float(values[where].mean()) if where.any() else float("nan")


def _notes(scene: Scene, options: SolverOptions, status: Array, prepared: WarmUp) -> tuple[str, ...]:
    notes = [*scene.mesh.repairs, *scene.mesh.warnings]
    if np.any(status & STATUS_START_INSIDE):
        notes.append("the haptic hand begins inside the object: the graphic hand began at the nearest free place")
    held = int(np.sum(status & STATUS_HELD > 0))
    if held:
        notes.append(f"{held:,} ticks had input that was not finite and used the last good one")
    if options.threads > 1:
        notes.append(f"CPU times are those of all {options.threads} threads together, waiting for each other included")
    if prepared.compiled:
        notes.append(
            f"the kernels were compiled in {prepared.seconds:.1f} s, apart from the ticks; the next run loads them"
        )
    return tuple(notes)
