"""Pictures of meshes and their spheres, coloured by protrusion: of `hhsim build-tree`, and of the links of a robot."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.signed_bvh import signed_bvh
from hhsim.render.figure import new_figure, save_figure
from hhsim.render.rasterizer import blend, frame, lit, see_spheres, shade
from hhsim.render.triangle_soup import joined, look_from, mesh_surface, moved
from hhsim.robots.formats import RobotSpheres
from hhsim.robots.touching_pairs import start_poses
from hhsim.trees.sphere_tree import SphereTree

DRAWN_EXTENT = 0.1
"""Longest extent that is drawn [m]: the shading is made for things of a hand's size."""
PIXELS = 620
HEIGHT, BAR = 7.2, 1.3
"""Height of a picture, and width of what is beside its two views [inches]."""
ASPECTS = (0.75, 1.5)
"""Least and most width of a view over its height."""
VIEW = look_from((1.0, -0.75, 0.4))
MESH_COLOR = np.array([0.80, 0.79, 0.77])
COLORS = "RdYlBu_r"
LEAST_GAP = 1e-9
"""A gap up to this is none [m]."""


class Part(NamedTuple):
    """A mesh and its spheres in its own frame [m], and the place of the frame: rotation (3, 3), position (3,) [m]."""

    mesh: Mesh
    tree: SphereTree
    turn: FloatArray
    place: FloatArray


def draw_tree(path: Path, mesh: Mesh, tree: SphereTree) -> None:
    """Draw a mesh and its tree, whose errors are measured; errors as `save_figure`."""
    last = tree.errors[-1]
    part, extent = Part(mesh, tree, np.eye(3), np.zeros(3)), float(mesh.extent.max())
    titles = f"{mesh.name}: {len(mesh.faces):,} triangles", f"level {last.level}: {last.spheres:,} spheres"
    _draw(path, [part], extent, last.protrusion_max, titles, last.gap_max > LEAST_GAP, "mesh")


def draw_robot(path: Path, found: RobotSpheres) -> None:
    """Draw a robot and its spheres where every joint is near 0; errors as `save_figure`."""
    poses = start_poses(found.robot)
    parts = [Part(each.mesh, each.tree, *(of[0] for of in poses[each.name])) for each in found.links]
    center, radius = _spheres(parts)
    ends = np.concatenate([center + side * radius[:, None] for side in (-1.0, 1.0)])
    highest = float(max(each.fit.protrusion_max for each in found.links))
    titles = f"{len(parts)} links of {found.robot.name}", f"{len(center):,} spheres"
    has_gap = any(each.fit.surface_gap_max > 0.0 for each in found.links)
    _draw(path, parts, 0.5 * float(np.ptp(ends, axis=0).max()), highest, titles, has_gap, "link")


def _spheres(parts: Sequence[Part]) -> tuple[FloatArray, FloatArray]:
    """Return the centres [m], world, and radii [m] of the leaf spheres of all parts."""
    center = np.concatenate([tree.leaf_center @ turn.T + place for _, tree, turn, place in parts])
    return center, np.concatenate([tree.leaf_radius for _, tree, _, _ in parts])


def _draw(
    path: Path, parts: Sequence[Part], extent: float, highest: float, titles: tuple[str, str], has_gap: bool, what: str
) -> None:
    """Draw parts without and with their spheres, beside the scale of the colours.

    `extent` [m] is that of something large in them, `highest` the farthest that a sphere is out of what it covers [m].
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    highest = max(highest, 1e-12)
    pictures = _pictures(parts, extent, highest)
    width = HEIGHT * pictures[0].shape[1] / pictures[0].shape[0]
    whole = 2.0 * width + BAR
    figure = new_figure(whole, HEIGHT)
    grey = f"; grey: the {what} outside of them" if has_gap else ""
    for k, (picture, title) in enumerate(zip(pictures, (titles[0], titles[1] + grey))):
        axes = figure.add_axes((k * width / whole, 0.02, width / whole, 0.90))
        axes.imshow(picture)
        axes.set_axis_off()
        axes.set_title(title, fontsize=16, color="0.2", loc="center")
    colors = ScalarMappable(Normalize(0.0, 1e3 * highest), colormaps[COLORS])
    bar = figure.colorbar(colors, cax=figure.add_axes((1.0 - 0.8 * BAR / whole, 0.16, 0.15 / whole, 0.6)))
    bar.set_label(f"out of the {what} [mm]", fontsize=13)
    bar.ax.tick_params(labelsize=12)
    bar.outline.set_visible(False)
    save_figure(figure, path)


def _pictures(parts: Sequence[Part], extent: float, highest: float) -> tuple[FloatArray, FloatArray]:
    """Return the meshes alone and with their spheres, red where these are `highest` [m] out of them."""
    from matplotlib import colormaps

    scale = DRAWN_EXTENT / extent
    surface = joined(
        [moved(mesh_surface(mesh.scaled(scale), MESH_COLOR), turn, scale * place) for mesh, _, turn, place in parts]
    )
    center, radius = _spheres(parts)
    owner = np.repeat(np.arange(len(parts)), [part.tree.leaf_count for part in parts])
    edges = [scale * (center + side * radius[:, None] * VIEW[k]) for k in (0, 1) for side in (-1.0, 1.0)]
    reach = np.concatenate([surface.points, *edges])
    wide, tall = np.ptp(reach @ VIEW[:2].T, axis=0)
    camera = frame(reach, VIEW, (PIXELS, round(float(np.clip(wide / tall, *ASPECTS)) * PIXELS)))
    depth, normals, there = see_spheres(scale * center, scale * radius, camera)
    points, height = center[there] + radius[there, None] * (normals @ camera.rotation), np.empty(len(there))
    for k, (mesh, _, turn, place) in enumerate(parts):
        own = np.flatnonzero(owner[there] == k)
        height[own] = mesh_signed_distance(signed_bvh(mesh), (points[own] - place) @ turn)
    colors = colormaps[COLORS](np.clip(height / highest, 0.0, 1.0))[:, :3]
    alone = shade(surface, camera)
    return blend([(alone, 1.0)]), blend([(alone, 1.0), (lit(depth, normals, colors, camera), 1.0)])
