"""How far from the true mesh the hand touches: an error like depth, to the other side."""

import numpy as np

from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import PLACED, RunTicks


def _largest(run: RunTicks) -> float:
    # Fmax leaves out the ticks without contact, and is undefined where there is no other.
    return float(np.fmax.reduce(run.contact_error, initial=np.nan))


METRICS = (
    RunMetric(
        name="contact_error_max",
        label="contacts off the mesh, max",
        digits=3,
        unit="mm",
        place=31,
        short="off the mesh",
        needs=PLACED,
        compute=_largest,
        judged=Judged(rounding=1e-9, limit=1e-3),
    ),
)
