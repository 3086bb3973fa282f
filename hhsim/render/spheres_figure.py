"""Pictures of meshes and their spheres, coloured by protrusion: of `hhsim build-tree`, and of the links of a robot."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.signed_bvh import heights, signed_bvh
from hhsim.render.figure import new_figure, save_figure, tidy
from hhsim.render.rasterizer import blend, frame, lit, see_spheres, shade
from hhsim.render.triangle_soup import joined, look_from, mesh_surface, moved
from hhsim.robots.formats import RobotSpheres
from hhsim.robots.touching_pairs import start_poses
from hhsim.system.output_path import check_picture
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWN_EXTENT = 0.1
"""Longest extent that is drawn [m]: the shading is made for things of a hand's size."""
PIXELS = 620
HEIGHT, BAR = 7.2, 1.3
"""Height of a robot's picture, and width of what is beside its two views [inches]."""
ASPECTS = (0.75, 1.5)
"""Least and most width of a robot's view over its height."""
TREE_VIEW, ROBOT_VIEW = look_from((0.45, -1.0, 0.42)), look_from((1.0, -0.75, 0.4))
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


class Part(NamedTuple):
    """A mesh and its spheres in its own frame [m], and the place of the frame: rotation (3, 3), position (3,) [m]."""

    mesh: Mesh
    tree: SphereTree
    turn: FloatArray
    place: FloatArray


def draw_tree(path: Path, mesh: Mesh, tree: SphereTree) -> None:
    """Draw a mesh and its tree, whose errors are measured; errors as `save_figure`."""
    check_picture(path)
    last = tree.errors[-1]
    highest = max(last.protrusion_max, 1e-12)
    part = Part(mesh, tree, np.eye(3), np.zeros(3))
    pictures = _pictures([part], float(mesh.extent.max()), TREE_VIEW, (1.0, 1.0), highest)
    figure = new_figure(19.2, 6.9)
    grey = "; grey: the mesh outside of them" if last.gap_max > _LEAST else ""
    titles = f"{mesh.name}: {len(mesh.faces):,} triangles", f"level {last.level}: {last.spheres:,} spheres{grey}"
    _show(figure, pictures, titles, [(0.005, 0.02, 0.32, 0.88), (0.33, 0.02, 0.32, 0.88)])
    _bar(figure, (0.648, 0.16, 0.009, 0.6), highest, "out of the mesh [mm]")
    _draw_errors(figure.add_axes((0.745, 0.14, 0.245, 0.76)), tree)
    save_figure(figure, path)


def draw_robot(path: Path, found: RobotSpheres) -> None:
    """Draw a robot and its spheres where every joint is near 0; errors as `save_figure`."""
    check_picture(path)
    poses = start_poses(found.robot)
    parts = [Part(each.mesh, each.tree, *(of[0] for of in poses[each.name])) for each in found.links]
    ends = [tree.leaf_center @ turn.T + place for _, tree, turn, place in parts]
    radii = np.concatenate([tree.leaf_radius for _, tree, _, _ in parts])[:, None]
    extent = float(np.ptp(np.concatenate([np.concatenate(ends) + side * radii for side in (-1.0, 1.0)]), axis=0).max())
    highest = max(float(max(each.fit.protrusion_max for each in found.links)), 1e-12)
    pictures = _pictures(parts, 0.5 * extent, ROBOT_VIEW, ASPECTS, highest)
    width = HEIGHT * pictures[0].shape[1] / pictures[0].shape[0]
    whole = 2.0 * width + BAR
    figure = new_figure(whole, HEIGHT)
    grey = "; grey: links outside of them" if any(each.fit.surface_gap_max > 0.0 for each in found.links) else ""
    titles = f"{len(parts)} links of {found.robot.name}", f"{sum(map(len, ends)):,} spheres{grey}"
    _show(figure, pictures, titles, [(k * width / whole, 0.02, width / whole, 0.90) for k in (0, 1)])
    _bar(figure, (1.0 - 0.8 * BAR / whole, 0.16, 0.15 / whole, 0.6), highest, "out of the link [mm]")
    save_figure(figure, path)


def _pictures(
    parts: Sequence[Part], extent: float, view: FloatArray, aspects: tuple[float, float], highest: float
) -> tuple[FloatArray, FloatArray]:
    """Return the meshes alone and with their spheres, red where these are `highest` [m] out of them."""
    from matplotlib import colormaps

    scale = DRAWN_EXTENT / extent
    surface = joined(
        [moved(mesh_surface(mesh.scaled(scale), MESH_COLOR), turn, scale * place) for mesh, _, turn, place in parts]
    )
    center = np.concatenate([tree.leaf_center @ turn.T + place for _, tree, turn, place in parts])
    radius = np.concatenate([tree.leaf_radius for _, tree, _, _ in parts])
    owner = np.repeat(np.arange(len(parts)), [tree.leaf_count for _, tree, _, _ in parts])
    edges = [scale * (center + side * radius[:, None] * view[k]) for k in (0, 1) for side in (-1.0, 1.0)]
    reach = np.concatenate([surface.points, *edges])
    wide, tall = np.ptp(reach @ view[:2].T, axis=0)
    camera = frame(reach, view, (PIXELS, round(float(np.clip(wide / tall, *aspects)) * PIXELS)))
    depth, normals, there = see_spheres(scale * center, scale * radius, camera)
    points, height = center[there] + radius[there, None] * (normals @ camera.rotation), np.empty(len(there))
    for k, (mesh, _, turn, place) in enumerate(parts):
        own = np.flatnonzero(owner[there] == k)
        height[own] = heights(signed_bvh(mesh), np.ascontiguousarray((points[own] - place) @ turn))
    colors = colormaps[COLORS](np.clip(height / highest, 0.0, 1.0))[:, :3]
    alone = shade(surface, camera)
    return blend([(alone, 1.0)]), blend([(alone, 1.0), (lit(depth, normals, colors, camera), 1.0)])


def _show(
    figure: "Figure", pictures: Sequence[FloatArray], titles: Sequence[str], places: Sequence[tuple[float, ...]]
) -> None:
    for picture, title, (left, bottom, width, height) in zip(pictures, titles, places, strict=True):
        axes = figure.add_axes((left, bottom, width, height))
        axes.imshow(picture)
        axes.set_axis_off()
        axes.set_title(title, fontsize=16, color="0.2", loc="center")


def _bar(figure: "Figure", place: tuple[float, float, float, float], highest: float, label: str) -> None:
    """Draw the scale of the colours, up to a height [m]."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colors = ScalarMappable(Normalize(0.0, 1e3 * highest), colormaps[COLORS])
    bar = figure.colorbar(colors, cax=figure.add_axes(place))
    bar.set_label(label, fontsize=13)
    bar.ax.tick_params(labelsize=12)
    bar.outline.set_visible(False)


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
