"""The hand as rigid bodies: its joints are where hhsim's are, and its coupling is Eq. 1."""

import numpy as np
import pytest

from hhsim.engines.rigid_hand import RigidHand, rotation_between, speed_between
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.solver.options import Stiffness


def posed(seed: int) -> HandConfiguration:
    random = np.random.default_rng(seed)
    return HandConfiguration(
        random.normal(size=3), quaternion(random.normal(size=3)), random.uniform(0.0, 1.0, (5, 3)),
        random.uniform(-0.2, 0.3, 5),
    )  # fmt: skip


@pytest.mark.parametrize("side", ["right", "left"])
def test_its_joints_are_those_of_the_hand(side: Side) -> None:
    model = HandModel.default(side)
    hand, pose = RigidHand.of(model, Stiffness(), 0.005), posed(1)
    palm, joints = rotation_matrix(pose.orientation), model.joints(*pose)
    for f in range(5):
        frame = palm @ rotation_matrix(np.array(hand.mount(f, float(pose.abduction[f]))))
        place = pose.position + palm @ hand.base[f]
        for k in range(3):
            place = place + frame @ hand.place(f, k)
            np.testing.assert_allclose(place, joints[f, k], atol=1e-12)
            frame = frame @ rotation_matrix(quaternion(np.array([0.0, pose.flexion[f, k], 0.0])))
        np.testing.assert_allclose(place + frame @ [hand.length[f, 2], 0.0, 0.0], joints[f, 3], atol=1e-12)


def test_the_turn_between_two_orientations_is_the_one_that_was_made() -> None:
    first, turn = posed(2).orientation, np.array([0.3, -0.2, 0.5])
    second = quaternion_product(quaternion(turn), first)
    np.testing.assert_allclose(rotation_between(first, second), turn, atol=1e-12)
    np.testing.assert_allclose(rotation_between(first, -second), turn, atol=1e-12)
    np.testing.assert_allclose(rotation_between(first, first), 0.0, atol=1e-15)


def test_the_coupling_is_critically_damped() -> None:
    hand = RigidHand.of(HandModel.default(), Stiffness(), 0.005)
    np.testing.assert_allclose(hand.stiffness, [1000.0, 5.0, 0.5])
    # The damping of a mass m on a spring k is 2 sqrt(k m).
    masses = np.array([hand.mass, hand.inertia, hand.armature])
    np.testing.assert_allclose(hand.damping, 2.0 * np.sqrt(hand.stiffness * masses))


def test_speed_is_the_way_over_the_time() -> None:
    before, now = posed(4), posed(5)
    speed = speed_between(before, now, 1e-3)
    np.testing.assert_allclose(now.position - 1e-3 * speed.linear, before.position, atol=1e-12)
    np.testing.assert_allclose(now.flexion - 1e-3 * speed.flexion, before.flexion, atol=1e-12)
    np.testing.assert_allclose(1e-3 * speed.angular, rotation_between(before.orientation, now.orientation))
