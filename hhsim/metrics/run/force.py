"""The force that a user would feel: in the hold, with the input still or trembling, and while the hand moves."""

import numpy as np

from hhsim.metrics.metrics import Statistics, force_ripple, force_step, statistics
from hhsim.metrics.run_metric import Figure, Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks

TOTAL, VARIATION = "force/total", "force_variation_rate"
TREMBLING = "force_variation_tremor"
"""The figure that only a hold with frozen input has: that hold again, by a hand that trembles."""
ANOTHER_RUN = "is of a run of its own, which the file does not hold"


def _variation(run: RunTicks) -> Statistics:
    return statistics(run[VARIATION], run.hold)


def _ripple(run: RunTicks) -> float:
    # The worst hold of those that are long enough.
    return statistics([force_ripple(run[TOTAL][part], run.rate) for part in run.holds]).max


METRICS = (
    RunMetric(
        name="force_hold_mean",
        label="force in the hold, mean",
        digits=2,
        unit="N",
        less_is_better=False,
        place=40,
        needs=(TOTAL,),
        compute=lambda run: statistics(np.linalg.norm(run[TOTAL], axis=1), run.hold).mean,
    ),
    RunMetric(
        name="force_variation_hold",
        label="force variation in the hold, frozen input",
        digits=6,
        unit="%",
        place=41,
        needs=(VARIATION,),
        compute=lambda run: _variation(run).mean,
        per_tick=True,
        judged=Judged(rounding=1e-6),
        moving_hold=Figure("force_variation_hold", "force variation in the hold, mean", 4, "%", paper="0.18"),
    ),
    RunMetric(
        name="force_variation_hold_std",
        label="force variation in the hold, std",
        digits=4,
        unit="%",
        paper="0.32",
        place=42,
        needs=(VARIATION,),
        compute=lambda run: _variation(run).std,
        per_tick=True,
        # Of a frozen hold the spread says nothing that its mean does not.
        moving_hold_only=True,
    ),
    RunMetric(
        name=TREMBLING,
        label="force variation in the hold, trembling hand, mean",
        digits=4,
        unit="%",
        paper="0.18",
        place=43,
        own_run=ANOTHER_RUN,
        per_tick=True,
        judged=Judged(rounding=1e-6, limit=0.5),
    ),
    RunMetric(
        name="force_variation_tremor_std",
        label="force variation in the hold, trembling hand, std",
        digits=4,
        unit="%",
        paper="0.32",
        place=44,
        own_run=ANOTHER_RUN,
        per_tick=True,
    ),
    RunMetric(
        name="force_ripple_hold",
        label="force ripple in the hold, 50 to 400 Hz",
        digits=5,
        unit="N",
        place=45,
        needs=(TOTAL,),
        compute=_ripple,
        judged=Judged(rounding=1e-9, limit=1e-3),
    ),
    RunMetric(
        name="force_step",
        label="largest force step while moving",
        digits=1,
        unit="% of hold",
        place=46,
        needs=(TOTAL,),
        compute=lambda run: force_step(run[TOTAL], ~run.hold, run.hold),
        judged=Judged(rounding=1e-6, limit=20.0),
    ),
)
