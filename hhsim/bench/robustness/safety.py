"""Figures of safety of a run of any length, which is measured and dropped block by block."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.figure_fields import cpu_times, figure, metric, totals_of
from hhsim.bench.robustness.local_optimality import Pieces, stuck_with_way_out
from hhsim.bench.run_errors import placed_of
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.metrics.metrics import Penetration, penetration
from hhsim.motion.analytic_motion import hold_readings
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.system.log_histogram import LogHistogram
from hhsim.system.settings_file import Names

SAFE_DEPTH = 1e-6
"""Penetration [m] that a method which promises none may show."""
BLOCK = 2048
"""Ticks that are run and measured together."""


def solvers_of(methods: Names | None, surfaces: Names, **options: Any) -> list[SolverOptions]:
    """Return the options of every solver; without named methods those of all that take the surface.

    Raises InputError if a method does not take a surface, or an option is out of its range; UnknownNameError for no
    such method or surface.
    """
    return [
        SolverOptions(method=method, surface=surface, **options)
        for surface in surfaces
        for method in methods or METHODS
        if methods or surface == "spheres" or not METHODS[method].refuses_surfaces
    ]


def recorded_penetration(hand: HandModel, surface: Any, record: TickRecord) -> Penetration:
    """Return the depths [m] of the recorded hand, computed by `hhsim.metrics.metrics` and not by the solver."""
    return penetration(surface, hand_shape(hand), placed_of(record))


def not_finite(record: TickRecord) -> BoolArray:
    """Return the ticks whose graphic hand or force is not finite, shape (T,)."""
    bad = np.zeros(len(record.status), dtype=bool)
    for name in ("position", "orientation", "flexion", "abduction", "joints", "phalanx", "palm_wrench", "total"):
        values = getattr(record, name)
        bad |= ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    return bad


def _deepest(depths: Sequence[float]) -> float:
    """Return the largest depth; NaN if one is, that of a hand that is not finite."""
    return float(np.max(depths))


@dataclass(frozen=True, kw_only=True)
class SafetyFigures:
    """Figures of a run by one method."""

    object: str = figure("object", default="")
    method: str = figure("method of the solver", default="")
    surface: str = figure("what of the object the hand touches", default="")
    ticks: int = figure("ticks run", "", sum, 0)
    penetration: float = figure("deepest penetration", "µm", _deepest, 0.0)
    penetrating: int = figure("ticks deeper than 1 um", "", sum, 0)
    not_finite: int = figure("ticks whose hand or force is not finite", "", sum, 0)
    touching: int = figure("ticks in touch with the object", "", sum, 0)
    candidates_max: int = metric(max, 0)
    stuck: int = figure("ticks that kept the last feasible hand", "", sum, 0)
    longest_stuck: int = figure("longest run of stuck ticks", "", max, 0)
    unexplained: int = figure("stuck ticks that had a way out", "", sum, 0)
    lagging: int = figure("ticks with distance still to go", "", sum, 0)
    lag: float = figure("most distance still to go", "mm", max, 0.0)
    cpu: LogHistogram = cpu_times("a tick")  # noqa: RUF009

    cpu_p50 = property(lambda self: 1e-9 * self.cpu.percentile(50.0))
    cpu_p99 = property(lambda self: 1e-9 * self.cpu.percentile(99.0))
    cpu_max = property(lambda self: 1e-9 * self.cpu.largest)

    @property
    def safe(self) -> bool:
        """True if the hand stayed within 1 µm and finite, and no stuck tick had a free step."""
        return self.penetration <= SAFE_DEPTH and self.not_finite == 0 and self.unexplained == 0


class SafetyMeasure:
    """Measures a run, block by block, beside the pieces of the surface that the hand touches, world."""

    def __init__(self, hand: HandModel, pieces: Pieces, options: SolverOptions) -> None:
        self._hand, self._pieces, self._options = hand, pieces, options
        self._before: HandConfiguration | None = None
        self._stuck_run = 0
        self.figures = SafetyFigures()

    def readings(self, motion: HandConfiguration) -> HandConfiguration:
        """Return a block of the haptic motion with readings held as the solver holds them, across blocks too."""
        if self._before is None:
            held = hold_readings(motion)
        else:
            held = hold_readings(sequence(self._before, motion)).part(1, motion.ticks + 1)
        self._before = held.part(motion.ticks - 1, motion.ticks).copy()
        return held

    def add(self, haptic: HandConfiguration, record: TickRecord, depth: FloatArray) -> dict[str, BoolArray]:
        """Measure a block of known depths [m]; return its failed ticks, shape (T,), by the name of the failure."""
        penetrating, lost = ~(depth <= SAFE_DEPTH), not_finite(record)
        unexplained = stuck_with_way_out(self._hand, self._pieces, self._options, haptic, record)
        stuck = (record.status & STATUS_STUCK) > 0
        run = np.concatenate([np.ones(self._stuck_run, bool), stuck])
        self._stuck_run = int(np.argmin(run[::-1])) if not run.all() else len(run)
        cpu = LogHistogram()
        cpu.add(record.duration_cpu)
        block = SafetyFigures(
            ticks=len(stuck),
            penetration=float(depth.max()),
            penetrating=int(penetrating.sum()),
            not_finite=int(lost.sum()),
            touching=int((record.work[:, WORK_TOUCHING] > 0).sum()),
            candidates_max=int(record.work[:, WORK_CANDIDATES].max()),
            stuck=int(stuck.sum()),
            longest_stuck=longest_run(run),
            unexplained=int(unexplained.sum()),
            lagging=int(((record.status & STATUS_LAG) > 0).sum()),
            lag=float(record.lag.max()),
            cpu=cpu,
        )
        self.figures = replace(block, **totals_of(SafetyFigures, [self.figures, block]))
        return {"penetration": penetrating, "not finite": lost, "stuck": unexplained}


def longest_run(where: BoolArray) -> int:
    """Return the largest number of neighbouring entries that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
