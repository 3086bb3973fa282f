"""Chart of a table of `hhsim bench`."""

import json
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from hhsim.bench.table import BenchTable, Cell
from hhsim.report.figure import GRID, LIMIT, SOFT, Album, Drawing, ReportFigure, drawn_figure, panel_title, run_style
from hhsim.system.counted import counted
from hhsim.table.table import Column, Table, unit_size, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row: TypeAlias = Mapping[str, Cell]

MARKS = ("o", "s", "D", "^", "v", "P", "X", "*")
MOST_LABELS = 40
"""Most lines of a chart; a longer table shows its first ones."""
LINE, TITLE, BOTTOM, LEGEND, PANEL = 0.2, 0.3, 0.5, 0.22, 2.6
"""Height [inches] of a line of a chart, a title, the axis below, a line of the legend, and a panel of points."""
BOLD, TITLE_LINE = 0.085, 0.16
"""Width [inches] of a letter of the title, and height of each of its lines but the first."""
LETTER = 0.075
"""Width [inches] of a letter of a name."""
SPREAD = 8.0
"""Ratio of largest to least value from which on an axis is logarithmic."""


@dataclass(frozen=True)
class Chart:
    """Chart of one suite.

    Attributes:
        series: Columns whose values together choose a colour; a table may lack all but the first.
        x: Column of the abscissa.
        y: Column of the ordinate; "" where each line is one of `labels`.
        labels: Columns that name a line.
        of: Computes a row's abscissa where it is no column's; `axis` names it.
        mark: Abscissa of a line that is drawn.
        chosen: True of the rows that are drawn.
    """

    title: str
    series: tuple[str, ...] = ("method",)
    x: str = ""
    y: str = ""
    labels: tuple[str, ...] = ()
    of: Callable[[Row], float] | None = None
    axis: str = ""
    mark: float | None = None
    chosen: Callable[[Row], bool] = lambda row: True


def _share_of_bar(row: Row) -> float:
    value, bar = float(row["value"]), float(row["bar"])
    return math.nan if row["at_least"] or not bar > 0.0 else value / bar


def _share_of_allowed(row: Row) -> float:
    off, allowed = abs(float(row["off"])), float(row["allowed"])
    return off / allowed if allowed > 0.0 else math.nan


CHARTS: Mapping[str, Chart] = {
    "paper": Chart("How many times below the paper's figure", x="ratio", labels=("label",), mark=1.0),
    **dict.fromkeys(
        ("speed-error", "peers"),
        Chart(
            "Time of a tick against distance from the true mesh",
            ("method", "surface"),
            x="tick_cpu_p50",
            y="mesh_error",
            chosen=lambda row: row["object"] != "all" and row["motion"] == "all" and not row.get("stretch"),
        ),
    ),
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
    "qp": Chart("KKT residual of the programs", ("program",), x="residual_max", labels=("program",)),
    "trees": Chart("How far the spheres protrude", x="spheres", y="protrusion_max"),
    "mesh-size": Chart("Time of a tick by triangles", x="triangles", y="tick_p50"),
    "threads": Chart("Wall time of a tick by threads", ("case",), x="threads", y="total"),
}


def bench_figure(found: BenchTable) -> ReportFigure | None:
    """Draw the chart of a table; None where its suite has none, or no row has the numbers."""
    chart = CHARTS.get(found.suite)
    names = {column.name for column in found.columns}
    if chart is None or not {chart.series[0], *chart.labels, *filter(None, (chart.x, chart.y))} <= names:
        return None
    try:
        rows = [row for row in found.rows if chart.chosen(row) and _is_number(_along(chart, row))]
    except (KeyError, TypeError, ValueError):
        return None
    if chart.y:
        rows = [row for row in rows if _is_number(row[chart.y])]
    if not rows:
        return None
    series = list(dict.fromkeys(_series(chart, row) for row in rows))
    told = " and ".join(name for name in chart.series if name in names)
    labels = list(dict.fromkeys(_label(chart, row) for row in rows))
    shown, more = labels[:MOST_LABELS], len(labels) - MOST_LABELS

    def height(width: float, narrow: bool) -> float:
        panel = PANEL if chart.y else LINE * (len(shown) + 1)
        return LEGEND * _legend(series, width)[1] + _title(chart, width)[1] + panel + BOTTOM

    def draw(figure: "Figure", narrow: bool) -> None:
        width, tall = (float(side) for side in figure.get_size_inches())
        names = LEGEND * _legend(series, width)[1]
        left = 0.65 if chart.y else min(0.5 * width, 0.2 + LETTER * max(map(len, shown)))
        title, above = _title(chart, width)
        box = (left / width, BOTTOM / tall, 1.0 - (left + 0.15) / width, (tall - names - above - BOTTOM) / tall)
        axes = figure.add_axes(box)
        (_draw_points if chart.y else _draw_lines)(axes, found, chart, rows, series, shown)
        panel_title(axes, title, 4, left - 0.05)
        _draw_legend(figure, series, width)

    first = f" The first {MOST_LABELS} of {len(labels)} lines." if more > 0 else ""
    caption = f"{counted(len(rows), 'row')} of the table.{first}"
    alt = f"{chart.title}: {counted(len(rows), 'point')}, by {told} ({'; '.join(series)})."
    return drawn_figure(f"bench-{found.suite}", chart.title, caption, alt, Drawing(draw, height))


