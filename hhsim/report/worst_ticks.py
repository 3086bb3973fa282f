"""Ticks of a result that a reader wants to see: slowest, deepest, largest step of the force, largest lag."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from hhsim.metrics import metrics
from hhsim.metrics.run_ticks import HOLD
from hhsim.result.reader import Result
from hhsim.result.schema import LIVE_TICK

WorstKind = Literal["slowest", "deepest", "force-step", "lag"]


@dataclass(frozen=True)
class WorstTick:
    """A tick, the first of several equal ones, why it was chosen, and a sentence on what happened."""

    kind: WorstKind
    tick: int
    sentence: str


def worst_ticks(result: Result) -> list[WorstTick]:
    """Return at most one tick of each kind, none of what did not happen.

    Raises:
        InputError: The file cannot be read.
    """
    if result.ticks == 0:
        return []
    values: dict[WorstKind, np.ndarray] = {
        "slowest": 1e-9 * result["duration/total_cpu"],
        "deepest": result["penetration_depth"],
        "force-step": _force_steps(result),
        "lag": result["lag"],
    }
    found = []
    for kind, sizes in values.items():
        known = np.where(np.isfinite(sizes), sizes, 0.0)
        tick = int(np.argmax(known))
        if known[tick] > 0.0:
            found.append(WorstTick(kind, tick, _sentence(result, kind, tick, float(known[tick]), known)))
    return found


def _force_steps(result: Result) -> np.ndarray:
    """Return the one-tick change of the total force [N], shape (T,), as `hhsim.metrics.metrics.force_step` does.

    It is 0 in holds and wherever the tick before is not in the file.
    """
    moving = np.ones(result.ticks, bool)
    moving[0] = False
    for phase in result.phases:
        if phase.name == HOLD:
            moving &= ~metrics.phase_mask(result.ticks, phase.first_tick, phase.last_tick)
    if result.live is not None:
        moving[1:] &= np.diff(result[f"{LIVE_TICK}/record"]) == 1
    steps = np.zeros(result.ticks)
    steps[1:] = np.linalg.norm(np.diff(result["force/total"], axis=0), axis=1)
    return np.where(moving, steps, 0.0)


def _sentence(result: Result, kind: WorstKind, tick: int, value: float, values: np.ndarray) -> str:
    phase = result.phase_at(tick)
    where = f"tick {tick:,} at {result['time'][tick]:.3f} s" + (f", {phase}" if phase else "")
    if kind == "slowest":
        # Of the ticks that the table's median is of.
        contact = result["contacts/candidates"] > 0
        median = float(np.median(values[contact])) if contact.any() else 0.0
        ratio = f", {value / median:.1f} times the median of ticks in contact" if median > 0.0 else ""
        return f"The slowest tick took {1e6 * value:,.1f} µs of CPU time{ratio}: {where}."
    if kind == "deepest":
        return f"The deepest penetration is {1e6 * value:,.3f} µm: {where}."
    if kind == "force-step":
        return f"The total force changed most in one tick of motion, by {value:.3f} N: {where}."
    return f"The hand lagged most, {1e3 * value:.2f} mm behind what was asked: {where}."
