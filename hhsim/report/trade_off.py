"""Cost against error, on logarithmic axes with a line for nothing, of results and of tables of `hhsim bench`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import IntArray
from hhsim.errors import HhsimError
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.metrics.mesh_penetration import contact_error, find_contact_points, mesh_clearance, sampled
from hhsim.metrics.run.registry import tick_figures
from hhsim.metrics.run_ticks import PLACED, result_ticks
from hhsim.motion.trajectory import RigidMotion
from hhsim.render.figure import save_figure
from hhsim.report import figure as style
from hhsim.result.reader import Result
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.system.counted import counted
from hhsim.system.output_path import check_picture
from hhsim.table.file import ALL, BenchTable
from hhsim.trees.contact_surface import encloses
from hhsim.view.viewer import shown_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

import json

from hhsim.report.figure import Album
from hhsim.table.table import Table, words

MARKS = ("o", "s", "D", "^", "v", "P", "X")
"""Markers, one more than colours: no two results of a page share both."""
PAPER_RANGE = (310e-6, 480e-6)
"""Mean times of a tick that the paper states, for the five simple objects of its Fig. 11, on its own machine [s]."""
ROUNDING = 1e-6
"""Smaller errors, in the unit of their axis, are drawn as 0."""
TIME_LABEL = 0.44
"""Width of a time label with the gap to the next one [inches]."""


@dataclass(frozen=True)
class Mark:
    """One mark of a panel."""

    cost: float  # median CPU time of a tick [s]; NaN where undefined
    error: float  # error in the unit of the panel; NaN where undefined
    color: str
    shape: str
    until: float | None = None  # cost at which a line from the mark ends; None for no line
    filled: bool = True  # False for a mark with a white face
    best: bool = False  # True if a line joins it to the others that are best

    @property
    def known(self) -> bool:
        """True if cost and error are defined."""
        return bool(np.isfinite(self.cost) and np.isfinite(self.error))


@dataclass(frozen=True)
class TradeOff:
    """One panel."""

    title: str
    marks: Sequence[Mark]
    least: float  # a tenth of the lowest decade that is shown, in the unit of the errors
    paper: bool = True  # True to shade the mean times that the paper states for simple objects


def trade_off_drawing(
    panels: Sequence[TradeOff], names: Mapping[str, tuple[str, str]], size: tuple[float, float]
) -> style.Drawing:
    """Return the drawing of panels, whose least width with labels, and height, are `size` [inches].

    `names` has colour and mark by label in the legend.
    """
    drawn = [style.Panel(panel.title, size[1], partial(_draw_panel, panel=panel)) for panel in panels]
    return style.chart(drawn, names=names, least=size[0])


def _draw_panel(axes: "Axes", panel: TradeOff) -> None:
    errors = [0.0 if abs(mark.error) < ROUNDING else mark.error for mark in panel.marks if np.isfinite(mark.error)]
    some = [error for error in errors if error > 0.0]
    low = 10.0 ** np.floor(np.log10(min([*some, panel.least * 10.0])))
    high = 10.0 ** np.ceil(np.log10(max([*some, 10.0 * low])) + 0.1)
    # A logarithm has no zero: 0 stands below the lowest decade, where an error is nothing.
    decades = float(np.log10(high / low))
    zero = low * 10.0 ** (-0.12 * decades)
    has_zero = len(some) < max(1, len(errors))
    axes.set(xscale="log", yscale="log", ylim=(zero * 10.0 ** (-0.1 * decades) if has_zero else low, high))
    axes.axhline(low, color=style.SOFT, linewidth=0.5, linestyle=":")
    _draw_axis(axes, panel)
    if panel.paper:
        axes.axvspan(*PAPER_RANGE, color=style.SOFT, alpha=0.1, linewidth=0)
    heights = [mark.error if mark.error >= ROUNDING else zero for mark in panel.marks]
    known = [(mark, height) for mark, height in zip(panel.marks, heights) if mark.known]
    for mark, height in known:
        face = mark.color if mark.filled else "white"
        look: Any = {"color": mark.color, "markerfacecolor": face, "markersize": 6.0, "zorder": 4, "clip_on": False}
        axes.plot(mark.cost, height, mark.shape, **look)
        if mark.until is not None:
            axes.plot([mark.cost, mark.until], [height, height], color=mark.color, linewidth=1.2)
            axes.plot(mark.until, height, "|", color=mark.color, markersize=7.0)
    if best := sorted((mark.cost, height) for mark, height in known if mark.best):
        # Steps, down to the cheapest and on to the right of the best.
        costs, steps = [best[0][0], *(cost for cost, _ in best), 1e9], [1e9, *(off for _, off in best), best[-1][1]]
        axes.plot(costs, steps, color=style.SOFT, linewidth=0.9, drawstyle="steps-post", zorder=2)
    if not errors:
        style.note(axes, "not measured")
    powers = [10.0**k for k in range(round(np.log10(low)), round(np.log10(high)) + 1)]
    powers = powers[:: 1 + len(powers) // 7]
    # An energy may be below the optimum; a depth is not below 0.
    least = "≤ 0" if any(error < 0.0 for error in errors) else "0"
    zeros = {zero: least} if has_zero else {}
    axes.set_yticks(
        [*zeros, *powers], [*zeros.values(), *(f"{power:,.{max(0, -round(np.log10(power)))}f}" for power in powers)]
    )
    axes.minorticks_off()


def _draw_axis(axes: "Axes", panel: TradeOff) -> None:
    """Draw the axis below with the line of the budget; the panel's width decides how many labels fit."""
    ends = [end for mark in panel.marks for end in (mark.cost, mark.until) if end is not None]
    costs = [end for end in ends if np.isfinite(end) and end > 0.0]
    costs += [1e-5, style.BUDGET]
    low, high = 0.5 * min(costs), 2.0 * max(costs)
    axes.set_xlim(low, high)
    axes.axvline(style.BUDGET, color=style.LIMIT, linewidth=1.2)
    decade = style.inches(axes) / float(np.log10(high / low))
    step = int(np.ceil(TIME_LABEL / decade))
    powers = [k for k in range(-8, 8) if low <= 10.0**k <= high]
    # Counted from 1 ms, which always has its label; a label near the right end would be cut.
    fits = [
        (k + 3) % step == 0 and decade * np.log10(high / 10.0**k) > 0.5 * TIME_LABEL - 2.0 * style.RIGHT for k in powers
    ]
    labels = [style.time_text(10.0**k).replace(".0 ", " ") if fit else "" for k, fit in zip(powers, fits)]
    axes.set_xticks([10.0**k for k in powers], labels)
    axes.set_xlabel("CPU time of a tick in contact")


