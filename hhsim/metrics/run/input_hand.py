"""Depth of the user's hand, and its distance from the shown one, in the hold against the nearest possible too."""

from collections.abc import Callable

import numpy as np

from hhsim.metrics.metrics import palm_distance_mm, statistics
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import PLACED, TOUCHING, RunTicks

HAPTIC = tuple(f"haptic/{name}" for name in ("position", "orientation", "flexion", "abduction"))
USER, SHOWN = "haptic/position", "graphic/position"
LABELS = {"palm": "palm", "joint": "joints"}
NEEDS = (*HAPTIC, *PLACED, TOUCHING)


def _of_input(field: str) -> Callable[[RunTicks], float]:
    return lambda run: np.nan if run.input_hand is None else float(getattr(run.input_hand, field))


def _correction(part: str, statistic: str, place: int, field: str, short: str = "") -> RunMetric:
    """Figure of a part's distance in contact: a field of `Correction`, by a `Statistics`."""

    def compute(run: RunTicks) -> float:
        if run.input_hand is None:
            return np.nan
        return float(getattr(statistics(getattr(run.input_hand.correction, field)), statistic))

    name, label = f"correction_{part}_{statistic}", f"{LABELS[part]} off the input in contact, {statistic}"
    return RunMetric(name, label, 2, "mm", less_is_better=False, place=place, short=short, needs=NEEDS, compute=compute)


def _in_itself(whose: str) -> Callable[[RunTicks], float]:
    def compute(run: RunTicks) -> float:
        if run.hand is None:
            return np.nan
        # A hand that is not finite has no depth, and hides none.
        return float(np.fmax.reduce(-run.self_clearance(whose), initial=0.0))

    return compute


METRICS = (
    RunMetric(
        *("self_depth_haptic", "input hand in itself, max", 2, "mm"),
        less_is_better=False,
        place=29,
        needs=("haptic/flexion", "haptic/abduction"),
        compute=_in_itself("haptic"),
        unless_zero=True,
    ),
    RunMetric(
        *("self_depth_graphic", "shown hand in itself, max", 2, "mm"),
        place=31,
        needs=("graphic/flexion", "graphic/abduction"),
        compute=_in_itself("graphic"),
        unless_zero=True,
    ),
    RunMetric(
        *("input_depth_max", "input depth, max", 2, "mm"),
        less_is_better=False,
        place=29,
        short="input depth",
        needs=NEEDS,
        compute=_of_input("depth"),
    ),
    _correction("palm", "mean", 52, "palm"),
    _correction("palm", "max", 53, "palm"),
    _correction("joint", "mean", 54, "joints", short="correction"),
    _correction("joint", "max", 55, "farthest"),
    RunMetric(
        *("free_off_max", "joints off the input in free space, max", 2, "mm"),
        place=55,
        needs=(*NEEDS, "contacts/candidates"),
        compute=_of_input("free"),
        # `penalty`, whose hand has a mass, is up to 1.3 mm behind a grasping hand; 20 ticks of a frozen one are 4 mm.
        judged=Judged(rounding=1e-6, limit=5e-3, promise="follows_input"),
    ),
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
        needs=(USER, SHOWN),
        compute=lambda run: 1e-3 * statistics(palm_distance_mm(run[USER], run[SHOWN]), run.hold).mean,
        judged=Judged(rounding=1e-9, limit=0.02),
    ),
)
