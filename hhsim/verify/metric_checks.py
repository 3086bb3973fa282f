"""Claims about figures: the columns and the summary that follow from other columns, computed anew by other code."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import known_figures, run_metrics
from hhsim.result.reader import Result
from hhsim.solver.method import EVERYTHING
from hhsim.verify.claim import NOT_JUDGED, Claim, difference, judged, told_apart
from hhsim.verify.depth_checks import CONTACT_ERROR
from hhsim.verify.file_checks import follows
from hhsim.verify.free_object_checks import free_figures
from hhsim.verify.input_hand_check import FIGURES as INPUT_HAND

SAME = 1e-9
"""Relative tolerance of figures: the rounding of sums in another order."""
FLOOR = 0.01
REQUIRED = (
    *("candidates_max", "touching_max", "penetration_max", "force_hold_mean", "force_variation_hold"),
    *("force_ripple_hold", "force_step", "tracking_excess", "tracking_palm"),
    *("tick_cpu_p50", "tick_cpu_p99", "tick_cpu_max", "tick_wall_p50", "tick_wall_over_1ms", "ticks"),
    *("fingers_modelled", "bodies_near", "rows_max", "tests_mean", "tests_share", "work_mean"),
    *("stuck_ticks", "lag_ticks", "lag_max"),
)
"""Figures of every complete summary of a replay; other figures may be absent from older files."""
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
    force, fingers = np.asarray(result["force/total"]), np.asarray(result["force/phalanx"]).sum(axis=2)
    ticks, first = np.arange(result.ticks), ~follows(result)
    says, claims = "the one-tick change of the force's size is that of the stored forces", []
    why = "forces of a hundredth of a newton have a change that is rounded to this"
    for name, column, own in (
        ("force variation", "force_variation_rate", change_rate(force, first)),
        ("finger variation", "force_variation_finger", change_rate(fingers, first)),
    ):
        off = difference(result[column], own) / np.maximum(1.0, np.nan_to_num(np.abs(own)))
        off = off.reshape(result.ticks, -1).max(axis=1)
        claims.append(judged(name, says, off, 1e-7, "%", why, ticks=ticks))
    # The figures of a session cover all its periods: `hhsim.verify.session_checks`.
    if result.complete and result.live is None:
        claims += _summary_claims(result)
    return claims


def change_rate(force: FloatArray, first: NDArray[np.bool_]) -> FloatArray:
    """One-tick change of the size of forces (T, ..., 3) [N], in %; NaN below 0.01 N and at ticks that are `first`."""
    size = np.sqrt(np.einsum("...i,...i->...", force, force))
    rate = np.full(size.shape, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        change = 100.0 * np.abs(size[1:] / size[:-1] - 1.0)
    rate[1:] = np.where(size[:-1] < FLOOR, np.nan, change)
    rate[first] = np.nan
    return rate


def _summary_claims(result: Result) -> list[Claim]:
    own = own_summary(result)
    stored = {name: _number(value) for name, value in result.summary.items()}
    off = {}
    for name, value in own.items():
        if name in stored:
            tolerance = np.nan_to_num(np.abs(value)) + ROUNDING.get(name, 0.0) / SAME
            apart = float(difference(np.array(stored[name]), np.array(value)))
            off[name] = apart / tolerance if tolerance > 0.0 else np.inf if apart > 0.0 else 0.0
    wrong = [
        "{} is stored as {}, the ticks give {}".format(name, *told_apart(stored[name], own[name]))
        for name, value in off.items()
        if value > SAME
    ]
    gone = [name for name in required_figures(result) if name not in stored]
    wrong += [f"{name} is not there" for name in gone]
    metrics = run_metrics()
    rest = sorted(name for name in stored if name not in own and name not in (CONTACT_ERROR, *INPUT_HAND))
    invented = [name for name in rest if name not in metrics]
    wrong += [f"{name} has no definition" for name in invented]
    values = np.concatenate([list(off.values()), np.full(len(gone) + len(invented), np.inf)])
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


def _number(value: Any) -> float:
    """A figure as the file has it; NaN for what is no number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("nan")


def required_figures(result: Result) -> list[str]:
    """Figures of a complete replay's summary; of a trembling hand only where a hold stands still."""
    known = known_figures([what for what in EVERYTHING if result.gives(what)])
    names = [name for name in REQUIRED if name in {*known, "ticks"}]
    if result.free:
        # No further run of the solver is of an object that moves.
        return [name for name in names if name != "tracking_excess"]
    if not (result.gives("forces") and result.gives("runs")):
        return names
    hold = next((phase for phase in result.phases if phase.name == "hold"), None)
    if hold is not None:
        rows = slice(hold.first_tick, hold.last_tick + 1)
        haptic = [np.asarray(result[f"haptic/{name}"])[rows] for name in HandConfiguration._fields]
        if all(np.array_equal(values, np.broadcast_to(values[:1], values.shape)) for values in haptic):
            names += [TREMBLING, f"{TREMBLING}_std"]
    return names


