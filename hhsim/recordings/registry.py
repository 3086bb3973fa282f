"""A file of any known format as a `hhsim.recordings.recording.Recording`; the content decides which format it is.

| format | begins with | reader |
|---|---|---|
| hhsim | HDF5's signature | `hhsim.motion.file` |
| leap | { or [ of JSON, or nothing but letters of base64 | `hhsim.recordings.leap_reader` |
| bvh | HIERARCHY | `hhsim.recordings.bvh_reader` |
| npz | the signature of a zip archive | `hhsim.recordings.npz_reader` |
| dexmo | the names of a Dexmo glove's eleven channels in a table | `hhsim.recordings.dexmo_reader` |
| csv | anything else that is text | `hhsim.recordings.csv_reader`, by our columns or by a mapping |
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, get_args

from hhsim.errors import InputError, TrajectoryError, UnknownNameError
from hhsim.motion.trajectory import HandSide, Trajectory
from hhsim.recordings.bvh_parser import looks_like_bvh
from hhsim.recordings.bvh_reader import read_bvh_recording
from hhsim.recordings.column_map import OWN_COLUMNS, ColumnMap, is_own_header
from hhsim.recordings.csv_reader import read_csv_recording
from hhsim.recordings.csv_table import read_table
from hhsim.recordings.dexmo_reader import Poses, has_dexmo_channels, read_dexmo_table
from hhsim.recordings.dexmo_regression import DexmoRegression
from hhsim.recordings.frames import axes_matrix
from hhsim.recordings.leap_reader import looks_like_leap, read_leap_recording
from hhsim.recordings.npz_reader import read_npz_recording
from hhsim.recordings.recording import Recording
from hhsim.result.motion import holds_a_result, load_result_motion

FORMATS = {
    "hhsim": "a trajectory, a result or a session of hhsim, .h5",
    "npz": "NumPy arrays t, wrist_pos, wrist_quat, flex, abd",
    "leap": "a Leap Motion recording, .json or .json.lz",
    "bvh": "BVH motion capture with the joints of fingers",
    "dexmo": "a table of a Dexmo glove's eleven channels",
    "csv": "a table: hhsim's own columns, or any with --columns",
}
"""Every format with its one line."""
MOST_BYTES = 1 << 30
"""A file larger than this [byte] is no hand recording."""


@dataclass(frozen=True)
class ReadOptions:
    """What the user says about a file.

    Attributes:
        form: a word of `FORMATS`; None lets the content decide.
        columns: what the columns of a table mean.
        hand: which hand it is, where the file does not say it, or says it wrong.
        palm_axes: our palm's x, y, z in the recording's palm frame, such as ("-y", "x", "z"); None takes the file's.
        world_up: the axis of the recording's world that points up; None takes the file's.
        length_unit: of BVH, whose unit else follows from the length of the hand.
        dexmo: the calibration of a Dexmo glove.
        poses: when a Dexmo glove's hand was in the poses of its calibration.
    """

    form: str | None = None
    columns: ColumnMap | None = None
    hand: HandSide = ""
    palm_axes: Sequence[str] | None = None
    world_up: str | None = None
    length_unit: str | None = None
    dexmo: DexmoRegression | None = None
    poses: Poses | None = None


def read_recording(path: str | Path, options: ReadOptions | None = None) -> Recording:
    """Read a recording.

    Args:
        path: the file.
        options: what the user says about it.

    Raises:
        TrajectoryError: no such file, none of the formats, or a damaged one; one line that begins with the path.
        InputError: options that do not fit the file.
    """
    source = Path(path)
    asked = options or ReadOptions()
    if source.is_dir():
        raise TrajectoryError(f"{source}: a folder; expected a recording")
    if holds_a_result(source):
        # Read in parts, however long the session is.
        recording = from_trajectory(load_result_motion(source))
        return recording.changed(hand=asked.hand) if asked.hand else recording
    try:
        if source.stat().st_size > MOST_BYTES:
            raise TrajectoryError(f"{source}: more than 1 GB; expected a recording of a hand")
        data = source.read_bytes()
    except OSError as error:
        raise TrajectoryError(f"{source}: cannot be read: {error.strerror or error}") from None
    try:
        recording = read_bytes(data, asked, name=source.stem, path=source)
    except TrajectoryError as error:
        said = str(error)
        raise TrajectoryError(said if said.startswith(f"{source}: ") else f"{source}: {said}") from None
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    return recording.changed(hand=asked.hand) if asked.hand else recording


def read_bytes(data: bytes, options: ReadOptions, *, name: str, path: Path | None = None) -> Recording:
    """The recording in the content of a file; arguments and errors as for `read_recording`."""
    form = options.form or format_of(data)
    if form not in FORMATS:
        raise UnknownNameError("format", form, FORMATS)
    if options.palm_axes is not None:
        axes_matrix(options.palm_axes, "--palm-axes")
    if options.columns is not None and form != "csv":
        raise InputError(f"--columns explains a table, and this is {FORMATS[form]}")
    if form == "hhsim":
        from hhsim.motion.file import read_fields

        if path is None:
            raise InputError("an HDF5 file is read from its path")
        return _from_fields(read_fields(path))
    if form == "npz":
        return read_npz_recording(data, name=name, palm_axes=options.palm_axes, world_up=options.world_up)
    text = as_text(data)
    if form == "bvh":
        return read_bvh_recording(
            text, name=name, hand=options.hand, world_up=options.world_up, length_unit=options.length_unit
        )
    if form == "leap":
        return read_leap_recording(text, name=name.removesuffix(".json"), hand=options.hand)
    if form == "dexmo" or (options.form is None and options.columns is None and _is_dexmo(text)):
        return read_dexmo_table(read_table(text), options.dexmo, name=name, poses=options.poses)[0]
    if options.dexmo is not None or options.poses is not None:
        raise InputError("a calibration of the Dexmo glove, but the file holds other columns than its channels")
    columns = options.columns
    if columns is None and (options.palm_axes or options.world_up) and is_own_header(read_table(text).header):
        columns = OWN_COLUMNS
    if columns is not None:
        axes, up = options.palm_axes or columns.palm_axes, options.world_up or columns.world_up
        columns = replace(columns, palm_axes=tuple(axes), world_up=up)
    return read_csv_recording(text, columns, name=name)


def format_of(data: bytes) -> str:
    """The word of `FORMATS` for a file's content.

    Raises:
        TrajectoryError: nothing in it.
    """
    if not data.strip():
        raise TrajectoryError("empty; expected a recording")
    if data.startswith(b"\x89HDF"):
        return "hhsim"
    if data.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return "npz"
    begin = data[:4096].decode("utf-8-sig", errors="replace")
    return "bvh" if looks_like_bvh(begin) else "leap" if looks_like_leap(begin) else "csv"


def calibration_of(path: str | Path, options: ReadOptions) -> DexmoRegression:
    """The calibration that a Dexmo glove's recording gives itself by its poses.

    Args:
        path: the file.
        options: with which it is read.

    Raises:
        TrajectoryError, InputError: as for `read_recording`.
    """
    data = Path(path).read_bytes()
    return read_dexmo_table(read_table(as_text(data)), options.dexmo, poses=options.poses)[1]


def _is_dexmo(text: str) -> bool:
    try:
        return has_dexmo_channels(read_table(text).header)
    except TrajectoryError:
        return False


def as_text(data: bytes) -> str:
    """The text in the content of a file; what is no UTF-8 becomes a sign that no number holds.

    Raises:
        TrajectoryError: no text.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    else:
        text = data.decode("utf-8-sig", errors="replace")
    sample = text[:4096]
    if sum(sign in "\x00\ufffd" for sign in sample) > 0.1 * len(sample):
        raise TrajectoryError(f"neither text nor a known format; expected one of {', '.join(FORMATS)}")
    return text


def from_trajectory(trajectory: Trajectory) -> Recording:
    """A trajectory as a recording, to be looked over once more."""
    keys = (field.name for field in fields(trajectory))
    return _from_fields({key: getattr(trajectory, key) for key in keys})


def _from_fields(given: dict[str, Any]) -> Recording:
    """The recording of a trajectory's fields, which need not make one: there may be NaN in them."""
    known = given | {"form": "hhsim"}
    if given["hand"] not in get_args(HandSide):
        raise TrajectoryError(f"hand is '{given['hand']}'; expected right, left, or nothing")
    if given.get("flags") is None:
        known.pop("flags", None)
    return Recording(**known)
