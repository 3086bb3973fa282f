"""Figures of a run of `hhsim bench recorded`, their bars, and the columns of its table."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.bench.figure_columns import columns_of, cpu_times, figure, mean, metric, totals_of
from hhsim.bench.robustness.failure import SAFE_DEPTH
from hhsim.metrics.mesh_penetration import MOST_CONTACT_ERROR
from hhsim.solver.method import never_penetrates
from hhsim.system.log_histogram import CpuTimes, LogHistogram
from hhsim.table.table import Column

NAN = float("nan")


def _largest(values: Sequence[Any]) -> Any:
    return max((value for value in values if value == value), default=NAN)


@dataclass(frozen=True, kw_only=True)
class RecordedFigures(CpuTimes):
    """Figures of a run; `reason` says why there was none.

    Forces in touch are those of the figures `force_contact_…` of a replay; variations are means over the ticks with a
    force before them.
    """

    recording: str = figure("recording")
    object: str = figure("object; empty where the recording could not be read", default="")
    method: str = figure("method of the solver", default="")
    surface: str = figure("what of the object the hand touches", default="")
    reason: str = figure("why there was no run", default="")
    placement: str = figure("where the object was put, and how the hand begins", default="")
    samples: int = figure("samples of the recording", "", sum, 0)
    rate: float = figure("ticks a second", "Hz", default=NAN)
    ticks: int = figure("ticks run", "", sum, 0)
    fastest: float = figure("farthest way of a fingertip of the user's hand in a tick", "m", _largest, NAN)
    penetration: float = figure("deepest penetration", "m", _largest, NAN)
    penetrating: int = figure("ticks deeper than 1 um", "", sum, 0)
    brute_ticks: int = figure("ticks in touch recomputed by brute force over all leaves or triangles", "", sum, 0)
    brute_depth: float = figure("deepest penetration of those, by brute force", "m", _largest, NAN)
    not_finite: int = figure("ticks whose hand or force is not finite", "", sum, 0)
    touching: int = figure("ticks in touch with the object", "", sum, 0)
    candidates_max: int = metric(_largest, 0)
    contact_error_max: float = metric(_largest, NAN)
    force_mean: float = figure("mean size of the total force in touch", "N", mean, NAN)
    force_max: float = figure("largest size of the total force in touch", "N", _largest, NAN)
    force_step: float = figure("largest one-tick step of the total force in touch", "N", _largest, NAN)
    variation_tick: float = figure("mean force variation from tick to tick", "%", mean, NAN)
    variation_sample: float = figure("mean force variation from one new input sample to the next", "%", mean, NAN)
    stuck: int = figure("ticks that kept the last feasible hand", "", sum, 0)
    longest_stuck: int = figure("longest run of stuck ticks", "", _largest, 0)
    unexplained: int = figure("stuck ticks that had a way out", "", sum, 0)
    lagging: int = figure("ticks with distance still to go", "", sum, 0)
    lag: float = figure("most distance still to go", "m", _largest, 0.0)
    started_inside: bool = figure("whether the user's hand begins inside the object", "", _largest, default=False)
    cpu: LogHistogram = cpu_times("a tick with candidates")  # noqa: RUF009

    @property
    def safe(self) -> bool:
        """True if it ran, stayed within 1 µm and finite, and no stuck tick had a free step."""
        if self.reason:
            return False
        shallow = self.penetration <= SAFE_DEPTH and not self.brute_depth > SAFE_DEPTH
        return shallow and self.not_finite == 0 and self.unexplained == 0

    @property
    def floats(self) -> bool:
        """True if it touches farther from the true mesh than a user should feel."""
        return self.contact_error_max > MOST_CONTACT_ERROR

    @property
    def missed(self) -> bool:
        """True if there was no run, or if a method that promises safety is not safe, or floats."""
        return bool(self.reason) or (never_penetrates(self.method) and (self.floats or not self.safe))


COLUMNS = (*columns_of(RecordedFigures), Column("safe", "ran within 1 um, finite, and no stuck tick had a way out"))
"""Columns of the suite's table: a row a run, or one for a recording that could not be run."""


def longest_run(where: BoolArray) -> int:
    """Return the largest number of neighbouring entries that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def totals(rows: Sequence[RecordedFigures]) -> list[RecordedFigures]:
    """Return all recordings of each object, method and surface as one; those of all objects too if there are several.

    Counts are added, the largest is kept, percentiles are over all ticks; means are over the recordings that have one.
    """
    ran = [row for row in rows if not row.reason]
    objects = list(dict.fromkeys(row.object for row in ran))
    found = []
    for name in [*objects, *(["all"] if len(objects) > 1 else [])]:
        for solver in dict.fromkeys((row.method, row.surface) for row in ran):
            group = [row for row in ran if (row.method, row.surface) == solver and name in (row.object, "all")]
            if group:
                known = replace(group[0], recording=f"all {len({row.recording for row in group})}", object=name)
                found.append(replace(known, placement="", **totals_of(RecordedFigures, group)))
    return found
