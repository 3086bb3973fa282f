"""Curves of a report: a number a tick, in the units of the page, of results of any length."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.result.reader import Result
from hhsim.result.schema import LIVE_TICK
from hhsim.view.plots import force_values

SingleArray = NDArray[np.float32]

BLOCK = 16_384
FORCES = ("resultant", *FINGERS, "palm")
"""Columns of `ReportColumns.force`."""
STIFFNESS = f"{LIVE_TICK}/command_stiffness"


@dataclass(frozen=True, eq=False)
class ReportColumns:
    """Ticks of a result, shapes (T,), in single precision: ten minutes at 1 kHz are 40 MB.

    Attributes:
        time: Time since the start of the motion [s], in double precision.
        cpu: CPU time of the whole tick [s].
        candidates, touching: Number of pairs.
        depth: Deepest penetration [m].
        variation: One-tick change of the total force's size [%]; NaN where undefined.
        force: Sizes of forces by `FORCES` [N], shape (T, 7).
        stiffness: Stiffness sent to each finger, 0 free to 1, shape (T, 5); None of a replay.
    """

    time: FloatArray
    cpu: SingleArray
    candidates: SingleArray
    touching: SingleArray
    depth: SingleArray
    variation: SingleArray
    force: SingleArray
    stiffness: SingleArray | None = None

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.time)


SCALES = {
    "cpu": ("duration/total_cpu", 1e-9),
    "candidates": ("contacts/candidates", 1.0),
    "touching": ("contacts/touching", 1.0),
    "depth": ("penetration_depth", 1.0),
    "variation": ("force_variation_rate", 1.0),
}
"""Dataset and unit of the columns that are stored as such."""


def report_columns(result: Result) -> ReportColumns:
    """Read a result block by block; raise InputError if the file cannot be read."""
    time = np.empty(result.ticks)
    single = {name: np.empty(result.ticks, np.float32) for name in SCALES}
    force = np.empty((result.ticks, len(FORCES)), np.float32)
    stiffness = np.empty((result.ticks, len(FINGERS)), np.float32) if result.live is not None else None
    first = 0
    names = ["time", "force/phalanx", "force/total", *(dataset for dataset, _ in SCALES.values())]
    names += [STIFFNESS] if stiffness is not None else []
    for block in result.blocks(names, BLOCK):
        part = slice(first, first + len(block["time"]))
        time[part] = block["time"]
        for name, (dataset, scale) in SCALES.items():
            single[name][part] = scale * block[dataset]
        force[part] = force_values(block["force/phalanx"], block["force/total"])
        if stiffness is not None:
            stiffness[part] = block[STIFFNESS]
        first = part.stop
    return ReportColumns(time=time, force=force, stiffness=stiffness, **single)


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
