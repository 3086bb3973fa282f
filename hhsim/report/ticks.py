"""Tables and curves that a report computes of a result's ticks, read block by block."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import AnyArray, FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics import metrics
from hhsim.metrics.run.registry import known_figures, needed_columns, run_metrics, tick_figures
from hhsim.metrics.run_ticks import RunTicks, result_ticks
from hhsim.replay.summary_table import SummaryRow, summary_rows
from hhsim.result.reader import Result
from hhsim.result.schema import LIVE_TICK
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.solver.method import EVERYTHING, TIMES
from hhsim.view.plots import force_values

BLOCK_TICKS = 16_384
SAME = 1e-9
"""Relative difference [SI, %] up to which figures are the same: sums in another order differ by less."""
PHASE_COLUMNS = (
    *("contacts/candidates", "status", "duration/total_cpu"),
    *("force/total", "force_variation_rate", "penetration_depth"),
)
"""Datasets of /tick that the line of a phase is computed from."""
FORCE = "force/phalanx"


def report_ticks(result: Result) -> RunTicks:
    """Read what a report needs of every tick, some 170 bytes."""
    result = result.seen_from_object
    names = dict.fromkeys((*needed_columns(), *PHASE_COLUMNS))
    parts: dict[str, list[AnyArray]] = {name: [] for name in names}
    for block in result.blocks(list(names), BLOCK_TICKS):
        for name, values in block.items():
            # What is infinite is no figure either.
            known = np.where(np.isfinite(values), values, np.nan) if values.dtype.kind == "f" else values
            parts[name].append(known)
    columns = {name: np.concatenate(blocks) if blocks else result[name] for name, blocks in parts.items()}
    return result_ticks(result, columns)


class FigureTable(NamedTuple):
    """Table of a result.

    Attributes:
        rows: What its replay printed; what the file lacks, as of a session, is computed from its ticks.
        misstated: Sentence on figures of the file that are not those of its ticks; else "".
    """

    rows: tuple[SummaryRow, ...]
    misstated: str


def figure_table(result: Result, ticks: RunTicks) -> FigureTable:
    """Compute the figures of the ticks, and replace them by those of the file."""
    known = known_figures([what for what in EVERYTHING if result.gives(what)])
    own, stated = {name: value for name, value in tick_figures(ticks).items() if name in known}, {}
    if result.complete and result.live is None:
        stated = {name: float(result.summary[name]) for name in run_metrics() if name in result.summary}
    of_paper = of_the_paper(result.scene)
    computed = {row.name: row for row in summary_rows({**stated, **own}, result.rate, of_paper=of_paper)}
    rows = summary_rows({**own, **stated}, result.rate, of_paper=of_paper)
    wrong = [
        f"{row.label} {row.shown} where its ticks give {computed[row.name].shown} {row.unit}".rstrip()
        for row in rows
        # What reads the same is the same, and a last digit may fall either way.
        if row.shown != computed[row.name].shown
        and not math.isclose(row.value, computed[row.name].value, rel_tol=SAME, abs_tol=SAME)
    ]
    text = f"The file says {'; '.join(wrong)}. hhsim verify looks further." if wrong else ""
    return FigureTable(rows, text)


def phase_figures(result: Result, ticks: RunTicks) -> list[dict[str, Any]]:
    """Return a line for each phase, or one for all ticks without a phase; none without a tick.

    CPU times are those of ticks in contact [µs], depth is in [µm], force the mean size of the total force [N].
    """
    if result.ticks == 0:
        return []
    spans = [(phase.name, phase.first_tick, min(phase.last_tick, result.ticks - 1)) for phase in result.phases]
    found = []
    for name, first, last in spans or [("all ticks", 0, result.ticks - 1)]:
        part = slice(first, last + 1)
        candidates, status = ticks["contacts/candidates"][part], ticks["status"][part]
        timed = (candidates > 0) & result.gives(TIMES)
        cpu = metrics.tick_statistics(ticks["duration/total_cpu"][part][timed])
        force = metrics.statistics(np.linalg.norm(ticks["force/total"][part], axis=1))
        found.append(
            {
                "name": name,
                "first": first,
                "last": last,
                "seconds": (last - first + 1) / result.rate,
                "cpu_p50": cpu.p50,
                "cpu_p99": cpu.p99,
                "depth": 1e6 * metrics.statistics(ticks["penetration_depth"][part]).max,
                "force": force.mean,
                "variation": metrics.statistics(ticks["force_variation_rate"][part]).mean,
                "candidates": int(candidates.max(initial=0)),
                "stuck": int(np.sum(status & STATUS_STUCK > 0)),
                "lagging": int(np.sum(status & STATUS_LAG > 0)),
            }
        )
    return found


def finger_figures(result: Result, ticks: RunTicks) -> list[dict[str, Any]]:
    """Return a line for each finger, thumb to little finger; none without a tick.

    All are of the sum of its phalanges' forces [N]: size in the ticks that bear one, largest one-tick change as a
    vector, and RMS between 50 and 400 Hz in the worst quarter of a second.
    """
    # Summed block by block: the forces on all phalanges of a long session do not fit into memory.
    sums = [block[FORCE].sum(axis=2) for block in result.blocks([FORCE], BLOCK_TICKS)]
    if not sums:
        return []
    found = []
    for name, force in zip(FINGERS, np.moveaxis(np.concatenate(sums), 1, 0)):
        size = np.linalg.norm(force, axis=1)
        touch = size > 0.0
        of_touch = metrics.statistics(size, touch)
        step = metrics.contact_force_step(force, touch, ticks.breaks)
        ripple = metrics.worst_force_ripple(force, ticks.rate, ticks.breaks) if touch.any() else math.nan
        figures = {"mean": of_touch.mean, "largest": of_touch.max, "step": step, "ripple": ripple}
        found.append({"name": name, "ticks": int(touch.sum()), **figures})
    return found


SingleArray = NDArray[np.float32]

FORCES = ("resultant", *FINGERS, "palm")
"""Columns of `ReportColumns.force`."""
STIFFNESS = f"{LIVE_TICK}/command_stiffness"


@dataclass(frozen=True, eq=False)
class ReportColumns:
    """Ticks of a result, shapes (T,), in single precision: ten minutes at 1 kHz are 40 MB.

    Attributes:
        time: Time since the start of the motion [s], in double precision.
        cpu: CPU time of the whole tick [s].
        candidates, touching: Number of pairs.
        depth: Deepest penetration [m].
        variation: One-tick change of the total force's size [%]; NaN where undefined.
        force: Sizes of forces by `FORCES` [N], shape (T, 7).
        stiffness: Stiffness sent to each finger, 0 free to 1, shape (T, 5); None of a replay.
    """

    time: FloatArray
    cpu: SingleArray
    candidates: SingleArray
    touching: SingleArray
    depth: SingleArray
    variation: SingleArray
    force: SingleArray
    stiffness: SingleArray | None = None

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.time)


SCALES = {
    "cpu": ("duration/total_cpu", 1e-9),
    "candidates": ("contacts/candidates", 1.0),
    "touching": ("contacts/touching", 1.0),
    "depth": ("penetration_depth", 1.0),
    "variation": ("force_variation_rate", 1.0),
}
"""Dataset and unit of the columns that are stored as such."""


def report_columns(result: Result) -> ReportColumns:
    """Read a result block by block; raise InputError if the file cannot be read."""
    time = np.empty(result.ticks)
    single = {name: np.empty(result.ticks, np.float32) for name in SCALES}
    force = np.empty((result.ticks, len(FORCES)), np.float32)
    stiffness = np.empty((result.ticks, len(FINGERS)), np.float32) if result.live is not None else None
    first = 0
    names = ["time", "force/phalanx", "force/total", *(dataset for dataset, _ in SCALES.values())]
    names += [STIFFNESS] if stiffness is not None else []
    for block in result.blocks(names, BLOCK_TICKS):
        part = slice(first, first + len(block["time"]))
        time[part] = block["time"]
        for name, (dataset, scale) in SCALES.items():
            single[name][part] = scale * block[dataset]
        force[part] = force_values(block["force/phalanx"], block["force/total"])
        if stiffness is not None:
            stiffness[part] = block[STIFFNESS]
        first = part.stop
    return ReportColumns(time=time, force=force, stiffness=stiffness, **single)


class MinMaxBand(NamedTuple):
    """Middle of each of n stretches of the axis, and least value, median and largest value there (NaN without any)."""

    at: FloatArray
    low: FloatArray
    middle: FloatArray
    high: FloatArray


def minmax_band(at: FloatArray, values: NDArray[np.floating], stretches: int) -> MinMaxBand:
    """Return the band of a curve, shapes (T,); the curve itself where it has no more values than stretches."""
    if len(values) <= stretches:
        whole = np.asarray(values, np.float64)
        return MinMaxBand(at, whole, whole, whole)
    edges = np.linspace(0, len(values), stretches + 1).astype(np.int64)
    starts = edges[:-1]
    # NaN is no value: fmin and fmax pass it over.
    low, high = (np.asarray(reduce.reduceat(values, starts), np.float64) for reduce in (np.fmin, np.fmax))
    middle = np.full(stretches, np.nan)
    for k in np.flatnonzero(np.isfinite(low)):
        middle[k] = np.nanmedian(values[edges[k] : edges[k + 1]])
    return MinMaxBand(0.5 * (at[starts] + at[edges[1:] - 1]), low, middle, high)
