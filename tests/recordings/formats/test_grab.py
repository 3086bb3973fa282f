"""ARCTIC's and GRAB's hands and objects, by a model that is made from our own hand; no file of theirs is here."""

from pathlib import Path

import numpy as np
import pytest
from joint_samples import joint_sample, words
from pose_samples import mano_fields, mano_poses

from hhsim.errors import InputError
from hhsim.recordings.joint_names import JOINT_ORDERS
from hhsim.recordings.registry import ReadOptions, read_recording

SAMPLE, MANO = joint_sample(), JOINT_ORDERS["mano"]
COUNT = len(SAMPLE.motion.time)
TURN, POSE, SHIFT = mano_poses(SAMPLE)
FIELDS = mano_fields(SAMPLE.hand)
RIGHT = {"rot": TURN, "pose": POSE - FIELDS["hands_mean"], "trans": SHIFT, "shape": np.zeros(10)}
LEFT_FIELDS = mano_fields(joint_sample("left").hand, seed=1)
LEFT = dict(zip(("rot", "pose", "trans"), mano_poses(joint_sample("left")))) | {"shape": np.zeros(10)}
LEFT["pose"] = LEFT["pose"] - LEFT_FIELDS["hands_mean"]


@pytest.fixture
def options(tmp_path: Path) -> ReadOptions:
    np.savez(tmp_path / "MANO_RIGHT.npz", **FIELDS)
    return ReadOptions(mano_model=tmp_path / "MANO_RIGHT.npz", world_up="y", hand="right")


def test_of_two_models_each_hand_takes_its_own(tmp_path: Path, options: ReadOptions) -> None:
    path = tmp_path / "mug_grab_01.mano.npy"
    np.save(path, np.array({"right": RIGHT, "left": LEFT}, dtype=object))
    left = ReadOptions(mano_model=options.mano_model, world_up="y", hand="left")
    with pytest.raises(InputError, match=r"left hand, but the model is called .*: is it the other hand's\?"):
        read_recording(path, left)
    np.savez(tmp_path / "MANO_LEFT.npz", **LEFT_FIELDS)
    found = words(read_recording(path, left))
    assert "model mano_left.npz" in found and "other hand's" not in found
    assert "model mano_right.npz" in words(read_recording(path, options))
