"""Forces in a picture of the hand: those that another part of it hides are hollow and named."""

from dataclasses import replace

import numpy as np
import pytest

from hhsim.render.figure import new_figure
from hhsim.render.hand_picture import arrow_layers, label, with_hidden
from hhsim.render.rasterizer import Camera, shade
from hhsim.render.triangle_soup import SKIN, joined, look_from, round_cone_surface
from hhsim.render.viewpoint import PieceForce

CAMERA = Camera(look_from((1.0, 0.0, 0.0)), np.zeros(3), 0.12, (300, 300))


@pytest.mark.parametrize(
    ("contact", "is_hidden"),
    [
        ((-0.008, 0.0, 0.0), False),  # behind its own finger, which is before no other
        ((-0.05, 0.0, 0.02), True),  # of a finger behind that one
        ((-0.05, 0.04, 0.0), False),  # beside the finger in front
        ((-0.05, 1.0, 0.0), False),  # outside the picture
    ],
)
def test_a_force_behind_another_part_of_the_hand_is_hollow_and_has_its_fingers_name(
    contact: tuple[float, float, float], is_hidden: bool
) -> None:
    fingers = [
        round_cone_surface(np.array([x, 0.0, -0.04]), np.array([x, 0.0, 0.04]), 0.01, 0.01, SKIN) for x in (0.0, -0.05)
    ]
    force = PieceForce("thumb/distal", np.array(contact), np.array([0.0, 1.0, 0.0]))
    (marked,) = with_hidden([force], shade(joined(fingers), CAMERA), CAMERA)
    assert marked.is_hidden == is_hidden
    (solid, _), (drawn, _) = (arrow_layers([one], CAMERA)[0] for one in (replace(force, is_hidden=False), marked))
    assert (drawn.seen() <= solid.seen()).all()
    assert (0 < drawn.seen().sum() < 0.5 * solid.seen().sum()) == is_hidden
    axes = new_figure(2.0, 2.0).add_subplot()
    label(axes, [marked], CAMERA)
    assert axes.texts[0].get_text() == ("1.0 N thumb" if is_hidden else "1.0 N")
