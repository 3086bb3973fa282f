"""Verdict on a run: a word and a few sentences, above its table and at the top of its report.

A session is judged by its faults, too.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hhsim.mesh.solidify import ASSUMED_SOLID
from hhsim.metrics.run.registry import known_figures, needed_columns, run_metrics, tick_figures
from hhsim.metrics.run.ticks import is_mostly_stuck
from hhsim.metrics.run_ticks import result_ticks
from hhsim.metrics.session_faults import SESSION_FAULTS, how_it_ended, recorded_faults
from hhsim.replay.summary_table import SummaryRow, default_limits, stored_promises, summary_rows
from hhsim.result.reader import Result
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.solver.method import EVERYTHING, PROMISES
from hhsim.table.verdict import verdict as over_limits

OK, MISSED, UNTOUCHED = "within limits", "limits missed", "nothing touched"
SHORT, LATE, EMPTY = "cut short", "ticks missed", "no ticks"
NOT_JUDGED = "depth not judged"
"""Words of verdicts. Missed limits come first, whether a run is cut short or touches nothing."""
ELSEWHERE = "Put the object elsewhere (a recording: --place-object auto), or look at its size (--unit, --size)."
"""Advice where nothing touches."""

STATED_TIMES = "the times of its ticks are what the submission says: they were not measured here"
"""Remark on the times of a submission."""


@dataclass(frozen=True)
class Verdict:
    """Verdict on one run."""

    word: str  # one of the words
    sentences: tuple[str, ...]  # reasons, missed limits last
    missed: tuple[str, ...] = ()  # names of the figures over their limits
    mostly_stuck: bool = False  # True if more than half of the ticks are stuck
    line: str = ""  # word and reason, for the head of a table that has the figures themselves


def run_verdict(
    rows: Sequence[SummaryRow],
    promises: Collection[str],
    ticks: int,
    *,
    complete: bool = True,
    late: int = 0,
    repairs: Sequence[str] = (),
    surface: str = "spheres",
) -> Verdict:
    """Judge a run by the default limits of `hhsim gate`.

    A figure that is undefined, missing, or not among the method's `promises` (`hhsim.solver.method.PROMISES`) is not
    judged. A depth over the limit that is not judged is the verdict itself: such a run is never "within limits".
    `complete` is False if it was stopped; `late` counts periods of a session without a tick; of `repairs` of the
    object's mesh an assumed solid is a reservation.
    """
    if ticks == 0:
        return Verdict(EMPTY, ("The file holds no tick.",), line=f"{EMPTY}: the file holds none")
    figures = {row.name: row for row in rows}
    limits = {
        name: limit
        for name, limit in default_limits(promises).items()
        if name in figures and math.isfinite(figures[name].value)
    }
    missed = over_limits({name: row.value for name, row in figures.items()}, limits)
    over = "; ".join(over_limit(figures[name], limits[name]) for name in missed)
    contact, touched = _contact(figures, surface)
    stuck = "stuck_ticks" in figures and is_mostly_stuck(figures["stuck_ticks"].value, ticks)
    if stuck:
        contact = f"More than half of the ticks are stuck: the shown hand does not follow the user's. {contact}".strip()
    stopped = "" if complete else f"The run was stopped after {ticks:,} ticks; what follows is of these."
    assumed = [f"{text[:1].upper()}{text[1:]}." for text in repairs if text.startswith(ASSUMED_SOLID)]
    parts = [stopped, contact, *assumed]
    if late:
        parts.append(f"{late:,} periods of the session had no tick at all, beside the {ticks:,} that had one.")
    if missed:
        parts.append(f"Over the limits that hhsim gate has by default: {over}.")
    elif limits:
        parts.append(
            f"All {len(limits)} figures that hhsim gate has a default limit for, and that are defined here, hold it."
        )
    word = SHORT if not complete else UNTOUCHED if not touched else LATE if late else OK
    line = f"{word}. {contact}"
    depth = figures.get("penetration_max")
    if depth is not None and depth.value > default_limits(PROMISES)[depth.name] and depth.name not in limits:
        word = NOT_JUDGED
        line = f"{word}, since the method does not promise it. {contact}"
    if missed:
        word = MISSED
        line = f"{word}: {over}. {contact}"
    return Verdict(word, tuple(part for part in parts if part), missed, stuck, line.strip())


def _contact(figures: Mapping[str, SummaryRow], surface: str) -> tuple[str, bool]:
    """Sentence on the contact, and whether the hand touched the object, as far as known."""
    near, touching, depth = (figures.get(name) for name in ("candidates_max", "touching_max", "penetration_max"))
    if near is None or touching is None or depth is None:
        # A run that was stopped has no figures.
        return "", True
    force = figures.get("force_contact_max")
    if not any(row is not None and row.value > 0.0 for row in (touching, force, depth)):
        where = "never touches" if near.value > 0 else "never comes near"
        return f"The hand {where} the object, so that this run says nothing about contact. {ELSEWHERE}", False
    if depth.shown == depth.figure.shown(0.0):
        return f"The shown hand stays out of the object's {surface} in every tick.", True
    return f"The shown hand is up to {depth.shown} {depth.unit} inside the object's {surface}.", True


def over_limit(row: SummaryRow, limit: float) -> str:
    """Say by how much a figure is over its limit."""
    unit = f" {row.unit}" if row.unit else ""
    return f"{row.label} {row.shown}{unit} (limit {limit / row.figure.scale:g})"


def verdict(result: Result, rows: Sequence[SummaryRow]) -> Verdict:
    """Judge a result by its table, as `run_verdict`."""
    # A tick that never was is in no figure of the ticks.
    late = int(result.summary.get("missed", 0))
    repairs = [str(text) for text in result.scene.get("object_repairs") or []]
    run = rows, stored_promises(result.scene), result.ticks
    found = run_verdict(*run, complete=result.complete, late=late, repairs=repairs, surface=result.surface)
    if result.scene.get("submission") and any(row.name.startswith("tick_") for row in rows):
        remark = f"{STATED_TIMES[:1].upper()}{STATED_TIMES[1:]}."
        found = replace(found, sentences=(*found.sentences, remark), line=f"{found.line} {remark}")
    if result.live is None:
        return found
    figures = recorded_faults(result).figures
    over = over_limits(figures, {fault.name: fault.limit for fault in SESSION_FAULTS})
    if not over:
        return found
    faults = (fault for fault in SESSION_FAULTS if fault.name in over)
    listed = "; ".join(over_limit(SummaryRow(fault, figures[fault.name]), fault.limit) for fault in faults)
    return replace(
        found,
        word=MISSED,
        sentences=(f"Over the limits of a session: {listed}. It ended so: {how_it_ended(result)}.", *found.sentences),
        missed=(*found.missed, *over),
        line=f"{MISSED}: {listed}. {found.line[:1].upper()}{found.line[1:]}",
    )


def result_rows(result: Result) -> tuple[SummaryRow, ...]:
    """Return the table of a result: the figures of its file, and of its ticks those that the file lacks."""
    stated = {}
    if result.complete and result.live is None:
        stated = {name: float(result.summary[name]) for name in run_metrics() if name in result.summary}
    lacking = known_figures([what for what in EVERYTHING if result.gives(what)]) - stated.keys()
    own = {}
    if any(run_metrics()[name].compute and not run_metrics()[name].free_only for name in lacking):
        seen = result.seen_from_object
        values = ((name, seen[name]) for name in needed_columns())
        # What is infinite is no figure either.
        known = {name: np.where(np.isfinite(of), of, np.nan) if of.dtype.kind == "f" else of for name, of in values}
        computed = tick_figures(result_ticks(seen, known), but=stated)
        own = {name: value for name, value in computed.items() if name in lacking}
    return summary_rows({**own, **stated}, of_paper=of_the_paper(result.scene))
