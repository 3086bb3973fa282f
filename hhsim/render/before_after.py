"""Picture of a hand before and after a repair: the deepest frames, whole and from close by, red where inside."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.kernels.mesh.bvh import MeshBvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import object_bvh
from hhsim.render.figure import new_figure, save_figure
from hhsim.render.hand_picture import BODY_OPACITY, RED
from hhsim.render.rasterizer import OVERSAMPLING, Camera, Layer, blend, frame, rendered, shade
from hhsim.render.triangle_soup import SKIN, STONE, Surface, look_from, mesh_surface, near_hands
from hhsim.render.viewpoint import AZIMUTHS, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE = 320
"""Height and width of a picture [pixels]."""
ELEVATIONS = (15.0, 50.0, -30.0)
"""Elevations of the views that are tried [degrees]."""
TRIAL = 40
"""Height and width of the pictures that a view is chosen by [pixels]."""
TITLE = 30
"""Height of the line above it [pixels]."""
CLOSE = 0.05
"""Height of the view from close by [m]."""
FRAMES = 3
"""Most frames that are drawn."""
APART = 0.05
"""Least distance of drawn frames, as a share of all frames."""
JUST_INSIDE = 5e-5
"""Depth above which skin is painted as inside [m]: rounding of a stored position is not."""
BAR = 0.01
"""Length of the bar that shows the scale [m]."""


def deepest_frames(depth: FloatArray) -> list[int]:
    """Return frames by falling depth (T,) [m], at most `FRAMES`, none near another one; the first is the deepest."""
    apart, left = max(1, round(APART * len(depth))), np.array(depth, dtype=np.float64)
    found: list[int] = []
    while len(found) < FRAMES and (not found or left.max() > JUST_INSIDE):
        found.append(int(left.argmax()))
        left[max(0, found[-1] - apart) : found[-1] + apart + 1] = -np.inf
    return found


def draw_before_after(
    meshes: Sequence[Mesh],
    before: FloatArray,
    after: FloatArray,
    faces: IntArray,
    path: Path,
    time: FloatArray,
    numbers: Sequence[int],
    depth: Sequence[FloatArray],
) -> None:
    """Draw frames of a hand before and after, a row each: both whole, then both from close by at the deepest point.

    Args:
        meshes: Closed object in each frame [m].
        before, after: Vertices of the hand's skin at each frame [m], in the object's frame, shape (T, V, 3).
        faces: Triangles of the skin, shape (F, 3).
        path: File of the picture; its ending says which kind.
        time, numbers: Time [s] and number of each frame, shapes (T,), for the titles.
        depth: Depth of the hand before and after at each frame [m], each (T,), for the titles.

    Raises OutputError for a file that cannot be written.
    """
    width, height = 4 * SIDE, len(meshes) * (SIDE + TITLE)
    figure = new_figure(width / 100, height / 100)
    for row, (shape, *hands) in enumerate(zip(meshes, before, after, strict=True)):
        bvh = object_bvh(shape)
        skins = [mesh_surface(Mesh(hand, faces), SKIN) for hand in hands]
        body = mesh_surface(near_hands(shape, np.concatenate(hands)), STONE)
        deepest = hands[0][int(mesh_signed_distance(bvh, hands[0]).argmin())]
        rotation = _view(skins[0], bvh, deepest)
        whole = frame(np.concatenate([*hands, body.points]), rotation, (SIDE, SIDE))
        close = Camera(rotation, deepest, CLOSE, (SIDE, SIDE))
        when = f"frame {numbers[row]:,} at {time[row]:.2f} s, "
        for column in range(4):
            # On whole pixels, so that nothing is drawn anew.
            corner = column * SIDE / width, 1.0 - (row + 1) * (SIDE + TITLE) / height
            axes = figure.add_axes((*corner, SIDE / width, SIDE / height))
            axes.axis("off")
            camera, side = (whole, close)[column // 2], column % 2
            axes.imshow(
                blend([(_reddened(skins[side], bvh, camera), 1.0), (shade(body, camera), BODY_OPACITY)]),
                interpolation="nearest",
            )
            _scale(axes, camera)
            what = f"{('before', 'after')[side]}: {1e3 * depth[side][row]:.1f} mm in"
            axes.set_title((when if column == 0 else "") + what, fontsize=9, loc="left", x=0.02, y=1.0, pad=3)
    save_figure(figure, path)


def _inside(depth: FloatArray, bvh: MeshBvh, camera: Camera) -> BoolArray:
    """Return where the finished picture shows skin that is inside the object, from the skin's `Layer.depth`."""
    # A point's distance costs more than its colour, so there is one for the pixels that become one.
    row, column = OVERSAMPLING * np.argwhere(np.isfinite(depth[::OVERSAMPLING, ::OVERSAMPLING])).T
    rows, columns = depth.shape
    seen = np.stack([column - 0.5 * columns, 0.5 * rows - row], axis=1) * camera.height / rows
    place = np.column_stack([seen, depth[row, column]]) @ camera.rotation + camera.center
    inside = np.zeros(camera.shape, dtype=bool)
    inside[row // OVERSAMPLING, column // OVERSAMPLING] = mesh_signed_distance(bvh, place) < -JUST_INSIDE
    return inside


def _reddened(skin: Surface, bvh: MeshBvh, camera: Camera) -> Layer:
    """Render a skin, red in each pixel that is inside the object."""

    def inside(depth: FloatArray) -> BoolArray:
        return _inside(depth, bvh, camera).repeat(OVERSAMPLING, axis=0).repeat(OVERSAMPLING, axis=1)

    return shade(skin, camera, inside, RED)


def _view(skin: Surface, bvh: MeshBvh, middle: FloatArray) -> FloatArray:
    """Return the camera's rotation that shows most of what is inside around a point: the object is see-through."""

    def inside(rotation: FloatArray) -> int:
        camera = Camera(rotation, middle, 2.0 * CLOSE, (TRIAL, TRIAL))
        return int(_inside(rendered(skin, camera)[0], bvh, camera).sum())

    views = (View(azimuth, elevation) for elevation in ELEVATIONS for azimuth in AZIMUTHS)
    return max((look_from(view.towards) for view in views), key=inside)


def _scale(axes: "Axes", camera: Camera) -> None:
    """Draw a bar of `BAR` and its length."""
    rows = camera.shape[0]
    long, left, down = BAR * rows / camera.height, 0.04 * rows, 0.95 * rows
    axes.plot([left, left + long], [down, down], color="0.1", linewidth=1.6, solid_capstyle="butt")
    axes.text(left, down - 0.015 * rows, f"{1e3 * BAR:g} mm", ha="left", va="bottom", fontsize=7)
