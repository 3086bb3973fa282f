"""The report's histogram of tick times."""

from collections.abc import Sequence

from hhsim.report_figures import ReportFigure
from hhsim.result import Result


def histogram_figure(results: Sequence[Result], labels: Sequence[str] = ()) -> ReportFigure:
    """How long ticks took, CPU and wall, on a logarithmic axis with the line of 1 ms; p50 and p99 are marked.

    Args:
        results: one or more; any may hold no tick.
        labels: names of the results; the files' stems where none are given.

    Raises:
        InputError: a file cannot be read.
    """
    raise NotImplementedError
