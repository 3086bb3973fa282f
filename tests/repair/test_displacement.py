"""Object in a hand that is held still: free fall in closed form, and the tongs' friction against its weight."""

import numpy as np
import pytest
from free_scenes import WIDTH, box, closing, far_hand, tongs, tongs_at

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.metrics.field.displacement import GRAVITY, STEP, STEPS
from hhsim.repair.displacement import FIXED, RATE, object_displacements

TICKS = round(STEPS * STEP * RATE)
FALL = GRAVITY * TICKS * (TICKS + 1) / (2.0 * RATE**2)
"""Free fall by steps that change first the speed, then the place [m]."""


def test_without_a_hand_in_its_way_the_object_falls_freely_along_gravity() -> None:
    away = HandConfiguration(*far_hand(2))
    down = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, 0.8]])
    mesh = box((0.02, 0.03, 0.04))
    assert object_displacements(HandModel.default(), mesh, away, (0,)) == pytest.approx([FALL], rel=1e-6)
    found = object_displacements(HandModel.default(), mesh, away, (1, 0), down)
    assert found == pytest.approx([FALL, FALL], rel=1e-6)


def test_tongs_hold_by_friction_what_they_press_and_drop_what_is_too_heavy() -> None:
    touch, tip = closing(WIDTH)
    mesh = box((0.02, WIDTH, 0.02), (tip, 0.0, 0.0))
    # Fingers that are given 1 mm inside press with the force of their joints' springs.
    inside = touch + 0.001 / tip
    press = FIXED.flexion * (inside - touch) / tip
    grip = HandConfiguration(*tongs_at([inside, touch - 0.05]))
    held = 2.0 * 0.8 * press / GRAVITY
    found = object_displacements(tongs(), mesh, grip, (0,), mass=0.5 * held, friction=0.8)
    assert found[0] < 5e-4
    assert object_displacements(tongs(), mesh, grip, (0,), mass=4.0 * held, friction=0.8)[0] > 0.3 * FALL
    assert object_displacements(tongs(), mesh, grip, (1,), friction=0.8) == pytest.approx([FALL], rel=1e-6)
