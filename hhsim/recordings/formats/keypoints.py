"""Joints of a hand as bare numbers: 21 in MediaPipe's or MANO's order, or OpenXR's 26 or WebXR's 25.

| file | holds |
|---|---|
| .npy | an array (T, 21, 3) or (T, 63), or of 25 or 26 joints |
| .npz | such an array under any name, or `keypoints`, `landmarks`, `joints`; stamps under `t`, `time` or `timestamps` |
| .csv | 63 columns of coordinates, with stamps or without, or columns such as left_lm00_x; 63 without a header too |
| .json | a list of frames of 21 points, or objects with a stamp and a list of 21 points |

They have no radius, often no scale and no world: the wrist stands still then. The order of 21 joints is the one in
which the bones from the wrist to the tips are the shortest together; bones that keep their lengths decide between two
that are nearly equal. An object's pose in `.npz` or in JSON is read by its names (`hhsim.recordings.object_poses`).
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError, UnknownNameError
from hhsim.motion.csv_table import Table, lacks_names, read_table
from hhsim.motion.npz_arrays import array_names, npy_with, npz_of, npz_with, numbers, read_npy
from hhsim.recordings.correction import Changes, Correction, joint_changes
from hhsim.recordings.joint_frames import frame_edits, joints_of_frames, read_frames
from hhsim.recordings.joint_names import JOINT_ORDERS, KEYPOINTS, OPENXR_JOINTS, WEBXR_JOINTS, JointName, joint_name
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.joint_table import joint_columns, joint_edits, joints_of_table, located, table_of_joints
from hhsim.recordings.json_document import PlacedJson
from hhsim.recordings.object_poses import poses_in
from hhsim.recordings.recording import HandMotion, Recording, note, readings, unused
from hhsim.recordings.registry import NPY, Content, ReadOptions, RecordingFormat
from hhsim.recordings.unit_detection import time_column

COUNT = len(KEYPOINTS)
SHAPES = f"(T, {COUNT}, 3) or (T, {3 * COUNT})"
LARGER = {len(names): names for names in (WEBXR_JOINTS, OPENXR_JOINTS)}
"""Joints of rows of more than 21, by their number."""
CLEARLY = 1.1
"""Ratio of lengths from which on one order is more plausible: of our own hand it is 1.03 to 1.6, 1.2 in the mean."""
COORDINATES = [JointName("", joint, axis) for joint in KEYPOINTS for axis in "xyz"]
"""Meaning of 63 columns in a row."""
NAMES = ("keypoints", "landmarks", "joints", "hand_keypoints", "hand_landmarks", "kp3d", "joints_3d")
NUMBERED = re.compile(r"(?:^|[^0-9a-zA-Z])(?:[a-zA-Z]*?)([0-9]{1,2})[^0-9a-zA-Z]*([xyz])$", re.IGNORECASE)
PLAIN = re.compile(r"^([xyz])[_ ]?([0-9]{1,2})$", re.IGNORECASE)
LISTS = re.compile(r'"[a-zA-Z_]*(landmarks|keypoints)[a-zA-Z_]*"', re.IGNORECASE)
FEWEST_NAMED = 4
"""Number of joints in the names of columns that mark another format."""


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the only one; raises TrajectoryError."""
    zipped = content.head.startswith(b"PK")
    if content.head.startswith(NPY):
        joints = joints_of_array(read_npy(content.data), "the array", content, options)
    elif zipped:
        joints = _from_npz(content, options)
    elif content.is_json:
        joints = joints_of_frames(*read_frames(content.document), "keypoints", options)
        joints = replace(joints, **_ordered(joints.position, content, options))
    else:
        joints = _from_table(content, options)
        joints = replace(joints, **_ordered(joints.position, content, options))
    return recording_of_joints(joints, content, options).changed(checksums="held" if zipped else "")


def joints_of_array(array: Any, where: str, content: Content, options: ReadOptions, **more: Any) -> JointPositions:
    """Return the joints in an array of points, with more fields of `JointPositions`."""
    try:
        # A damaged float32 can be a signalling NaN, which would be warned of.
        with np.errstate(invalid="ignore"):
            values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise TrajectoryError(f"{where} does not hold numbers; expected {SHAPES}") from None
    if not _is_points(values, content):
        lacking = {(16, 3): ": 16 joints lack the fingertips", (20, 3): ": 20 joints lack the wrist"}
        lack = lacking.get(values.shape[1:], "")
        raise TrajectoryError(f"{where} has shape {values.shape}; expected {SHAPES}{lack}")
    points = values.reshape(len(values), -1, 3)
    ordered = _ordered(readings("position", points, points.shape), content, options, where)
    return JointPositions(**{"form": "keypoints"} | ordered | more)


