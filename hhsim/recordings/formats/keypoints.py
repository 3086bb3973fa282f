"""21 keypoints of a hand as bare numbers: MediaPipe's order, which is also that of many data sets.

| file | holds |
|---|---|
| .npy | an array (T, 21, 3) or (T, 63) |
| .npz | such an array under any name, or `keypoints`, `landmarks`, `joints`; stamps under `t`, `time` or `timestamps` |
| .csv | 63 columns of coordinates, with stamps or without, or columns such as left_lm00_x; 63 without a header too |
| .json | a list of frames of 21 points, or objects with a stamp and a list of 21 points |

They have no radius, often no scale and no world: the wrist stands still then.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.csv_table import Table, lacks_names, read_table
from hhsim.motion.npz_arrays import array_names, npy_with, npz_of, npz_with, numbers, read_npy, read_npz
from hhsim.recordings.correction import Changes, Correction, joint_changes
from hhsim.recordings.joint_frames import frame_edits, joints_of_frames, read_frames
from hhsim.recordings.joint_names import KEYPOINTS, JointName, joint_name
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.joint_table import joint_columns, joint_edits, joints_of_table, located, table_of_joints
from hhsim.recordings.json_document import PlacedJson, read_json
from hhsim.recordings.recording import HandMotion, Recording, note
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat
from hhsim.recordings.unit_detection import time_column

COUNT = len(KEYPOINTS)
SHAPES = f"(T, {COUNT}, 3) or (T, {3 * COUNT})"
COORDINATES = [JointName("", joint, axis) for joint in KEYPOINTS for axis in "xyz"]
"""Meaning of 63 columns in a row."""
NAMES = ("keypoints", "landmarks", "joints", "hand_keypoints", "hand_landmarks", "kp3d", "joints_3d")
NUMBERED = re.compile(r"(?:^|[^0-9a-zA-Z])(?:[a-zA-Z]*?)([0-9]{1,2})[^0-9a-zA-Z]*([xyz])$", re.IGNORECASE)
PLAIN = re.compile(r"^([xyz])[_ ]?([0-9]{1,2})$", re.IGNORECASE)
LISTS = re.compile(r'"[a-zA-Z_]*(landmarks|keypoints)[a-zA-Z_]*"', re.IGNORECASE)
FEWEST_NAMED = 4
"""Number of joints in the names of columns that mark another format."""
NPY = b"\x93NUMPY"


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the only one; raises TrajectoryError."""
    zipped = content.head.startswith(b"PK")
    if content.head.startswith(NPY):
        joints = _joints(read_npy(content.data), "the array")
    elif zipped:
        joints = _from_npz(content.data)
    elif content.is_json:
        joints = joints_of_frames(read_frames(read_json(content.text)), "keypoints", options)
    else:
        joints = _from_table(content, options)
    return recording_of_joints(joints, content.name, options).changed(checksums="held" if zipped else "")


def _joints(array: Any, where: str, time: FloatArray | None = None, unit: str | None = None) -> JointPositions:
    """Return the joints in an array of points."""
    try:
        values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise TrajectoryError(f"{where} does not hold numbers; expected {SHAPES}") from None
    if not _is_points(values):
        raise TrajectoryError(f"{where} has shape {values.shape}; expected {SHAPES}")
    what = f"{COUNT} keypoints in MediaPipe's order: wrist, thumb to little finger"
    return JointPositions(values.reshape(-1, COUNT, 3), "keypoints", what, time, unit)


def _from_npz(data: bytes) -> JointPositions:
    arrays = read_npz(data)
    if not arrays:
        files = ", ".join(sorted(array_names(data))[:4]) or "nothing"
        raise TrajectoryError(f"a zip archive of {files}, without an array; expected .npz, or the recording unpacked")
    key = _points_key(arrays)
    points = arrays[key]
    stamps = time_column(arrays)
    if stamps is None:
        return _joints(points, f"array '{key}'")
    return _joints(points, f"array '{key}'", numbers(arrays, stamps.name, len(points)), stamps.unit)


def _points_key(arrays: Mapping[str, Any]) -> str:
    """Return the name of the array of points; TrajectoryError if there is none, or more than one."""
    fitting = [key for key, value in arrays.items() if _is_points(value)]
    named = [key for key in fitting if key in NAMES] or fitting
    if len(named) != 1:
        held = ", ".join(f"{key} {np.shape(value)}" for key, value in list(arrays.items())[:6])
        reason = "more than one" if named else "no"
        raise TrajectoryError(f"{reason} array of shape {SHAPES}; it holds {held}")
    return named[0]


