"""ARCTIC's and GRAB's hands and objects, by a model that is made from our own hand; no file of theirs is here."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_samples import Y_UP, arrays_npz, assert_our_own, joint_sample, words
from pose_samples import mano_fields, mano_poses
from scipy.spatial.transform import Rotation

from hhsim.errors import TrajectoryError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.recordings.registry import Content, ReadOptions, format_of, read_content, read_recording

SAMPLE = joint_sample()
COUNT = len(SAMPLE.motion.time)
TURN, POSE, SHIFT = mano_poses(SAMPLE)
FIELDS = mano_fields(SAMPLE.hand)
RANDOM = np.random.default_rng(3)
PLACE, SPIN = RANDOM.uniform(-0.3, 0.3, (COUNT, 3)), RANDOM.normal(0.0, 1.0, (COUNT, 3))
"""Pose of an object in a world with y up: position [m] and rotation vector [rad]."""
RIGHT = {"rot": TURN, "pose": POSE - FIELDS["hands_mean"], "trans": SHIFT, "shape": np.zeros(10)}


class Planted:
    """Object whose pickle runs a function when it is loaded."""

    def __reduce__(self) -> Any:
        return print, ("ran",)


@pytest.fixture
def options(tmp_path: Path) -> ReadOptions:
    np.savez(tmp_path / "MANO_RIGHT.npz", **FIELDS)
    return ReadOptions(mano_model=tmp_path / "MANO_RIGHT.npz", world_up="y", hand="right")


def assert_object(recording: Any) -> None:
    moved = recording.object_motion
    assert moved is not None
    np.testing.assert_allclose(moved.position, PLACE @ Y_UP, atol=1e-12)
    np.testing.assert_allclose(
        rotation_matrix(moved.orientation), Y_UP.T @ Rotation.from_rotvec(SPIN).as_matrix(), atol=1e-12
    )


def test_arctics_hands_and_the_object_beside_them(tmp_path: Path, options: ReadOptions) -> None:
    path = tmp_path / "mug_grab_01.mano.npy"
    other = RIGHT | {"trans": SHIFT + 0.2}
    np.save(path, np.array({"right": RIGHT | {"fitting_err": np.zeros(COUNT)}, "left": other}, dtype=object))
    alone = read_recording(path, options)
    assert (alone.form, alone.name, alone.object_motion) == ("grab", "mug_grab_01", None)
    assert_our_own(alone, SAMPLE)
    assert np.allclose(np.diff(alone.time), 1.0 / 30.0)
    assert "axis-angle-mean" in words(alone) and f"not used: right/fitting_err ({COUNT},)" in words(alone)
    rows = np.concatenate([RANDOM.uniform(0, 1, (COUNT, 1)), SPIN, 1e3 * PLACE], axis=1)
    np.save(tmp_path / "mug_grab_01.object.npy", rows)
    recording = read_recording(path, options)
    assert_our_own(recording, SAMPLE)
    assert_object(recording)
    assert "as mug_grab_01.object.npy beside it has it" in words(recording)
    np.save(tmp_path / "mug_grab_01.object.npy", rows[:-1])
    with pytest.raises(TrajectoryError, match=rf"object\.npy: {COUNT - 1} poses of the object .* for {COUNT} samples"):
        read_recording(path, options)


def test_arctics_plain_arrays_have_the_object_in_millimetres(options: ReadOptions) -> None:
    named = {
        "rot_r": RIGHT["rot"],
        "pose_r": RIGHT["pose"],
        "trans_r": SHIFT,
        "obj_rot": SPIN,
        "obj_trans": 1e3 * PLACE,
    }
    recording = read_content(Content(data=arrays_npz(**named, obj_arti=np.zeros(COUNT))), options)
    assert recording.form == "grab" and f"not used: obj_arti ({COUNT},)" in words(recording)
    assert_our_own(recording, SAMPLE)
    assert_object(recording)


@pytest.mark.parametrize("pose", ["rhand_fullpose", "rhand_hand_pose"])
def test_grabs_arrays_whose_object_turns_by_the_transpose(pose: str, options: ReadOptions) -> None:
    numbers = POSE if pose == "rhand_fullpose" else (POSE @ FIELDS["hands_components"].T)[:, :44]
    arrays = {"rhand_global_orient": TURN, pose: numbers, "rhand_transl": SHIFT, "framerate": 120.0}
    data = arrays_npz(**arrays, object_transl=PLACE, object_global_orient=-SPIN, obj_name="mug", lhand_transl=SHIFT)
    assert format_of(Content(data=data), options).name == "grab"
    recording = read_content(Content(data=data), options)
    if pose == "rhand_fullpose":
        assert_our_own(recording, SAMPLE)
    else:
        assert "44 numbers a pose" in words(recording) and "(pca-flat)" in words(recording)
    assert_object(recording)
    assert np.allclose(np.diff(recording.time), 1.0 / 120.0)
    assert "turns by its transpose" in words(recording) and "mean one" in words(recording)
    assert f"not used: obj_name, lhand_transl ({COUNT}, 3)" in words(recording)


def test_pickles_that_are_more_than_data_are_refused(tmp_path: Path, options: ReadOptions) -> None:
    pickled = np.array({"params": {"transl": SHIFT}}, dtype=object)
    sequence = arrays_npz(rhand=pickled, object=pickled, framerate=120.0)
    with pytest.raises(
        TrajectoryError, match=r"not loaded; save their params as arrays: np\.savez\(FILE, rhand_global"
    ):
        read_content(Content(data=sequence), options)
    np.save(tmp_path / "a.mano.npy", np.array({"right": Planted()}, dtype=object))
    with pytest.raises(TrajectoryError, match=r"a\.mano\.npy: holds .*print, which is not data"):
        read_recording(tmp_path / "a.mano.npy", options)
    np.save(tmp_path / "b.mano.npy", np.array({"left": {"shape": np.zeros(10)}}, dtype=object))
    with pytest.raises(TrajectoryError, match="no hand, it holds left/shape; expected right and left"):
        read_recording(tmp_path / "b.mano.npy", options)
    whole = (tmp_path / "b.mano.npy").read_bytes()
    (tmp_path / "b.mano.npy").write_bytes(whole[:-20])
    with pytest.raises(TrajectoryError, match="no pickle, or a damaged one"):
        read_recording(tmp_path / "b.mano.npy", options)
