"""Figures of a result as its file states them, held against those of its ticks."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.metrics.run.registry import known_figures, needed_columns, run_metrics, tick_figures
from hhsim.metrics.run_ticks import RunTicks, result_ticks
from hhsim.replay.summary_table import SummaryRow, summary_rows
from hhsim.result.reader import Result
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.solver.method import EVERYTHING

SAME = 1e-9
"""Relative difference [SI, %] up to which figures are the same: sums in another order differ by less."""


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
    computed = {row.name: row for row in summary_rows({**stated, **own}, result.rate, of_paper=of_paper)}
    rows = summary_rows({**own, **stated}, result.rate, of_paper=of_paper)
    wrong = [
        f"{row.label} {row.shown} where its ticks give {computed[row.name].shown} {row.unit}".rstrip()
        for row in rows
        # What reads the same is the same, and a last digit may fall either way.
        if row.shown != computed[row.name].shown
        and not math.isclose(row.value, computed[row.name].value, rel_tol=SAME, abs_tol=SAME)
    ]
    text = f"The file says {'; '.join(wrong)}. hhsim verify looks further." if wrong else ""
    return CheckedFigures(rows, text)