def _write(content: Content, options: ReadOptions, recording: Recording, correction: Correction) -> bytes:
    made = joint_changes(recording, correction)
    if content.head.startswith(NPY):
        return npy_with(content.data, _moved(read_npy(content.data), made))
    if content.head.startswith(b"PK"):
        arrays = read_npz(content.data)
        key = _points_key(arrays)
        return npz_with(content.data, {key: _moved(arrays[key], made)})
    if content.is_json:
        placed = PlacedJson(content.exact_text)
        return content.edited(frame_edits(placed, read_frames(placed.document), options, made))
    table, names, _ = _named_table(content)
    return content.edited(joint_edits(content.exact_text, table, names, options, made))


def _moved(points: Any, made: Changes) -> FloatArray:
    """Return points, shape (T, 21, 3) or (T, 63), with the changes; a missing number stays."""
    values = np.array(points, dtype=np.float64).reshape(-1, COUNT, 3)
    values[made.rows] += np.nan_to_num(made.shift, nan=0.0)
    return values


def _is_points(value: Any) -> bool:
    return np.shape(value)[1:] in ((COUNT, 3), (3 * COUNT,))


def _numbered(column: str) -> JointName | None:
    """Return the meaning of a column such as left_lm05_y, y5 or 5_y; None for another."""
    plain = PLAIN.match(column.strip())
    found = plain or NUMBERED.search(column.strip())
    if found is None:
        return None
    digits, axis = (found.group(2), found.group(1)) if plain else (found.group(1), found.group(2))
    return JointName(joint_name(column).side, KEYPOINTS[int(digits)], axis.lower()) if int(digits) < COUNT else None


def _numbered_names(header: tuple[str, ...]) -> dict[str, JointName]:
    """Return the meanings of numbered columns; none if no hand has all of its 21 points."""
    names = {column: name for column in header if (name := _numbered(column)) is not None}
    whole = {side for side, joints in joint_columns(names).items() if len(located(joints)) == COUNT}
    return {column: name for column, name in names.items() if name.side in whole}


def _from_table(content: Content, options: ReadOptions) -> JointPositions:
    table, names, notes = _named_table(content)
    joints = joints_of_table(table, names, "keypoints", options)
    return replace(joints, findings=(*map(note, notes), *joints.findings))


def _named_table(content: Content) -> tuple[Table, Mapping[str, JointName], list[str]]:
    """Return the table, the meanings of its columns, and notes about them."""
    header = content.header
    bare = len(header) == len(COORDINATES) and lacks_names(header)
    table = read_table(content.text, names=[f"{name.part} of {name.joint}" for name in COORDINATES] if bare else None)
    notes = ["no header line: the first line is a sample"] if bare else []
    names: Mapping[str, JointName] = _numbered_names(table.header)
    if not names:
        stamps = time_column(table.header)
        columns = [name for name in table.header if stamps is None or name not in (stamps.name, *stamps.others)]
        if len(columns) != len(COORDINATES):
            given = f"{len(columns)} columns{' and a time' if stamps else ''}"
            raise TrajectoryError(f"{given}; expected {len(COORDINATES)} coordinates of {COUNT} points")
        names = dict(zip(columns, COORDINATES))
        notes.append(f"{len(columns)} columns without numbered names: taken as x, y, z of each point in turn")
    return table, names, notes


def _make(suffix: str, motion: HandMotion) -> bytes:
    """Return keypoints in our world, z up, which the format does not say."""
    if suffix == ".npz":
        return npz_of({"keypoints": motion.joints, "t": motion.time})
    return table_of_joints(motion, [f"lm{k:02d}" for k in range(COUNT)], motion.joints)


def _sniff(content: Content, options: ReadOptions) -> bool:
    if content.head.startswith(NPY):
        return True
    if content.head.startswith(b"PK"):
        names = array_names(content.data)
        return bool(names) and not names & {"wrist_pos", "flex", "poses", "pose", "hand_pose", "mano_pose"}
    if content.is_json:
        text = content.beginning.lstrip()
        return LISTS.search(text) is not None or re.match(r"\[\s*\[\s*(\[\s*)?-?[0-9]", text) is not None
    header = content.header if options.columns is None else ()
    said = map(joint_name, header)
    if len({name.joint for name in said if name.joint and name.part in ("x", "y", "z")}) >= FEWEST_NAMED:
        # Columns named after joints may stand in any order: format openxr.
        return False
    others = len(header) - len(COORDINATES)
    return bool(_numbered_names(header)) or (others == 0 or (others == 1 and time_column(header) is not None))


FORMAT = RecordingFormat(
    "keypoints",
    "21 keypoints in MediaPipe's order as bare numbers",
    (".npy", ".npz", ".csv", ".json"),
    _sniff,
    _read,
    write=_write,
    make=_make,
    made=(".npz", ".csv"),
)
