"""Chart of a table of `hhsim bench`."""

import json
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from hhsim.bench.table import BenchTable, Cell
from hhsim.report import figure as style
from hhsim.report.bench_trade_off import TRADE_OFF_COLUMNS, bench_trade_off
from hhsim.report.trade_off import MARKS
from hhsim.system.counted import counted
from hhsim.table.table import Column, Table, unit_size, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Row: TypeAlias = Mapping[str, Cell]

MOST_LABELS = 40
"""Most lines of a chart; a longer table shows its first ones."""
LINE, PANEL = 0.2, 2.6
"""Height [inches] of a line of a chart, and of a panel of points."""
BOLD, TITLE_LINE = 0.085, 0.16
"""Width [inches] of a letter of the title, and height of each of its lines but the first."""
SPREAD = 8.0
"""Ratio of largest to least value from which on an axis is logarithmic."""


@dataclass(frozen=True)
class Chart:
    """Chart of one suite."""

    title: str
    series: str = "method"  # column whose values choose a colour
    x: str = ""  # column of the abscissa
    y: str = ""  # column of the ordinate; "" where each line is one of `labels`
    labels: tuple[str, ...] = ()  # columns that name a line
    of: Callable[[Row], float] | None = None  # computes a row's abscissa where it is no column's; `axis` names it
    axis: str = ""
    mark: float | None = None  # abscissa of a line that is drawn


def _share_of_bar(row: Row) -> float:
    value, bar = float(row["value"]), float(row["bar"])
    return math.nan if row["at_least"] or not bar > 0.0 else value / bar


def _share_of_allowed(row: Row) -> float:
    off, allowed = abs(float(row["off"])), float(row["allowed"])
    return off / allowed if allowed > 0.0 else math.nan


CHARTS: Mapping[str, Chart] = {
    "paper": Chart("How many times below the paper's figure", x="ratio", labels=("label",), mark=1.0),
    "hard": Chart(
        "Share of the bar that is used", labels=("case", "figure"), of=_share_of_bar, axis="of the bar", mark=1.0
    ),
    "manipulation": Chart(
        "Share that is used of what a figure may be off by",
        labels=("case", "figure"),
        of=_share_of_allowed,
        axis="of what is allowed",
        mark=1.0,
    ),
    "stress": Chart("Slowest hundredth of the ticks", x="cpu_p99", labels=("object", "level")),
    "recorded": Chart("Slowest hundredth of the ticks", x="cpu_p99", labels=("recording", "object")),
}


def bench_figure(found: BenchTable) -> style.ReportFigure | None:
    """Draw the chart of a table; None where its suite has none, or no row has the numbers."""
    chart = CHARTS.get(found.suite)
    names = {column.name for column in found.columns}
    if TRADE_OFF_COLUMNS.get(found.suite) in names:
        return bench_trade_off(found.suite, found.rows)
    if chart is None or not {chart.series, *chart.labels, *filter(None, (chart.x, chart.y))} <= names:
        return None
    rows = [row for row in found.rows if _is_number(_along(chart, row)) and (not chart.y or _is_number(row[chart.y]))]
    if not rows:
        return None
    series = list(dict.fromkeys(str(row[chart.series]) for row in rows))
    labels = list(dict.fromkeys(_label(chart, row) for row in rows))
    shown, more = labels[:MOST_LABELS], len(labels) - MOST_LABELS

    def height(width: float, narrow: bool) -> float:
        panel = PANEL if chart.y else LINE * (len(shown) + 1)
        return style.fitted_legend(series, width).height + _title(chart, width)[1] + panel + style.BOTTOM

    def draw(figure: "Figure", narrow: bool) -> None:
        width, tall = (float(side) for side in figure.get_size_inches())
        legend, (title, above) = style.fitted_legend(series, width), _title(chart, width)
        left = style.LEFT if chart.y else min(0.5 * width, 0.2 + style.LETTER * max(map(len, shown)))
        down = legend.height + above
        axes = style.add_panel(figure, left, down, (width - left - style.RIGHT, tall - down - style.BOTTOM))
        handles = (_draw_points if chart.y else _draw_lines)(axes, found, chart, rows, series, shown)
        style.panel_title(axes, title, 4, left - 0.05)
        legend.draw(figure, handles)

    first = f" The first {MOST_LABELS} of {len(labels)} lines." if more > 0 else ""
    caption = f"{counted(len(rows), 'row')} of the table.{first}"
    alt = f"{chart.title}: {counted(len(rows), 'point')}, by {chart.series} ({'; '.join(series)})."
    return style.drawn_figure(f"bench-{found.suite}", chart.title, caption, alt, style.Drawing(draw, height))


def _title(chart: Chart, width: float) -> tuple[str, float]:
    """Return the title in lines that fit a figure `width` inches wide, and their height [inches]."""
    lines = textwrap.wrap(chart.title, int((width - 0.1) / BOLD))
    return "\n".join(lines), style.TITLE + TITLE_LINE * (len(lines) - 1)


def _draw_points(
    axes: "Axes", found: BenchTable, chart: Chart, rows: Sequence[Row], series: Sequence[str], labels: Sequence[str]
) -> "list[Line2D]":
    """Draw a mark for each row, and return one for each series."""
    units = {name: shown_unit(found, name) for name in (chart.x, chart.y)}
    drawn = []
    for number, name in enumerate(series):
        of = [row for row in rows if str(row[chart.series]) == name]
        x, y = ([float(row[column]) / unit_size(units[column]) for row in of] for column in (chart.x, chart.y))
        drawn += axes.plot(
            x, y, MARKS[number % len(MARKS)], color=style.run_style(number)[0], markersize=4.0, alpha=0.75
        )
    for axis, column in (("x", chart.x), ("y", chart.y)):
        if _is_wide([float(row[column]) for row in rows]):
            _make_logarithmic(axes, axis)
        unit = units[column]
        text = f"{column.replace('_', ' ')}{f' [{unit}]' if unit else ''}"
        (axes.set_xlabel if axis == "x" else axes.set_ylabel)(text)
    axes.grid()
    return drawn


