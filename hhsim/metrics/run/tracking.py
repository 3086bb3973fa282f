"""Distance of the shown hand from the user's in the hold."""

from hhsim.metrics.metrics import palm_distance_mm, statistics
from hhsim.metrics.run_metric import Judged, RunMetric

HAPTIC, GRAPHIC = "haptic/position", "graphic/position"


METRICS = (
    RunMetric(
        *("tracking_excess", "coupling energy over the local optimum", 3, "%"),
        # Below the optimum of the hands that stay outside is a hand that is inside.
        signed=True,
        place=50,
        own_run="is against an optimum that only a solver can find",
        judged=Judged(rounding=1e-6, limit=1.0, promise="nearest_to_user"),
    ),
    RunMetric(
        *("tracking_palm", "palm off the user's in the hold, mean", 2, "mm"),
        place=51,
        needs=(HAPTIC, GRAPHIC),
        compute=lambda run: 1e-3 * statistics(palm_distance_mm(run[HAPTIC], run[GRAPHIC]), run.hold).mean,
        judged=Judged(rounding=1e-9, limit=0.02),
    ),
)
