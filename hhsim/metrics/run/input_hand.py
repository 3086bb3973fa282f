"""Distance of the shown hand from the user's, in the hold against the nearest possible too."""

from collections.abc import Callable

import numpy as np

from hhsim.metrics.metrics import statistics
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import PLACED, TOUCHING, RunTicks

HAPTIC = tuple(f"haptic/{name}" for name in ("position", "orientation", "flexion", "abduction"))
USER, SHOWN = "haptic/position", "graphic/position"
LABELS = {"palm": "palm", "joint": "joints"}
NEEDS = (*HAPTIC, *PLACED, TOUCHING)


def of_input(field: str) -> Callable[[RunTicks], float]:
    """Return the computation of a field of `InputHand`."""
    return lambda run: np.nan if run.input_hand is None else float(getattr(run.input_hand, field))


def _correction(part: str, statistic: str, field: str, short: str = "") -> RunMetric:
    """Figure of a part's distance in contact: a field of `Correction`, by a `Statistics`."""

    def compute(run: RunTicks) -> float:
        if run.input_hand is None:
            return np.nan
        return float(getattr(statistics(getattr(run.input_hand.correction, field)), statistic))

    name, label = f"correction_{part}_{statistic}", f"{LABELS[part]} off the input in contact, {statistic}"
    return RunMetric(name, label, 2, "mm", less_is_better=False, short=short, needs=NEEDS, compute=compute)


METRICS = (
    RunMetric(
        "tracking_excess", "coupling energy over the local optimum", digits=3, unit="%",
        # Below the optimum of the hands that stay outside is a hand that is inside.
        signed=True, own_run="is against an optimum that only a solver can find",
        judged=Judged(rounding=1e-6, limit=1.0, promise="nearest_to_user"),
    ),
    RunMetric(
        "tracking_palm", "palm off the user's in the hold, mean", digits=2, unit="mm", needs=(USER, SHOWN),
        compute=lambda run: statistics(np.linalg.norm(run[USER] - run[SHOWN], axis=1), run.hold).mean,
        judged=Judged(rounding=1e-9, limit=0.02),
    ),
    _correction("palm", "mean", "palm"),
    _correction("palm", "max", "palm"),
    _correction("joint", "mean", "joints", short="correction"),
    _correction("joint", "max", "farthest"),
    RunMetric(
        "free_off_max", "joints off the input in free space, max", digits=2, unit="mm",
        needs=(*NEEDS, "contacts/candidates"), compute=of_input("free"),
        # `penalty`, whose hand has a mass, is up to 1.3 mm behind a grasping hand; 20 ticks of a frozen one are 4 mm.
        judged=Judged(rounding=1e-6, limit=5e-3, promise="follows_input"),
    ),
)  # fmt: skip
