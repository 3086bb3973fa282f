"""Penetration of each part of the hand, its largest and its mean: a deeper palm does not hide a finger's."""

from functools import partial

import numpy as np

from hhsim.hand.fingers import FINGERS
from hhsim.metrics.run.contact import NO_DEPTH
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks

PARTS = ("palm", *FINGERS)


def _depth(run: RunTicks, part: int, mean: bool) -> float:
    """Largest or mean depth of a part in all ticks [m]; NaN for a finger that is not modelled."""
    depth = run["penetration_palm"] if part == 0 else run["penetration_finger"][:, part - 1]
    depth = depth[~np.isnan(depth)]
    return float(np.mean(depth) if mean else np.max(depth)) if depth.size else np.nan


PART_DEPTHS = {
    metric.name: metric
    for part, name in enumerate(PARTS)
    for of, mean in (("max", False), ("mean", True))
    for metric in (
        RunMetric(
            *(f"penetration_{name}_{of}", f"penetration, {name}, {of}", 3, "µm"),
            needs=("penetration_palm" if part == 0 else "penetration_finger",),
            compute=partial(_depth, part=part, mean=mean),
            judged=Judged(rounding=1e-9, growth=NO_DEPTH),
        ),
    )
}
"""Figures of palm and fingers by name."""