SAMPLES = 20
"""Ticks in contact whose hand is compared with the mesh: exact, and slow."""
RESULT_PANEL = 2.3, 2.0
"""Least width of a panel with its labels, and its height [inches]."""


@dataclass(frozen=True)
class SpeedError:
    """One result as a point; NaN where a figure is undefined."""

    label: str
    p50: float  # CPU time of a tick in contact [s]
    p99: float
    depth: float  # deepest penetration of the touched surface, leaf spheres or mesh, of all ticks [m]
    mesh: float  # deepest penetration of the mesh, or largest distance of a contact point from it, of sampled ticks [m]
    excess: float  # coupling energy above the optimum, mean of the hold [%]
    of_paper: bool = False  # True if the scene is one of the paper's


AXES = (
    ("depth", "deep in what is touched [µm]", 1e6, 1e-3),
    ("mesh", "off the true mesh [mm]", 1e3, 1e-2),
    ("excess", "over the optimum [%]", 1.0, 1e-3),
)
"""Panels: field of `SpeedError`, title with unit, scale to that unit, and a tenth of the lowest decade shown."""


def speed_error_figure(results: Mapping[str, Result]) -> style.ReportFigure:
    """Draw each result by its label as a point: CPU time of a tick in contact, p50 to p99, against three errors."""
    points = [_measured(label, result) for label, result in results.items()]
    styles = [(style.run_style(number)[0], MARKS[number % len(MARKS)]) for number in range(len(points))]
    of_paper = any(point.of_paper for point in points)
    panels = [
        TradeOff(
            title,
            [Mark(point.p50, scale * getattr(point, field), *style, point.p99) for point, style in zip(points, styles)],
            least,
            of_paper,
        )
        for field, title, scale, least in AXES
    ]
    names = dict(zip((point.label for point in points), styles))
    drawing = trade_off_drawing(panels, names, RESULT_PANEL)
    return style.drawn_figure("speed-error", "Speed against error", _caption(points), _alt(points), drawing)


