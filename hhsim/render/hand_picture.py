"""Layers of a picture of the hand on an object: skin, the haptic hand as blue glass, forces in red with their sizes.

A force behind another part of the hand is hollow, and has the name of its finger beside its size.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.render.figure import halo
from hhsim.render.rasterizer import Camera, Layer, shade
from hhsim.render.triangle_soup import Surface, arrow_surface, joined
from hhsim.render.viewpoint import PieceForce, arrow

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RED = np.array([0.85, 0.10, 0.08])

ARROW_RADIUS = 1.3e-3
"""Radius of an arrow's shaft [m]."""
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


Layers = list[tuple[Layer, FloatArray | float]]
"""Layers of a picture with their opacities."""


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
