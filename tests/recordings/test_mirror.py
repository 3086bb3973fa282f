"""Left-handed coordinates: a known hand and its object seen in a mirror come in as the ones that were not mirrored."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_samples import Y_UP, arrays_npz, joint_sample, mcap_bytes, words  # fmt: skip
from leap_document import document
from recording_samples import read_as, smooth_recording
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.csv_file import format_csv
from hhsim.motion.file import save_trajectory
from hhsim.motion.trajectory import ObjectMotion
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.object_poses import with_object_poses
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import ReadOptions, read_recording

SAMPLE = joint_sample()
TIME, COUNT = SAMPLE.motion.time, len(SAMPLE.motion.time)
MOTION = smooth_recording(COUNT)
RANDOM = np.random.default_rng(7)
PLACE, TURN = RANDOM.uniform(-0.3, 0.3, (COUNT, 3)), Rotation.from_rotvec(RANDOM.normal(0.0, 1.0, (COUNT, 3)))
FLIPS = {axis: np.where(np.arange(3) == k, -1.0, 1.0) for k, axis in enumerate("xyz")}
NONE = np.ones(3)


def turned(rotation: Rotation, flip: FloatArray) -> Rotation:
    """A body's rotation in coordinates whose axes, and its own, are turned round."""
    return Rotation.from_matrix(np.diag(flip) @ rotation.as_matrix() @ np.diag(flip))


def object_of(flip: FloatArray) -> dict[str, Any]:
    return {"object_pos": PLACE * flip, "object_quat_wxyz": turned(TURN, flip).as_quat(scalar_first=True)}


def seen(flip: FloatArray) -> Any:
    """The joints of a hand in coordinates with y up that are flipped."""
    return SAMPLE._replace(joints=(SAMPLE.joints @ Y_UP.T * flip) @ Y_UP)


def angles(flip: FloatArray) -> Any:
    """A motion of palm and angles that is flipped, with its object."""
    palm = turned(Rotation.from_quat(MOTION.orientation, scalar_first=True), flip).as_quat(scalar_first=True)
    moved = ObjectMotion(PLACE * flip, turned(TURN, flip).as_quat(scalar_first=True))
    return replace(MOTION, position=MOTION.position * flip, orientation=palm, object_motion=moved)


def npz_of_angles(flip: FloatArray) -> bytes:
    motion = angles(flip)
    palm = {"wrist_pos": motion.position, "wrist_quat_wxyz": motion.orientation}
    meta = json.dumps({"hand": "right", "frame": "palm: x=direction, z=-palmNormal; y up"})
    return arrays_npz(
        t=motion.time, **palm, flex=motion.flexion, abd=motion.abduction, **object_of(flip), meta=np.array(meta)
    )


def leap_document(flip: FloatArray) -> str:
    def flipped(node: Any) -> Any:
        if isinstance(node, dict):
            return {key: flipped(value) for key, value in node.items()}
        if isinstance(node, list) and len(node) == 3 and all(isinstance(each, float) for each in node):
            return (np.array(node) * flip).tolist()
        return [flipped(each) for each in node] if isinstance(node, list) else node

    return json.dumps(flipped(document()))


def own_csv(flip: FloatArray) -> str:
    motion = clean_recording(MOTION).trajectory
    return format_csv(replace(motion, **{key: getattr(angles(flip), key) for key in MOVED}))


MOVED = ("position", "orientation", "object_motion")
MIRRORED: dict[str, tuple[str, Callable[[FloatArray], str | bytes], dict[str, Any]]] = {
    "npz of joints": (
        "keypoints",
        lambda flip: arrays_npz(keypoints=seen(flip).named(), t=TIME, hand="right", **object_of(flip)),
        {"world_up": "y"},
    ),
    "mcap": ("mcap", lambda flip: mcap_bytes(seen(flip)), {}),
    "leap": ("leap", leap_document, {}),
    "npz of angles": ("npz", npz_of_angles, {}),
    "own csv": ("csv", own_csv, {"world_up": "y", "palm_axes": ("y", "z", "x")}),
}


