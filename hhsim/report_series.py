"""The report's curves over time, in the manner of the paper's Figs. 12 and 14."""

from collections.abc import Sequence

from hhsim.report_figures import ReportFigure
from hhsim.result import Result


def series_figure(results: Sequence[Result], labels: Sequence[str] = ()) -> ReportFigure:
    """Forces, CPU time of the tick, contacts, depth and force variation over time, phases shaded.

    Of one result the forces are drawn finger by finger; of several, each result is one colour in every panel. Long
    runs are drawn as the band from the least to the largest value.

    Args:
        results: one or more; any may hold no tick.
        labels: names of the results in the legend; the files' stems where none are given.

    Raises:
        InputError: a file cannot be read.
    """
    raise NotImplementedError
