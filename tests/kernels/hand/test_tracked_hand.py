"""Our hand in tracked joints, one at a time: what the importer of recordings makes of the same joints, to rounding."""

from typing import Literal

import numpy as np
import pytest
from joint_samples import joint_sample
from numpy.typing import NDArray

from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand.tracked_hand import OurHand, fit_tracked_hand
from hhsim.kernels.jit import as_argument
from hhsim.recordings.finger_ik import (
    finger_angles,
    finger_axes,
    middle_of_knuckles,
    palm_from_knuckles,
    palm_in_knuckles,
    palm_origin,
)
from hhsim.recordings.frames import FileFrame, in_palm, world_matrix


def our_hand(side: Literal["right", "left"]) -> OurHand:
    distal, dorsal, across = finger_axes(side)
    return OurHand(
        as_argument(np.stack([distal, dorsal, across], axis=1)),
        as_argument(rotation_matrix(palm_in_knuckles(side)[0])),
        as_argument(middle_of_knuckles(side)),
        as_argument(world_matrix("y")),
        np.array([-1.0 if side == "left" else 1.0]),
    )


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize(("noise", "bend"), [(0.0, 1.0), (0.004, 1.0), (0.003, 0.0), (0.02, 1.0)])
def test_it_is_what_the_importer_makes_of_the_same_joints(
    side: Literal["right", "left"], noise: float, bend: float
) -> None:
    points = joint_sample(side, noise=noise, bend=bend).named()
    random = np.random.default_rng(3)
    # Any way up: every branch of the palm's quaternion.
    turns = rotation_matrix(unit(random, len(points)))
    points = np.einsum("tij,tkj->tki", turns, points)
    fingers = points[:, 1:].reshape(-1, 5, 4, 3)
    orientation = palm_from_knuckles(fingers[:, 1:, 0], points[:, 0], side)
    flexion, abduction = finger_angles(in_palm(np.diff(fingers, axis=2), orientation), side)
    position, orientation = FileFrame.of("y", None).poses(
        palm_origin(fingers[:, 1:, 0], orientation, side), orientation
    )
    ours, turn = our_hand(side), np.zeros((3, 3))
    for k, joints in enumerate(points):
        found = (np.zeros(3), np.zeros(4), np.zeros((5, 3)), np.zeros(5))
        length = fit_tracked_hand(as_argument(joints), ours, turn, *found)
        middle = joints[[0, 9, 10, 11, 12]]
        assert length == pytest.approx(np.linalg.norm(np.diff(middle, axis=0), axis=1).sum(), rel=1e-12)
        np.testing.assert_allclose(found[0], position[k], atol=1e-12)
        np.testing.assert_allclose(found[1], np.sign(orientation[k, 0]) * orientation[k], atol=1e-12)
        # Where a finger has no abduction of its own, rounding decides it in the tenth digit.
        np.testing.assert_allclose(found[2], flexion[k], atol=1e-9)
        np.testing.assert_allclose(found[3], abduction[k], atol=1e-9)


def unit(random: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Unit quaternions (w, x, y, z) of any rotation."""
    found = random.standard_normal((count, 4))
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))
