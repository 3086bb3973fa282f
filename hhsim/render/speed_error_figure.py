"""Pareto pictures of `hhsim bench speed-error` and `hhsim bench peers`: cost of a tick against its error."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.bench.speed_error import NO_LEVEL
from hhsim.bench.speed_error_table import ALL, chosen
from hhsim.render.figure import draw_frontier, halo, legend_mark, logarithmic, new_figure, save_figure
from hhsim.system.output_path import check_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

Row = dict[str, Any]

BUDGET = 1e3
"""Time of a tick at 1 kHz [µs]."""
COLORS = {"coupled": "#1b6ca8", "progressive": "#c8641a", "paper": "#7a3b8f", "penalty": "#4a7d2f"}
OTHER_COLOR = "#8a6d1b"
MARKERS = {NO_LEVEL: "P", 1: "v", 2: "D", 3: "s", 4: "o", 5: "*"}
SIZES = {NO_LEVEL: 95.0, 1: 45.0, 2: 40.0, 3: 46.0, 4: 58.0, 5: 130.0}
"""Size of a mark by the level of the sphere tree, and for the mesh itself."""
GREY = "0.45"
PAPER_RANGE = (310.0, 1000.0)
"""CPU time of a tick that the paper states for simple to complex objects, on a 6-core 3.7 GHz machine [µs]."""
FLOOR = 1e-4
"""Smaller errors are drawn at it [mm]: a logarithm has no zero."""
TIMES = (5, 10, 20, 50, 100, 200, 500, 1000, 5000)
ERRORS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50)
NAMES_AT, LINE = 0.74, 0.036
"""Place of the engines' names and their least distance, as shares of a panel's width and height."""
DECADES = (0.0001, 0.001, 0.01, 0.1, 1, 10, 100)
"""Ticks of a panel of many decades; those of one of few are `ERRORS`."""


def draw_speed_error(path: Path, rows: Sequence[Row], peers: Sequence[Row] = ()) -> None:
    """Draw the trade-off: a panel against the true mesh for up to two objects, one against the optimum.

    Engines of `peers`, a table of `hhsim bench peers`, are drawn in grey. Errors as `save_figure`.
    """
    check_picture(path)
    names = list(dict.fromkeys(row["object"] for row in rows if row["object"] != ALL))
    others = {name: chosen_peers(peers, name) for name in names}
    # Objects that the peers were measured on say the most.
    shown = sorted(names, key=lambda name: (len(others[name]) < 2, names.index(name)))[:2]
    figure = new_figure(19.2, 8.4)
    panels = figure.subplots(1, len(shown) + 1, squeeze=False)[0]
    for axes, name in zip(panels, shown):
        mine = chosen(rows, object=name, motion=ALL)
        _draw_panel(axes, mine, "mesh_error", "mesh_frontier", 5e4 if others[name] else 2e3)
        _name_surfaces(axes, mine, "mesh_error")
        _draw_peers(axes, others[name])
        axes.set_title(f"{name}: off the true mesh [mm]", fontsize=15, loc="left")
    last = panels[-1]
    _draw_panel(last, chosen(rows, object=ALL, motion=ALL), "off_optimum_mean", "tracking_frontier", 2e3)
    whose = "all objects" if len(names) > 1 else names[0]
    last.set_title(f"{whose}: off the best pose [mm]", fontsize=15, loc="left")
    _draw_legend(figure, chosen(rows, object=ALL, motion=ALL), peers=any(others.values()))
    grey = "Grey: other engines, as hhsim bench peers measured them; " if any(others.values()) else ""
    note = (
        "Off the true mesh: the larger of the deepest penetration and the farthest contact point. Off the best pose: "
        "palm or fingertip, from where the converged optimum on the mesh itself has it, mean.\n"
        f"{grey}ratios carry over, times do not. The paper's times are those it states for its own machine."
    )
    figure.text(0.012, 0.012, note, fontsize=11.5, color="0.35", va="bottom")
    figure.subplots_adjust(left=0.042, right=0.992, top=0.86, bottom=0.145, wspace=0.13)
    save_figure(figure, path)


def _draw_panel(axes: "Axes", rows: Sequence[Row], error: str, flag: str, longest: float) -> None:
    axes.axvline(BUDGET, color="#b00020", linewidth=1.5)
    axes.axvspan(*PAPER_RANGE, color=GREY, alpha=0.12, linewidth=0)
    for row in sorted(rows, key=lambda row: row[flag]):
        time, off = 1e6 * row["tick_cpu_p50"], max(FLOOR, 1e3 * row[error])
        if np.isnan(time) or np.isnan(1e3 * row[error]):
            continue
        color = COLORS.get(row["method"], OTHER_COLOR)
        face = color if row["linearisations"] > 1 else "white"
        axes.scatter(
            time, off, s=SIZES[row["level"]], marker=MARKERS[row["level"]], facecolor=face, edgecolor=color,
            linewidth=1.3, zorder=4 if row[flag] else 3,
        )  # fmt: skip
    best = [(1e6 * row["tick_cpu_p50"], max(FLOOR, 1e3 * row[error])) for row in rows if row[flag]]
    draw_frontier(axes, best, "0.15", 1.4)
    axes.set_xlabel("CPU time of a tick in contact, median [µs]", fontsize=13)
    axes.tick_params(labelsize=12)
    errors = [max(FLOOR, 1e3 * row[error]) for row in rows if not np.isnan(row[error])]
    low = min(0.55 * min(errors, default=0.05), 0.02)
    high = 1.6 * max([*errors, 2.0])
    fastest = min([1e6 * row["tick_cpu_p50"] for row in rows if row["tick_cpu_p50"] > 0.0], default=5.0)
    marked = DECADES if high > 3e3 * low else ERRORS
    logarithmic(axes, (min(4.0, 0.25 * fastest), longest), (low, high), TIMES, marked)


def _name_surfaces(axes: "Axes", rows: Sequence[Row], error: str) -> None:
    """Write left of each level, and of the mesh, what it is."""
    known = [row for row in rows if not np.isnan(row["tick_cpu_p50"]) and not np.isnan(row[error])]
    for level in {row["level"] for row in known}:
        same = [row for row in known if row["level"] == level]
        fastest = 1e6 * min(row["tick_cpu_p50"] for row in same)
        middle = max(FLOOR, 1e3 * float(np.median([row[error] for row in same])))
        text = "mesh" if level == NO_LEVEL else f"level {level}"
        axes.annotate(
            text, (fastest, middle), (-9.0, 0.0), textcoords="offset points",
            ha="right", va="center", fontsize=12, color="0.15",
            **halo(3.0),
        )  # fmt: skip


def chosen_peers(peers: Sequence[Row], name: str) -> list[Row]:
    """Return the rows of a table of `hhsim bench peers` of other engines on one object, over all motions."""
    return [
        row
        for row in peers
        if (row["object"], row["motion"]) == (name, ALL) and not row["ours"] and not np.isnan(row["mesh_error"])
    ]


def _draw_peers(axes: "Axes", peers: Sequence[Row]) -> None:
    """Draw crosses, and their names down the right side in the same order, with a thin line to each."""
    if not peers:
        return
    low, high = np.log(axes.get_ylim())
    places = [(1e6 * peer["tick_cpu_p50"], max(FLOOR, 1e3 * peer["mesh_error"])) for peer in peers]
    order = sorted(range(len(peers)), key=lambda i: -places[i][1])
    heights = _spread([float((np.log(places[i][1]) - low) / (high - low)) for i in order])
    for i, height in zip(order, heights):
        axes.plot(*places[i], "x", color=GREY, markersize=8, markeredgewidth=2.0, zorder=3)
        line = {"arrowstyle": "-", "color": "0.75", "linewidth": 0.8, "shrinkA": 1.0, "shrinkB": 6.0}
        axes.annotate(
            peers[i]["method"], places[i], (NAMES_AT, height), textcoords="axes fraction",
            ha="left", va="center", fontsize=11, color=GREY, arrowprops={**line, "relpos": (0.0, 0.5)},
        )  # fmt: skip


def _spread(heights: Sequence[float]) -> list[float]:
    """Return heights of lines of text, from the top down: near those wanted, without overlap."""
    down, up = list(heights), list(heights)
    for i in range(1, len(heights)):
        down[i] = min(down[i], down[i - 1] - LINE)
        up[-1 - i] = max(up[-1 - i], up[-i] + LINE)
    return [(low + high) / 2.0 for low, high in zip(down, up)]


def _draw_legend(figure: Any, rows: Sequence[Row], *, peers: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    methods = list(dict.fromkeys(row["method"] for row in rows))
    levels = sorted({row["level"] for row in rows}, key=lambda level: (level == NO_LEVEL, level))

    handles: list[Any] = [legend_mark(method, "o", COLORS.get(method, OTHER_COLOR)) for method in methods]
    names = {n: f"spheres of level {n}" if n != NO_LEVEL else "the mesh itself" for n in levels}
    handles += [legend_mark(name, MARKERS[n], "0.2", size=0.97 * SIZES[n] ** 0.5) for n, name in names.items()]
    handles += [
        legend_mark("one linearisation", "o", "0.2", "white"),
        Line2D([], [], color="0.15", linewidth=1.4, label="frontier"),
        Line2D([], [], color="#b00020", linewidth=1.5, label="1 ms: the budget at 1 kHz"),
        *([legend_mark("other engines", "x", GREY)] if peers else []),
        Patch(color=GREY, alpha=0.15, label="the paper's times; error not given"),
    ]
    figure.legend(
        handles=handles, loc="upper left", ncols=7, fontsize=11.5, frameon=False, bbox_to_anchor=(0.03, 0.995)
    )


OURS, OTHERS = "#1b6ca8", "0.35"
PEER_FLOOR = 1e-3
"""Smaller errors are drawn at it [mm]: a logarithm has no zero."""
PEER_TIMES = (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
PEER_ERRORS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30)
PANELS = 4
MARK = 6.0
"""Half of a mark's width [pixels]."""
Place = tuple[float, float, str, str]
PLACES: tuple[Place, ...] = (
    (8.0, 6.0, "left", "center"),
    (-8.0, 6.0, "right", "center"),
    *((x, y, side, "center") for y in (-7.0, 14.0, -14.0) for x, side in ((6.0, "left"), (-6.0, "right"))),
    *((0.0, y, "center", "center") for y in (13.0, -13.0, 24.0, -24.0)),
    *((x, y, side, "center") for y in (24.0, -24.0, 34.0, -34.0) for x, side in ((4.0, "left"), (-4.0, "right"))),
)
"""Places of a label beside its mark, the nearest first: offsets [points] and alignment."""


