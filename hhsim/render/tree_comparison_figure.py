"""Picture of `hhsim bench trees`: largest error against spheres, and against CPU time, an object a column."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hhsim.bench.trees import largest_error
from hhsim.render.figure import legend_mark, logarithmic, new_figure, save_figure
from hhsim.system.picture_path import check_picture
from hhsim.trees.published_results import BARS, EXTENT, TOOLKIT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Row = Mapping[str, Any]

COLOR = "#1b6ca8"
GREY = "0.45"
BAR_COLOR = "#b00020"
MOST_COLUMNS = 6
NARROWEST = 12.0
"""Width that the legend and the note need [inches]."""
SPHERES = (8, 64, 512, 4096, 32768)
SECONDS = (0.01, 0.1, 1, 10, 100, 1000)
ERRORS = (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200)


def draw_trees(path: Path, rows: Sequence[Row], size: float) -> None:
    """Draw the table of `hhsim.bench.trees.measure` for objects of extent `size` [m]; errors as `save_figure`."""
    check_picture(path)
    names = list(dict.fromkeys(row["object"] for row in rows))[:MOST_COLUMNS]
    shown = [row for row in rows if row["object"] in names]
    figure = new_figure(max(2.9 * len(names) + 1.2, NARROWEST), 9.6)
    panels = figure.subplots(2, len(names), squeeze=False)
    errors = [1e3 * largest_error(row) for row in shown]
    heights = 0.6 * min(errors), 1.6 * max(errors)
    for row, (across, what, ticks) in enumerate(
        (("spheres", "spheres", SPHERES), ("cpu", "CPU time of the builder [s]", SECONDS))
    ):
        known = [float(one[across]) for one in shown if one[across] is not None]
        for column, (axes, name) in enumerate(zip(panels[row], names)):
            _draw(axes, [one for one in shown if one["object"] == name], across, name, size)
            logarithmic(axes, (0.6 * min(known), 1.7 * max(known)), heights, ticks, ERRORS)
            axes.set_xlabel(what, fontsize=12)
            axes.tick_params(labelsize=11, labelleft=column == 0)
            if row == 0:
                axes.set_title(name, fontsize=15, loc="left")
            if column == 0:
                axes.set_ylabel("largest error [mm]", fontsize=13)
    _draw_legend(figure, shown)
    note = (
        f"Objects of {1e3 * size:g} mm. Error: the larger of how far the leaf spheres reach out of the mesh and "
        "how far the mesh lies outside of them.\nThe trees built here leave no gap. Other programs: as measured in "
        "November 2026 on one core of a 2-core machine."
    )
    figure.text(0.012, 0.012, note, fontsize=11, color="0.35", va="bottom")
    width = figure.get_figwidth()
    figure.subplots_adjust(left=0.85 / width, right=1.0 - 0.15 / width, top=0.86, bottom=0.135, wspace=0.08, hspace=0.2)
    save_figure(figure, path)


def _draw(axes: "Axes", rows: Sequence[Row], across: str, name: str, size: float) -> None:
    from matplotlib.patheffects import withStroke

    own = sorted((float(row[across]), 1e3 * largest_error(row)) for row in rows if not row["is_reference"])
    axes.plot(
        *zip(*own), marker="o", color=COLOR, linewidth=1.6, markersize=8.0, markeredgecolor="white",
        markeredgewidth=0.8, zorder=4,
    )  # fmt: skip
    for row in rows:
        if row["is_reference"] and row[across] is not None:
            place = float(row[across]), 1e3 * largest_error(row)
            if row["method"] == TOOLKIT:
                axes.plot(*place, "X", color="0.25", markersize=9.0, markeredgecolor="white", zorder=5)
                continue
            axes.plot(*place, "x", color=GREY, markersize=7.0, zorder=5)
            if across == "spheres":
                axes.annotate(
                    row["method"], place, (5.0, 5.0), textcoords="offset points", fontsize=9.0, color=GREY,
                    path_effects=[withStroke(linewidth=2.5, foreground="white")], zorder=5,
                )  # fmt: skip
    for (object_name, spheres), bar in BARS.items():
        if object_name == name and any(row["asked"] == spheres for row in rows):
            x = float(spheres) if across == "spheres" else bar.cpu
            axes.plot(x, 1e3 * bar.protrusion * size / EXTENT, "_", color=BAR_COLOR, markersize=20, markeredgewidth=2.0)


def _draw_legend(figure: Any, rows: Sequence[Row]) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=COLOR, marker="o", linewidth=1.6, markersize=8.0, label="certified: proved covers")]
    if any(row["is_reference"] and row["method"] == TOOLKIT for row in rows):
        handles.append(legend_mark("Bradshaw's toolkit, medial", "X", "0.25", size=9.0))
    if any(row["is_reference"] and row["method"] != TOOLKIT and row["spheres"] is not None for row in rows):
        handles.append(legend_mark("other programs", "x", GREY, size=7.0))
    if any(row["protrusion_limit"] is not None for row in rows):
        handles.append(legend_mark("limit for certified", "_", BAR_COLOR, size=16.0))
    columns = 4 if figure.get_figwidth() < 15.0 else 7
    figure.legend(
        handles=handles, loc="upper left", ncols=columns, fontsize=11.5, frameon=False, bbox_to_anchor=(0.01, 0.995)
    )
