"""A picture of the hand model: `python -m tools.hand_figure docs/hand.png`.

The figure shows what the kernels collide with: each phalanx is the surface of its round cone, the palm is its mesh, and
the second half shows the palm as the leaf spheres of its tree (paper, Fig. 4).
"""

import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, OutputError
from hhsim.hand.model import DEFAULT_HAND_LENGTH, HandModel
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.render.figure import save_figure
from hhsim.render.rasterizer import blend, frame, look_from, shade
from hhsim.render.triangle_soup import FINE, SPHERE, Surface, hand_surface, joined, piece_surfaces, round_cone_surface
from hhsim.system.output_path import check_picture

OPEN_POSE = (
    ((-8.0, 8.0, 8.0), (8.0, 10.0, 6.0), (8.0, 10.0, 6.0), (10.0, 12.0, 8.0), (12.0, 14.0, 8.0)),
    (-8.0, 4.0, 0.0, -3.0, -8.0),
)
"""Flexion and abduction [degrees] of a relaxed open hand."""

CURLED_POSE = (
    ((12.0, 22.0, 30.0), (42.0, 48.0, 30.0), (46.0, 52.0, 32.0), (50.0, 55.0, 34.0), (54.0, 56.0, 34.0)),
    (18.0, 2.0, 0.0, -2.0, -4.0),
)
"""Flexion and abduction [degrees] of a hand around a sphere."""

PIXELS = 460
"""Width of a panel."""


def draw_hand(path: str | Path, hand: HandModel | None = None) -> None:
    """Draw the hand, open and curled, as surfaces and as the hybrid model.

    Args:
        path: Picture file; matplotlib chooses the format by its ending.
        hand: The hand; the default right hand if not given.

    Raises:
        OutputError: The picture cannot be written.
        InputError: matplotlib has no such picture format.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    check_picture(Path(path))
    hand = hand or HandModel.default()
    panels = [
        ("Open, palm", OPEN_POSE, False, view(0.0, -14.0)),
        ("Curled, thumb side", CURLED_POSE, False, view(70.0, -8.0)),
        ("Hybrid model, palm", OPEN_POSE, True, view(0.0, -14.0)),
        ("Hybrid model, thumb side", CURLED_POSE, True, view(70.0, -8.0)),
    ]
    figure = Figure(figsize=(14.0, 5.0), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    for column, (title, pose, hybrid, rotation) in enumerate(panels):
        axes = figure.add_axes((0.25 * column, 0.0, 0.25, 0.93))
        flexion, abduction = np.radians(pose[0]), np.radians(pose[1])
        drawn = hybrid_surface if hybrid else hand_surface
        surface = drawn(hand, (np.zeros(3), (1.0, 0.0, 0.0, 0.0), flexion, abduction))
        camera = frame(surface.points, rotation, (PIXELS * 4 // 3, PIXELS))
        height = 0.21 * hand.hand_length / DEFAULT_HAND_LENGTH
        axes.imshow(blend([(shade(surface, replace(camera, height=height)), 1.0)]))
        axes.set_axis_off()
        axes.set_title(title, fontsize=13, color="0.25", pad=4)
    save_figure(figure, Path(path))


def hybrid_surface(hand: HandModel, pose: Iterable[ArrayLike]) -> Surface:
    """The hand's surface in the world frame with its palm as leaf spheres; arguments as of `hand_surface`."""
    palm = zip(hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius, strict=True)
    spheres = [round_cone_surface(center, center, size, size, SPHERE, rings=14, sides=44) for center, size in palm]
    pieces = (*piece_surfaces(hand, *FINE)[:PALM_BODY], joined(spheres))
    return hand_surface(hand, pose, pieces)


def view(turn: float, tilt: float) -> FloatArray:
    """Rows right, up and towards the viewer, shape (3, 3), for a look at the palm.

    `turn` [degrees] walks round the fingers' axis from the palm to the thumb side, `tilt` looks down from the tips.
    """
    a, b = np.radians(turn), np.radians(tilt)
    return look_from((-np.cos(b) * np.sin(a), np.sin(b), -np.cos(b) * np.cos(a)), up=(0.0, 1.0, 0.0))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m tools.hand_figure PICTURE, for example docs/hand.png")
    try:
        draw_hand(sys.argv[1])
    except (InputError, OutputError) as error:
        raise SystemExit(str(error)) from error
