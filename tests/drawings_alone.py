"""Charts that are not drawn when they are made: for tests that draw them themselves."""

import pytest

from hhsim.report.figure import Drawing, ReportFigure

CHARTS = ("time_series", "histogram", "speed_error", "pictures", "bench_chart")
"""Modules of the report that make one."""


def undrawn(name: str, title: str, caption: str, alt: str, drawing: Drawing) -> ReportFigure:
    return ReportFigure(name, title, caption, alt, b"", 0, 0, drawing=drawing)


def leave_charts_undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's pictures of a chart, which take most of the time, are left out; its drawing is there."""
    for module in CHARTS:
        monkeypatch.setattr(f"hhsim.report.{module}.drawn_figure", undrawn)
