"""Contacts of the shown hand: pairs near the object, penetration depth, and distance off the true mesh."""

import numpy as np

from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import PLACED

NO_DEPTH = 1e-6
"""Depth up to which nothing penetrates, or penetrates deeper than before [m]."""

METRICS = (
    RunMetric(
        *("candidates_max", "candidate pairs, most"),
        paper="whole hand: ≈ 250",
        less_is_better=False,
        place=10,
        needs=("contacts/candidates",),
        compute=lambda run: run["contacts/candidates"].max(initial=0),
    ),
    RunMetric(
        *("touching_max", "touching pairs, most"),
        less_is_better=False,
        place=11,
        needs=("contacts/touching",),
        compute=lambda run: run["contacts/touching"].max(initial=0),
    ),
    RunMetric(
        *("penetration_max", "penetration, max", 3, "µm"),
        paper="≈ 100",
        place=30,
        needs=("penetration_depth",),
        # A hand that is not finite has no depth, and hides none.
        compute=lambda run: np.fmax.reduce(run["penetration_depth"], initial=0.0),
        short="depth",
        judged=Judged(rounding=1e-9, limit=NO_DEPTH, growth=NO_DEPTH, promise="never_penetrates"),
    ),
    RunMetric(
        *("contact_error_max", "contacts off the mesh, max", 3, "mm"),
        place=31,
        short="off the mesh",
        needs=PLACED,
        # Ticks without contact are left out; NaN without any contact.
        compute=lambda run: float(np.fmax.reduce(run.contact_error, initial=np.nan)),
        judged=Judged(rounding=1e-9, limit=1e-3),
    ),
)
