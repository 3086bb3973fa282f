"""Penetration of each part of the hand, its largest and its mean: a deeper palm does not hide a finger's."""

from functools import partial

import numpy as np

from hhsim.hand.fingers import FINGERS
from hhsim.metrics.run.contact import NO_DEPTH
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks


def _depth(run: RunTicks, finger: int, mean: bool) -> float:
    """Largest or mean depth of a finger, or of the palm (-1), in all ticks [m]; NaN for one that is not modelled."""
    depth = run["penetration_palm"] if finger < 0 else run["penetration_finger"][:, finger]
    depth = depth[~np.isnan(depth)]
    return float(np.mean(depth) if mean else np.max(depth)) if depth.size else np.nan


PART_DEPTHS = {
    (name := f"penetration_{part}_{of}"): RunMetric(
        *(name, f"penetration, {part}, {of}", 3, "µm"),
        compute=partial(_depth, finger=finger, mean=of == "mean"),
        judged=Judged(rounding=1e-9, growth=NO_DEPTH),
    )
    for finger, part in enumerate(("palm", *FINGERS), -1)
    for of in ("max", "mean")
}
"""Figures of palm and fingers by name."""
