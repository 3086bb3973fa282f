"""Joints of a hand as bare numbers: 21 in MediaPipe's or MANO's order, or OpenXR's 26 or WebXR's 25.

| file | holds |
|---|---|
| .npy | an array (T, 21, 3) or (T, 63), or of 25 or 26 joints |
| .npz | such an array under any name, or `keypoints`, `landmarks`, `joints`; stamps under `t`, `time` or `timestamps` |
| .csv | 63 columns of coordinates, with stamps or without, or columns such as left_lm00_x; 63 without a header too |
| .json | a list of frames of 21 points, or objects with a stamp and a list of 21 points |

They have often no scale and no world: the wrist stands still then. Radii of the joints, (n,) or (T, n), may stand
beside the points in an `.npz` or its like (`RADII`). The order of the joints is the one whose
bones are nearest to a hand's in their proportions; it is refused where these are none of a hand, or change their
lengths. An object's pose in `.npz` or in JSON is read by its names (`hhsim.recordings.object_poses`).
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError, UnknownNameError
from hhsim.hand.model import DEFAULT_HAND_LENGTH
from hhsim.motion.csv_table import Table, lacks_names, read_table
from hhsim.motion.npz_arrays import array_names, npy_with, npz_of, npz_with, numbers, read_npy
from hhsim.recordings.correction import Changes, Correction, joint_changes
from hhsim.recordings.finger_ik import usual_bones
from hhsim.recordings.joint_frames import (
    frame_edits,
    joint_columns,
    joint_edits,
    joints_of_frames,
    joints_of_table,
    listed_joints,
    located,
    read_frames,
    table_of_joints,
)
from hhsim.recordings.joint_names import (
    KEYPOINTS,
    MANO_JOINTS,
    OPENXR_JOINTS,
    UNITY_JOINTS,
    WEBXR_JOINTS,
    JointName,
    hand_statement,
    joint_name,
)
from hhsim.recordings.joint_positions import TINY, JointPositions, recording_of_joints
from hhsim.recordings.json_document import PlacedJson
from hhsim.recordings.object_poses import poses_in
from hhsim.recordings.recording import HandMotion, Recording, note, readings, unused
from hhsim.recordings.registry import NPY, Content, ReadOptions, RecordingFormat
from hhsim.recordings.unit_detection import LENGTH_UNITS, time_column

COUNT = len(KEYPOINTS)
SHAPES = f"(T, {COUNT}, 3) or (T, {3 * COUNT})"
ORDERS: dict[int, dict[str, tuple[str, ...]]] = {
    21: {"mediapipe": KEYPOINTS, "mano": MANO_JOINTS},
    25: {"openxr": WEBXR_JOINTS},
    26: {"openxr": OPENXR_JOINTS, "unity": UNITY_JOINTS},
}
"""Known orders of the joints of a row by their number, and by the words of `--joint-order`."""
MAKERS = {"mediapipe": "MediaPipe", "mano": "MANO", "openxr": "OpenXR and WebXR", "unity": "Unity"}
PROPORTIONS = (0.4, 2.5)
"""Shortest and longest bone of a hand by the usual one's, as shares of all bones."""
MOST_CHANGE = 0.05
"""Largest usual change of a bone's share of all bones: noise of 10 mm makes it 0.03."""
MOST_JUDGED = 1000
"""Number of samples, evenly over the recording, that are enough to tell the order of the joints."""
COORDINATES = [JointName("", joint, axis) for joint in KEYPOINTS for axis in "xyz"]
"""Meaning of 63 columns in a row."""
NAMES = ("keypoints", "landmarks", "joints", "hand_keypoints", "hand_landmarks", "kp3d", "joints_3d")
RADII = ("radius", "radii", "joint_radius", "joint_radii")
"""Names of an array of the joints' radii, in the unit and the order of the points."""
NUMBERED = re.compile(r"(?:^|[^0-9a-zA-Z])(?:[a-zA-Z]*?)([0-9]{1,2})[^0-9a-zA-Z]*([xyz])$", re.IGNORECASE)
PLAIN = re.compile(r"^([xyz])[_ ]?([0-9]{1,2})$", re.IGNORECASE)
LISTS = re.compile(r'"[a-zA-Z_]*(landmarks|keypoints)[a-zA-Z_]*"', re.IGNORECASE)
MOST_LISTED = 12
"""Most arrays in a message."""
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
        frames, beside = read_frames(content.document)
        joints = joints_of_frames(frames, beside, "keypoints", options)
        if all(len(hand) <= COUNT for frame in frames for hand in frame.hands.values()):
            joints = replace(joints, **_ordered(joints.position, content, options))
        elif options.joint_order is None:
            order_by_bones(joints.position, {"openxr": KEYPOINTS})
    else:
        table, names, notes = _named_table(content)
        joints = joints_of_table(table, names, "keypoints", options)
        found = (*map(note, notes), *joints.findings)
        joints = replace(joints, findings=found, **_ordered(joints.position, content, options))
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
    if not len(values):
        raise TrajectoryError(f"{where} has shape {values.shape}: no samples")
    points = values.reshape(len(values), -1, 3)
    ordered = _ordered(readings("position", points, points.shape), content, options)
    return JointPositions(**{"form": "keypoints"} | ordered | more)


