"""ARCTIC's and GRAB's hands and objects, by a model that is made from our own hand; no file of theirs is here."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from correction_samples import a_correction
from joint_samples import joint_sample, words
from pose_samples import mano_fields, mano_poses

from hhsim.errors import InputError
from hhsim.recordings.joint_names import JOINT_ORDERS
from hhsim.recordings.registry import ReadOptions, read_recording, write_recording

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


@pytest.mark.parametrize("file", ["take.mano.npy", "take.pkl"])
def test_a_corrected_hand_comes_back_and_nothing_else_changes(file: str, tmp_path: Path, options: ReadOptions) -> None:
    path, out = tmp_path / file, tmp_path / f"new_{file}"
    single = {key: values.astype(np.float32) for key, values in RIGHT.items()}
    worn: dict[Any, Any] = {**RIGHT, "note": "worn", 3: None}
    held = {"right": single, "left": worn}
    path.write_bytes(pickle.dumps(held))
    if file == "take.mano.npy":
        np.save(path, np.array(held, dtype=object))
    recording: Any = read_recording(path, options)
    correction = a_correction(recording)
    off = write_recording(path, options, recording, correction, out)
    # Half a unit of float32 at a rotation of π moves a fingertip by 0.1 µm.
    assert off is not None and off < 1e-6
    again = read_recording(out, options)
    assert again.joints is not None and np.abs(again.joints - correction.joints).max() < 1e-6
    assert np.array_equal(again.joints[~correction.changed], recording.joints[~correction.changed])
    old, new = flat(path), flat(out)
    assert list(old) == list(new)
    changed = {name for name in old if not np.array_equal(old[name], new[name])}
    assert changed == {"right/rot", "right/pose", "right/trans"}
    assert {name: np.asarray(values).dtype for name, values in old.items()} == {
        name: np.asarray(values).dtype for name, values in new.items()
    }


def flat(path: Path) -> dict[str, Any]:
    """Arrays of a file by their names, those of dictionaries with a slash."""
    sides = pickle.loads(path.read_bytes()) if path.suffix == ".pkl" else np.load(path, allow_pickle=True).item()
    return {f"{side}/{key}": values for side, held in sides.items() for key, values in held.items()}
