"""Charts and pictures that are not drawn when they are made: for tests that draw them themselves, or need none."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

import pytest
from matplotlib.figure import Figure
from PIL import Image

from hhsim.errors import InputError
from hhsim.report.figure import Drawing, ReportFigure, new_figure

CHARTS = ("figure", "pictures")
"""Modules of the report that name the function which makes one; the others take it from the first."""


def undrawn(name: str, title: str, caption: str, alt: str, drawing: Drawing) -> ReportFigure:
    return ReportFigure(name, title, caption, alt, b"", 0, 0, drawing=drawing)


def leave_charts_undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's pictures of a chart, which take most of the time, are left out; its drawing is there."""
    for module in CHARTS:
        monkeypatch.setattr(f"hhsim.report.{module}.drawn_figure", undrawn)


def leave_report_undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of the page's is drawn: neither charts nor pictures."""

    def no_picture(*arguments: object) -> NoReturn:
        raise InputError("none is drawn here")

    leave_charts_undrawn(monkeypatch)
    monkeypatch.setattr("hhsim.report.pictures.worst_ticks", lambda result: [])
    for picture in ("overview_picture", "held_picture"):
        monkeypatch.setattr(f"hhsim.report.report.{picture}", no_picture)


def leave_pictures_white(monkeypatch: pytest.MonkeyPatch) -> None:
    """A repair's picture of the deepest frames, which takes most of its time, is one white pixel."""

    def white(*given: Any) -> None:
        Image.new("RGB", (1, 1), "white").save(given[4])

    monkeypatch.setattr("hhsim.repair.repair.draw_before_after", white)


@contextmanager
def drawn(chart: ReportFigure | None, width: float, narrow: bool = False) -> Iterator[Figure]:
    """A chart at a width [inches], with every text in its place."""
    assert chart is not None and chart.drawing is not None
    with new_figure(width, chart.drawing.height(width, narrow)) as figure:
        chart.drawing.draw(figure, narrow)
        figure.draw_without_rendering()
        yield figure