def _ordered(points: FloatArray, content: Content, options: ReadOptions, where: str = "") -> dict[str, Any]:
    """Return fields of `JointPositions` for the joints of rows, shape (T, n, 3), in the order of `KEYPOINTS`.

    Raises TrajectoryError if two orders are as plausible, and neither the options, a field of the file nor the name
    `where` of the array tell; InputError if the options state an order of other joints.
    """
    count, stated = points.shape[1], options.joint_order
    if stated is not None and (stated == "openxr") is (count == COUNT):
        expected = "25 or 26" if count == COUNT else str(COUNT)
        raise InputError(f"--joint-order {stated}: {count} joints a sample; expected {expected}")
    names = stated_names(content, options, count)
    if names:
        content.stated.take("order")
        what = f"{count} joints in the order that the file states"
    elif count in LARGER:
        names, what = LARGER[count], f"{count} joints in {'OpenXR' if count == 26 else 'WebXR'}'s order"
    else:
        word = next((word for word in JOINT_ORDERS if word in where.lower()), None)
        order = stated or order_by_bones(points) or word
        if order is None:
            either = "the joints may be in MediaPipe's or in MANO's order"
            raise TrajectoryError(f"{either}; say --joint-order mediapipe|mano")
        names, what = JOINT_ORDERS[order], f"{COUNT} keypoints in MediaPipe's order: wrist, thumb to little finger"
        if names is not KEYPOINTS:
            how = "as --joint-order says" if stated else "by the lengths of its bones; else say --joint-order"
            what = f"{COUNT} joints in MANO's order (wrist, index, middle, little, ring, thumb, then the tips), {how}"
    places = tuple(names.index(joint) for joint in KEYPOINTS)
    more = {"up": "y"} if names in LARGER.values() else {}
    return {"position": points[:, list(places)], "what": what, "joint_order": places, **more}


def stated_names(content: Content, options: ReadOptions, count: int) -> tuple[str, ...]:
    """Return the joints of a row of `count` by a field of the file; none without one, or if the options state them."""
    names: tuple[str, ...] = content.stated.seen("order") or ()
    return names if options.joint_order is None and len(names) == count else ()


def order_by_bones(points: FloatArray) -> str | None:
    """Return the order in which rows of 21 joints, shape (T, 21, 3), are a hand; None if two are as plausible."""
    whole = points[np.isfinite(points).all(axis=(1, 2)) & (np.ptp(points, axis=1) > 0.0).any(axis=1)]
    if not len(whole):
        return "mediapipe"
    length, change = {}, {}
    for order in ("mediapipe", "mano"):
        hand = whole[:, [JOINT_ORDERS[order].index(joint) for joint in KEYPOINTS]]
        ends = hand[:, 1:].reshape(-1, 5, 4, 3)
        starts = np.concatenate([np.broadcast_to(hand[:, None, None, 0], (len(hand), 5, 1, 3)), ends[:, :, :3]], axis=2)
        bones = np.linalg.norm(ends - starts, axis=3).reshape(-1, 20)
        length[order] = float(np.median(bones.sum(axis=1)))
        change[order] = float(np.median(np.abs(bones - np.median(bones, axis=0)), axis=0).sum())
    short, long = sorted(length, key=lambda order: length[order])
    if length[long] > CLEARLY * length[short] or CLEARLY * change[short] < change[long]:
        return short
    return None if CLEARLY * change[long] >= change[short] else long


def _from_npz(content: Content, options: ReadOptions) -> JointPositions:
    arrays = content.arrays
    if not arrays:
        files = ", ".join(sorted(array_names(content.data))[:4]) or "nothing"
        raise TrajectoryError(f"a zip archive of {files}, without an array; expected .npz, or the recording unpacked")
    key = _points_key(content, options)
    points, stamps = arrays[key], time_column(arrays)
    time = None if stamps is None else numbers(arrays, stamps.name, len(points))
    unit = None if stamps is None else stamps.unit
    joints = joints_of_array(points, f"array '{key}'", content, options, time=time, time_unit=unit)
    poses = poses_in(arrays, len(points), options)
    used = {key, *(poses.names if poses else ()), *((stamps.name,) if stamps else ())}
    return replace(joints, object_poses=poses, findings=(*joints.findings, *unused(arrays, used)))


