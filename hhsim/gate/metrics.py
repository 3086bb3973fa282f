"""What the gate takes from a result: errors, work counters, time, and what was fed in.

Errors are computed anew from the stored poses and forces where that needs no solver, so that a result whose own summary
is stale or wrong does not pass.
"""

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.gate.input_hash import RunInputs, run_inputs
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import FINGERS
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics import metrics
from hhsim.replay.stored_scene import stored_tree
from hhsim.result.reader import Result

Array = NDArray[Any]

HOLD = "hold"
"""Phases of this name are held; the others move."""


class Figure(NamedTuple):
    """What people read of a figure: `scale` takes SI to `unit`. Differences up to `floor` (SI) are rounding."""

    label: str
    unit: str = ""
    scale: float = 1.0
    floor: float = 0.0


ERRORS: dict[str, Figure] = {
    "penetration_max": Figure("penetration, max", "µm", 1e6, 1e-9),
    "stuck_ticks": Figure("stuck ticks"),
    "lag_ticks": Figure("ticks with lag"),
    "lag_max": Figure("lag, max", "mm", 1e3, 1e-9),
    "tracking_excess": Figure("coupling energy over the optimum", "%", 1.0, 1e-6),
    "tracking_palm": Figure("palm off the user's in the hold", "mm", 1e3, 1e-9),
    "force_variation_hold": Figure("force variation in the hold", "%", 1.0, 1e-6),
    "force_variation_tremor": Figure("force variation, trembling hand", "%", 1.0, 1e-6),
    "force_ripple_hold": Figure("force ripple in the hold, 50 to 400 Hz", "N", 1.0, 1e-9),
    "force_step": Figure("largest force step while moving", "% of hold", 1.0, 1e-6),
}
"""Errors that can have a limit; values in SI units, or % where the metric is defined so. Less is better."""

COUNTERS: dict[str, Figure] = {
    "node_tests": Figure("tree nodes tested"),
    "pair_tests": Figure("exact distances"),
    "qp_iterations": Figure("QP iterations"),
    "linearisations": Figure("linearisations"),
    "candidates": Figure("candidate pairs"),
    "work_units": Figure("work units"),
}
"""Sums over all ticks, exact integers."""

_COUNTED = {
    "candidates": "contacts/candidates",
    "work_units": "work/units",
}


@dataclass(frozen=True)
class RunFigures:
    """What one run is judged by.

    Attributes:
        inputs: What was fed in.
        errors: By the names of `ERRORS`; NaN where undefined.
        counters: By the names of `COUNTERS`.
        cpu_p50: Median CPU time of its ticks in contact, of all ticks where it has no contact [s].
    """

    inputs: RunInputs
    errors: dict[str, float]
    counters: dict[str, int]
    cpu_p50: float

    def to_json(self) -> dict[str, Any]:
        """As plain values; what is undefined is None."""
        errors = {name: value if np.isfinite(value) else None for name, value in self.errors.items()}
        return {"inputs": asdict(self.inputs), "errors": errors, "counters": self.counters}


def run_figures(result: Result) -> RunFigures:
    """Judge a result by its ticks.

    Raises:
        InputError: a dataset that the result's schema does not have, or a tree that is none.
    """
    counters = {name: int(np.sum(result[_COUNTED.get(name, f"work/{name}")])) for name in COUNTERS}
    return RunFigures(run_inputs(result), _errors(result), counters, cpu_p50(result))


def cpu_p50(result: Result) -> float:
    """Median CPU time of the ticks in contact, of all ticks where there is none [s]."""
    contact = result["contacts/candidates"] > 0
    cpu = result["duration/total_cpu"]
    return float(np.median(cpu[contact] if contact.any() else cpu)) * 1e-9


def _errors(result: Result) -> dict[str, float]:
    hold = np.zeros(result.ticks, bool)
    holds = [slice(p.first_tick, p.last_tick + 1) for p in result.phases if p.name == HOLD]
    for part in holds:
        hold[part] = True
    status, force = result["status"], result["force/total"]
    graphic = HandConfiguration(*(result[f"graphic/{name}"] for name in HandConfiguration._fields))
    haptic = HandConfiguration(*(result[f"haptic/{name}"] for name in HandConfiguration._fields))
    off = metrics.statistics(metrics.tracking_error(haptic, graphic).position_mm, hold).mean
    rate = float(result.scene.get("rate", 1000.0))
    ripple = max((metrics.force_ripple(force[part], rate) for part in holds), default=float("nan"))
    return {
        # np.max and not max: of a depth and NaN, which a pose that is no number has, max takes whichever it likes.
        "penetration_max": float(np.max([result["penetration_depth"].max(initial=0.0), _depth(result, graphic)])),
        "stuck_ticks": float(np.sum(status & STATUS_STUCK > 0)),
        "lag_ticks": float(np.sum(status & STATUS_LAG > 0)),
        "lag_max": float(result["lag"].max(initial=0.0)),
        # These two are optima and repetitions of the solver: only the run itself has them.
        "tracking_excess": _summed_up(result, "tracking_excess"),
        "tracking_palm": 1e-3 * off,
        "force_variation_hold": metrics.statistics(metrics.force_variation_rate(force), hold).mean,
        "force_variation_tremor": _summed_up(result, "force_variation_tremor"),
        "force_ripple_hold": ripple,
        "force_step": metrics.force_step(force, ~hold, hold),
    }


def _summed_up(result: Result, name: str) -> float:
    return float(result.summary.get(name, float("nan")))


def _depth(result: Result, graphic: HandConfiguration) -> float:
    """Deepest penetration [m] of the stored graphic hand in the stored tree's leaves; NaN where a pose is no number."""
    modelled = result.scene["solver"]["fingers"]
    static = result.static
    found = metrics.penetration(
        stored_tree(result).arrays(),
        static["hand/phalanx_radius"],
        static["hand/palm_center"],
        static["hand/palm_radius"],
        result["graphic/joints"],
        graphic.position,
        graphic.orientation,
        [finger in modelled for finger in FINGERS],
    )
    return float(found.depth.max(initial=0.0))