def _draw_lines(
    axes: "Axes", found: BenchTable, chart: Chart, rows: Sequence[Row], series: Sequence[str], labels: Sequence[str]
) -> "list[Line2D]":
    """Draw a line for each label with the marks of its rows, and return a mark for each series."""
    unit = shown_unit(found, chart.x) if chart.x else ""
    factor = unit_size(unit)
    values, drawn = [], []
    for number, name in enumerate(series):
        of = [row for row in rows if str(row[chart.series]) == name and _label(chart, row) in labels]
        x = [_along(chart, row) / factor for row in of]
        values += x
        y = [labels.index(_label(chart, row)) for row in of]
        drawn += axes.plot(
            x, y, MARKS[number % len(MARKS)], color=style.run_style(number)[0], markersize=4.5, alpha=0.8
        )
    axes.set_yticks(range(len(labels)), [label if len(label) <= 52 else f"{label[:51]}…" for label in labels])
    axes.set_ylim(len(labels) - 0.4, -0.6)
    for place in range(len(labels)):
        axes.axhline(place, color=style.GRID, linewidth=0.6, zorder=0)
    if _is_wide(values):
        _make_logarithmic(axes, "x")
    else:
        axes.set_xlim(left=min(0.0, *values))
    if chart.mark is not None:
        axes.axvline(chart.mark, color=style.LIMIT, linewidth=1.0)
    text = chart.axis or (chart.x.replace("_", " ") + (f" [{unit}]" if unit else ""))
    axes.set_xlabel(text, color=style.SOFT)
    return drawn


def _make_logarithmic(axes: "Axes", axis: str) -> None:
    from matplotlib.ticker import LogFormatter

    (axes.set_xscale if axis == "x" else axes.set_yscale)("log")
    scale = axes.xaxis if axis == "x" else axes.yaxis
    # Plain numbers: nobody reads 10 to the minus 3 mm at a glance.
    scale.set_major_formatter(lambda value, _: f"{value:,.10g}")
    scale.set_minor_formatter(LogFormatter(labelOnlyBase=False))


def _along(chart: Chart, row: Row) -> float:
    """Return a row's abscissa; NaN where it is not known."""
    try:
        return chart.of(row) if chart.of is not None else float(row[chart.x])
    except (KeyError, TypeError, ValueError):
        return math.nan


def _label(chart: Chart, row: Row) -> str:
    return ", ".join(str(row[name]) for name in chart.labels)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _is_wide(values: Sequence[float]) -> bool:
    known = [value for value in values if math.isfinite(value)]
    return bool(known) and min(known) > 0.0 and max(known) / min(known) > SPREAD


SMALLER = {"s": ("s", "ms", "µs", "ns"), "m": ("m", "mm", "µm")}
"""Units that may stand for an SI unit."""


def shown_unit(found: BenchTable, name: str) -> str:
    """Return the unit of a column that keeps its largest number at 1 or more; its own where there is none."""
    own = next(column.unit for column in found.columns if column.name == name)
    sizes = [abs(float(row[name])) for row in found.rows if isinstance(row[name], int | float)]
    largest = max((size for size in sizes if math.isfinite(size)), default=0.0)
    return next((unit for unit in SMALLER.get(own, ()) if largest >= unit_size(unit)), own)


def bench_section(found: BenchTable, name: str, album: style.Album, prefix: str = "") -> dict[str, Any]:
    """Return what the page shows of a table, by the names of its template; `prefix` goes before its chart's name."""
    made = {str(key): str(value) for key, value in found.attributes.items()}
    machine = json.loads(made.get("machine", "{}"))
    about = f"{name}, written {made.get('created_utc', 'at an unknown time')} by hhsim {made.get('hhsim_version', '')}"
    where = f", on {machine['cpu']}" if machine.get("cpu") else ""
    chart = bench_figure(found)
    columns = [_shown(column, found) for column in found.columns]
    same = [column for column in columns if len({*map(column.shown, found.rows)}) == 1 < len(found.rows)]
    alike = (words("column", "heading"), words("value", lambda column: column.shown(found.rows[0])))
    options = [(key, json.dumps(value, ensure_ascii=False)) for key, value in found.options.items()]
    caption = f"{counted(len(found.rows), 'row')} of hhsim bench {found.suite}"
    return {
        "heading": f"hhsim bench {found.suite}",
        "about": f"{about}{where}.",
        "chart": None if chart is None else album.shown(chart, prefix),
        "whole": Table([column for column in columns if column not in same], found.rows, caption),
        "more": {
            "The same in all rows": Table(alike, same, "Columns with one value"),
            "What the columns mean": Table((words("column", "name"), words("meaning", "says")), columns, "Columns"),
            "Its options": Table.of_cells(("option", "value"), options, "Its options"),
        },
    }


def _shown(column: Column, found: BenchTable) -> Column:
    """Return a column as people read it."""
    values = [row[column.name] for row in found.rows]
    is_number = any(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    unit = shown_unit(found, column.name)
    return replace(column, name=column.name.replace("_", " "), of=column.name, unit=unit, is_number=is_number)