def _measured(label: str, result: Result) -> SpeedError:
    result = result.seen_from_object
    ticks = result_ticks(result)
    figures = tick_figures(ticks)
    return SpeedError(
        label,
        figures["tick_cpu_p50"],
        figures["tick_cpu_p99"],
        figures["penetration_max"] if result.ticks else np.nan,
        _off_the_mesh(result, np.flatnonzero(ticks.contact)),
        float(result.summary.get("tracking_excess", np.nan)),
        of_the_paper(result.scene),
    )


def _off_the_mesh(result: Result, contact: IntArray) -> float:
    """Return `SpeedError.mesh` at sampled ticks in contact; NaN without one, or where the scene is not known."""
    try:
        scene = shown_scene(result)
        trees = [build_mesh_bvh(mesh.vertices, mesh.faces) for mesh, _ in scene.bodies.values()]
        # Nothing is in a skin.
        solid = [encloses(mesh) for mesh, _ in scene.bodies.values()]
    except HhsimError:
        # The hand, tree or mesh is not that of the run.
        return np.nan
    chosen = sampled(contact, SAMPLES)
    ticks = [result.at(int(tick), PLACED) for tick in chosen]
    if not ticks:
        return np.nan
    placed = PlacedHand(*(np.array([tick[name] for tick in ticks]) for name in ticks[0]))
    touching, farthest = 0, 0.0
    for bvh, has_inside, surface, moved in zip_longest(trees, solid, scene.surface_arrays, result.meshes_moved()):
        seen = placed if moved is None else RigidMotion(moved.turn[chosen], moved.shift[chosen]).seen_hand(placed)
        off = contact_error(bvh, find_contact_points(surface, scene.shape, seen, scene.touch).point)
        farthest = max(farthest, off.max(initial=0.0))
        if has_inside:
            farthest = max(farthest, -mesh_clearance(bvh, scene.shape, seen).min())
        touching += len(off)
    return float(farthest) if touching else np.nan


def _caption(points: Sequence[SpeedError]) -> str:
    text = (
        "Mark: p50 of the CPU time of ticks in contact; the line from it ends at p99. Further left is faster, further "
        "down is nearer to the truth; the axes are logarithmic, with a line of its own for 0 and less. First the "
        "deepest penetration of what is touched, the spheres or the mesh. Then how far the hand is in the true mesh or "
        f"a contact point off it, the larger, at up to {SAMPLES} ticks in contact: it holds the error of the sphere "
        "tree too. Last the coupling energy over that of the local optimum, mean of the hold, as the table has it. "
        "Red: 1 ms."
    )
    if any(point.of_paper for point in points):
        text += " Grey: the paper's mean times for simple objects, on its own machine."
    missing = [point.label for point in points if not np.isfinite(point.p50)]
    return text + (f" Not in contact, so without a point: {', '.join(missing)}." if missing else "")


def _alt(points: Sequence[SpeedError]) -> str:
    sentences = ["CPU time against three errors."]
    for point in points:
        times = f"{style.time_text(point.p50)} to {style.time_text(point.p99)}" if np.isfinite(point.p50) else ""
        off = f", {1e3 * point.mesh:.3g} mm off the mesh" if np.isfinite(point.mesh) else ""
        known = f"{times}, {1e6 * point.depth:.3g} µm deep in what it touches{off}"
        sentences.append(f"{point.label}: {known if times else 'no tick in contact'}.")
    return " ".join(sentences)


Row = Mapping[str, Any]

TRADE_OFFS = ("speed-error", "peers")
"""Suites that set the time of a tick against its error."""
MOST_PANELS, ACROSS = 4, 2
"""Panels of such a suite, and those beside one another in a file."""
PANEL, WIDE_PANEL = (3.4, 2.0), (6.5, 2.8)
"""Least width and height of a panel, without and with other engines [inches]."""
GREY = "#6e7781"
OTHERS = ("x", "^", "v", "<", ">", "p", "*", "d", "s", "h", "8", "H")
"""Marks of other engines, all in grey."""
OWN_QP = "active-set"
LEAST = 1e-2
"""A tenth of the lowest decade that is shown [mm]."""
LEVEL_MARKS = {1: "v", 2: "D", 3: "s", 4: "o", 5: "*"}
"""Marks by the level of the sphere tree."""
TITLE = "Time of a tick against distance from the true mesh"
CAPTION = (
    "Mark: median CPU time of a tick in contact; the line from it ends at p99. Off the true mesh: the larger of the "
    "deepest penetration and the farthest contact point, over all motions. A hollow mark is one linearisation; steps "
    "join those that none beats. Grey: other engines, whose ratios carry over to another machine, and not their times. "
    "Red: 1 ms."
)