def _points_key(content: Content, options: ReadOptions) -> str:
    """Return the name of the array of points, that of the options if they have one.

    Raises TrajectoryError if there is none, or more than one; UnknownNameError for a name that the file does not have.
    """
    arrays = content.arrays
    if options.array is not None:
        if options.array not in arrays:
            raise UnknownNameError("array", options.array, arrays)
        return options.array
    fitting = [key for key, value in arrays.items() if _is_points(value, content)]
    named = [key for key in fitting if key in NAMES] or fitting
    if options.hand and len(named) > 1:
        named = [key for key in named if joint_name(key).side == options.hand] or named
    if len(named) != 1:
        if named:
            sided = " or --hand right|left" if {joint_name(key).side for key in named} >= {"right", "left"} else ""
            listed = ", ".join(named)
            raise TrajectoryError(f"{len(named)} arrays of joints, {listed}; say which one: --array NAME{sided}")
        held = ", ".join(f"{key} {np.shape(value)}" for key, value in list(arrays.items())[:6])
        raise TrajectoryError(f"no array of shape {SHAPES}; it holds {held}")
    return named[0]


def _write(content: Content, options: ReadOptions, recording: Recording, correction: Correction) -> bytes:
    made = joint_changes(recording, correction)
    if content.head.startswith(NPY):
        return npy_with(content.data, _moved(read_npy(content.data), recording, made))
    if content.head.startswith(b"PK"):
        key = _points_key(content, options)
        points = content.arrays[key]
        order = stated_names(content, options, np.size(points[0]) // 3)
        return npz_with(content.data, {key: _moved(points, recording, made, order)})
    read = _joints_read(recording)
    if content.is_json:
        placed = PlacedJson(content.exact_text)
        frames = [
            frame._replace(
                hands={
                    side: {read.get(name, name): joint for name, joint in hand.items()}
                    for side, hand in frame.hands.items()
                }
            )
            for frame in read_frames(placed.document)[0]
        ]
        return content.edited(frame_edits(placed, frames, options, made))
    table, names, _ = _named_table(content)
    names = {column: name._replace(joint=read.get(name.joint, name.joint)) for column, name in names.items()}
    return content.edited(joint_edits(content.exact_text, table, names, options, made), table.decimal)


def _joints_read(recording: Recording) -> dict[str, str]:
    """Return the joint that was read at each place of 21, which MediaPipe's order calls by another name."""
    return {KEYPOINTS[place]: joint for joint, place in zip(KEYPOINTS, recording.joint_order) if place < COUNT}


def _moved(points: Any, recording: Recording, made: Changes, names: tuple[str, ...] = ()) -> FloatArray:
    """Return points of an array with the changes, shape (T, J, 3): those beyond the 21 with the palm.

    A missing number, and a joint without a correction, stay.
    """
    values = np.array(points, dtype=np.float64)
    values = values.reshape(len(values), -1, 3)
    names = names or LARGER.get(values.shape[1]) or tuple(_joints_read(recording)[joint] for joint in KEYPOINTS)
    for place, joint in enumerate(names):
        moved = made.moved(joint, values[made.rows, place])
        values[made.rows, place] = np.where(np.isfinite(moved), moved, values[made.rows, place])
    return values


def _is_points(value: Any, content: Content) -> bool:
    """Return True for rows of as many joints as are known, or as a field names."""
    counts = {COUNT, *LARGER, len(content.stated.seen("order") or KEYPOINTS)}
    return np.shape(value)[1:] in {shape for count in counts for shape in ((count, 3), (3 * count,))}


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
        foreign = {"wrist_pos", "flex", "poses", "pose", "hand_pose", "mano_pose"}
        return options.array is not None or (bool(names) and not names & foreign)
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
    (".npy", ".npz", ".pkl", ".csv", ".json"),
    _sniff,
    _read,
    write=_write,
    make=_make,
    made=(".npz", ".csv"),
)
