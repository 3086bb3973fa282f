"""Force that a user would feel: in contact, in the hold with still or trembling input, and while the hand moves."""

import math

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.metrics.metrics import FORCE_FLOOR, Statistics, contact_force_step, force_ripple, force_step, statistics
from hhsim.metrics.run_metric import Figure, Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks

TOTAL, PHALANX = "force/total", "force/phalanx"
VARIATION, TOUCHING = "force_variation_rate", "contacts/touching"
FELT = 20.0
"""Largest step of the force [% of its mean]: three times what a hand notices, 7 % (Pang, Tan & Durlach 1991), since a
user who closes the hand fast makes steps, too."""
TREMBLING = "force_variation_tremor"
"""Figure of the hold repeated with a trembling hand; only for a hold with frozen input."""
ANOTHER_RUN = "is of a run of its own, which the file does not hold"


def _variation(run: RunTicks) -> Statistics:
    return statistics(run[VARIATION], run.hold)


def _in_contact(run: RunTicks) -> Statistics:
    return statistics(np.linalg.norm(run[TOTAL], axis=1), run.touch)


def _step(run: RunTicks) -> float:
    return contact_force_step(run[TOTAL], run.touch, run.breaks)


def _pressed(run: RunTicks) -> FloatArray:
    # Fingers that oppose each other leave little in the total, however hard they press.
    phalanx = run[PHALANX].reshape(-1, 15, 3)
    palm = run[TOTAL] - phalanx.sum(axis=1)
    return np.asarray(np.linalg.norm(phalanx, axis=2).sum(axis=1) + np.linalg.norm(palm, axis=1))


def _step_share(run: RunTicks) -> float:
    mean = statistics(_pressed(run), run.touch).mean
    return 100.0 * _step(run) / mean if mean >= FORCE_FLOOR else math.nan


METRICS = (
    RunMetric(
        "force_contact_mean", "force in contact, mean", digits=2, unit="N", less_is_better=False,
        needs=(TOTAL, TOUCHING), compute=lambda run: _in_contact(run).mean, short="force",
    ),
    RunMetric(
        "force_contact_max", "force in contact, largest", digits=2, unit="N", less_is_better=False,
        needs=(TOTAL, TOUCHING), compute=lambda run: _in_contact(run).max,
    ),
    RunMetric(
        "force_contact_step", "largest force step in contact", digits=3, unit="N", needs=(TOTAL, TOUCHING),
        compute=_step, judged=Judged(rounding=1e-9), short="force step",
    ),
    RunMetric(
        "force_contact_step_share", "largest force step in contact, of the mean", digits=1, unit="%",
        needs=(TOTAL, PHALANX, TOUCHING), compute=_step_share, judged=Judged(rounding=1e-6, limit=FELT),
    ),
    RunMetric(
        "force_variation_contact", "force variation in contact, mean", digits=4, unit="%",
        needs=(VARIATION, TOTAL, TOUCHING), compute=lambda run: statistics(run[VARIATION], run.touch).mean,
        judged=Judged(rounding=1e-6), short="variation",
    ),
    RunMetric(
        "force_hold_mean", "force in the hold, mean", digits=2, unit="N", less_is_better=False, needs=(TOTAL,),
        compute=lambda run: statistics(np.linalg.norm(run[TOTAL], axis=1), run.hold).mean,
    ),
    RunMetric(
        "force_variation_hold", "force variation in the hold, frozen input", digits=6, unit="%", needs=(VARIATION,),
        compute=lambda run: _variation(run).mean, judged=Judged(rounding=1e-6),
        moving_hold=Figure("force_variation_hold", "force variation in the hold, mean", 4, "%"),
        short="variation",
    ),
    RunMetric(
        "force_variation_hold_std", "force variation in the hold, std", digits=4, unit="%",
        needs=(VARIATION,), compute=lambda run: _variation(run).std,
        # Of a frozen hold the spread says nothing that its mean does not.
        moving_hold_only=True,
    ),
    RunMetric(
        TREMBLING, "force variation in the hold, trembling hand, mean", digits=4, unit="%",
        needs=(TOTAL,), own_run=ANOTHER_RUN, judged=Judged(rounding=1e-6, limit=0.5), short="variation",
    ),
    RunMetric(
        "force_variation_tremor_std", "force variation in the hold, trembling hand, std", digits=4, unit="%",
        needs=(TOTAL,), own_run=ANOTHER_RUN,
    ),
    RunMetric(
        "force_ripple_hold", "force ripple in the hold, 50 to 400 Hz", digits=5, unit="N", needs=(TOTAL,),
        # The worst hold of those that are long enough.
        compute=lambda run: statistics([force_ripple(run[TOTAL][part], run.rate) for part in run.holds]).max,
        judged=Judged(rounding=1e-9, limit=1e-3),
    ),
    RunMetric(
        "force_step", "largest force step while moving", digits=1, unit="% of hold",
        needs=(TOTAL, PHALANX),
        compute=lambda run: force_step(run[TOTAL], ~run.hold, run.hold, _pressed(run)),
        judged=Judged(rounding=1e-6, limit=20.0),
    ),
)  # fmt: skip
