"""What `hhsim bench recorded` measures of a run, what it is held to, and the rows of its table."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.bench.robustness.failure import SAFE_DEPTH
from hhsim.bench.table import metric_column
from hhsim.metrics.contact_error import MOST_CONTACT_ERROR
from hhsim.metrics.metrics import statistics
from hhsim.solver.method import never_penetrates
from hhsim.system.log_histogram import CpuTimes, LogHistogram
from hhsim.table.table import Column


@dataclass(frozen=True, kw_only=True)
class RecordedFigures(CpuTimes):
    """What a run gave; lengths [m], times [s], forces [N], variation [%], counts of ticks.

    `force_mean`, `force_max` and `force_step` are of the ticks in touch, as the figures `force_contact_…` of a replay.
    `variation_tick` and `variation_sample` are means over the ticks with a force before them. The CPU times are those
    of ticks that have candidates. `reason` is why there was no run.
    """

    recording: str
    object: str = ""
    method: str = ""
    surface: str = ""
    reason: str = ""
    placement: str = ""
    samples: int = 0
    rate: float = float("nan")
    ticks: int = 0
    fastest: float = float("nan")
    penetration: float = float("nan")
    penetrating: int = 0
    brute_ticks: int = 0
    brute_depth: float = float("nan")
    not_finite: int = 0
    touching: int = 0
    candidates_max: int = 0
    contact_error_max: float = float("nan")
    force_mean: float = float("nan")
    force_max: float = float("nan")
    force_step: float = float("nan")
    variation_tick: float = float("nan")
    variation_sample: float = float("nan")
    stuck: int = 0
    longest_stuck: int = 0
    unexplained: int = 0
    lagging: int = 0
    lag: float = 0.0
    started_inside: bool = False
    cpu: LogHistogram = field(default_factory=LogHistogram, repr=False, compare=False)

    @property
    def safe(self) -> bool:
        """Whether it ran, stayed within 1 µm and finite, and no stuck tick had a way out."""
        if self.reason:
            return False
        shallow = self.penetration <= SAFE_DEPTH and not self.brute_depth > SAFE_DEPTH
        return shallow and self.not_finite == 0 and self.unexplained == 0

    @property
    def floats(self) -> bool:
        """Whether it touches farther from the true mesh than a user should feel."""
        return self.contact_error_max > MOST_CONTACT_ERROR

    @property
    def missed(self) -> bool:
        """Whether a limit was missed: no run, or a method that promises safety and is not safe, or floats."""
        return bool(self.reason) or (never_penetrates(self.method) and (self.floats or not self.safe))


COLUMNS = (
    Column("recording", "recording"),
    Column("object", "object; empty where the recording could not be read"),
    Column("method", "method of the solver"),
    Column("surface", "what of the object the hand touches"),
    Column("reason", "why there was no run"),
    Column("placement", "where the object was put, and how the hand begins"),
    Column("samples", "samples of the recording"),
    Column("rate", "ticks a second", "Hz"),
    Column("ticks", "ticks run"),
    Column("fastest", "farthest way of a fingertip of the user's hand in a tick", "m"),
    Column("penetration", "deepest penetration", "m"),
    Column("penetrating", "ticks deeper than 1 um"),
    Column("brute_ticks", "ticks in touch recomputed by brute force over all leaves or triangles"),
    Column("brute_depth", "deepest penetration of those, by brute force", "m"),
    Column("not_finite", "ticks whose hand or force is not finite"),
    Column("touching", "ticks in touch with the object"),
    metric_column("candidates_max"),
    metric_column("contact_error_max"),
    Column("force_mean", "mean size of the total force in touch", "N"),
    Column("force_max", "largest size of the total force in touch", "N"),
    Column("force_step", "largest one-tick step of the total force in touch", "N"),
    Column("variation_tick", "mean force variation from tick to tick", "%"),
    Column("variation_sample", "mean force variation from one new input sample to the next", "%"),
    Column("stuck", "ticks that kept the last feasible hand"),
    Column("longest_stuck", "longest run of stuck ticks"),
    Column("unexplained", "stuck ticks that had a way out"),
    Column("lagging", "ticks with distance still to go"),
    Column("lag", "most distance still to go", "m"),
    Column("started_inside", "whether the user's hand begins inside the object"),
    Column("cpu_p50", "CPU time of a tick with candidates, median", "s"),
    Column("cpu_p99", "CPU time of a tick with candidates, 99th percentile", "s"),
    Column("cpu_max", "CPU time of a tick with candidates, largest", "s"),
    Column("safe", "ran within 1 um, finite, and no stuck tick had a way out"),
)
"""Of the suite's table: a row a run, or one for a recording that could not be run."""


def longest_run(where: BoolArray) -> int:
    """Most neighbouring entries that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


_ADDED = ("samples", "ticks", "penetrating", "brute_ticks", "not_finite", "touching", "stuck", "unexplained", "lagging")
_LARGEST = (
    *("force_max", "force_step", "fastest", "penetration", "brute_depth"),
    *("candidates_max", "contact_error_max", "longest_stuck", "lag", "started_inside"),
)
_MEANS = ("force_mean", "variation_tick", "variation_sample")


def totals(rows: Sequence[RecordedFigures]) -> list[RecordedFigures]:
    """All recordings of each object, method and surface as one; where there are several objects, those of all too.

    Counts are added; of what has a largest it is that; percentiles are over all ticks; means are those of the
    recordings that have one.
    """
    ran = [row for row in rows if not row.reason]
    objects = list(dict.fromkeys(row.object for row in ran))
    solvers = dict.fromkeys((row.method, row.surface) for row in ran)
    found = []
    for name in [*objects, *(["all"] if len(objects) > 1 else [])]:
        for solver in solvers:
            group = [row for row in ran if (row.method, row.surface) == solver and name in (row.object, "all")]
            found += [_total(group, name)] if group else []
    return found


def _total(group: Sequence[RecordedFigures], object_: str) -> RecordedFigures:
    figures: dict[str, Any] = {name: sum(getattr(row, name) for row in group) for name in _ADDED}
    figures |= {name: _largest([getattr(row, name) for row in group]) for name in _LARGEST}
    figures |= {name: statistics([getattr(row, name) for row in group]).mean for name in _MEANS}
    cpu = LogHistogram.sum(row.cpu for row in group)
    count = len({row.recording for row in group})
    known = RecordedFigures(recording=f"all {count}", object=object_, rate=group[0].rate, cpu=cpu)
    return replace(known, method=group[0].method, surface=group[0].surface, **figures)


def _largest(values: Sequence[Any]) -> Any:
    defined = [value for value in values if value == value]
    return max(defined, default=float("nan"))
