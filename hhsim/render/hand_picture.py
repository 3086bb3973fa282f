"""Layers of a picture of the hand on an object: skin, the haptic hand as blue glass, forces in red with their sizes.

A force behind another part of the hand is hollow, and has the name of its finger beside its size.

The viewpoint is the one that shows most of the hand, chosen from points of the surfaces.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.topology import face_samples
from hhsim.render.figure import halo
from hhsim.render.rasterizer import Camera, Layer, blend, look_from, shade
from hhsim.render.triangle_soup import Surface, arrow_surface, joined

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GHOST = np.array([0.25, 0.52, 0.95])
RED = np.array([0.85, 0.10, 0.08])

ARROW_RADIUS = 1.3e-3
"""Radius of an arrow's shaft [m]."""
ARROW_LENGTH = 0.02
"""Length of the arrow of 1 N [m]; it grows with the square root of the force, so that small ones can be seen."""

LONGEST_ARROW = 10.0
"""Longest arrow that is drawn [m]: a damaged file may hold forces that no picture has space for."""

BODY_OPACITY = 0.5
IN_FRONT = 10.0
"""Distance by which forces are drawn in front of everything else [m]."""
BEHIND = 0.02
"""Depth below the skin that is seen at which a contact is behind another part of the hand, not its own [m]."""
RIM = 300
"""Height of a picture over the width of the rim of a hollow arrow."""
LETTER = 0.92
"""Width of a letter or digit with its share of the white rim [pixels at 100 to the inch, by the size in pt]."""
AZIMUTHS, ELEVATIONS = tuple(range(0, 360, 30)), (10.0, 35.0)
"""Views that are tried [degrees]."""
CELLS = 48
GAIN = 0.5
"""Score, of at most about 2.5, by which another view must be better than the usual one."""
POINTS = 10_000
"""Least number of points that stand for a surface: several to each cell that it fills."""


Layers = list[tuple[Layer, FloatArray | float]]
"""Layers of a picture with their opacities."""


@dataclass(frozen=True)
class PieceForce:
    """Contact force on one piece of a hand [N], and where its arrow begins [m], shapes (3,), world."""

    name: str
    contact: FloatArray
    force: FloatArray
    is_hidden: bool = False  # True if another part of the hand is before its contact


def arrow(force: PieceForce) -> FloatArray:
    """Return the arrow of a force [m], shape (3,)."""
    return np.asarray(ARROW_LENGTH * force.force / np.sqrt(np.linalg.norm(force.force)))


def arrow_surfaces(forces: Sequence[PieceForce]) -> list[Surface]:
    """Return the arrows of forces, but for those that no picture has space for."""
    shown = [force for force in forces if 0.0 < float(np.linalg.norm(arrow(force))) < LONGEST_ARROW]
    return [arrow_surface(force.contact, arrow(force), ARROW_RADIUS, RED) for force in shown]


def with_hidden(forces: Sequence[PieceForce], hand: Layer, camera: Camera) -> list[PieceForce]:
    """Return the forces, those marked that are behind another part of the hand."""
    rows, columns = hand.depth.shape
    marked = []
    for force in forces:
        right, up, depth = camera.rotation @ (force.contact - camera.center)
        row = int(0.5 * rows - up * rows / camera.height)
        column = int(0.5 * columns + right * rows / camera.height)
        inside = 0 <= row < rows and 0 <= column < columns
        marked.append(replace(force, is_hidden=bool(inside and hand.depth[row, column] > depth + BEHIND)))
    return marked


def transparent(
    graphic: Surface, haptic: Surface, body: Layer, forces: Sequence[PieceForce], camera: Camera
) -> tuple[Layers, list[PieceForce]]:
    """Return the layers of a transparent object, the haptic hand in and around it, and the forces over everything.

    The forces are returned, too, as of `with_hidden`.
    """
    hand = shade(graphic, camera)
    marked = with_hidden(forces, hand, camera)
    ghost = behind(shade(haptic, camera), hand)
    # Glass is clearest where one looks straight at it.
    glass = np.asarray(0.3 + 0.6 * (1.0 - np.abs(ghost.facing)) ** 2)
    return [(hand, 1.0), (body, BODY_OPACITY), (ghost, glass), *arrow_layers(marked, camera)], marked


