"""Picture of `hhsim build-tree`: a mesh, its spheres coloured by protrusion, and errors of all levels."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.mesh.mesh import Mesh
from hhsim.mesh.signed_bvh import heights, signed_bvh
from hhsim.render.figure import new_figure, save_figure, tidy
from hhsim.render.rasterizer import blend, frame, lit, look_from, see_spheres, shade
from hhsim.render.triangle_soup import mesh_surface
from hhsim.system.output_path import check_picture
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
    depth, normals, there = see_spheres(scale * center, scale * radius, camera)
    points = center[there] + radius[there, None] * (normals @ camera.rotation)
    height = heights(signed_bvh(mesh), points)
    spheres = lit(depth, normals, colormaps[COLORS](np.clip(height / highest, 0.0, 1.0))[:, :3], camera)

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
