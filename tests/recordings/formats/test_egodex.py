"""EgoDex's HDF5: our own hand by ARKit's joints, read, and written with a correction."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from correction_samples import a_correction
from joint_samples import assert_our_own, joint_sample

from hhsim.errors import TrajectoryError
from hhsim.recordings.formats.egodex import arkit_joints
from hhsim.recordings.joint_names import OPENXR_JOINTS
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import ReadOptions, read_recording, write_recording

SAMPLE = joint_sample()
PLACES = SAMPLE.named(OPENXR_JOINTS)


def egodex(change: Callable[[h5py.File], Any] = lambda file: None, sides: tuple[Any, ...] = ("right", "left")) -> bytes:
    """Our sample as EgoDex's right hand, beside a left one elsewhere and the camera."""
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        for side in sides:
            for joint, name in arkit_joints(side).items():
                matrices = np.tile(np.eye(4), (len(PLACES), 1, 1))
                matrices[:, :3, 3] = PLACES[:, OPENXR_JOINTS.index(joint)] + (side == "left")
                file[f"transforms/{name}"] = matrices
                file[f"confidences/{name}"] = np.ones(len(PLACES))
        file["transforms/camera"] = np.tile(np.eye(4), (len(PLACES), 1, 1))
        file["camera/intrinsic"] = np.eye(3)
        change(file)
    return image.getvalue()


def read_written(folder: Path, image: bytes) -> Recording:
    path = folder / "1.hdf5"
    path.write_bytes(image)
    return read_recording(path, ReadOptions(form="egodex", hand="right"))


def test_arkits_joints_are_our_own_hand(tmp_path: Path) -> None:
    path = tmp_path / "0.hdf5"
    path.write_bytes(egodex())
    recording = read_recording(path, ReadOptions())
    assert (recording.form, recording.hand) == ("egodex", "right")
    np.testing.assert_allclose(np.diff(recording.time), 1.0 / 30.0)
    assert_our_own(recording, SAMPLE)
    left = read_recording(path, ReadOptions(hand="left", mirror="x"))
    assert left.joints is not None and left.hand == "left"


def test_a_correction_is_written_and_nothing_else(tmp_path: Path) -> None:
    path, out = tmp_path / "0.hdf5", tmp_path / "free.hdf5"
    path.write_bytes(egodex())
    recording = read_recording(path, ReadOptions(hand="right"))
    correction = a_correction(recording)
    off = write_recording(path, ReadOptions(hand="right"), recording, correction, out)
    assert off is not None and off < 1e-12
    with h5py.File(path) as before, h5py.File(out) as after:
        names: list[str] = []
        before.visit(names.append)
        hand = set(arkit_joints("right").values())
        for name in names:
            if isinstance(before[name], h5py.Dataset):
                same = np.array_equal(before[name][()], after[name][()])
                assert same is not (name.startswith("transforms/") and name.split("/")[1] in hand)
        turned = after["transforms/rightIndexFingerTip"][:, :3, :3]
        np.testing.assert_allclose(turned @ turned.swapaxes(1, 2), np.tile(np.eye(3), (len(turned), 1, 1)), atol=1e-12)


def flattened(file: h5py.File) -> None:
    values = file["transforms/rightHand"][:].reshape(-1, 16)
    del file["transforms/rightHand"]
    file["transforms/rightHand"] = values


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda file: file.pop("transforms/rightThumbTip"), "no hand in 'transforms'"),
        (lambda file: file.pop("transforms"), "no hand in 'transforms', it holds camera, confidences"),
        (flattened, r"'rightHand' has shape \(40, 16\)"),
    ],
)
def test_a_file_of_other_things_is_told(tmp_path: Path, change: Callable[[h5py.File], Any], said: str) -> None:
    with pytest.raises(TrajectoryError, match=said) as caught:
        read_written(tmp_path, egodex(change, ("right",)))
    assert "\n" not in str(caught.value)
    with pytest.raises(TrajectoryError, match="a damaged HDF5 file"):
        read_written(tmp_path, egodex()[:4000])


def test_a_joint_of_little_confidence_is_doubtful(tmp_path: Path) -> None:
    def doubt(file: h5py.File) -> None:
        file["confidences/rightHand"][2] = 0.2

    recording = read_written(tmp_path, egodex(doubt))
    assert np.flatnonzero(recording.flags).tolist() == [2]
