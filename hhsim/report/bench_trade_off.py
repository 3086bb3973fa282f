"""Pictures of `hhsim bench speed-error`, `peers` and `trees`: cost against error, a panel for each object."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from hhsim.render.figure import save_figure
from hhsim.report.figure import (
    BLUE,
    INK,
    LEGEND_LINE,
    LETTER,
    LIMIT,
    SOFT,
    Drawing,
    ReportFigure,
    drawn_figure,
    new_figure,
    run_style,
    time_text,
)
from hhsim.report.trade_off import Mark, TradeOff, trade_off_drawing
from hhsim.system.counted import counted
from hhsim.system.output_path import check_picture
from hhsim.table.file import ALL, BenchTable
from hhsim.trees.published_results import TOOLKIT

Row = Mapping[str, Any]
Panels = tuple[list[TradeOff], dict[str, tuple[str, str]]]
"""Panels, and the legend's names with their colours and marks."""

TRADE_OFFS = ("speed-error", "peers")
"""Suites that set the time of a tick against its error."""
TRADE_OFF_COLUMNS = {"speed-error": "mesh_error", "peers": "mesh_error", "trees": "protrusion_max"}
"""Column of the error, by the suites that have a picture of this kind."""
MOST_PANELS, MOST_OBJECTS = 4, 6
"""Most panels of such a suite, and most objects of `trees`."""
WIDTH, ACROSS = 14.0, 2
"""Width of the picture of trees beside their table [inches]; panels beside one another in that of ticks."""
PANEL, WIDE_PANEL = (3.4, 2.0), (6.5, 2.8)
"""Least width and height of a panel, without and with other engines [inches]."""
GREY = "#6e7781"
OTHERS = ("x", "^", "v", "<", ">", "p", "*", "d", "s", "h", "8", "H")
"""Marks of other programs, all in grey."""
LEAST = 1e-2
"""A tenth of the lowest decade that is shown [mm]."""
LEVEL_MARKS = {1: "v", 2: "D", 3: "s", 4: "o", 5: "*"}
"""Marks by the level of the sphere tree."""
TITLES = {
    **dict.fromkeys(TRADE_OFFS, "Time of a tick against distance from the true mesh"),
    "trees": "Largest error of a tree against its spheres, and against the time of its builder",
}
CAPTIONS = {
    **dict.fromkeys(
        TRADE_OFFS,
        "Mark: median CPU time of a tick in contact; the line from it ends at p99. Off the true mesh: the larger of "
        "the deepest penetration and the farthest contact point, over all motions. A hollow mark is one linearisation; "
        "steps join those that none beats. Grey: other engines, whose ratios carry over to another machine, and not "
        "their times. Red: 1 ms.",
    ),
    "trees": "Error: the larger of how far the leaf spheres reach out of the mesh and how far the mesh lies outside of "
    "them. Other programs: as measured in November 2026 on one core of a 2-core machine.",
}


def has_trade_off(found: BenchTable) -> bool:
    """Return True for a table with the columns of such a picture."""
    return TRADE_OFF_COLUMNS.get(found.suite) in {column.name for column in found.columns}


def bench_trade_off(suite: str, rows: Sequence[Row]) -> ReportFigure | None:
    """Draw the rows of a table of one of `TITLES`; None if no row has both a cost and an error."""
    drawing, marks, _ = _drawing(suite, rows)
    if not marks:
        return None
    alt = f"{TITLES[suite]}: {counted(marks, 'point')}."
    return drawn_figure(f"bench-{suite}", TITLES[suite], CAPTIONS[suite], alt, drawing)


def draw_trade_off(path: Path, suite: str, rows: Sequence[Row], peers: Sequence[Row] = (), note: str = "") -> None:
    """Write the picture of a table, with a note on the run in its legend.

    Engines of `peers`, rows of a table of `hhsim bench peers`, are drawn in grey.

    Errors as `check_picture` and `save_figure`.
    """
    check_picture(path)
    drawing, _, least = _drawing(suite, rows, peers, note)
    width = ACROSS * least if suite in TRADE_OFFS else WIDTH
    caption = wrap(CAPTIONS[suite], int(width / LETTER))
    height = drawing.height(width, False) + LEGEND_LINE * len(caption)
    with new_figure(width, height) as figure:
        drawing.draw(figure, False)
        figure.text(0.0, 0.0, "\n".join(caption), color=SOFT, va="bottom", linespacing=1.2)
        save_figure(figure, path)


def _drawing(suite: str, rows: Sequence[Row], peers: Sequence[Row] = (), note: str = "") -> tuple[Drawing, int, float]:
    """Return the drawing of a table, the number of its marks, and the least width of a panel [inches]."""
    panels, legend = _of_trees(rows) if suite == "trees" else _of_ticks(rows, peers)
    if note:
        legend[note] = LIMIT, ""
    has_others = suite in TRADE_OFFS and any(color == GREY for color, _ in legend.values())
    size = WIDE_PANEL if has_others else PANEL
    known = sum(mark.known for panel in panels for mark in panel.marks)
    return trade_off_drawing(panels, legend, size), known, size[0]