def _ordered(points: FloatArray, content: Content, options: ReadOptions) -> dict[str, Any]:
    """Return fields of `JointPositions` for the joints of rows, shape (T, n, 3), in the order of `KEYPOINTS`.

    Raises TrajectoryError if no known order makes a hand of them, and neither the options nor a field of the file state
    one; InputError if the options state an order of other joints.
    """
    count, stated = points.shape[1], options.joint_order
    word = "mano" if stated == "smplx" else stated
    if word is not None and word not in ORDERS.get(count, {}):
        expected = " or ".join(str(number) for number, orders in ORDERS.items() if word in orders)
        raise InputError(f"--joint-order {stated}: {count} joints a sample; expected {expected}")
    names, misfit = stated_names(content, options, count), ""
    if names:
        content.stated.take("order")
        what = f"{count} joints in the order that the file states"
    else:
        if word is None:
            word = order_by_bones(points, ORDERS[count])
        else:
            misfit = "; ".join(fit.text for fit in _bone_fits(points, {word: ORDERS[count][word]}) if not fit.fits)
        names, how = ORDERS[count][word], "as --joint-order says" if stated else "by the lengths of its bones"
        what = {
            "mediapipe": f"{count} keypoints in MediaPipe's order: wrist, thumb to little finger",
            "mano": f"{count} joints in MANO's order (wrist, index, middle, little, ring, thumb, then the tips), {how}",
            "openxr": f"{count} joints in {'OpenXR' if count == 26 else 'WebXR'}'s order",
            "unity": f"{count} joints in Unity's order (the wrist before the palm), {how}",
        }[word]
        if not stated and word in ("mano", "unity"):
            what += "; else say --joint-order"
    places = tuple(names.index(joint) for joint in KEYPOINTS)
    more = {"up": "y"} if set(names) >= set(WEBXR_JOINTS) else {}
    return {"position": points[:, list(places)], "what": what, "joint_order": places, "misfit": misfit, **more}


def stated_names(content: Content, options: ReadOptions, count: int) -> tuple[str, ...]:
    """Return the joints of a row of `count` by a field of the file; none without one, or if the options state them."""
    names: tuple[str, ...] = content.stated.seen("order") or ()
    return names if options.joint_order is None and len(names) == count else ()


def order_by_bones(points: FloatArray, orders: Mapping[str, tuple[str, ...]]) -> str:
    """Return the one of these orders in which rows of joints, shape (T, n, 3), are most like a hand.

    Raises TrajectoryError, which says how far each is off, where none makes a hand.
    """
    found = _bone_fits(points, orders)
    if not found:
        return next(iter(orders))
    fitting = [fit for fit in found if fit.fits]
    if not fitting:
        what = f"{points.shape[1]} joints in no order that is known, by their bones: {'; '.join(f.text for f in found)}"
        raise TrajectoryError(f"{what}; name them in a field joint_names, or say --joint-order if it is one of these")
    return min(fitting, key=lambda fit: fit.misfit).word