def own_summary(result: Result) -> dict[str, float]:
    """Compute the summary's figures by their documented definitions; SI, or % where so defined."""
    force, status = np.asarray(result["force/total"]), np.asarray(result["status"])
    size = np.sqrt((force**2).sum(axis=1))
    hold = np.zeros(result.ticks, bool)
    ripples = []
    for phase in result.phases:
        if phase.name == "hold":
            rows = slice(phase.first_tick, phase.last_tick + 1)
            hold[rows] = True
            ripples.append(_ripple(force[rows], float(result.scene.get("rate", 1000.0))))
    contact = np.asarray(result["contacts/candidates"]) > 0
    cpu, wall = (1e-9 * np.asarray(result[f"duration/{name}"], np.float64) for name in ("total_cpu", "total"))
    every = change_rate(force, ~follows(result))
    variation = every[hold]
    variation = variation[~np.isnan(variation)]
    apart = np.asarray(result["haptic/position"]) - np.asarray(result["graphic/position"])
    step = np.sqrt(((force[1:] - force[:-1]) ** 2).sum(axis=1))[~hold[1:]]
    tests = np.asarray(result["work/node_tests"], np.float64) + np.asarray(result["work/pair_tests"])
    level = result.static["object/tree/level"]
    pairs = (15 + len(result.static["hand/palm_radius"])) * int((level == level.max()).sum())
    held_force = _mean(size[hold])
    touch = (np.asarray(result["contacts/touching"]) > 0) | (size > 0.0)
    touched_force = _mean(size[touch])
    jerk = np.sqrt(((force[1:] - force[:-1]) ** 2).sum(axis=1))[(touch[1:] | touch[:-1]) & follows(result)[1:]]
    felt = _quantile(jerk, 1.0)
    return {
        "ticks": float(result.ticks),
        "candidates_max": float(result["contacts/candidates"].max(initial=0)),
        "touching_max": float(result["contacts/touching"].max(initial=0)),
        "tick_cpu_p50": _quantile(cpu[contact], 0.50),
        "tick_cpu_p99": _quantile(cpu[contact], 0.99),
        "tick_cpu_max": _quantile(cpu, 1.0),
        "tick_wall_p50": _quantile(wall[contact], 0.50),
        "tick_wall_over_1ms": 100.0 * _mean((np.asarray(result["duration/total"]) > 1_000_000).astype(float)),
        "penetration_max": float(result["penetration_depth"].max(initial=0.0)),
        "force_contact_mean": touched_force,
        "force_contact_max": _quantile(size[touch], 1.0),
        "force_contact_step": felt,
        "force_contact_step_share": 100.0 * felt / touched_force if touched_force >= FLOOR else np.nan,
        "force_variation_contact": _mean(every[touch & ~np.isnan(every)]),
        "force_hold_mean": held_force,
        "force_variation_hold": _mean(variation),
        "force_variation_hold_std": float(np.sqrt(_mean((variation - _mean(variation)) ** 2))),
        "force_ripple_hold": max((ripple for ripple in ripples if ripple >= 0.0), default=np.nan),
        "force_step": 100.0 * step.max() / held_force if step.size and held_force >= FLOOR else np.nan,
        "tracking_palm": _mean(np.sqrt((apart[hold] ** 2).sum(axis=1))),
        "fingers_modelled": float(len(result.scene["solver"]["fingers"])),
        "bodies_near": _mean(np.asarray(result["work/bodies"])[contact]),
        "rows_max": float(result["work/rows"].max(initial=0)),
        "tests_mean": _mean(tests),
        "tests_share": 100.0 * _mean(tests) / pairs,
        "work_mean": _mean(np.asarray(result["work/units"])),
        "stuck_ticks": float((status & 1 > 0).sum()),
        "lag_ticks": float((status & 2 > 0).sum()),
        "lag_max": float(result["lag"].max(initial=0.0)),
        **free_figures(result),
    }


def _mean(values: NDArray[np.float64]) -> float:
    return float(np.sum(values) / len(values)) if len(values) else float("nan")


def _quantile(values: FloatArray, share: float) -> float:
    """Quantile by linear interpolation between ticks."""
    if values.size == 0:
        return float("nan")
    ordered = np.sort(values)
    place = share * (len(ordered) - 1)
    below = int(place)
    above = min(below + 1, len(ordered) - 1)
    return float(ordered[below] + (place - below) * (ordered[above] - ordered[below]))


def _ripple(force: FloatArray, rate: float) -> float:
    """RMS [N] between 50 and 400 Hz by scipy's periodogram with a Hann window, without the best line."""
    from scipy.signal import detrend, periodogram

    # A method that has no forces has none that shakes.
    if len(force) < 4.0 * rate / 50.0 or rate <= 100.0 or not np.isfinite(force).all():
        return float("nan")
    frequency, density = periodogram(detrend(force, axis=0), rate, window="hann", detrend=False, axis=0)
    band = (frequency >= 50.0) & (frequency <= 400.0)
    return float(np.sqrt(density[band].sum() * rate / len(force)))
