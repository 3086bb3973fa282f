"""Submissions in files, as other software writes them."""

from pathlib import Path

import h5py

from hhsim.submissions.pose_file import FORMAT, PARTS, Submission, format_poses
from hhsim.system.atomic_write import sealed_hdf5


def write_submission(submission: Submission, path: Path) -> None:
    """Write one, .csv or .h5."""

    def fill(file: h5py.File) -> None:
        file.attrs["format"] = FORMAT
        for key, value in submission.keys().items():
            file.attrs[key] = value
        for block, array in submission.arrays.items():
            file.create_dataset(block.name, data=array, track_times=False).attrs["units"] = PARTS[block.part].unit

    path.write_bytes(format_poses(submission).encode() if path.suffix == ".csv" else sealed_hdf5(fill))
