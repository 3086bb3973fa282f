"""How deep the shown hand is in the object's surface."""

import numpy as np

from hhsim.metrics.run_metric import Judged, RunMetric

METRICS = (
    RunMetric(
        name="penetration_max",
        label="penetration, max",
        digits=3,
        unit="µm",
        paper="≈ 100",
        place=30,
        needs=("penetration_depth",),
        # A hand that is not finite has no depth, and hides none.
        compute=lambda run: np.fmax.reduce(run["penetration_depth"], initial=0.0),
        short="depth",
        judged=Judged(rounding=1e-9, limit=1e-6, promise="never_penetrates"),
    ),
)