def draw_peers(path: Path, rows: Sequence[Row]) -> None:
    """Draw each object's methods over all its motions, and the Pareto frontier; errors as `save_figure`."""
    check_picture(path)
    names = [name for name in dict.fromkeys(row["object"] for row in rows) if name != ALL][:PANELS]
    across = min(2, len(names))
    down = -(-len(names) // across)
    figure = new_figure(8.0 * across, 5.2 * down)
    panels = figure.subplots(down, across, squeeze=False).ravel()
    known = [row for row in rows if row["motion"] == ALL and row["mesh_error"] == row["mesh_error"]]
    labels = {}
    for axes, name in zip(panels, names):
        labels[axes] = _draw_methods(axes, [row for row in known if row["object"] == name])
        axes.set_title(f"{name}: off the true mesh, most [mm]", fontsize=12, loc="left")
    for axes in panels[len(names) :]:
        axes.set_visible(False)
    note = (
        "The larger of the deepest penetration and the farthest that a pushed body is off the mesh, over all motions.\n"
        "Blue: hhsim; grey: other engines. Red: 1 ms, the budget at 1 kHz."
    )
    figure.text(0.01, 0.01, note, fontsize=9, color="0.35")
    figure.tight_layout(rect=(0.0, 0.06, 1.0, 1.0))
    # Free places for labels are known when the panels have their places.
    for axes, texts in labels.items():
        _place_labels(axes, texts)
    save_figure(figure, path)


def _draw_methods(axes: "Axes", rows: Sequence[Row]) -> list["Annotation"]:
    """Draw marks and frontier, and return the labels, which have no place yet."""
    points = [(1e6 * row["tick_cpu_p50"], max(PEER_FLOOR, 1e3 * row["mesh_error"])) for row in rows]
    labels = []
    for row, point in zip(rows, points):
        color = OURS if row["ours"] else OTHERS
        axes.plot(*point, "o" if row["ours"] else "x", color=color, markersize=8, markeredgewidth=2.0, zorder=3)
        label = f"{row['method']}, {row['surface']}" if row["ours"] else row["method"]
        labels.append(
            axes.annotate(
                label, point, xytext=(0.0, 0.0), textcoords="offset points", fontsize=9, color=color, zorder=4,
                **halo(3.0), annotation_clip=False,
            )
        )  # fmt: skip
    draw_frontier(axes, [point for row, point in zip(rows, points) if row["frontier"]], "0.6", 1.0)
    axes.axvline(BUDGET, color="#b00020", linewidth=1.2)
    axes.set_xlabel("CPU time of a tick in contact, median [µs]", fontsize=11)
    times_found = [time for time, _ in points] or [10.0]
    offs = [off for _, off in points] or [0.1]
    across = (0.6 * min(times_found), 6.0 * float(np.max([BUDGET, *times_found])))
    logarithmic(axes, across, (0.5 * min(offs), 2.5 * max(offs)), PEER_TIMES, PEER_ERRORS)
    return labels


def _place_labels(axes: "Axes", labels: Sequence["Annotation"]) -> None:
    """Put each label beside its mark, where it covers the least of the other labels and marks."""
    from matplotlib.transforms import Bbox

    marks = [axes.transData.transform(label.xy) for label in labels]
    taken = [Bbox.from_extents(x - MARK, y - MARK, x + MARK, y + MARK) for x, y in marks]
    for i in sorted(range(len(labels)), key=lambda i: tuple(marks[i])):
        label = labels[i]

        def covered(place: Place, label: "Annotation" = label) -> float:
            *offset, beside, above = place
            label.set(position=offset, horizontalalignment=beside, verticalalignment=above)
            box = label.get_window_extent()
            inside = Bbox.intersection(box, axes.bbox)
            outside = box.width * box.height - (inside.width * inside.height if inside else 0.0)
            overlaps = (Bbox.intersection(box, other) for other in taken)
            return outside + sum(overlap.width * overlap.height for overlap in overlaps if overlap)

        covered(min(PLACES, key=covered))
        taken.append(label.get_window_extent())
