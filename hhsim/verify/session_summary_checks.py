"""Claims of a session's summary: its figures follow from the rows, by sorting where the loop counts in bins."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hhsim.verify.claim import Claim, judged, told_apart
from hhsim.verify.session_rows import LOOP_DIED, OLD_NAME, SessionRows

SAME = 1e-9
"""Relative tolerance of figures: the rounding of sums in another order."""
HALF_A_BIN = 1e-3
"""Relative tolerance of percentiles: half a bin of the loop's histogram, which is 0.2 % wide."""
PERCENTILES = {"p50": 50.0, "p99": 99.0, "p999": 99.9}
REASONS = (
    *("stale_input", "not_finite", "solver_failed", "overrun_streak", "device_lost"),
    *("stopping", "no_watchdog", "dry_run", "no_input_yet"),
)
"""Names of the bits of `safety`, lowest first."""
CAUSES = ("missed_computed", "missed_woken_late", "missed_host", "missed_device")
"""Figures of the missed periods by cause, in the order of /live/tick/cause, from 1."""


def session_figures_claims(rows: SessionRows) -> list[Claim]:
    """Judge the figures of the summary of a complete session."""
    if not rows.result.complete:
        return []
    stored = {name.replace(*OLD_NAME): value for name, value in rows.result.summary.items()}
    wrong, off = [], []
    own = {**counted(rows), **percentiles(rows)}
    for name, value in own.items():
        given = float(stored.get(name, math.nan))
        room = HALF_A_BIN if name.endswith(tuple(PERCENTILES)) else SAME
        apart = 0.0 if math.isnan(given) and math.isnan(value) else abs(given - value) / (room * max(abs(value), SAME))
        off.append(apart if name in stored else math.inf)
        if not apart <= 1.0 or name not in stored:
            wrong.append("{} is stored as {}, the rows give {}".format(name, *told_apart(given, value)))
    least, most = missed_between(rows)
    missed = int(stored.get("missed", -1))
    off.append(0.0 if least <= missed <= most else math.inf)
    if off[-1]:
        wrong.append(f"missed is stored as {missed:,}, the rows allow {least:,} to {most:,}")
    by_cause = _causes_off(rows, stored, missed)
    off.append(math.inf if by_cause else 0.0)
    wrong += by_cause
    strange = sorted(set(stored) - set(own) - {"missed"} - set(CAUSES))
    off += [math.inf] * len(strange)
    wrong += [f"{name} has no definition here" for name in strange]
    says, why = "the figures of the summary are those of the rows", "a billionth; half a bin of 0.2 % for percentiles"
    return [judged("session figures", says, off, 1.0, "of what is let pass", why, note="; ".join(wrong))]


def _causes_off(rows: SessionRows, stored: Mapping[str, Any], missed: int) -> list[str]:
    """Errors of the missed periods by cause, as text; none where the file has no causes."""
    if "live/tick/cause" not in rows.result:
        return []
    died = rows.live["ended"] == LOOP_DIED
    # A loop that was killed had counted its last tick's or not.
    counted = rows.numbers < len(rows.numbers) - died
    cause = np.asarray(rows.result["live/tick/cause"])
    given = [int(stored.get(name, -1)) for name in CAUSES]
    least = [int(rows.missed[counted & (cause == i)].sum()) for i in range(1, 5)]
    found = [
        f"{name} is stored as {count:,}, the rows have {own:,}"
        for name, count, own in zip(CAUSES, given, least, strict=True)
        if count < own
    ]
    if sum(given) != missed and not (died and sum(given) <= missed):
        found.append(f"the causes are {sum(given):,} missed periods together, missed is stored as {missed:,}")
    return found


def missed_between(rows: SessionRows) -> tuple[int, int]:
    """Least and most periods without a tick: those of the rows, and those in no row."""
    least = int(rows.missed.sum())
    # A loop that was killed had counted its last tick's or not.
    if rows.live["ended"] == LOOP_DIED:
        return least - int(rows.missed[-1]), int(rows.period[-1]) + 1 - len(rows.period)
    return least, int(rows.period[-1]) + 1 - len(rows.period)


def counted(rows: SessionRows) -> dict[str, float]:
    """Counts and maxima of the rows, SI units."""
    result = rows.result
    status, seq = np.asarray(result["status"]), np.asarray(result["input_seq"], np.int64)
    steps = np.diff(seq, prepend=-1)
    force = np.sqrt((np.asarray(result["force/total"]) ** 2).sum(axis=1))
    found = {
        "ticks": result.ticks,
        "ticks_in_contact": (result["contacts/candidates"] > 0).sum(),
        "ticks_with_resistance": (rows.stiffness > 0.0).any(axis=1).sum(),
        "candidates_max": result["contacts/candidates"].max(initial=0),
        "force_max": np.nan_to_num(force).max(initial=0.0),
        "stuck_ticks": (status & 1 > 0).sum(),
        "lag_ticks": (status & 2 > 0).sum(),
        "samples_used": (steps > 0).sum(),
        "samples_superseded": (steps[steps > 1] - 1).sum(),
        "penetration_max": np.nan_to_num(result["penetration_depth"]).max(initial=0.0),
        **{f"kept_free_{name}": (rows.safety >> bit & 1).sum() for bit, name in enumerate(REASONS)},
        **{f"lost_{what}": rows.live[f"lost_{what}"] for what in ("ticks", "samples", "events")},
    }
    return {name: float(value) for name, value in found.items()}


def percentiles(rows: SessionRows) -> dict[str, float]:
    """Percentiles of wake-up, latency and tick time [s]; NaN where nothing was timed."""
    found = {}
    timed = {
        "wakeup": np.maximum(rows.wakeup, 0),
        "latency": rows.latency[rows.latency >= 0],
        "tick": np.asarray(rows.result["duration/total"], np.int64),
    }
    for what, values in timed.items():
        ordered = np.sort(values)
        for name, percent in PERCENTILES.items():
            rank = max(1, math.ceil(0.01 * percent * len(ordered)))
            # The loop's lowest bin begins at a nanosecond.
            value = min(max(ordered[rank - 1], 1), ordered[-1]) if len(ordered) else math.nan
            found[f"{what}_{name}"] = 1e-9 * float(value)
        found[f"{what}_max"] = 1e-9 * float(ordered[-1]) if len(ordered) else math.nan
    return found
