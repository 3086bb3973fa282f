"""How deep the user's hand was in the object, and how far the shown hand had to go from it."""

import numpy as np

from hhsim.metrics.metrics import statistics
from hhsim.metrics.run_metric import RunMetric
from hhsim.metrics.run_ticks import PLACED, TOUCHING, RunTicks

HAPTIC = tuple(f"haptic/{name}" for name in ("position", "orientation", "flexion", "abduction"))
LABELS = {"palm": "palm", "joint": "joints"}
NEEDS = (*HAPTIC, *PLACED, TOUCHING)


def _depth(run: RunTicks) -> float:
    return np.nan if run.input_hand is None else run.input_hand.depth


def _correction(part: str, statistic: str, place: int, field: str, short: str = "") -> RunMetric:
    """How far a part of the shown hand is from the user's in contact: a field of `Correction`, by a `Statistics`."""

    def compute(run: RunTicks) -> float:
        if run.input_hand is None:
            return np.nan
        return float(getattr(statistics(getattr(run.input_hand.correction, field)), statistic))

    name, label = f"correction_{part}_{statistic}", f"{LABELS[part]} off the input in contact, {statistic}"
    return RunMetric(
        name, label, 2, "mm", 1e-3, less_is_better=False, place=place, short=short, needs=NEEDS, compute=compute
    )


METRICS = (
    RunMetric(
        name="input_depth_max",
        label="input depth, max",
        digits=2,
        unit="mm",
        scale=1e-3,
        less_is_better=False,
        place=29,
        short="input depth",
        needs=NEEDS,
        compute=_depth,
    ),
    _correction("palm", "mean", 52, "palm"),
    _correction("palm", "max", 53, "palm"),
    _correction("joint", "mean", 54, "joints", short="correction"),
    _correction("joint", "max", 55, "farthest"),
)
