"""Claims about figures: the columns and the summary that follow from the other columns, computed anew."""

from dataclasses import replace

import numpy as np

from hhsim.hand.configuration import HandConfiguration
from hhsim.metrics.metrics import force_variation_rate
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import known_figures, run_metrics, tick_figures
from hhsim.metrics.run_ticks import ticks_alone
from hhsim.result.reader import Result
from hhsim.solver.method import EVERYTHING
from hhsim.verify.claim import NOT_JUDGED, Claim, as_number, difference, figures_apart, judged
from hhsim.verify.depth_checks import CONTACT_ERROR
from hhsim.verify.file_checks import follows
from hhsim.verify.input_hand_check import FIGURES as INPUT_HAND

SAME = 1e-9
"""Relative tolerance of figures: the rounding of sums in another order."""
IN_ITSELF = ("self_depth_haptic", "self_depth_graphic")
"""Depths of the hands in themselves, which have a claim of their own in a run with self-contact."""
ELSEWHERE = (CONTACT_ERROR, *INPUT_HAND, "free_off_max", *IN_ITSELF)
"""Figures that need object or hand; most have claims of their own, by the referee's distances."""
ROUNDING = {
    **dict.fromkeys(("force_ripple_hold", "force_variation_hold", "force_variation_hold_std"), 1e-09),
    "force_variation_contact": 1e-9,
    "tracking_palm": 1e-12,
    "object_momentum": 1e-9,
    "energy_gained": 1e-12,
}
"""Absolute tolerances of figures that are differences of large numbers [N, %, m]."""


def metric_claims(result: Result) -> list[Claim]:
    """Judge every figure that follows from the stored ticks."""
    ticks, first = np.arange(result.ticks), ~follows(result)
    says, claims = "the one-tick change of the force's size is that of the stored forces", []
    why = "forces of a hundredth of a newton have a change that is rounded to this"
    for name, column, force in (
        ("force variation", "force_variation_rate", result["force/total"]),
        ("finger variation", "force_variation_finger", result["force/phalanx"].sum(axis=2)),
    ):
        own = force_variation_rate(force)
        own[first] = np.nan
        off = difference(result[column], own) / np.maximum(1.0, np.nan_to_num(np.abs(own)))
        off = off.reshape(result.ticks, -1).max(axis=1)
        claims.append(judged(name, says, off, 1e-7, "%", why, ticks=ticks))
    # The figures of a session cover all its periods: `hhsim.verify.session_checks`.
    if result.complete and result.live is None:
        claims += _summary_claims(result)
    return claims


def _summary_claims(result: Result) -> list[Claim]:
    # Without the hand, whose kernels are not the referee's.
    figures = tick_figures(replace(ticks_alone(result), hand=None))
    own = {"ticks": float(result.ticks)}
    own |= {name: value for name, value in figures.items() if name not in ELSEWHERE}
    stored = {name: as_number(value) for name, value in result.summary.items()}
    known = {name: value for name, value in own.items() if name in stored}
    size = [np.nan_to_num(np.abs(value)) + ROUNDING.get(name, 0.0) / SAME for name, value in known.items()]
    off, wrong = figures_apart(stored, known, size, SAME, "the ticks give")
    gone = sorted(required_figures(result) - stored.keys())
    wrong += [f"{name} is not there" for name in gone]
    metrics = run_metrics()
    judged_apart = (CONTACT_ERROR, *INPUT_HAND, *(IN_ITSELF if result.scene["solver"].get("self_contact") else ()))
    rest = sorted(name for name in stored if name not in own and name not in judged_apart)
    invented = [name for name in rest if name not in metrics]
    wrong += [f"{name} has no definition" for name in invented]
    values = np.append(off, np.full(len(gone) + len(invented), np.inf))
    says = "the figures of the summary are those of the ticks, and no others"
    why = "sums in another order differ by less; 1e-9 N and 1e-9 % where rounding is all there is"
    claims = [judged("summary", says, values, SAME, "1", why, note="; ".join(wrong))]
    rest = [name for name in rest if name not in invented]
    if rest:
        note = "; ".join(f"{name} {metrics[name].own_run or 'is not computed here'}" for name in rest)
        claims.append(
            Claim("summary, rest", "figures that do not follow from the ticks", NOT_JUDGED, checked=0, note=note)
        )
    return claims


def required_figures(result: Result) -> set[str]:
    """Figures of a complete replay's summary; of a trembling hand only where a hold stands still."""
    known = known_figures([what for what in EVERYTHING if result.gives(what)])
    metrics = {name: metric for name, metric in run_metrics().items() if name in known}
    names = {"ticks"} | {
        name
        for name, metric in metrics.items()
        if not (metric.own_run or metric.moving_hold_only) and (result.free or not metric.free_only)
    }
    if result.free or result.parts:
        # No further run of the solver is of an object, or parts of it, that move.
        return names
    names.add("tracking_excess")
    hold = next((phase for phase in result.phases if phase.name == "hold"), None)
    if hold is not None and result.gives("forces") and result.gives("runs"):
        rows = slice(hold.first_tick, hold.last_tick + 1)
        haptic = [np.asarray(result[f"haptic/{name}"])[rows] for name in HandConfiguration._fields]
        if all(np.array_equal(values, np.broadcast_to(values[:1], values.shape)) for values in haptic):
            names |= {TREMBLING, f"{TREMBLING}_std"}
    return names
