"""The hand as rigid bodies: its joints are where hhsim's are, and its coupling is Eq. 1."""

import numpy as np
import pytest

from hhsim.engines.rigid_hand import RigidHand, earlier, rotation_between, speed_between
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


def test_the_coupling_pulls_with_its_stiffness_and_brakes_what_is_faster_than_the_user() -> None:
    hand, user = RigidHand.of(HandModel.default(), Stiffness(), 0.005), posed(3)
    turn, still = np.array([0.0, 0.01, 0.0]), np.zeros(3)
    speed = speed_between(user, user, 1e-3)
    shown = quaternion_product(quaternion(-turn), user.orientation)
    force, torque = hand.pull(user, speed, user.position - [0.001, 0.0, 0.0], shown, still, still)
    np.testing.assert_allclose(force, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(torque, 5.0 * turn, atol=1e-12)
    force, _ = hand.pull(user, speed, user.position, user.orientation, np.array([0.0, 1.0, 0.0]), still)
    # Critical: the damping of a mass m on a spring k is 2 sqrt(k m).
    np.testing.assert_allclose(force, [0.0, -2.0 * np.sqrt(1000.0 * hand.mass), 0.0])
    np.testing.assert_allclose(hand.bend(user, speed, user.flexion.ravel() - 0.1, np.zeros(15)), np.full(15, 0.05))


def test_speed_is_the_way_over_the_time_and_leads_back() -> None:
    before, now = posed(4), posed(5)
    speed = speed_between(before, now, 1e-3)
    was = earlier(now, speed, 1e-3)
    np.testing.assert_allclose(was.position, before.position, atol=1e-12)
    np.testing.assert_allclose(was.flexion, before.flexion, atol=1e-12)
    np.testing.assert_allclose(1e-3 * speed.angular, rotation_between(before.orientation, now.orientation))
