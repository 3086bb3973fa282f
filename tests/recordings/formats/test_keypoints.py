"""21 keypoints as bare numbers in four kinds of file."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from joint_samples import array_npy, arrays_npz, assert_our_own, joint_sample, words
from recording_samples import read_as

from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.recordings.joint_arrays import ORDERS, order_by_bones
from hhsim.recordings.joint_names import JOINT_ORDERS, KEYPOINTS, MANO_JOINTS, WEBXR_JOINTS

SAMPLE = joint_sample()
POINTS, TIME = SAMPLE.named(), SAMPLE.motion.time


IN_MANO = POINTS[:, [KEYPOINTS.index(joint) for joint in MANO_JOINTS]]


@given(st.integers(0, 2**32 - 1), st.sampled_from(["mediapipe", "mano"]))
def test_no_posture_of_our_hand_is_taken_for_the_other_order(seed: int, order: str) -> None:
    random = np.random.default_rng(seed)
    hand = SAMPLE.hand
    flexion = random.uniform(hand.flexion_min, hand.flexion_max)
    abduction = random.uniform(hand.abduction_min, hand.abduction_max)
    fingers = hand.joints(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), flexion, abduction)
    wrist = np.array([-0.070 * hand.hand_breadth, -0.223 * hand.hand_length, 0.0])
    points = np.concatenate([wrist[None], fingers.reshape(20, 3)])[None]
    rows = points[:, [KEYPOINTS.index(joint) for joint in JOINT_ORDERS[order]]]
    assert order_by_bones(rows, ORDERS[21]) == order


SEGMENTS_OF = {finger: [joint for joint in KEYPOINTS if joint.startswith(finger)] for finger in FINGERS}
NODES = [joint for joint in WEBXR_JOINTS if joint.startswith("thumb")]
FOREIGN: dict[str, list[str]] = {
    "InterHand": [*(joint for finger in FINGERS for joint in SEGMENTS_OF[finger][::-1]), "wrist"],
    "FrankMocap": [*MANO_JOINTS[:16], *(f"{finger}_tip" for finger in ("index", "middle", "little", "ring", "thumb"))],
    "FPHAB": [
        "wrist",
        *(SEGMENTS_OF[f][0] for f in FINGERS),
        *(joint for f in FINGERS for joint in SEGMENTS_OF[f][1:]),
    ],
    "tips first": ["wrist", *(joint for finger in FINGERS for joint in SEGMENTS_OF[finger][::-1])],
    "fingers reversed": ["wrist", *(joint for finger in FINGERS[::-1] for joint in SEGMENTS_OF[finger])],
    "level by level": ["wrist", *(SEGMENTS_OF[finger][k] for k in range(4) for finger in FINGERS)],
    "MANUS": [*WEBXR_JOINTS[:1], *WEBXR_JOINTS[5:], *NODES],
    "palm last": [*WEBXR_JOINTS, "palm"],
}


@pytest.mark.parametrize("maker", FOREIGN)
@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_rows_in_an_order_that_is_not_known_are_refused(maker: str, noise: float) -> None:
    rows = joint_sample(noise=noise).named(tuple(FOREIGN[maker]))
    for data in (array_npy(rows), array_npy(1e3 * rows), json.dumps(rows.tolist()).encode()):
        with pytest.raises(TrajectoryError, match="in no order that is known, by their bones; name") as error:
            read_as("keypoints", data, rate=100.0, hand="right")
        assert "--mirror" not in str(error.value) and "\n" not in str(error.value)


def test_a_stated_order_is_taken_and_must_have_as_many_joints() -> None:
    line = np.zeros((40, 21, 3))
    line[:, 1:, 0] = 0.1
    line[:, :, 1] = np.sin(TIME)[:, None]
    with pytest.raises(TrajectoryError, match="in no order that is known"):
        read_as("keypoints", arrays_npz(points=line, t=TIME))
    with pytest.raises(InputError, match="--joint-order openxr: 21 joints a sample; expected 25 or 26"):
        read_as("keypoints", array_npy(POINTS), rate=100.0, joint_order="openxr")
    foreign = array_npy(SAMPLE.named(tuple(FOREIGN["FPHAB"])))
    for side in ("right", "left", ""):
        try:
            text = words(read_as("keypoints", foreign, rate=100.0, joint_order="mano", hand=side))
        except TrajectoryError as error:
            text = str(error)
        assert "bones are not those of a hand" in text and "--mirror" not in text
    told = read_as("keypoints", array_npy(IN_MANO), rate=100.0, world_up="y", joint_order="smplx")
    assert_our_own(told, SAMPLE)
    assert "as --joint-order says" in words(told)


def test_missing_joints_and_noise_leave_the_order() -> None:
    noisy = joint_sample(noise=0.004).named()[:, [KEYPOINTS.index(joint) for joint in MANO_JOINTS]].copy()
    noisy[::3, 5] = np.nan
    assert order_by_bones(noisy, ORDERS[21]) == "mano"


def test_each_hand_of_two_arrays_is_read_by_its_side() -> None:
    data = arrays_npz(right_joints=POINTS, left_joints=POINTS * [-1.0, 1.0, 1.0])
    for side in ("right", "left"):
        assert read_as("keypoints", data, hand=side, rate=30.0).hand == side