def assert_same(one: Recording, other: Recording) -> None:
    assert one.hand == other.hand
    for key in ("position", "flexion", "abduction", "joints"):
        if getattr(other, key) is not None:
            np.testing.assert_allclose(getattr(one, key), getattr(other, key), atol=1e-6)
    assert np.allclose(np.abs((one.orientation * other.orientation).sum(axis=1)), 1.0)
    if other.object_motion is not None:
        np.testing.assert_allclose(one.object_motion.position, other.object_motion.position, atol=1e-9)
        assert np.allclose(np.abs((one.object_motion.orientation * other.object_motion.orientation).sum(axis=1)), 1.0)


@pytest.mark.parametrize("form", MIRRORED)
def test_a_mirrored_hand_and_its_object_come_in_as_they_were(form: str) -> None:
    name, make, options = MIRRORED[form]
    right = read_as(name, make(NONE), **options)
    for axis, flip in FLIPS.items():
        again = read_as(name, make(flip), mirror=axis, **options)
        assert_same(again, right)
        assert f"left-handed coordinates: {axis} is turned round, as --mirror says" in words(again)


@pytest.mark.parametrize("form", ["npz of joints", "mcap", "leap"])
def test_a_named_side_that_the_fingers_contradict_stops(form: str) -> None:
    name, make, options = MIRRORED[form]
    remedy = "--hand left" if name == "keypoints" else "--mirror x --other-hand"
    said = rf"named a right hand, but its fingers bend as a left one's: say --mirror x\|y\|z .*, {remedy} if it is"
    with pytest.raises(TrajectoryError, match=said):
        read_as(name, make(FLIPS["z"]), **options)
    with pytest.raises(TrajectoryError, match=r"bend as a left one's: leave out --mirror y"):
        read_as(name, make(NONE), mirror="y", **options)


def test_poses_of_a_file_are_mirrored_as_those_beside_the_hand(tmp_path: Path) -> None:
    beside = read_as("keypoints", MIRRORED["npz of joints"][1](NONE), world_up="y")
    for axis, flip in FLIPS.items():
        path = tmp_path / f"{axis}.npz"
        path.write_bytes(arrays_npz(position=PLACE * flip, quat_xyzw=turned(TURN, flip).as_quat()))
        hand = arrays_npz(keypoints=seen(flip).named(), t=TIME, is_rhand=np.ones(COUNT))
        mirrored = read_as("keypoints", hand, mirror=axis, world_up="y")
        assert_same(with_object_poses(mirrored, path, ReadOptions(pose_unit="m")), beside)


def test_where_nothing_names_the_hand_the_note_says_that_coordinates_may_be_left_handed() -> None:
    data = arrays_npz(keypoints=seen(FLIPS["z"]).named(), t=TIME, **object_of(FLIPS["z"]))
    told = read_as("keypoints", data, world_up="y")
    assert told.hand == "left" and "a right one in left-handed coordinates, as Unity's: --mirror x|y|z" in words(told)
    turned_round = read_as("keypoints", data, world_up="y", mirror="z")
    assert_same(turned_round, read_as("keypoints", MIRRORED["npz of joints"][1](NONE), world_up="y"))
    assert "Unity" not in words(turned_round)
    own = format_csv(replace(clean_recording(MOTION).trajectory, hand=""))
    told = words(read_as("csv", own, world_up="y"))
    assert "nothing names the hand; with y up its coordinates may be left-handed" in told
    assert words(read_as("csv", own)) == "" and "Unity" not in words(read_as("csv", own, world_up="y", mirror="z"))


def test_a_file_of_hhsim_is_right_handed(tmp_path: Path) -> None:
    save_trajectory(clean_recording(MOTION).trajectory, tmp_path / "take.h5")
    with pytest.raises(InputError, match="--mirror z: a file of hhsim is right-handed"):
        read_recording(tmp_path / "take.h5", ReadOptions(mirror="z"))