def _title(chart: Chart, width: float) -> tuple[str, float]:
    """Return the title in lines that fit a figure `width` inches wide, and their height [inches]."""
    lines = textwrap.wrap(chart.title, int((width - 0.1) / BOLD))
    return "\n".join(lines), TITLE + TITLE_LINE * (len(lines) - 1)


def _draw_points(
    axes: "Axes", found: BenchTable, chart: Chart, rows: Sequence[Row], series: Sequence[str], labels: Sequence[str]
) -> None:
    units = {name: shown_unit(found, name) for name in (chart.x, chart.y)}
    for number, name in enumerate(series):
        of = [row for row in rows if _series(chart, row) == name]
        x, y = ([float(row[column]) / unit_size(units[column]) for row in of] for column in (chart.x, chart.y))
        axes.plot(x, y, MARKS[number % len(MARKS)], color=run_style(number)[0], markersize=4.0, alpha=0.75)
    for axis, column in (("x", chart.x), ("y", chart.y)):
        if _is_wide([float(row[column]) for row in rows]):
            _make_logarithmic(axes, axis)
        unit = units[column]
        text = f"{column.replace('_', ' ')}{f' [{unit}]' if unit else ''}"
        (axes.set_xlabel if axis == "x" else axes.set_ylabel)(text)
    axes.grid()


def _draw_lines(
    axes: "Axes", found: BenchTable, chart: Chart, rows: Sequence[Row], series: Sequence[str], labels: Sequence[str]
) -> None:
    unit = shown_unit(found, chart.x) if chart.x else ""
    factor = unit_size(unit)
    values = []
    for number, name in enumerate(series):
        of = [row for row in rows if _series(chart, row) == name and _label(chart, row) in labels]
        x = [_along(chart, row) / factor for row in of]
        values += x
        y = [labels.index(_label(chart, row)) for row in of]
        axes.plot(x, y, MARKS[number % len(MARKS)], color=run_style(number)[0], markersize=4.5, alpha=0.8)
    axes.set_yticks(range(len(labels)), [label if len(label) <= 52 else f"{label[:51]}…" for label in labels])
    axes.set_ylim(len(labels) - 0.4, -0.6)
    for place in range(len(labels)):
        axes.axhline(place, color=GRID, linewidth=0.6, zorder=0)
    if _is_wide(values):
        _make_logarithmic(axes, "x")
    else:
        axes.set_xlim(left=min(0.0, *values))
    if chart.mark is not None:
        axes.axvline(chart.mark, color=LIMIT, linewidth=1.0)
    text = chart.axis or (chart.x.replace("_", " ") + (f" [{unit}]" if unit else ""))
    axes.set_xlabel(text, color=SOFT)


def _make_logarithmic(axes: "Axes", axis: str) -> None:
    from matplotlib.ticker import LogFormatter

    (axes.set_xscale if axis == "x" else axes.set_yscale)("log")
    scale = axes.xaxis if axis == "x" else axes.yaxis
    # Plain numbers: nobody reads 10 to the minus 3 mm at a glance.
    scale.set_major_formatter(lambda value, _: f"{value:,.10g}")
    scale.set_minor_formatter(LogFormatter(labelOnlyBase=False))


def _along(chart: Chart, row: Row) -> float:
    return chart.of(row) if chart.of is not None else float(row[chart.x])


def _series(chart: Chart, row: Row) -> str:
    return ", ".join(str(row[name]) for name in chart.series if name in row)


def _label(chart: Chart, row: Row) -> str:
    return ", ".join(str(row[name]) for name in chart.labels)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _is_wide(values: Sequence[float]) -> bool:
    known = [value for value in values if math.isfinite(value)]
    return bool(known) and min(known) > 0.0 and max(known) / min(known) > SPREAD


def _legend(series: Sequence[str], width: float) -> tuple[int, int]:
    """Return columns and lines of the legend in a figure `width` inches wide."""
    columns = max(1, min(len(series), int(width / (0.4 + LETTER * max(map(len, series))))))
    return columns, -(-len(series) // columns)


def _draw_legend(figure: "Figure", series: Sequence[str], width: float) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], marker=MARKS[number % len(MARKS)], color=run_style(number)[0], linestyle="", label=name)
        for number, name in enumerate(series)
    ]
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.0), ncols=_legend(series, width)[0],
        borderaxespad=0.1, borderpad=0.1, handletextpad=0.2, columnspacing=1.0,
    )  # fmt: skip


SMALLER = {"s": ("s", "ms", "µs", "ns"), "m": ("m", "mm", "µm")}
"""Units that may stand for an SI unit."""


def shown_unit(found: BenchTable, name: str) -> str:
    """Return the unit of a column that keeps its largest number at 1 or more; its own where there is none."""
    own = next(column.unit for column in found.columns if column.name == name)
    sizes = [abs(float(row[name])) for row in found.rows if isinstance(row[name], int | float)]
    largest = max((size for size in sizes if math.isfinite(size)), default=0.0)
    return next((unit for unit in SMALLER.get(own, ()) if largest >= unit_size(unit)), own)


def bench_section(found: BenchTable, name: str, album: Album, prefix: str = "") -> dict[str, Any]:
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
