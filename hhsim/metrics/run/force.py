"""The force that a user would feel: in contact; in the hold, input still or trembling; and while the hand moves."""

import math

import numpy as np

from hhsim.metrics.metrics import FORCE_FLOOR, Statistics, contact_force_step, force_ripple, force_step, statistics
from hhsim.metrics.run_metric import Figure, Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks

TOTAL, VARIATION, TOUCHING = "force/total", "force_variation_rate", "contacts/touching"
TREMBLING = "force_variation_tremor"
"""The figure that only a hold with frozen input has: that hold again, by a hand that trembles."""
ANOTHER_RUN = "is of a run of its own, which the file does not hold"


def _variation(run: RunTicks) -> Statistics:
    return statistics(run[VARIATION], run.hold)


def _ripple(run: RunTicks) -> float:
    # The worst hold of those that are long enough.
    return statistics([force_ripple(run[TOTAL][part], run.rate) for part in run.holds]).max


def _in_contact(run: RunTicks) -> Statistics:
    return statistics(np.linalg.norm(run[TOTAL], axis=1), run.touch)


def _step(run: RunTicks) -> float:
    return contact_force_step(run[TOTAL], run.touch, run.breaks)


def _step_share(run: RunTicks) -> float:
    mean = _in_contact(run).mean
    return 100.0 * _step(run) / mean if mean >= FORCE_FLOOR else math.nan


METRICS = (
    RunMetric(
        name="force_contact_mean",
        label="force in contact, mean",
        digits=2,
        unit="N",
        less_is_better=False,
        place=36,
        needs=(TOTAL, TOUCHING),
        compute=lambda run: _in_contact(run).mean,
        short="force",
    ),
    RunMetric(
        name="force_contact_max",
        label="force in contact, largest",
        digits=2,
        unit="N",
        less_is_better=False,
        place=37,
        needs=(TOTAL, TOUCHING),
        compute=lambda run: _in_contact(run).max,
    ),
    RunMetric(
        name="force_contact_step",
        label="largest force step in contact",
        digits=3,
        unit="N",
        place=38,
        needs=(TOTAL, TOUCHING),
        compute=_step,
        per_tick=True,
        judged=Judged(rounding=1e-9),
        short="force step",
    ),
    RunMetric(
        name="force_contact_step_share",
        label="largest force step in contact, of the mean",
        digits=1,
        unit="%",
        place=39,
        needs=(TOTAL, TOUCHING),
        compute=_step_share,
        per_tick=True,
        judged=Judged(rounding=1e-6),
    ),
    RunMetric(
        name="force_variation_contact",
        label="force variation in contact, mean",
        digits=4,
        unit="%",
        place=39,
        needs=(VARIATION, TOTAL, TOUCHING),
        compute=lambda run: statistics(run[VARIATION], run.touch).mean,
        per_tick=True,
        judged=Judged(rounding=1e-6),
        short="variation",
    ),
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
        short="variation",
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
        needs=(TOTAL,),
        own_run=ANOTHER_RUN,
        per_tick=True,
        judged=Judged(rounding=1e-6, limit=0.5),
        short="variation",
    ),
    RunMetric(
        name="force_variation_tremor_std",
        label="force variation in the hold, trembling hand, std",
        digits=4,
        unit="%",
        paper="0.32",
        place=44,
        needs=(TOTAL,),
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
