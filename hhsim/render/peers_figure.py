"""Picture of `hhsim bench peers`: cost of a tick against distance from the true mesh, an object a panel."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.bench.speed_error_table import ALL
from hhsim.render.figure import draw_frontier, logarithmic, new_figure, save_figure
from hhsim.system.picture_path import check_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

Row = dict[str, Any]

OURS, OTHERS = "#1b6ca8", "0.35"
FLOOR = 1e-3
"""Smaller errors are drawn at it [mm]: a logarithm has no zero."""
BUDGET = 1e3
"""Time of a tick at 1 kHz [µs]."""
TIMES = (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
ERRORS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30)
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
        labels[axes] = _draw_panel(axes, [row for row in known if row["object"] == name])
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
        _spread(axes, texts)
    save_figure(figure, path)


def _draw_panel(axes: "Axes", rows: Sequence[Row]) -> list["Annotation"]:
    """Draw marks and frontier, and return the labels, which have no place yet."""
    from matplotlib.patheffects import withStroke

    points = [(1e6 * row["tick_cpu_p50"], max(FLOOR, 1e3 * row["mesh_error"])) for row in rows]
    labels = []
    for row, point in zip(rows, points):
        color = OURS if row["ours"] else OTHERS
        axes.plot(*point, "o" if row["ours"] else "x", color=color, markersize=8, markeredgewidth=2.0, zorder=3)
        label = f"{row['method']}, {row['surface']}" if row["ours"] else row["method"]
        labels.append(
            axes.annotate(
                label, point, xytext=(0.0, 0.0), textcoords="offset points", fontsize=9, color=color, zorder=4,
                path_effects=[withStroke(linewidth=3.0, foreground="white")], annotation_clip=False,
            )
        )  # fmt: skip
    draw_frontier(axes, [point for row, point in zip(rows, points) if row["frontier"]], "0.6", 1.0)
    axes.axvline(BUDGET, color="#b00020", linewidth=1.2)
    axes.set_xlabel("CPU time of a tick in contact, median [µs]", fontsize=11)
    times_found = [time for time, _ in points] or [10.0]
    offs = [off for _, off in points] or [0.1]
    across = (0.6 * min(times_found), 6.0 * float(np.max([BUDGET, *times_found])))
    logarithmic(axes, across, (0.5 * min(offs), 2.5 * max(offs)), TIMES, ERRORS)
    return labels


def _spread(axes: "Axes", labels: Sequence["Annotation"]) -> None:
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