class _BoneFit(NamedTuple):
    """Bones of joints in an order."""

    word: str  # the order, of `ORDERS`
    misfit: float  # mean deviation of their proportions from the usual hand's, as a logarithm
    fits: bool  # True if they have the proportions of a hand and keep their lengths
    text: str  # how far they are off


def _bone_fits(points: FloatArray, orders: Mapping[str, tuple[str, ...]]) -> list[_BoneFit]:
    """Compare rows of joints, shape (T, n, 3), in each of these orders with a hand; empty if no row is whole."""
    whole = points[np.isfinite(points).all(axis=(1, 2)) & (np.ptp(points, axis=1) > 0.0).any(axis=1)]
    some, found = whole[:: len(whole) // MOST_JUDGED + 1], []
    for word, names in orders.items() if len(some) else ():
        hand = some[:, [names.index(joint) for joint in KEYPOINTS]]
        ends = hand[:, 1:].reshape(-1, 5, 4, 3)
        starts = np.concatenate([np.broadcast_to(hand[:, None, None, 0], (len(hand), 5, 1, 3)), ends[:, :, :3]], axis=2)
        bones = np.linalg.norm(ends - starts, axis=3).reshape(-1, 20)
        # Shares of all bones: a tracker without scale may see the hand grow and shrink.
        total = np.maximum(bones.sum(axis=1, keepdims=True), TINY)
        share = np.median(bones / total, axis=0)
        usual = usual_bones().ravel()
        ratio = np.maximum(share / max(float(share.sum()), TINY) * usual.sum() / usual, 1e-3)
        change = float(np.percentile(np.abs(bones / total - share), 90.0, axis=0).max())
        worst, low, high = int(np.argmax(np.abs(np.log(ratio)))), *PROPORTIONS
        # In no order the length of the hand tells the unit; the largest distance of two joints does, about.
        size = float(np.median(np.linalg.norm(hand[:, :, None] - hand[:, None], axis=3).max(axis=(1, 2))))
        metres = (metre for metre in LENGTH_UNITS.values() if 0.08 <= metre * size <= 0.3)
        millimetres = 1e3 * next(metres, DEFAULT_HAND_LENGTH / size) * float(np.median(total))
        text = (
            f"in {MAKERS[word]}'s the bone to {KEYPOINTS[1 + worst]} is {millimetres * share[worst]:.0f} mm, "
            f"{ratio[worst]:.2g} times a hand's, and bones change by {millimetres * change:.0f} mm"
        )
        fits = low <= ratio.min() and ratio.max() <= high and change <= MOST_CHANGE
        found.append(_BoneFit(word, float(np.abs(np.log(ratio)).mean()), bool(fits), text))
    return found


def _from_npz(content: Content, options: ReadOptions) -> JointPositions:
    arrays = content.arrays
    if not arrays and content.packed:
        raise TrajectoryError(f"no arrays of numbers; expected one of shape {SHAPES}")
    if not arrays:
        files = ", ".join(sorted(array_names(content.data))[:4]) or "nothing"
        if "[Content_Types].xml" in files:
            raise TrajectoryError("an Excel workbook is not read; save it as CSV")
        raise TrajectoryError(f"a zip archive of {files}, without an array; expected .npz, or the recording unpacked")
    key = _points_key(content, options)
    points, stamps = arrays[key], time_column(arrays)
    time = None if stamps is None else stamps.stamps(lambda name: numbers(arrays, name, len(points)))
    unit = None if stamps is None else stamps.unit
    joints = joints_of_array(points, f"array '{key}'", content, options, time=time, time_unit=unit)
    poses = poses_in(arrays, len(points), options)
    used = {key, *(poses.names if poses else ()), *(stamps.names if stamps else ())}
    validity, rows = {}, np.size(points[0]) // 3
    shapes = (rows,), (len(points), rows)
    for name in (name for name in arrays if name.rpartition("/")[2] in RADII and np.shape(arrays[name]) in shapes):
        radius = np.broadcast_to(numbers(arrays, name), (len(points), rows))
        joints = replace(joints, radius=radius[:, list(joints.joint_order)])
        used.add(name)
    for name, given in arrays.items():
        said = hand_statement(name)
        if said and np.shape(given) in ((len(points),), (len(points), 1), (len(points), rows)):
            values = numbers(arrays, name).reshape(len(points), -1)
            validity[said.part] = values[:, list(joints.joint_order)] if values.shape[1] == rows else values
            used.add(name)
    return replace(joints, object_poses=poses, validity=validity, findings=(*joints.findings, *unused(arrays, used)))


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
    if len(named) > 1:
        sided = " or --hand right|left" if {joint_name(key).side for key in named} >= {"right", "left"} else ""
        listed = ", ".join(named)
        raise TrajectoryError(f"{len(named)} arrays of joints, {listed}; say which one: --array NAME{sided}")
    if not named:
        large = sorted(arrays.items(), key=lambda each: -np.ndim(each[1]))
        held = ", ".join(f"{key} {np.shape(value)}" for key, value in large[:MOST_LISTED])
        more = f" and {len(large) - MOST_LISTED} more" if len(large) > MOST_LISTED else ""
        raise TrajectoryError(f"no array of shape {SHAPES}; it holds {held}{more}")
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
        frames = []
        for frame in read_frames(placed.document)[0]:
            hands = {side: {read.get(name, name): hand[name] for name in hand} for side, hand in frame.hands.items()}
            frames.append(frame._replace(hands=hands))
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
    orders = [] if names else ORDERS[values.shape[1]].values()
    read = [order for order in orders if tuple(map(order.index, KEYPOINTS)) == recording.joint_order]
    names = names or (read[0] if read else tuple(_joints_read(recording)[joint] for joint in KEYPOINTS))
    for place, joint in enumerate(names):
        moved = made.moved(joint, values[made.rows, place])
        values[made.rows, place] = np.where(np.isfinite(moved), moved, values[made.rows, place])
    return values


def _is_points(value: Any, content: Content) -> bool:
    """Return True for rows of as many joints as are known, or as a field names."""
    counts = {*ORDERS, len(content.stated.seen("order") or KEYPOINTS)}
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


def _named_table(content: Content) -> tuple[Table, Mapping[str, JointName], list[str]]:
    """Return the table, the meanings of its columns, and notes about them."""
    header = content.header
    bare = len(header) == len(COORDINATES) and lacks_names(header)
    table = read_table(content.text, names=[f"{name.part} of {name.joint}" for name in COORDINATES] if bare else None)
    notes = ["no header line: the first line is a sample"] if bare else []
    names: Mapping[str, JointName] = _numbered_names(table.header)
    if not names:
        stamps = time_column(table.header)
        columns = [name for name in table.header if stamps is None or name not in (*stamps.names, *stamps.others)]
        if len(columns) != len(COORDINATES):
            given = f"{len(columns)} columns{' and a time' if stamps else ''}"
            raise TrajectoryError(f"{given}; expected {len(COORDINATES)} coordinates of {COUNT} points")
        names = dict(zip(columns, COORDINATES))
        notes.append(f"{len(columns)} columns without numbered names: taken as x, y, z of each point in turn")
    return table, names, notes


def _make(suffix: str, motion: HandMotion) -> bytes:
    """Return keypoints in our world, z up, which the format does not say."""
    if suffix == ".npz":
        hand = {"hand": np.array(motion.side)} if motion.side else {}
        return npz_of({"keypoints": motion.joints, "t": motion.time, **hand})
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
        bare = re.match(r"\[\s*\[\s*(\[\s*)?-?[0-9]", text) is not None
        return bare or LISTS.search(text) is not None or listed_joints(content) == COUNT
    header = content.header if options.columns is None else ()
    said = map(joint_name, header)
    if len({name.joint for name in said if name.joint and name.part in ("x", "y", "z")}) >= FEWEST_NAMED:
        # Columns named after joints may stand in any order: format openxr.
        return False
    stamps = time_column(header) if len(header) > len(COORDINATES) else None
    stamped = 0 if stamps is None else len(stamps.names) + len(stamps.others)
    return bool(_numbered_names(header)) or len(header) == len(COORDINATES) + stamped


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
