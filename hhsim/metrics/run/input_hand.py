"""How deep the user's hand was in the object, and how far the shown hand had to go from it."""

import numpy as np

from hhsim.metrics.metrics import statistics
from hhsim.metrics.run_metric import RunMetric
from hhsim.metrics.run_ticks import PLACED, TOUCHING, RunTicks

HAPTIC = tuple(f"haptic/{name}" for name in ("position", "orientation", "flexion", "abduction"))
NEEDS = (*HAPTIC, *PLACED, TOUCHING)


def _depth(run: RunTicks) -> float:
    return np.nan if run.input_hand is None else run.input_hand.depth


def _mean(run: RunTicks, name: str) -> float:
    return np.nan if run.input_hand is None else statistics(getattr(run.input_hand.correction, name)).mean


def _most(run: RunTicks, name: str) -> float:
    return np.nan if run.input_hand is None else statistics(getattr(run.input_hand.correction, name)).max


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
    RunMetric(
        name="correction_palm_mean",
        label="palm off the input in contact, mean",
        digits=2,
        unit="mm",
        scale=1e-3,
        less_is_better=False,
        place=52,
        needs=NEEDS,
        compute=lambda run: _mean(run, "palm"),
    ),
    RunMetric(
        name="correction_palm_max",
        label="palm off the input in contact, max",
        digits=2,
        unit="mm",
        scale=1e-3,
        less_is_better=False,
        place=53,
        needs=NEEDS,
        compute=lambda run: _most(run, "palm"),
    ),
    RunMetric(
        name="correction_joint_mean",
        label="joints off the input in contact, mean",
        digits=2,
        unit="mm",
        scale=1e-3,
        less_is_better=False,
        place=54,
        short="correction",
        needs=NEEDS,
        compute=lambda run: _mean(run, "joints"),
    ),
    RunMetric(
        name="correction_joint_max",
        label="joints off the input in contact, max",
        digits=2,
        unit="mm",
        scale=1e-3,
        less_is_better=False,
        place=55,
        needs=NEEDS,
        compute=lambda run: _most(run, "farthest"),
    ),
)
