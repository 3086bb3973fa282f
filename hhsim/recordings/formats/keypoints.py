"""Joints of a hand as bare numbers: 21 in MediaPipe's order, WebXR's 25, or others that are stated.

| file | holds |
|---|---|
| .npy | an array (T, 21, 3) or (T, 63), or of 25 or 26 joints |
| .npz | such an array under any name, or `keypoints`, `landmarks`, `joints`; stamps under `t`, `time` or `timestamps` |
| .csv | 63 columns of coordinates, with stamps or without, or columns such as left_lm00_x; 63 without a header too |
| .json | a list of frames of 21 points, or objects with a stamp and a list of 21 points; read and not written |

They have often no scale and no world: the wrist stands still then.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.motion.csv_table import NewColumn, Table, format_table, lacks_names, read_table
from hhsim.motion.npz_arrays import npz_of
from hhsim.motion.trajectory import as_numbers
from hhsim.recordings.content import ARCHIVES, NPY, ROWS, ZIP, Content, ReadOptions
from hhsim.recordings.joint_arrays import (
    ORDERS,
    columns_of_hand,
    frames_in,
    joint_columns,
    joints_of_frames,
    joints_of_rows,
    joints_of_table,
    listed_joints,
    located,
    row_names,
)
from hhsim.recordings.joint_names import KEYPOINTS, JointName, joint_name
from hhsim.recordings.object_poses import beside
from hhsim.recordings.recording import Recording, readings
from hhsim.recordings.registry import Changes, JointPositions, RecordingFormat
from hhsim.recordings.unit_detection import time_column

COUNT = len(KEYPOINTS)
SHAPES = f"(T, {COUNT}, 3) or (T, {3 * COUNT})"
LACKING = {(16, 3): ": 16 joints lack the fingertips", (20, 3): ": 20 joints lack the wrist"}
COORDINATES = [JointName("", joint, axis) for joint in KEYPOINTS for axis in "xyz"]
"""Meaning of 63 columns in a row."""
NAMES = ("keypoints", "landmarks", "joints", "hand_keypoints", "hand_landmarks", "kp3d", "joints_3d")
NUMBERED = re.compile(r"(?:^|[^0-9a-zA-Z])(?:[a-zA-Z]*?)(?P<k>[0-9]{1,2})[^0-9a-zA-Z]*(?P<axis>[xyz])$", re.IGNORECASE)
PLAIN = re.compile(r"^(?P<axis>[xyz])[_ ]?(?P<k>[0-9]{1,2})$", re.IGNORECASE)
LISTS = re.compile(r'"[a-zA-Z_]*(landmarks|keypoints)[a-zA-Z_]*"', re.IGNORECASE)
MOST_LISTED = 12
"""Most arrays in a message."""
FEWEST_NAMED = 4
"""Number of joints in the names of columns that mark another format."""


def _read(content: Content, options: ReadOptions) -> JointPositions:
    """Read the hand of the options, else the only one; raises TrajectoryError."""
    if content.head.startswith((NPY, *ARCHIVES)):
        key, arrays = _points_key(content, options), content.arrays
        points = points_of(arrays[key], "the array" if key == ROWS else f"array '{key}'", content)
        fields, used = joints_of_rows(points, content, options, arrays)
        return JointPositions(**fields, **beside(content, len(points), options, {key, *used}))
    if content.is_json:
        return joints_of_frames(content, options, *frames_in(content.document))
    joints = joints_of_table(content, *_named_table(content), options)
    fields, _ = joints_of_rows(joints.position, content, options)
    return replace(joints, **fields)


def points_of(array: Any, where: str, content: Content) -> FloatArray:
    """Return rows of points, shape (T, n, 3), NaN for what is no reading; TrajectoryError for another array."""
    # A damaged float32 can be a signalling NaN, which would be warned of.
    with np.errstate(invalid="ignore"):
        values = as_numbers(where, array)
    if not _is_points(values, content):
        raise TrajectoryError(f"{where} has shape {values.shape}; expected {SHAPES}{LACKING.get(values.shape[1:], '')}")
    if not len(values):
        raise TrajectoryError(f"{where} has shape {values.shape}: no samples")
    points = values.reshape(len(values), -1, 3)
    return readings("position", points, points.shape)


def _points_key(content: Content, options: ReadOptions) -> str:
    """Return the name of the array of points, that of the options if they have one.

    Raises TrajectoryError if there is none, or more than one; UnknownNameError for a name that the file does not have.
    """
    arrays = content.arrays
    if arrays.keys() == {ROWS}:
        return ROWS
    if not arrays and content.head.startswith(ZIP):
        files = ", ".join(sorted(content.array_names)[:4]) or "nothing"
        if "[Content_Types].xml" in files:
            raise TrajectoryError("an Excel workbook is not read; save it as CSV")
        raise TrajectoryError(f"a zip archive of {files}, without an array; expected .npz, or the recording unpacked")
    if options.array is not None:
        if options.array not in arrays:
            raise UnknownNameError("array", options.array, arrays)
        return options.array
    fitting = [key for key, value in arrays.items() if _is_points(value, content)]
    named = [key for key in fitting if key in NAMES] or fitting
    if options.hand and len(named) > 1:
        named = [key for key in named if joint_name(key).side == options.hand] or named
    if len(named) > 1:
        raise TrajectoryError(f"{len(named)} arrays of joints, {', '.join(named)}; say which: --array NAME, or --hand")
    if not named:
        held = ", ".join(f"{key} {np.shape(value)}" for key, value in list(arrays.items())[:MOST_LISTED]) or "nothing"
        raise TrajectoryError(f"no array of shape {SHAPES}; it holds {held}")
    return named[0]


def _write(content: Content, options: ReadOptions, made: Changes) -> bytes:
    if content.head.startswith((NPY, *ARCHIVES)):
        key = _points_key(content, options)
        return content.with_arrays({key: _moved(content.arrays[key], content, options, made)})
    table, names = _named_table(content)
    # The columns are numbered in MediaPipe's order, whatever the joints are.
    joints = row_names(joints_of_table(content, table, names, options).position, content, options)[0]
    read = dict(zip(KEYPOINTS, joints))
    names = {column: name._replace(joint=read[name.joint]) for column, name in names.items()}
    columns: dict[str, NewColumn] = {}
    for joint, parts in columns_of_hand(content, names, options)[1].items():
        cells = [parts[axis] for axis in "xyz"]
        moved = made.moved(joint, table.numbers(cells)[0][made.rows])
        columns |= {cell: NewColumn(values, made.digits) for cell, values in zip(cells, moved.T)}
    return content.edited(table, made.rows, columns)


def _moved(array: Any, content: Content, options: ReadOptions, made: Changes) -> FloatArray:
    """Return points of an array with the changes, shape (T, n, 3): those beyond the 21 with the palm.

    A missing number, and a joint without a correction, stay.
    """
    values = np.array(array, dtype=np.float64).reshape(len(array), -1, 3)
    for place, joint in enumerate(row_names(points_of(array, "the array", content), content, options)[0]):
        moved = made.moved(joint, values[made.rows, place])
        values[made.rows, place] = np.where(np.isfinite(moved), moved, values[made.rows, place])
    return values


def _is_points(value: Any, content: Content) -> bool:
    """Return True for rows of as many joints as are known, or as a field names."""
    counts = {*ORDERS, len(content.stated.seen("order") or KEYPOINTS)}
    return np.shape(value)[1:] in {shape for count in counts for shape in ((count, 3), (3 * count,))}


def _numbered_names(header: tuple[str, ...]) -> dict[str, JointName]:
    """Return the meanings of columns such as left_lm05_y, y5 or 5_y; none if no hand has all of its 21 points."""
    names = {}
    for column in header:
        found = PLAIN.match(column.strip()) or NUMBERED.search(column.strip())
        if found is not None and int(found["k"]) < COUNT:
            names[column] = JointName(joint_name(column).side, KEYPOINTS[int(found["k"])], found["axis"].lower())
    whole = {side for side, joints in joint_columns(names).items() if len(located(joints)) == COUNT}
    return {column: name for column, name in names.items() if name.side in whole}


def _named_table(content: Content) -> tuple[Table, Mapping[str, JointName]]:
    """Return the table, and the meanings of its columns."""
    header = content.header
    bare = len(header) == len(COORDINATES) and lacks_names(header)
    table = read_table(content.text, names=[f"{name.part} of {name.joint}" for name in COORDINATES] if bare else None)
    if bare:
        content.note("no header line: the first line is a sample")
    names: Mapping[str, JointName] = _numbered_names(table.header)
    if not names:
        stamps = time_column(table.header)
        columns = [name for name in table.header if name not in (*stamps.names, *stamps.others)]
        if len(columns) != len(COORDINATES):
            given = f"{len(columns)} columns{' and a time' if stamps.name else ''}"
            raise TrajectoryError(f"{given}; expected {len(COORDINATES)} coordinates of {COUNT} points")
        names = dict(zip(columns, COORDINATES))
        content.note(f"{len(columns)} columns without numbered names: taken as x, y, z of each point in turn")
    return table, names


def _make(suffix: str, recording: Recording) -> bytes:
    """Return keypoints in our world, z up, which the format does not say."""
    time, joints, side = recording.time, recording.joints, recording.hand
    assert joints is not None
    if suffix == ".npz":
        return npz_of({"keypoints": joints, "t": time, **({"hand": np.array(side)} if side else {})})
    header = ["time_s", *(f"{side}_lm{k:02d}_{axis}" for k in range(COUNT) for axis in "xyz")]
    rows = np.column_stack([time, joints.reshape(len(joints), -1)]).tolist()
    return format_table({}, header, (list(map(repr, row)) for row in rows)).encode()


def _sniff(content: Content, options: ReadOptions) -> bool:
    if content.head.startswith((NPY, *ARCHIVES)):
        names = content.array_names
        foreign = {"wrist_pos", "flex", "poses", "pose", "hand_pose", "mano_pose"}
        return options.array is not None or (bool(names) and not names & foreign)
    if content.is_json:
        text = content.beginning.lstrip()
        bare = re.match(r"\[\s*\[\s*(\[\s*)?-?[0-9]", text) is not None
        return bare or LISTS.search(text) is not None or listed_joints(content) == COUNT
    header = content.header if options.columns is None else ()
    said = map(joint_name, header)
    if len({name.joint for name in said if name.joint and name.part in ("x", "y", "z")}) >= FEWEST_NAMED:
        # Columns named after joints may stand in any order: format openxr.
        return False
    if len(header) > len(COORDINATES):
        stamps = time_column(header)
        header = tuple(name for name in header if name not in (*stamps.names, *stamps.others))
    return len(header) == len(COORDINATES) or bool(_numbered_names(header))


FORMAT = RecordingFormat(
    "keypoints",
    "21 keypoints in MediaPipe's order as bare numbers",
    (".npy", ".npz", ".pkl", ".csv", ".json"),
    _sniff,
    _read,
    write=_write,
    make=_make,
)
