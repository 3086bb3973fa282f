"""Picture of the spheres of a robot: its links, and beside them the spheres, coloured by protrusion."""

from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.signed_bvh import heights, signed_bvh
from hhsim.render.figure import new_figure, save_figure
from hhsim.render.rasterizer import blend, frame, lit, look_from, see_spheres, shade
from hhsim.render.tree_figure import COLORS, MESH_COLOR
from hhsim.render.triangle_soup import joined, mesh_surface, moved
from hhsim.robots.poses import start_poses
from hhsim.robots.robot_spheres import RobotSpheres
from hhsim.system.output_path import check_picture

DRAWN_EXTENT = 0.2
"""Longest extent that is drawn [m]: the shading is made for things of a hand's size."""
PIXELS = 780
HEIGHT, BAR = 7.2, 1.3
"""Height of the picture, and width of what is beside the two views [inches]."""
ASPECTS = (0.75, 1.5)
VIEW = look_from((1.0, -0.75, 0.4))


def draw_robot(path: Path, found: RobotSpheres) -> None:
    """Draw a robot and its spheres where every joint is near 0; errors as `save_figure`."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    check_picture(path)
    poses = {name: (turn[0], place[0]) for name, (turn, place) in start_poses(found.robot).items()}
    places = [poses[link.name] for link in found.links]
    center = np.concatenate([each.tree.leaf_center @ turn.T + at for each, (turn, at) in zip(found.links, places)])
    radius = np.concatenate([each.tree.leaf_radius for each in found.links])
    of_link = np.repeat(np.arange(len(found.links)), [each.tree.leaf_count for each in found.links])
    low, high = (center - radius[:, None]).min(axis=0), (center + radius[:, None]).max(axis=0)
    scale = DRAWN_EXTENT / float((high - low).max())
    surface = joined(
        [
            moved(mesh_surface(Mesh(scale * each.mesh.vertices, each.mesh.faces), MESH_COLOR), turn, scale * at)
            for each, (turn, at) in zip(found.links, places)
        ]
    )
    edges = [scale * (center + side * radius[:, None] * VIEW[k]) for k in (0, 1) for side in (-1.0, 1.0)]
    reach = np.concatenate([surface.points, *edges])
    wide, tall = np.ptp(reach @ VIEW[:2].T, axis=0)
    aspect = float(np.clip(wide / tall, *ASPECTS))
    camera = frame(reach, VIEW, (PIXELS, round(aspect * PIXELS)))
    depth, normals, there = see_spheres(scale * center, scale * radius, camera)
    points = center[there] + radius[there, None] * (normals @ camera.rotation)
    height = _heights(found, places, points, of_link[there])
    highest = max(float(max(each.fit.protrusion_max for each in found.links)), 1e-12)
    colors = colormaps[COLORS](np.clip(height / highest, 0.0, 1.0))[:, :3]
    alone = shade(surface, camera)
    layers = [alone], [alone, lit(depth, normals, colors, camera)]

    width = HEIGHT * aspect
    whole = 2.0 * width + BAR
    figure = new_figure(whole, HEIGHT)
    bare = any(each.fit.surface_gap_max > 0.0 for each in found.links)
    grey = "; grey: links outside of them" if bare else ""
    links = f"{len(found.links)} links of {found.robot.name}"
    for column, (text, shown) in enumerate(zip((links, f"{len(radius):,} spheres{grey}"), layers)):
        axes = figure.add_axes((column * width / whole, 0.02, width / whole, 0.90))
        axes.imshow(blend([(layer, 1.0) for layer in shown]))
        axes.set_axis_off()
        axes.set_title(text, fontsize=16, color="0.2", loc="center")
    bar = figure.colorbar(
        ScalarMappable(Normalize(0.0, 1e3 * highest), colormaps[COLORS]),
        cax=figure.add_axes((1.0 - 0.8 * BAR / whole, 0.16, 0.15 / whole, 0.6)),
    )
    bar.set_label("out of the link [mm]", fontsize=13)
    bar.ax.tick_params(labelsize=12)
    bar.outline.set_visible(False)
    save_figure(figure, path)


def _heights(
    found: RobotSpheres, places: list[tuple[FloatArray, FloatArray]], points: FloatArray, link: IntArray
) -> FloatArray:
    """Return the distance [m] of points (n, 3) of spheres from the link that each is of, negative inside, (n,)."""
    height = np.empty(len(points))
    for k, (each, (turn, at)) in enumerate(zip(found.links, places)):
        own = np.flatnonzero(link == k)
        height[own] = heights(signed_bvh(each.mesh), np.ascontiguousarray((points[own] - at) @ turn))
    return height
