"""Picture of time against error of the suites `speed-error` and `peers` of `hhsim bench`, on logarithmic axes."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hhsim.render.figure import save_figure
from hhsim.report import figure as style
from hhsim.system.output_path import check_picture
from hhsim.table.file import ALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = Mapping[str, Any]

MOST_PANELS, ACROSS = 4, 2
"""Panels of such a suite, and those beside one another."""
PANEL, WIDE_PANEL = (3.4, 2.4), (6.5, 3.2)
"""Width and height of a panel with its labels, without and with other engines [inches]."""
PAPER_RANGE = (310e-6, 480e-6)
"""Mean times of a tick that the paper states, for the five simple objects of its Fig. 11, on its own machine [s]."""
ROUNDING = 1e-6
"""Smaller errors are drawn as 0 [mm]."""
LEAST = 1e-2
"""A tenth of the lowest decade that is shown [mm]."""
GREY = "#6e7781"
OTHERS = ("x", "^", "v", "<", ">", "p", "*", "d", "s", "h", "8", "H")
"""Marks of other engines, all in grey."""
OWN_QP = "active-set"
LEVEL_MARKS = {1: "v", 2: "D", 3: "s", 4: "o", 5: "*"}
"""Marks by the level of the sphere tree."""
CAPTION = (
    "Mark: median CPU time of a tick in contact; the line from it ends at p99. Off the true mesh: the larger of the "
    "deepest penetration and the farthest contact point, over all motions. A hollow mark is one linearisation; steps "
    "join those that none beats. Grey: other engines, whose ratios carry over to another machine, and not their times. "
    "Red: 1 ms."
)


class Mark(NamedTuple):
    """One mark of a panel; NaN where time or error is undefined."""

    time: float  # median CPU time of a tick [s]
    p99: float  # 99th percentile [s]
    error: float  # [mm]
    color: str
    shape: str
    is_filled: bool
    is_best: bool  # True if a line joins it to the others that none beats


class TradeOff(NamedTuple):
    """Panels by their titles, the colour and mark of each label of the legend, and the size of a panel [inches]."""

    panels: dict[str, list[Mark]]
    legend: dict[str, tuple[str, str]]
    size: tuple[float, float]


def draw_trade_off(path: Path, rows: Sequence[Row], peers: Sequence[Row] = (), note: str = "") -> None:
    """Write the picture of a table, with a note on the run in its legend.

    Engines of `peers`, rows of a table of `hhsim bench peers`, are drawn in grey.

    Errors as `check_picture` and `save_figure`.
    """
    check_picture(path)
    trade_off = _trade_off(rows, peers, note)
    with _drawn(trade_off) as figure:
        caption = wrap(CAPTION, int(figure.get_figwidth() / style.LETTER))
        figure.supxlabel("\n".join(caption), x=0.0, ha="left", color=style.SOFT, fontsize=style.TEXT)
        save_figure(figure, path)


def _trade_off(rows: Sequence[Row], peers: Sequence[Row], note: str) -> TradeOff:
    """Return a panel for each object, and of `speed-error` one against the optimum."""
    summed = [row for row in rows if row["motion"] == ALL and row.get("qp", OWN_QP) == OWN_QP]
    others = [row for row in peers if row["motion"] == ALL and not row["ours"]]
    names = list(dict.fromkeys(row["object"] for row in summed if row["object"] != ALL))
    # Objects that other engines were measured on say the most.
    names.sort(key=lambda name: bool(others) and not any(row["object"] == name for row in others))
    ours = [row for row in summed if row.get("ours", True)]
    colors = {
        name: style.run_style(number)[0] for number, name in enumerate(dict.fromkeys(row["method"] for row in ours))
    }
    foreign = dict.fromkeys(row["method"] for row in (*summed, *others) if row["method"] not in colors)
    engines = {name: (GREY, OTHERS[i % len(OTHERS)]) for i, name in enumerate(foreign)}

    def panel(name: str, error: str, frontier: str) -> list[Mark]:
        marks = []
        for row in (row for row in (*summed, *others) if row["object"] == name):
            time, p99, off = (_number(row.get(key)) for key in ("tick_cpu_p50", "tick_cpu_p99", error))
            look = engines.get(row["method"]) or (colors[row["method"]], _touched(row)[1])
            marks.append(Mark(time, p99, 1e3 * off, *look, row.get("linearisations") != 1, bool(row.get(frontier))))
        return marks

    of_pose = any("off_optimum_mean" in row for row in summed)
    frontier = "mesh_frontier" if of_pose else "frontier"
    drawn = names[: MOST_PANELS - of_pose]
    panels = {f"{name}: off the true mesh [mm]": panel(name, "mesh_error", frontier) for name in drawn}
    if of_pose:
        of_all = names[0] if len(names) == 1 else "all objects"
        panels[f"{of_all}: off the best pose [mm]"] = panel(ALL, "off_optimum_mean", "tracking_frontier")
    legend = {method: (color, "o") for method, color in colors.items()}
    legend |= {label: (style.INK, shape) for label, shape in sorted(map(_touched, ours))} | engines
    if note:
        legend[note] = style.LIMIT, ""
    return TradeOff(panels, legend, WIDE_PANEL if engines else PANEL)


def _touched(row: Row) -> tuple[str, str]:
    """Return what a row's hand touches, in words, and its mark."""
    if row["surface"] == "mesh":
        return "the mesh itself", "P"
    level = row.get("level")
    return ("spheres", "o") if level is None else (f"spheres of level {level:.0f}", LEVEL_MARKS.get(level, "o"))


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


