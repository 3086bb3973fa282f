"""EgoDex's HDF5: our own hand by ARKit's joints, read, and written with a correction."""

from pathlib import Path

import h5py
import numpy as np
from correction_samples import a_correction
from recorded_files import egodex

from hhsim.recordings.formats.egodex import arkit_joints
from hhsim.recordings.registry import ReadOptions, read_recording, write_recording


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
