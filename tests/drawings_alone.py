"""Charts and pictures that are not drawn when they are made: for tests that look at their figures, or need none."""

from typing import Any, NoReturn

import pytest
from matplotlib.figure import Figure
from PIL import Image

from hhsim.errors import InputError


def leave_charts_undrawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return the list that takes the figures; their pixels, which take most of the time, are left out."""
    figures: list[Figure] = []

    def undrawn(figure: Figure) -> bytes:
        figures.append(figure)
        return b""

    monkeypatch.setattr("hhsim.report.figure.png_bytes", undrawn)
    return figures


def trade_offs_undrawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return the list that takes the pictures of time against error, none of which is written."""
    figures: list[Figure] = []
    monkeypatch.setattr("hhsim.bench.trade_off.save_figure", lambda figure, path: figures.append(figure))
    return figures


def leave_report_undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of the page's is drawn: neither charts nor pictures."""

    def no_picture(*arguments: object) -> NoReturn:
        raise InputError("none is drawn here")

    leave_charts_undrawn(monkeypatch)
    for picture in ("overview_picture", "overview_view"):
        monkeypatch.setattr(f"hhsim.report.report.{picture}", no_picture)


def leave_pictures_white(monkeypatch: pytest.MonkeyPatch) -> None:
    """A repair's picture of the deepest frames, which takes most of its time, is one white pixel."""

    def white(*given: Any) -> None:
        Image.new("RGB", (1, 1), "white").save(given[4])

    monkeypatch.setattr("hhsim.repair.repair.draw_before_after", white)
