"""The report's picture of speed against error."""

from collections.abc import Sequence

from hhsim.report_figures import ReportFigure
from hhsim.result import Result


def speed_error_figure(results: Sequence[Result], labels: Sequence[str] = ()) -> ReportFigure:
    """Each result as a point: CPU time of a tick in contact, p50 to p99, against what replay knows of the error.

    Args:
        results: one or more; any may hold no tick, or no tick in contact.
        labels: names of the results; the files' stems where none are given.

    Raises:
        InputError: a file cannot be read.
    """
    raise NotImplementedError
