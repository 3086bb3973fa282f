"""Lines of phases and of fingers, and bands of curves, computed from the ticks of a result."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics import metrics
from hhsim.metrics.run_ticks import RunTicks
from hhsim.result.reader import Result
from hhsim.solver.method import TIMES

BLOCK_TICKS = 16_384
PHASE_COLUMNS = (
    *("contacts/candidates", "status", "duration/total_cpu"),
    *("force/total", "force_variation_rate", "penetration_depth"),
)
"""Datasets of /tick that the lines of phases are computed from, besides those of `read_ticks`."""
FORCE = "force/phalanx"


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
