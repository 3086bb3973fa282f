"""A result whose depths are computed from its poses, whatever the file's own columns say."""

from dataclasses import dataclass, fields

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.run_ticks import PLACED, result_ticks, touched_object
from hhsim.result.reader import Result

DEPTH, PALM, FINGER = "penetration_depth", "penetration_palm", "penetration_finger"
"""Datasets of /tick that follow from the poses."""
BLOCK_TICKS = 16_384
ROUNDING = 1e-9
"""Depths that differ by no more are the same [m]."""


@dataclass(frozen=True, repr=False)
class PosedResult(Result):
    """A result with depths [m] computed from its poses, and the deepest by the file's own column (NaN without one)."""

    stated_depth: float = np.nan

    @property
    def deepest(self) -> float:
        """Deepest penetration of all ticks, by their poses [m]."""
        return _deepest(self.replaced[DEPTH])

    def contradiction(self) -> str:
        """Return in a sentence where the file's own depth differs; "" where it agrees."""
        if self.ticks == 0 or abs(self.stated_depth - self.deepest) <= ROUNDING:
            return ""
        return (
            f"The file says that the deepest penetration is {1e6 * self.stated_depth:,.3f} µm; its poses are "
            f"{1e6 * self.deepest:,.3f} µm deep, and that is what is shown here. hhsim verify looks further."
        )


def posed_result(result: Result) -> PosedResult:
    """Compute the depths of a result from its poses, seen from its object, in its columns and in its summary.

    InputError if the file cannot be read, or its tree is damaged.
    """
    result = result.seen_from_object
    touched = touched_object(result)
    depths = {name: np.empty(result.ticks) for name in (DEPTH, PALM)} | {FINGER: np.empty((result.ticks, len(FINGERS)))}
    stated, first = 0.0, 0
    for block in result.blocks([*PLACED, DEPTH], BLOCK_TICKS):
        count = len(block[DEPTH])
        part = slice(first, first + count)
        found = touched.penetration(PlacedHand(*(block[name] for name in PLACED)), part)
        finite = np.logical_and.reduce([np.isfinite(block[name]).reshape(count, -1).all(1) for name in PLACED])
        for name, values in ((DEPTH, found.depth), (PALM, found.palm), (FINGER, found.finger)):
            values[~finite] = np.nan
            depths[name][part] = values
        stated, first = max(stated, _deepest(block[DEPTH])), part.stop
    given = {one.name: getattr(result, one.name) for one in fields(Result)}
    given |= {"summary": {**result.summary, **_figures(result, depths)}, "replaced": depths, "_loaded": {}}
    return PosedResult(**given, stated_depth=max(stated, float(result.summary.get("penetration_max", 0.0))))


def _deepest(depth: AnyArray) -> float:
    return float(np.fmax.reduce(depth[np.isfinite(depth)], initial=0.0))


def _figures(result: Result, depths: dict[str, AnyArray]) -> dict[str, float]:
    """Return figures of the summary that follow from depths alone."""
    ticks = result_ticks(result, depths)
    return {
        name: float(metric.compute(ticks))
        for name, metric in run_metrics().items()
        if name in result.summary and metric.compute is not None and metric.needs and set(metric.needs) <= depths.keys()
    }