@contextmanager
def _drawn(trade_off: TradeOff) -> "Iterator[Figure]":
    """Draw panels beside one another, below their legend."""
    from matplotlib.lines import Line2D

    labels, down, width = list(trade_off.legend), -(-len(trade_off.panels) // ACROSS), trade_off.size[0]
    columns = max(1, int(ACROSS * width / (style.SIGN + style.LETTER * max(map(len, labels), default=1))))
    height = down * trade_off.size[1] + 0.2 * (len(labels) // columns + 1)
    with style.new_figure(ACROSS * width, height, "constrained") as figure:
        grid = figure.subplots(down, ACROSS, squeeze=False).ravel()
        for axes in grid[len(trade_off.panels) :]:
            axes.set_axis_off()
        for axes, (title, marks) in zip(grid, trade_off.panels.items()):
            axes.set_title(title)
            _draw_panel(axes, marks)
        signs = [Line2D([], [], color=color, marker=mark, linewidth=1.2) for color, mark in trade_off.legend.values()]
        figure.legend(signs, labels, loc="outside upper left", ncols=columns, **style.LEGEND)
        yield figure


def _draw_panel(axes: "Axes", marks: Sequence[Mark]) -> None:
    errors = [0.0 if abs(mark.error) < ROUNDING else mark.error for mark in marks if np.isfinite(mark.error)]
    some = [error for error in errors if error > 0.0]
    low = 10.0 ** np.floor(np.log10(min([*some, LEAST * 10.0])))
    high = 10.0 ** np.ceil(np.log10(max([*some, 10.0 * low])) + 0.1)
    # A logarithm has no zero: 0 stands below the lowest decade, where an error is nothing.
    decades = float(np.log10(high / low))
    zero, has_zero = low * 10.0 ** (-0.12 * decades), len(some) < max(1, len(errors))
    axes.set(xscale="log", yscale="log", ylim=(zero * 10.0 ** (-0.1 * decades) if has_zero else low, high))
    axes.grid(axis="y")
    axes.axhline(low, color=style.SOFT, linewidth=0.5, linestyle=":")
    axes.axvspan(*PAPER_RANGE, color=style.SOFT, alpha=0.1, linewidth=0)
    axes.axvline(style.BUDGET, color=style.LIMIT, linewidth=1.2)
    known = [(mark, max(mark.error, zero)) for mark in marks if np.isfinite(mark.time) and np.isfinite(mark.error)]
    for mark, height in known:
        face = mark.color if mark.is_filled else "white"
        look: Any = {"color": mark.color, "markerfacecolor": face, "markersize": 6.0, "zorder": 4, "clip_on": False}
        axes.plot(mark.time, height, mark.shape, **look)
        axes.plot([mark.time, mark.p99], [height, height], color=mark.color, linewidth=1.2)
    times = [time for mark, _ in known for time in (mark.time, mark.p99) if time > 0.0]
    axes.set_xlim(0.5 * min([*times, 1e-5]), 2.0 * max([*times, style.BUDGET]))
    if best := sorted((mark.time, height) for mark, height in known if mark.is_best):
        # Steps, down to the fastest and on to the right of the best.
        steps = [best[0][0], *(time for time, _ in best), 1e9], [1e9, *(off for _, off in best), best[-1][1]]
        axes.plot(*steps, color=style.SOFT, linewidth=0.9, drawstyle="steps-post", zorder=2)
    if not errors:
        style.note(axes, "not measured")
    powers = [10.0**k for k in range(round(np.log10(low)), round(np.log10(high)) + 1)][:: 1 + round(decades) // 7]
    named = {**({zero: "0"} if has_zero else {}), **{power: f"{power:g}" for power in powers}}
    axes.set_yticks(list(named), list(named.values()))
    axes.xaxis.set_major_formatter(lambda value, _: style.time_text(value).replace(".0 ", " "))
    axes.minorticks_off()
    axes.set_xlabel("CPU time of a tick in contact")