def has_trade_off(found: BenchTable) -> bool:
    """Return True for a table with the columns of such a picture."""
    return found.suite in TRADE_OFFS and "mesh_error" in {column.name for column in found.columns}


def bench_trade_off(suite: str, rows: Sequence[Row]) -> style.ReportFigure | None:
    """Draw the rows of a table of one of `TRADE_OFFS`; None if no row has both a time and an error."""
    panels, legend, size = _panels(rows, (), "")
    marks = sum(mark.known for panel in panels for mark in panel.marks)
    if not marks:
        return None
    drawing = trade_off_drawing(panels, legend, size)
    return style.drawn_figure(f"bench-{suite}", TITLE, CAPTION, f"{TITLE}: {counted(marks, 'point')}.", drawing)


def draw_trade_off(path: Path, rows: Sequence[Row], peers: Sequence[Row] = (), note: str = "") -> None:
    """Write the picture of a table, with a note on the run in its legend.

    Engines of `peers`, rows of a table of `hhsim bench peers`, are drawn in grey.

    Errors as `check_picture` and `save_figure`.
    """
    check_picture(path)
    panels, legend, size = _panels(rows, peers, note)
    drawing, width = trade_off_drawing(panels, legend, size), ACROSS * size[0]
    caption = wrap(CAPTION, int(width / style.LETTER))
    height = drawing.height(width, False) + style.LEGEND_LINE * len(caption)
    with style.new_figure(width, height) as figure:
        drawing.draw(figure, False)
        figure.text(0.0, 0.0, "\n".join(caption), color=style.SOFT, va="bottom", linespacing=1.2)
        save_figure(figure, path)


def _panels(
    rows: Sequence[Row], peers: Sequence[Row], note: str
) -> tuple[list[TradeOff], dict[str, tuple[str, str]], tuple[float, float]]:
    """Return a panel for each object, and of `speed-error` one against the optimum; their legend, and their size."""
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

    def mark(row: Row, error: str, frontier: str) -> Mark:
        time, until = _number(row["tick_cpu_p50"]), _number(row.get("tick_cpu_p99"))
        off, best = 1e3 * _number(row.get(error)), bool(row.get(frontier))
        if row["method"] not in colors:
            return Mark(time, off, *engines[row["method"]], until, best=best)
        filled = row.get("linearisations") != 1
        return Mark(time, off, colors[row["method"]], _touched(row)[1], until, filled=filled, best=best)

    def panel(title: str, name: str, error: str, frontier: str) -> TradeOff:
        chosen = (row for row in (*summed, *others) if row["object"] == name)
        return TradeOff(title, [mark(row, error, frontier) for row in chosen], LEAST)

    of_pose = any("off_optimum_mean" in row for row in summed)
    frontier = "mesh_frontier" if of_pose else "frontier"
    panels = [panel(f"{name}: off the true mesh [mm]", name, "mesh_error", frontier) for name in names]
    panels = panels[: MOST_PANELS - of_pose]
    if of_pose:
        of_all = names[0] if len(names) == 1 else "all objects"
        panels.append(panel(f"{of_all}: off the best pose [mm]", ALL, "off_optimum_mean", "tracking_frontier"))
    legend = {method: (color, "o") for method, color in colors.items()}
    legend |= {label: (style.INK, shape) for label, shape in sorted(map(_touched, ours))} | engines
    if note:
        legend[note] = style.LIMIT, ""
    return panels, legend, WIDE_PANEL if engines else PANEL


def _touched(row: Row) -> tuple[str, str]:
    """Return what a row's hand touches, in words, and its mark."""
    if row["surface"] == "mesh":
        return "the mesh itself", "P"
    level = row.get("level")
    return ("spheres", "o") if level is None else (f"spheres of level {level:.0f}", LEVEL_MARKS.get(level, "o"))


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def bench_section(found: BenchTable, name: str, album: Album, prefix: str = "") -> dict[str, Any]:
    """Return what the page shows of a table, by the names of its template; `prefix` goes before its chart's name."""
    made = {str(key): str(value) for key, value in found.attributes.items()}
    machine = json.loads(made.get("machine", "{}"))
    about = f"{name}, written {made.get('created_utc', 'at an unknown time')} by hhsim {made.get('hhsim_version', '')}"
    where = f", on {machine['cpu']}" if machine.get("cpu") else ""
    chart = bench_trade_off(found.suite, found.rows) if has_trade_off(found) else None
    columns = Table.of_records(found.columns, found.rows).columns
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
