"""One figure of a report as a file, as wide as a journal's column."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from hhsim.errors import InputError
from hhsim.render.figure import save_figure
from hhsim.report.figure import ReportFigure, new_figure
from hhsim.report.pictures import overview_picture
from hhsim.report.run import posed_result, result_labels
from hhsim.report.time_series import histogram_figure, series_figure
from hhsim.report.trade_off import TRADE_OFFS, bench_trade_off, has_trade_off, speed_error_figure
from hhsim.result.reader import Result, load_result
from hhsim.system.output_path import check_picture
from hhsim.table.file import is_table, load_table

FIGURES: Mapping[str, Callable[[Mapping[str, Result]], ReportFigure]] = {
    "series": series_figure,
    "ticks": histogram_figure,
    "speed-error": speed_error_figure,
    "hand": lambda results: _hand(results),
}
TABLE_FIGURE = "speed-error"
"""Figure that tables of `hhsim bench` have, those of `TRADE_OFFS`."""
FORMATS = (".pdf", ".svg", ".png")
UNITS = {"mm": 25.4, "cm": 2.54, "in": 1.0}
LEAST_WIDTH, MOST_WIDTH = 50.0, 600.0
"""Widths of a figure [mm]."""
NARROW = 6.4
"""Narrower figures [inches] are laid out as on a phone: panels one below another."""


def parse_width(text: str) -> float:
    """Return a width such as 88mm, 8.8cm or 3.5in in inches; raise InputError for any other text."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(mm|cm|in)\s*", text)
    if found is None:
        raise InputError(f"a width of {text!r}: expected a number with mm, cm or in, such as 88mm")
    inches = float(found[1]) / UNITS[found[2]]
    if not LEAST_WIDTH <= 25.4 * inches <= MOST_WIDTH:
        raise InputError(f"a width of {text}: expected {LEAST_WIDTH:g} to {MOST_WIDTH:g} mm")
    return inches


def check_figure_path(output_path: Path) -> None:
    """Raise InputError for a name not of `FORMATS`; OutputError as `hhsim.system.output_path.check_picture`."""
    if output_path.suffix.lower() not in FORMATS:
        raise InputError(f"{output_path}: a figure is a file that ends in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    check_picture(output_path)


def make_figure(paths: Sequence[Path], name: str) -> ReportFigure:
    """Draw one of `FIGURES` of results in the order of the legend; `speed-error` also of one table of `hhsim bench`.

    Raises InputError for a file that is no result, or one that the figure cannot show.
    """
    tables = [path for path in paths if is_table(path)]
    if tables:
        return _table_figure(tables[0], name, alone=len(paths) == 1)
    results = [posed_result(hand) for path in paths for hand in load_result(path).hands.values()]
    return FIGURES[name](dict(zip(result_labels(results), results)))


def write_figure(figure: ReportFigure, output_path: Path, width: float) -> None:
    """Write a figure `width` inches wide in the format of the ending; OutputError as on a full disk."""
    assert figure.drawing is not None
    narrow = width < NARROW
    with new_figure(width, figure.drawing.height(width, narrow)) as drawn:
        figure.drawing.draw(drawn, narrow)
        save_figure(drawn, output_path, figure.title)


def _table_figure(path: Path, name: str, *, alone: bool) -> ReportFigure:
    """Draw the figure of a table of `hhsim bench`: two suites set speed against error."""
    found = load_table(path)
    if found.suite not in TRADE_OFFS or name != TABLE_FIGURE:
        suites = " and ".join(TRADE_OFFS)
        raise InputError(
            f"{path} is a table of hhsim bench {found.suite}, which has no figure {name}: of tables, those of {suites} "
            f"have the figure {TABLE_FIGURE}"
        )
    if not alone:
        raise InputError(f"{path} is a table of hhsim bench, which has a figure of its own: name it alone")
    figure = bench_trade_off(found.suite, found.rows) if has_trade_off(found) else None
    if figure is None:
        raise InputError(f"{path}: no row of the table has both a time and a distance from the mesh to draw")
    return figure


def _hand(results: Mapping[str, Result]) -> ReportFigure:
    if len(results) > 1:
        raise InputError("the figure hand shows one result: name one, or draw the figure of each")
    (result,) = results.values()
    return overview_picture(result)
