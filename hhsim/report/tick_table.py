"""What a report computes from the ticks of a result, read block by block: its table, and a line for each phase."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.hand.fingers import FINGERS
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics import metrics
from hhsim.replay.run_metrics import FIGURE_SERIES, tick_figures
from hhsim.replay.summary_table import PAPER_RATE, SummaryRow, stored_rows, summary_rows
from hhsim.result.reader import Result
from hhsim.result.schema import TICK_COLUMNS

Array = NDArray[Any]

BLOCK_TICKS = 16_384
"""Ticks that are read at a time."""


@dataclass(frozen=True)
class ReportTicks:
    """What a report needs of every tick, some 130 bytes.

    Attributes:
        columns: datasets of /tick by name, as far as the schema has them.
        palm_off: the shown palm from the user's [mm], shape (T,).
    """

    columns: Mapping[str, Array]
    palm_off: NDArray[np.float64]


class PhaseFigures(NamedTuple):
    """One phase; NaN where undefined.

    Attributes:
        name: Of the phase.
        first, last: Its ticks, both included.
        seconds: How long it lasts [s].
        cpu_p50, cpu_p99: Of its ticks in contact [µs].
        depth: Deepest in the object's spheres [µm].
        force: Mean size of the total force [N].
        variation: Mean one-tick change of that [%].
        candidates: Most pairs.
        stuck, lagging: Ticks.
    """

    name: str
    first: int
    last: int
    seconds: float
    cpu_p50: float
    cpu_p99: float
    depth: float
    force: float
    variation: float
    candidates: int
    stuck: int
    lagging: int


def tick_rate(result: Result) -> float:
    """Ticks per second [Hz]."""
    return float(result.scene.get("rate", PAPER_RATE))


def fingers_of(result: Result) -> tuple[str, ...]:
    """Names of the fingers that the run modelled."""
    return tuple(result.scene.get("solver", {}).get("fingers", FINGERS))


def report_ticks(result: Result) -> ReportTicks:
    """Read what a report needs; nothing else of the file is kept in memory."""
    stored = {column.name for column in TICK_COLUMNS if column.since <= result.schema_version}
    names = [name for name in FIGURE_SERIES if name in stored]
    palms = ("haptic/position", "graphic/position")
    parts: dict[str, list[Array]] = {name: [] for name in names}
    off: list[Array] = []
    for block in result.blocks((*names, *palms), BLOCK_TICKS):
        for name in names:
            values = block[name]
            if values.dtype.kind == "f":
                # What is infinite is no figure either.
                values = np.where(np.isfinite(values), values, np.nan)
            parts[name].append(values)
        off.append(1e3 * np.linalg.norm(block[palms[0]] - block[palms[1]], axis=1))
    if not off:
        return ReportTicks({name: result[name] for name in names}, np.zeros(0))
    return ReportTicks({name: np.concatenate(blocks) for name, blocks in parts.items()}, np.concatenate(off))


def figure_rows(result: Result, ticks: ReportTicks) -> tuple[SummaryRow, ...]:
    """The table of a result: the one that its replay printed; else, of a session or a run cut short, from its ticks.

    Empty where the file's schema lacks what the table needs.
    """
    if result.complete and result.live is None:
        return stored_rows(result.summary, tick_rate(result))
    if not set(FIGURE_SERIES) <= ticks.columns.keys():
        return ()
    static = result.static
    level = static["object/tree/level"]
    bodies = static["hand/phalanx_length"].size + static["hand/palm_radius"].size
    figures = tick_figures(
        ticks.columns,
        ticks.palm_off,
        phases=result.phases,
        rate=tick_rate(result),
        fingers=len(fingers_of(result)),
        all_pairs=bodies * int(np.sum(level == level.max())),
    )
    return summary_rows(figures, tick_rate(result))


def phase_figures(result: Result, ticks: ReportTicks) -> list[PhaseFigures]:
    """A line for each phase, or one for all ticks where there is none; no line where there is no tick."""
    if result.ticks == 0:
        return []
    spans = [(phase.name, phase.first_tick, min(phase.last_tick, result.ticks - 1)) for phase in result.phases]
    columns = ticks.columns
    found = []
    for name, first, last in spans or [("all ticks", 0, result.ticks - 1)]:
        part = slice(first, last + 1)
        candidates, status = columns["contacts/candidates"][part], columns["status"][part]
        cpu = metrics.tick_statistics(columns["duration/total_cpu"][part][candidates > 0])
        force = metrics.statistics(np.linalg.norm(columns["force/total"][part], axis=1))
        found.append(
            PhaseFigures(
                name,
                first,
                last,
                (last - first + 1) / tick_rate(result),
                cpu.p50,
                cpu.p99,
                1e6 * metrics.statistics(columns["penetration_depth"][part]).max,
                force.mean,
                metrics.statistics(columns["force_variation_rate"][part]).mean,
                int(candidates.max(initial=0)),
                int(np.sum(status & STATUS_STUCK > 0)),
                int(np.sum(status & STATUS_LAG > 0)),
            )
        )
    return found
