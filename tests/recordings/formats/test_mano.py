"""Poses of MANO by a model that is made from our own hand; no file of the real one is here."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_samples import Side, arrays_npz, assert_our_own, joint_sample, words
from pose_samples import mano_fields, mano_poses

from hhsim.errors import InputError, TrajectoryError
from hhsim.recordings.recording import OTHER
from hhsim.recordings.registry import Content, ReadOptions, format_of, read_content


def numbers_of(reading: str, pose: Any, fields: dict[str, Any]) -> Any:
    """The numbers that say this pose in a reading."""
    from_mean = pose - fields["hands_mean"]
    components = fields["hands_components"]
    return {
        "axis-angle": pose,
        "axis-angle-mean": from_mean,
        "pca-flat": pose @ components.T,
        "pca": from_mean @ components.T,
    }[reading]


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("reading", ["axis-angle", "axis-angle-mean", "pca", "pca-flat"])
def test_our_own_hand_comes_back_in_every_reading(side: Side, reading: str, tmp_path: Path) -> None:
    sample = joint_sample(side)
    fields = mano_fields(sample.hand)
    np.savez(tmp_path / f"MANO_{side.upper()}.npz", **fields)
    turn, pose, shift = mano_poses(sample)
    numbers = np.concatenate([turn, numbers_of(reading, pose, fields)], axis=1)
    data = arrays_npz(poses=numbers, trans=shift, t=sample.motion.time, hand=side)
    mano: dict[str, Any] = {"mano_model": tmp_path / f"MANO_{side.upper()}.npz", "mano_pose": reading}
    assert format_of(Content(data=data), ReadOptions()).name == "mano"
    recording = read_content(Content(data=data), ReadOptions(**mano, world_up="y"))
    assert recording.hand == side and np.allclose(recording.time, sample.motion.time)
    assert_our_own(recording, sample)
    assert f"({reading}); model mano_{side}" in words(recording)
    other = OTHER[side]
    with pytest.raises(InputError, match=rf"{other} hand, but the model is called .*: is it the other hand's\?"):
        read_content(Content(data=data), ReadOptions(**mano, world_up="y", hand=other))


def test_no_reading_is_guessed_and_the_model_is_asked_for(tmp_path: Path) -> None:
    sample = joint_sample()
    turn, pose, shift = mano_poses(sample)
    np.savez(tmp_path / "model.npz", **mano_fields(sample.hand))
    model = tmp_path / "model.npz"
    whole = arrays_npz(poses=np.concatenate([turn, pose], axis=1), trans=shift, fps=100.0, hand="right")
    few = arrays_npz(hand_pose=pose[:, :15], global_orient=turn, t=sample.motion.time)
    for data, file, reading, kind, said in (
        (whole, model, None, TrajectoryError, "say which: --mano-pose axis-angle, axis-angle-mean, pca, "),
        (few, model, None, TrajectoryError, "15 numbers .* say which: --mano-pose pca, pca-flat"),
        (few, model, "axis-angle", InputError, "needs 45 numbers a pose, and there are 15"),
        (whole, None, "axis-angle", TrajectoryError, "40 poses of a MANO hand, 45 numbers .*--mano-model"),
        (arrays_npz(pose=pose[:, :2]), model, None, TrajectoryError, "has shape|0 numbers"),
        (arrays_npz(pose=pose[:0]), model, None, TrajectoryError, "no samples"),
        (arrays_npz(pose=np.zeros((0, 16, 3))), model, None, TrajectoryError, "no samples"),
    ):
        with pytest.raises(kind, match=said):
            read_content(Content(data=data), ReadOptions(mano_model=file, mano_pose=reading))
    read = read_content(Content(data=whole), ReadOptions(mano_model=model, mano_pose="axis-angle", world_up="y"))
    assert "made from the rate, 100 Hz" in words(read)