def _others(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return colour and mark of other programs, by their names."""
    return {name: (GREY, OTHERS[i % len(OTHERS)]) for i, name in enumerate(dict.fromkeys(names))}


def _of_trees(rows: Sequence[Row]) -> Panels:
    """Return panels of each object's trees: against their spheres, then against the time of the builder."""
    names = list(dict.fromkeys(row["object"] for row in rows))[:MOST_OBJECTS]
    others = _others(row["method"] for row in rows if row["is_reference"] and row["method"] != TOOLKIT)
    panels = []
    axes = (
        ("spheres", "asked", "spheres", "{:,.0f}".format),
        ("cpu", "cpu_limit", "CPU time of the builder", time_text),
    )
    for cost, limit, axis, spelled in axes:
        for name in names:
            marks = []
            for row in (row for row in rows if row["object"] == name):
                place, off = _number(row[cost]), 1e3 * largest_error(row)
                if row["method"] == TOOLKIT:
                    marks.append(Mark(place, off, INK, "X"))
                elif row["is_reference"]:
                    marks.append(Mark(place, off, *others[row["method"]]))
                else:
                    marks.append(Mark(place, off, BLUE, "o", best=True))
                    marks.append(Mark(_number(row[limit]), 1e3 * _number(row["protrusion_limit"]), LIMIT, "_"))
            panels.append(TradeOff(f"{name}: largest error [mm]", marks, 10.0 * LEAST, None, axis, None, spelled))
    legend = {"certified: proved covers": (BLUE, "o"), "Bradshaw's toolkit, medial": (INK, "X"), "limit": (LIMIT, "_")}
    return panels, legend | others


def _of_ticks(rows: Sequence[Row], peers: Sequence[Row]) -> Panels:
    """Return a panel for each object, and of `speed-error` one against the optimum."""
    summed = [row for row in rows if row["motion"] == ALL and not row.get("stretch")]
    others = [row for row in peers if row["motion"] == ALL and not row["ours"]]
    names = list(dict.fromkeys(row["object"] for row in summed if row["object"] != ALL))
    # Objects that other engines were measured on say the most.
    names.sort(key=lambda name: bool(others) and not any(row["object"] == name for row in others))
    ours = [row for row in summed if row.get("ours", True)]
    colors = {name: run_style(number)[0] for number, name in enumerate(dict.fromkeys(row["method"] for row in ours))}
    engines = _others(row["method"] for row in (*summed, *others) if row["method"] not in colors)

    def mark(row: Row, error: str, frontier: str) -> Mark:
        time, until = _number(row["tick_cpu_p50"]), _number(row.get("tick_cpu_p99"))
        off, best = 1e3 * _number(row.get(error)), bool(row.get(frontier))
        if row["method"] not in colors:
            return Mark(time, off, *engines[row["method"]], until, best=best)
        filled = row.get("linearisations") != 1
        return Mark(time, off, colors[row["method"]], _touched(row)[1], until, filled=filled, best=best)

    def panel(title: str, name: str, error: str, frontier: str) -> TradeOff:
        chosen = (row for row in (*summed, *others) if row["object"] == name)
        return TradeOff(title, [mark(row, error, frontier) for row in chosen], LEAST, np.nan)

    of_pose = any("off_optimum_mean" in row for row in summed)
    frontier = "mesh_frontier" if of_pose else "frontier"
    panels = [panel(f"{name}: off the true mesh [mm]", name, "mesh_error", frontier) for name in names]
    panels = panels[: MOST_PANELS - of_pose]
    if of_pose:
        of_all = names[0] if len(names) == 1 else "all objects"
        panels.append(panel(f"{of_all}: off the best pose [mm]", ALL, "off_optimum_mean", "tracking_frontier"))
    legend = {method: (color, "o") for method, color in colors.items()}
    legend |= {label: (INK, shape) for label, shape in sorted(map(_touched, ours))}
    return panels, legend | engines


def _touched(row: Row) -> tuple[str, str]:
    """Return what a row's hand touches, in words, and its mark."""
    if row["surface"] == "mesh":
        return "the mesh itself", "P"
    level = row.get("level")
    return ("spheres", "o") if level is None else (f"spheres of level {level:.0f}", LEVEL_MARKS.get(level, "o"))


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def largest_error(row: Row) -> float:
    """Return the larger of protrusion and gap [m], as far as they are known."""
    known = [value for value in (row["protrusion_max"], row["gap_max"]) if value is not None and not np.isnan(value)]
    return float(max(known))
