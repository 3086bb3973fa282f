"""Figures of a case of `hhsim bench stress`, their bars, and the columns of its table."""

from collections.abc import Sequence
from dataclasses import dataclass

from hhsim.bench.figure_columns import columns_of, cpu_times, figure, metric, totals_of
from hhsim.bench.robustness.failure import SAFE_DEPTH
from hhsim.solver.method import never_penetrates
from hhsim.system.log_histogram import CpuTimes, LogHistogram
from hhsim.table.table import Column


@dataclass(frozen=True)
class KeptFailure:
    """A failure that was shrunk and kept.

    `reproduced` is False if no fresh solver fails on any end of the motion: then the file holds all of it.
    """

    kind: str
    tick: int
    path: str
    ticks: int
    failing_tick: int
    depth: float
    reproduced: bool
    command: str


@dataclass(frozen=True, kw_only=True)
class StressFigures(CpuTimes):
    """Figures of a case.

    `unexplained` are the stuck ticks with a free step (`hhsim.bench.robustness.local_optimality`), of those looked at.
    """

    object: str = figure("object")
    method: str = figure("method")
    surface: str = figure("what of the object the hand touches")
    level: int = figure("level of the sphere tree", total=max)
    spheres: int = figure("leaf spheres of the object", total=sum)
    seed: int = figure("seed of the random targets")
    ticks: int = figure("ticks run", total=sum)
    penetration: float = figure("deepest penetration", "m", max)
    penetration_palm: float = figure("deepest penetration of the palm", "m", max)
    penetration_finger: float = figure("deepest penetration of a finger", "m", max)
    penetrating: int = figure("ticks deeper than 1 um", total=sum)
    penetrating_deep: int = figure("ticks deeper than 10 um", total=sum)
    not_finite: int = figure("ticks whose hand or force is not finite", total=sum)
    stuck: int = figure("ticks that kept the last feasible hand", total=sum)
    unexplained: int = figure("stuck ticks that had a way out", total=sum)
    longest_stuck: int = figure("longest run of stuck ticks", total=max)
    lag: int = figure("ticks whose budget ended on the way", total=sum)
    held: int = figure("ticks whose input was no reading of a hand", total=sum)
    touching: int = figure("ticks in touch with the object", total=sum)
    candidates_max: int = metric(max)
    force_max: float = figure("largest total force", "N")
    coupling_force: float = figure("the coupling's own force at that tick", "N")
    force_ratio: float = figure("largest ratio of the total force to the coupling's own at the same tick", total=max)
    cpu: LogHistogram = cpu_times("a tick")  # noqa: RUF009
    brute_ticks: int = figure("ticks recomputed by brute force", total=sum)
    brute_difference: float = figure("largest disagreement with brute force", "m", max)
    failures: tuple[KeptFailure, ...] = ()

    @property
    def safe(self) -> bool:
        """True if the hand is shallow and finite, no stuck tick had a free step, and brute force agrees."""
        shallow = self.penetration <= SAFE_DEPTH and self.brute_difference <= SAFE_DEPTH
        return shallow and self.not_finite == 0 and self.unexplained == 0

    @property
    def missed(self) -> bool:
        """True if the method promises safety and is not safe."""
        return never_penetrates(self.method) and not self.safe


COLUMNS = (*columns_of(StressFigures), Column("safe", "kept what a safe method promises"))


def total(rows: Sequence[StressFigures]) -> StressFigures:
    """Return all cases of one solver as one: counts are added, the largest is kept, percentiles are over all ticks."""
    strongest = max(rows, key=lambda row: row.force_max)
    return StressFigures(
        object="all",
        method=rows[0].method,
        surface=rows[0].surface,
        seed=rows[0].seed,
        force_max=strongest.force_max,
        coupling_force=strongest.coupling_force,
        failures=tuple(failure for row in rows for failure in row.failures),
        **totals_of(StressFigures, rows),
    )
