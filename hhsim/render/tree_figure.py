"""Pictures of `hhsim build-tree` and of `hhsim bench trees`.

The one has a mesh, its spheres coloured by protrusion, and errors of all levels; the other the largest error against
spheres, and against CPU time, an object a column.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.trees import largest_error
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.render.figure import halo, legend_mark, logarithmic, new_figure, save_figure, tidy
from hhsim.render.rasterizer import Camera, Layer, blend, frame, lit, look_from, see_spheres, shade
from hhsim.render.triangle_soup import mesh_surface
from hhsim.system.output_path import check_picture
from hhsim.trees.published_results import BARS, EXTENT, TOOLKIT
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DRAWN_EXTENT = 0.1
"""Longest extent that is drawn [m]: the shading is made for things of a hand's size."""
PIXELS = 620
VIEW = look_from((0.45, -1.0, 0.42))
MESH_COLOR = np.array([0.80, 0.79, 0.77])
COLORS = "RdYlBu_r"
CURVES = (
    ("protrusion_max", "protrusion, largest", "#1b6ca8", "o", "-"),
    ("protrusion_p99", "protrusion, 99th percentile", "#4a90c2", "s", "-"),
    ("protrusion_mean", "protrusion, mean", "#8fbfe0", "D", "-"),
    ("gap_max", "gap, largest", "#b00020", "v", "-"),
    ("bound", "protrusion, proved bound", "0.25", "", ":"),
)
"""Field of the errors, label, colour, marker and line."""
_LEAST = 1e-9
"""Smaller lengths are nothing [m]."""


def draw_tree(path: Path, mesh: Mesh, tree: SphereTree) -> None:
    """Draw a mesh and its tree, whose errors are measured; errors as `save_figure`."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    check_picture(path)
    last = tree.errors[-1]
    highest = max(last.protrusion_max, 1e-12)
    scale = DRAWN_EXTENT / float(mesh.extent.max())
    surface = mesh_surface(mesh.scaled(scale), MESH_COLOR)
    center, radius = tree.spheres(tree.depth)
    reach = np.concatenate(
        [surface.points, *(scale * (center + side * radius[:, None] * VIEW[k]) for k in (0, 1) for side in (-1.0, 1.0))]
    )
    camera = frame(reach, VIEW, (PIXELS, PIXELS))
    alone = shade(surface, camera)
    spheres = _spheres(mesh, center, radius, scale, highest, camera)

    figure = new_figure(19.2, 6.9)
    grey = "; grey: the mesh outside of them" if last.gap_max > _LEAST else ""
    title = f"{mesh.name}: {len(mesh.faces):,} triangles", f"level {last.level}: {last.spheres:,} spheres{grey}"
    for column, (text, layers) in enumerate(zip(title, ([alone], [alone, spheres]), strict=True)):
        axes = figure.add_axes((0.005 + 0.325 * column, 0.02, 0.32, 0.88))
        axes.imshow(blend([(layer, 1.0) for layer in layers]))
        axes.set_axis_off()
        axes.set_title(text, fontsize=16, color="0.2", loc="center")
    bar = figure.colorbar(
        ScalarMappable(Normalize(0.0, 1e3 * highest), colormaps[COLORS]), cax=figure.add_axes((0.648, 0.16, 0.009, 0.6))
    )
    bar.set_label("out of the mesh [mm]", fontsize=13)
    bar.ax.tick_params(labelsize=12)
    bar.outline.set_visible(False)
    _draw_errors(figure.add_axes((0.745, 0.14, 0.245, 0.76)), tree)
    save_figure(figure, path)


def _spheres(mesh: Mesh, center: FloatArray, radius: FloatArray, scale: float, highest: float, camera: Camera) -> Layer:
    """Render spheres [m] coloured by their distance outside the mesh, `scale` times as large for the camera."""
    from matplotlib import colormaps

    depth, normals, there = see_spheres(scale * center, scale * radius, camera)
    points = center[there] + radius[there, None] * (normals @ camera.rotation)
    height = mesh_signed_distance(build_mesh_bvh(mesh.vertices, mesh.faces), points)
    color = colormaps[COLORS](np.clip(height / highest, 0.0, 1.0))[:, :3]
    return lit(depth, normals, color, camera)


def _draw_errors(axes: "Axes", tree: SphereTree) -> None:
    errors = tree.errors
    spheres = [error.spheres for error in errors]
    drawn: list[Any] = []
    for name, label, color, marker, line in CURVES:
        heights = [1e3 * getattr(error, name) for error in errors]
        if max(heights) > 1e3 * _LEAST:
            points = [(x, y) for x, y in zip(spheres, heights, strict=True) if y > 1e3 * _LEAST]
            drawn += axes.plot(*zip(*points), color=color, marker=marker, linestyle=line, linewidth=1.8, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    heights = [step * 10.0**power for power in range(-6, 7) for step in (1, 2, 5)]
    inside = [height for height in heights if low <= height <= high]
    axes.set_yticks(inside, [f"{height:g}" for height in inside])
    axes.set_xticks(spheres, [f"{count:,}\nlevel {error.level}" for count, error in zip(spheres, errors, strict=True)])
    axes.minorticks_off()
    axes.set_title("error against spheres", fontsize=16, color="0.2")
    axes.set_xlabel("spheres", fontsize=13)
    axes.set_ylabel("error [mm]", fontsize=13)
    tidy(axes)
    axes.tick_params(labelsize=12)
    axes.legend(handles=drawn, fontsize=12, frameon=False, loc="upper right")
    if max(error.gap_max for error in errors) <= _LEAST:
        axes.text(0.03, 0.04, "no gap at any level", transform=axes.transAxes, fontsize=12, color="0.35")


Row = Mapping[str, Any]

BLUE = "#1b6ca8"
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
            _draw_builders(axes, [one for one in shown if one["object"] == name], across, name, size)
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


def _draw_builders(axes: "Axes", rows: Sequence[Row], across: str, name: str, size: float) -> None:
    own = sorted((float(row[across]), 1e3 * largest_error(row)) for row in rows if not row["is_reference"])
    axes.plot(
        *zip(*own), marker="o", color=BLUE, linewidth=1.6, markersize=8.0, markeredgecolor="white",
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
                    **halo(2.5), zorder=5,
                )  # fmt: skip
    for (object_name, spheres), bar in BARS.items():
        if object_name == name and any(row["asked"] == spheres for row in rows):
            x = float(spheres) if across == "spheres" else bar.cpu
            axes.plot(x, 1e3 * bar.protrusion * size / EXTENT, "_", color=BAR_COLOR, markersize=20, markeredgewidth=2.0)


def _draw_legend(figure: Any, rows: Sequence[Row]) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=BLUE, marker="o", linewidth=1.6, markersize=8.0, label="certified: proved covers")]
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
