"""Figures of safety of a run of any length, which is measured and dropped block by block."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.figures import figure, summed
from hhsim.bench.robustness.local_optimality import Pieces, stuck_with_way_out
from hhsim.bench.tick_records import placed_of
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK, WORK_TOUCHING
from hhsim.metrics.metrics import Penetration, penetration
from hhsim.motion.analytic_motion import hold_readings
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
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


SAFETY = (
    figure("ticks", "ticks run", "", sum),
    figure("penetration", "deepest penetration", "µm", _deepest),
    figure("penetrating", "ticks deeper than 1 um", "", sum),
    figure("not_finite", "ticks whose hand or force is not finite", "", sum),
    figure("touching", "ticks in touch with the object", "", sum),
    figure("stuck", "ticks that kept the last feasible hand", "", sum),
    figure("unexplained", "stuck ticks that had a way out", "", sum),
    figure("lagging", "ticks with distance still to go", "", sum),
    figure("lag", "most distance still to go", "mm", max),
)
"""Figures of a run of any length."""


def is_safe(figures: Mapping[str, Any]) -> bool:
    """Return True if the hand stayed within 1 µm and finite, and no stuck tick had a free step; figures of `SAFETY`."""
    return bool(figures["penetration"] <= SAFE_DEPTH and not figures["not_finite"] and not figures["unexplained"])


class SafetyMeasure:
    """Measures a run, block by block, beside the pieces of the surface that the hand touches, world."""

    def __init__(self, hand: HandModel, pieces: Pieces, options: SolverOptions) -> None:
        self._hand, self._pieces, self._options = hand, pieces, options
        self._before: HandConfiguration | None = None
        self.figures: dict[str, Any] = {}  # of `SAFETY`, of all blocks so far; none before the first

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
        block = {
            "ticks": len(stuck),
            "penetration": float(depth.max()),
            "penetrating": int(penetrating.sum()),
            "not_finite": int(lost.sum()),
            "touching": int((record.work[:, WORK_TOUCHING] > 0).sum()),
            "stuck": int(stuck.sum()),
            "unexplained": int(unexplained.sum()),
            "lagging": int(((record.status & STATUS_LAG) > 0).sum()),
            "lag": float(record.lag.max()),
        }
        self.figures = summed(SAFETY, [self.figures, block] if self.figures else [block])
        return {"penetration": penetrating, "not finite": lost, "stuck": unexplained}
