"""The task of the pinch, and the shapes that the known answers are played on."""

import numpy as np
import pytest

from hhsim.bench.manipulation.gripper import LENGTHS, REACH, closed, gripper, gripper_options
from hhsim.bench.manipulation.pinch import Pinch
from hhsim.bench.manipulation.stage import ball, block, turned_by
from hhsim.mesh.mass_properties import mass_properties
from hhsim.trees.contact_surface import encloses


def test_a_pinch_closes_presses_lifts_eases_and_holds() -> None:
    pinch = Pinch(squeeze=2.0, easing=1.0, eased=0.5, hold=1.0)
    assert pinch.threshold == pytest.approx(0.981)
    assert (pinch.eased_from, pinch.held_from, pinch.ticks) == (1500, 2500, 3500)
    assert pinch.closed_at([0, 150, 300]).tolist() == [0.0, 1.0, 1.0]
    np.testing.assert_allclose(pinch.squeeze_at([150, 300, 1500, 2000, 2500, 3000]), [0.0, 2.0, 2.0, 1.5, 1.0, 1.0])
    np.testing.assert_allclose(pinch.height_at([500, 1000, 1500]), [0.0, 0.015, 0.03])


def test_an_outcome_says_whether_it_came_along_and_how_it_creeps() -> None:
    pinch = Pinch(hold=1.0)
    height = np.append(np.zeros(pinch.held_from), np.full(1000, 0.029))
    height[-1] += 1e-6
    found = pinch.outcome(height, 0.0)
    assert found.lifted and found.hangs == pytest.approx(1e-3) and found.creep == pytest.approx(1e-6)
    left = pinch.outcome(0.5 * height, 0.0)
    assert not left.lifted and np.isnan(left.creep) and np.isnan(left.hangs)


def test_the_gripper_has_its_fingers_opposed_and_its_coupling_as_stated() -> None:
    hand = gripper(0.044, 0.008)
    hands = closed(np.array([0.0, 0.002]), np.zeros((2, 3)))
    straight, bent = (
        hand.joints(np.zeros(3), hands.orientation[0], hands.flexion[k], hands.abduction[k]) for k in (0, 1)
    )
    np.testing.assert_allclose(straight[:2, 3], [[-0.03, REACH, 0.0], [0.03, REACH, 0.0]], atol=1e-15)
    np.testing.assert_allclose(bent[:2, 3, 0] - straight[:2, 3, 0], [0.002, -0.002], atol=1e-6)
    levers = np.cumsum(LENGTHS[::-1])
    options = gripper_options(500.0)
    assert (levers**2).sum() / options.stiffness.flexion == pytest.approx(1.0 / 500.0)


def test_the_block_is_closed_and_the_ball_is_one() -> None:
    mesh = block([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
    assert encloses(mesh)
    assert mass_properties(mesh).volume == pytest.approx(0.006)
    assert ball(0.04).arrays.radius.tolist() == [0.04, 0.04]
    assert turned_by([1.0, 0.0, 0.0, 0.0], [np.cos(0.2), 0.0, np.sin(0.2), 0.0]) == pytest.approx(0.4)
