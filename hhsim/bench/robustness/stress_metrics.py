"""What `hhsim bench stress` measures of a case, what it is held to, and the rows of its table."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from hhsim.bench.robustness.failure import SAFE_DEPTH
from hhsim.bench.table import metric_column
from hhsim.solver.method import never_penetrates
from hhsim.system.log_histogram import CpuTimes, LogHistogram
from hhsim.table.table import Column


@dataclass(frozen=True)
class KeptFailure:
    """A failure that was shrunk and kept.

    `reproduced` is False where no fresh solver fails on any end of the motion: then the file holds all of it.
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
    """What a case gave; lengths [m], forces [N], times [s], counts of ticks.

    `coupling_force` is the coupling's own at the tick of the largest force, palm and joints together, and `force_ratio`
    the largest ratio of the two at any tick. `unexplained` are the stuck ticks that had a way out
    (`hhsim.bench.robustness.local_optimality`), of those looked into. `brute_ticks` were recomputed over all leaves or
    triangles; `brute_difference` is the largest disagreement with what the trees gave.
    """

    object: str
    method: str
    surface: str
    level: int
    spheres: int
    seed: int
    ticks: int
    penetration: float
    penetration_palm: float
    penetration_finger: float
    penetrating: int
    penetrating_deep: int
    not_finite: int
    stuck: int
    unexplained: int
    longest_stuck: int
    lag: int
    held: int
    touching: int
    candidates_max: int
    force_max: float
    coupling_force: float
    force_ratio: float
    brute_ticks: int
    brute_difference: float
    cpu: LogHistogram = field(repr=False, compare=False)
    failures: tuple[KeptFailure, ...] = ()

    @property
    def safe(self) -> bool:
        """Whether the method kept what a safe one promises: no penetration, finite, not stuck where there is a way."""
        return (
            self.penetration <= SAFE_DEPTH
            and self.not_finite == 0
            and self.unexplained == 0
            and self.brute_difference <= SAFE_DEPTH
        )

    @property
    def missed(self) -> bool:
        """Whether a limit was missed: the method promises safety and is not safe."""
        return never_penetrates(self.method) and not self.safe


COLUMNS = (
    Column("object", "object"),
    Column("method", "method"),
    Column("surface", "what of the object the hand touches"),
    Column("level", "level of the sphere tree"),
    Column("spheres", "leaf spheres of the object"),
    Column("seed", "seed of the random targets"),
    Column("ticks", "ticks run"),
    Column("penetration", "deepest penetration", "m"),
    Column("penetration_palm", "deepest penetration of the palm", "m"),
    Column("penetration_finger", "deepest penetration of a finger", "m"),
    Column("penetrating", "ticks deeper than 1 um"),
    Column("penetrating_deep", "ticks deeper than 10 um"),
    Column("not_finite", "ticks whose hand or force is not finite"),
    Column("stuck", "ticks that kept the last feasible hand"),
    Column("unexplained", "stuck ticks that had a way out"),
    Column("longest_stuck", "longest run of stuck ticks"),
    Column("lag", "ticks whose budget ended on the way"),
    Column("held", "ticks whose input was no reading of a hand"),
    Column("touching", "ticks in touch with the object"),
    metric_column("candidates_max"),
    Column("force_max", "largest total force", "N"),
    Column("coupling_force", "the coupling's own force at that tick", "N"),
    Column("force_ratio", "largest ratio of the total force to the coupling's own at the same tick"),
    Column("cpu_p50", "CPU time of a tick, median", "s"),
    Column("cpu_p99", "CPU time of a tick, 99th percentile", "s"),
    Column("cpu_max", "CPU time of a tick, largest", "s"),
    Column("brute_ticks", "ticks recomputed by brute force"),
    Column("brute_difference", "largest disagreement with brute force", "m"),
    Column("safe", "kept what a safe method promises"),
)


_ADDED = (
    *("spheres", "ticks", "penetrating", "penetrating_deep", "not_finite", "stuck", "unexplained", "lag", "held"),
    *("touching", "brute_ticks"),
)
_LARGEST = (
    *("level", "penetration", "penetration_palm", "penetration_finger", "longest_stuck", "candidates_max"),
    *("force_ratio", "brute_difference"),
)


def total(rows: Sequence[StressFigures]) -> StressFigures:
    """All cases of one solver as one: counts added up, largest of what has a largest, percentiles over all ticks."""
    strongest = max(rows, key=lambda row: row.force_max)
    return StressFigures(
        object="all",
        method=rows[0].method,
        surface=rows[0].surface,
        seed=rows[0].seed,
        force_max=strongest.force_max,
        coupling_force=strongest.coupling_force,
        cpu=LogHistogram.sum(row.cpu for row in rows),
        failures=tuple(failure for row in rows for failure in row.failures),
        **{name: sum(getattr(row, name) for row in rows) for name in _ADDED},
        **{name: max(getattr(row, name) for row in rows) for name in _LARGEST},
    )
