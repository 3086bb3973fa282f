"""Verdict on a result as its file holds it, a live session's faults among them.

Figures that the file states are held against those of its ticks.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.metrics.run.registry import known_figures, needed_columns, run_metrics, tick_figures
from hhsim.metrics.run_ticks import RunTicks, result_ticks
from hhsim.metrics.session_faults import SESSION_FAULTS, how_it_ended, recorded_faults
from hhsim.replay.summary_table import SummaryRow, stored_promises, summary_rows
from hhsim.replay.verdict import MISSED, Verdict, over_limit, run_verdict
from hhsim.result.reader import Result
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.solver.method import EVERYTHING
from hhsim.table.verdict import verdict as missed_limits

STATED_TIMES = "the times of its ticks are what the submission says: they were not measured here"
"""Remark on the times of a submission."""
SAME = 1e-9
"""Relative difference [SI, %] up to which figures are the same: sums in another order differ by less."""


def verdict(result: Result, rows: Sequence[SummaryRow]) -> Verdict:
    """Judge a result by its table; as `hhsim.replay.verdict.run_verdict`."""
    # A tick that never was is in no figure of the ticks.
    late = int(result.summary.get("missed", 0))
    repairs = [str(text) for text in result.scene.get("object_repairs") or []]
    run = rows, stored_promises(result.scene), result.ticks
    found = run_verdict(*run, complete=result.complete, late=late, repairs=repairs, surface=result.surface)
    if result.scene.get("submission") and any(row.name.startswith("tick_") for row in rows):
        remark = f"{STATED_TIMES[:1].upper()}{STATED_TIMES[1:]}."
        found = replace(found, sentences=(*found.sentences, remark), line=f"{found.line} {remark}")
    return found if result.live is None else _with_faults(found, result)


def _with_faults(found: Verdict, session: Result) -> Verdict:
    figures = recorded_faults(session).figures
    over = missed_limits(figures, {fault.name: fault.limit for fault in SESSION_FAULTS})
    if not over:
        return found
    faults = (fault for fault in SESSION_FAULTS if fault.name in over)
    listed = "; ".join(over_limit(SummaryRow(fault, figures[fault.name]), fault.limit) for fault in faults)
    return replace(
        found,
        word=MISSED,
        sentences=(f"Over the limits of a session: {listed}. It ended so: {how_it_ended(session)}.", *found.sentences),
        missed=(*found.missed, *over),
        line=f"{MISSED}: {listed}. {found.line[:1].upper()}{found.line[1:]}",
    )


def read_ticks(result: Result, more: Sequence[str] = ()) -> RunTicks:
    """Read what the figures need of every tick, and `more` datasets of /tick."""
    result = result.seen_from_object

    def known(values: AnyArray) -> AnyArray:
        # What is infinite is no figure either.
        return np.where(np.isfinite(values), values, np.nan) if values.dtype.kind == "f" else values

    return result_ticks(result, {name: known(result[name]) for name in (*needed_columns(), *more)})


class CheckedFigures(NamedTuple):
    """Figures of a result."""

    rows: tuple[SummaryRow, ...]  # what its replay printed; what the file lacks is computed from its ticks
    misstated: str  # sentence on figures of the file that are not those of its ticks; else ""


def checked_figures(result: Result, ticks: RunTicks) -> CheckedFigures:
    """Compute the figures of the ticks, and replace them by those of the file."""
    known = known_figures([what for what in EVERYTHING if result.gives(what)])
    own, stated = {name: value for name, value in tick_figures(ticks).items() if name in known}, {}
    if result.complete and result.live is None:
        stated = {name: float(result.summary[name]) for name in run_metrics() if name in result.summary}
    of_paper = of_the_paper(result.scene)
    computed = {row.name: row for row in summary_rows({**stated, **own}, of_paper=of_paper)}
    rows = summary_rows({**own, **stated}, of_paper=of_paper)
    wrong = [
        f"{row.label} {row.shown} where its ticks give {computed[row.name].shown} {row.unit}".rstrip()
        for row in rows
        # What reads the same is the same, and a last digit may fall either way.
        if row.shown != computed[row.name].shown
        and not math.isclose(row.value, computed[row.name].value, rel_tol=SAME, abs_tol=SAME)
    ]
    text = f"The file says {'; '.join(wrong)}. hhsim verify looks further." if wrong else ""
    return CheckedFigures(rows, text)