def arrow_layers(forces: Sequence[PieceForce], camera: Camera) -> Layers:
    """Return the layers of arrows in front of everything, the hidden ones hollow; none without arrows."""
    from scipy.ndimage import binary_erosion

    layers: Layers = []
    for is_hidden in (False, True):
        if arrows := arrow_surfaces([force for force in forces if force.is_hidden == is_hidden]):
            layer = shade(joined(arrows), camera)
            rim = max(1, len(layer.depth) // RIM)
            inside = binary_erosion(layer.seen(), iterations=rim) if is_hidden else False
            layers.append((replace(layer, depth=np.where(inside, -np.inf, layer.depth + IN_FRONT)), 1.0))
    return layers


def seen_through(
    graphic: Surface, haptic: Surface, body: Surface, forces: list[PieceForce], camera: Camera
) -> tuple[FloatArray, list[PieceForce]]:
    """Render the picture of `transparent`; return it, and the forces as of `with_hidden`."""
    layers, marked = transparent(graphic, haptic, shade(body, camera), forces, camera)
    return blend(layers), marked


def behind(ghost: Layer, hand: Layer) -> Layer:
    """Return the haptic hand behind the graphic one: where both are, the skin stays clean."""
    return replace(ghost, depth=np.where(hand.seen(), np.minimum(ghost.depth, hand.depth - 1e-6), ghost.depth))


def label(axes: "Axes", forces: Sequence[PieceForce], camera: Camera, size: float = 11.0, pixel: float = 1.0) -> None:
    """Write the size of each force at its arrow's head in letters of `size` [pt], or lower where another one stands.

    A hidden force has its finger's name, too. `pixel` is the size of the picture's pixels, relative to 100 to the inch.
    """
    rows, columns = camera.shape
    scale = rows / camera.height
    apart = np.array([max(40.0, 4.3 * size), max(15.0, 1.4 * size)]) / pixel
    placed: list[FloatArray] = []
    for force in forces:
        along = camera.rotation @ arrow(force)
        tip = camera.rotation @ (force.contact - camera.center) + along
        away = along[:2] / max(float(np.linalg.norm(along[:2])), 1e-9)
        head = np.array([0.5 * columns + scale * tip[0], 0.5 * rows - scale * tip[1]])
        first = head + np.array([20.0 * away[0], -12.0 * away[1]]) / pixel
        finger = f" {force.name.partition('/')[0]}" if force.is_hidden else ""
        text = f"{np.linalg.norm(force.force):.1f} N{finger}"
        edge = np.array([max(22.0, 0.5 * LETTER * size * len(text)), 9.0]) / pixel
        first = np.clip(first, edge, np.array([columns, rows]) - edge)
        place = first.copy()
        while any((np.abs(place - other) < apart).all() for other in placed):
            place[1] += 3.0 / pixel
        placed.append(place)
        color = tuple(0.8 * RED)
        # A number that had to go further is tied to its arrow.
        far = bool(place[1] - first[1] > 12.0 / pixel)
        axes.annotate(
            text, tuple(head) if far else tuple(place), tuple(place), ha="center", va="center", fontsize=size,
            color=color, **halo(3),
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.7, "shrinkB": 0.0} if far else None,
        )  # fmt: skip


class View(NamedTuple):
    """Azimuth from x to y, and elevation [degrees], of a viewer."""

    azimuth: float
    elevation: float

    @property
    def towards(self) -> FloatArray:
        """Unit direction to the viewer, shape (3,)."""
        a, e = np.radians(self)
        return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def viewpoint(
    hand: Surface,
    body: Surface,
    marks: FloatArray,
    forces: FloatArray,
    usual: View | None = None,
    below: float = np.inf,
    rest: Surface | None = None,
    elevations: Sequence[float] = ELEVATIONS,
) -> View:
    """Return the view that shows most of the marks, then of hand and object, with forces not seen end on.

    Marks are points that the object should not hide [m], shape (k, 3); forces are vectors, (j, 3). Only a view better
    by `GAIN` replaces the usual one of another picture; from `below` [m] under its surface the hand hides marks. Beside
    other things, `rest`, which may hide it, most of the object itself is to be seen.
    """
    rng = np.random.default_rng(0)
    surfaces = (hand, body) if rest is None else (hand, body, rest)
    sampled = [face_samples(surface.points, surface.faces, POINTS, rng)[0] for surface in surfaces]
    # A fine mesh has a point on each of very many faces, of which some suffice.
    points = [points[:: max(1, len(points) // POINTS)] for points in sampled]
    views = [View(float(azimuth), elevation) for elevation in elevations for azimuth in AZIMUTHS]
    return max(views, key=lambda view: _seen(view, points, marks, forces, below) + GAIN * (view == usual))


def _seen(view: View, points: Sequence[FloatArray], marks: FloatArray, forces: FloatArray, below: float) -> float:
    rotation = look_from(view.towards)
    whole = np.concatenate(points) @ rotation[:2].T
    low, scale = whole.min(axis=0), CELLS / max(float(np.ptp(whole, axis=0).max()), 1e-9)

    def depths(points: FloatArray) -> tuple[IntArray, FloatArray]:
        seen = points @ rotation.T
        cell = np.clip(((seen[:, :2] - low) * scale).astype(np.int64), 0, CELLS)
        return cell[:, 0] * (CELLS + 1) + cell[:, 1], seen[:, 2]

    nearest = []
    for surface in points:
        cell, depth = depths(surface)
        nearest.append(np.full((CELLS + 1) ** 2, -np.inf))
        np.maximum.at(nearest[-1], cell, depth)
    skin, stone = nearest[:2]
    others = np.maximum.reduce([skin, *nearest[2:]])
    body_cells = int((stone > others).sum())
    score = 1.5 * min(int((skin > stone).sum()), 1.5 * body_cells) / CELLS**2
    if len(nearest) > 2:
        score += body_cells / int((stone > -np.inf).sum())
    if len(marks):
        cell, depth = depths(marks)
        hidden = np.maximum.reduce([stone - 2e-3, skin - below, *nearest[2:]])[cell]
        score += float(np.mean(depth > hidden))
    if len(forces):
        size = np.linalg.norm(forces, axis=1)
        across = np.linalg.norm((forces @ rotation.T)[:, :2], axis=1)
        score += 0.5 * float(across.sum() / max(float(size.sum()), 1e-12))
    return score
