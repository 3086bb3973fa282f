"""HDF5 files: a trajectory, or the motion of a result or a session of hhsim."""

import io
from dataclasses import fields
from typing import get_args

import h5py

from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.file import HDF5_SUFFIXES, read_fields
from hhsim.motion.trajectory import HandSide, Trajectory
from hhsim.recordings.content import HDF5, Content, ReadOptions
from hhsim.recordings.recording import MOTION, Recording
from hhsim.recordings.registry import Changes, RecordingFormat
from hhsim.result.motion import holds_a_result, load_result_motion
from hhsim.system.checksummed_file import MARK, SIZE, seal_holds, sealed
from hhsim.system.hdf5_input import require_own_data


def recording_of(trajectory: Trajectory) -> Recording:
    """Return a trajectory as a recording."""
    given = {field.name: getattr(trajectory, field.name) for field in fields(trajectory)}
    return Recording(**{key: value for key, value in given.items() if value is not None}, form="hhsim")


def _read(content: Content, options: ReadOptions) -> Recording:
    if content.path is None:
        raise InputError("an HDF5 file is read from its path")
    if options.mirror is not None:
        raise InputError(f"--mirror {options.mirror}: a file of hhsim is right-handed; expected what it was made from")
    if holds_a_result(content.path):
        # Read in blocks, so of any length.
        recording = recording_of(load_result_motion(content.path))
    else:
        content.refuse_large()
        # They may hold NaN.
        given = read_fields(content.path)
        if given["hand"] not in get_args(HandSide):
            raise TrajectoryError(f"hand is '{given['hand']}'; expected right, left, or nothing")
        recording = Recording(**given, form="hhsim")
    return recording.changed(checksums=(recording.checksums or "held") if seal_holds(content.path) else "missing")


def _write(content: Content, options: ReadOptions, made: Changes) -> bytes:
    if content.path is None or holds_a_result(content.path):
        raise InputError("a result or a session is not corrected; expected a trajectory")
    given = content.data.removesuffix(content.data[-SIZE:]) if content.data[-SIZE:].startswith(MARK) else content.data
    image = io.BytesIO(given)
    with h5py.File(image, "r+") as file:
        require_own_data(file)
        place, turn, flexion, abduction = (file[key][()] for key in MOTION)
        for key, values in zip(MOTION, made.motion(place, turn, flexion, abduction)):
            file[key][...] = values
    return image.getvalue() if given is content.data else sealed(image.getvalue())


FORMAT = RecordingFormat(
    "hhsim",
    "a trajectory, a result or a session of hhsim, .h5",
    HDF5_SUFFIXES,
    lambda content, options: content.head.startswith(HDF5),
    _read,
    write=_write,
)
