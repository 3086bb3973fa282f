"""Figures of a run that follow from its ticks, in the units that the table of `hhsim replay` shows."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics import metrics
from hhsim.motion.trajectory import TickPhase

Array = NDArray[Any]
Mask = NDArray[np.bool_]

HOLD = "hold"
"""Phases of this name are held; the others move."""

FIGURE_SERIES = (
    *("status", "lag", "force/total", "force_variation_rate", "penetration_depth"),
    *("duration/total", "duration/total_cpu"),
    *("contacts/candidates", "contacts/touching", "work/node_tests", "work/pair_tests"),
    *("work/rows", "work/bodies", "work/units"),
)
"""Datasets of /tick that `tick_figures` needs."""


class Columns(Protocol):
    """Datasets of /tick by name, each with a row a tick."""

    def __getitem__(self, name: str, /) -> Array:
        """The dataset."""


def tick_figures(
    columns: Columns,
    palm_off: NDArray[np.float64],
    *,
    phases: Sequence[TickPhase],
    rate: float,
    fingers: int,
    all_pairs: int,
) -> dict[str, float]:
    """What follows from the ticks of the lines of `hhsim.replay.summary_table`, in their units; NaN where undefined.

    Args:
        columns: The datasets of `FIGURE_SERIES`.
        palm_off: The shown palm from the user's [mm], shape (T,).
        phases: Of the motion.
        rate: Ticks per second [Hz].
        fingers: How many are modelled.
        all_pairs: Of a hand body and an object sphere.
    """
    ticks = len(palm_off)
    holds = hold_slices(phases, ticks)
    hold = np.zeros(ticks, bool)
    for part in holds:
        hold[part] = True
    force = columns["force/total"]
    contact = columns["contacts/candidates"] > 0
    cpu = metrics.tick_statistics(columns["duration/total_cpu"])
    busy = metrics.tick_statistics(columns["duration/total_cpu"][contact])
    wall = metrics.tick_statistics(columns["duration/total"])
    variation = metrics.statistics(columns["force_variation_rate"], hold)
    tests = _mean(columns["work/node_tests"] + columns["work/pair_tests"])
    status = columns["status"]
    return {
        "candidates_max": columns["contacts/candidates"].max(initial=0),
        "touching_max": columns["contacts/touching"].max(initial=0),
        "tick_cpu_p50": busy.p50,
        "tick_cpu_p99": busy.p99,
        "tick_cpu_max": cpu.max,
        "tick_wall_p50": metrics.tick_statistics(columns["duration/total"][contact]).p50,
        "tick_wall_over_1ms": 100.0 * wall.over_budget,
        # A hand that is not finite has no depth, and hides none.
        "penetration_max": 1e6 * float(np.fmax.reduce(columns["penetration_depth"], initial=0.0)),
        "force_hold_mean": metrics.statistics(np.linalg.norm(force, axis=1), hold).mean,
        "force_variation_hold": variation.mean,
        "force_variation_hold_std": variation.std,
        "force_ripple_hold": max((metrics.force_ripple(force[part], rate) for part in holds), default=np.nan),
        "force_step": metrics.force_step(force, ~hold, hold),
        "tracking_palm": metrics.statistics(palm_off, hold).mean,
        "fingers_modelled": fingers,
        "bodies_near": _mean(columns["work/bodies"][contact]),
        "rows_max": columns["work/rows"].max(initial=0),
        "tests_mean": tests,
        "tests_share": 100.0 * tests / all_pairs,
        "work_mean": _mean(columns["work/units"]),
        "stuck_ticks": np.sum(status & STATUS_STUCK > 0),
        "lag_ticks": np.sum(status & STATUS_LAG > 0),
        "lag_max": 1e3 * columns["lag"].max(initial=0.0),
    }


def hold_slices(phases: Sequence[TickPhase], ticks: int) -> list[slice]:
    """The ticks of each hold, of so many ticks."""
    held = [phase for phase in phases if phase.name == HOLD and phase.first_tick < ticks]
    return [slice(phase.first_tick, min(phase.last_tick + 1, ticks)) for phase in held]


def _mean(values: Array) -> float:
    return float(values.mean()) if values.size else np.nan
