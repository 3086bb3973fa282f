"""Joints of hands in JSON of any maker, and the joint centres of one hand in it.

A frame is an object with a stamp, or a list, and has hands anywhere in it: objects whose keys are joints, lists of
objects that name their joint, lists of 21 points (in MediaPipe's order), 25 (WebXR's) or 26 (OpenXR's or Unity's), of
63 numbers, or of as many matrices. A joint has a position, three numbers or x, y and z, in itself or in its pose or
transform, or a matrix: 16 numbers, column by column as WebXR has them, or row by row, or four rows.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.csv_table import Table, format_table
from hhsim.motion.pickled_data import flat
from hhsim.motion.text_edit import NewColumn, NumberEdit, cell_edits
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.correction import ANGLE_DIGITS, Changes
from hhsim.recordings.joint_names import (
    KEYPOINTS,
    OPENXR_JOINTS,
    UNITY_JOINTS,
    VALIDITY_WORDS,
    WEBXR_JOINTS,
    JointName,
    hand_statement,
    joint_name,
    recognised,
    side_in,
    stated_value,
)
from hhsim.recordings.joint_positions import JointPositions
from hhsim.recordings.json_document import PlacedJson, keys_of, number, vector
from hhsim.recordings.object_poses import poses_in, record_arrays, table_arrays
from hhsim.recordings.recording import HandMotion, chosen_side, frames_with_hand, note, unreadable, unused
from hhsim.recordings.registry import Content, ReadOptions
from hhsim.recordings.unit_detection import time_column

ORDERS = {len(joints): joints for joints in (KEYPOINTS, WEBXR_JOINTS, OPENXR_JOINTS)}
"""Order of the joints in a list of points, by its length."""
DEEPEST = 8
"""Deepest nesting of a hand in a frame."""
FEWEST = 8
"""Number of joints among an object's keys that make it a hand."""
MATRIX = 16
"""Numbers of a matrix."""
MOST_ENTRIES = 64
"""Number of entries of a list that are searched for hands."""

STAMPED = ("header", "stamp", "timestamp", "time")
"""Keys of objects that hold a stamp."""
TURNS = ("orientation", "rotation", "quaternion", "quat", "rot", "matrix")
"""Keys of a joint's orientation; a quaternion (x, y, z, w) can be corrected."""


class Joint(NamedTuple):
    """Joint of a hand in the document."""

    # Position in the unit of the file, NaN where missing, shape (3,).
    position: Sequence[float] = (np.nan, np.nan, np.nan)
    radius: float = np.nan  # radius in the same unit, NaN where missing
    validity: Mapping[str, float] = {}  # what the document says of it, by its kind; see `stated_validity`
    place: Any = None  # node of the document that holds the position; None without
    turn: Any = None  # node that holds the orientation; None without


class Frame(NamedTuple):
    """Frame of a document."""

    hands: Mapping[HandSide, Mapping[str, Joint]]  # joints of each hand by their names
    stamp: float  # stamp, NaN where missing
    unit: str | None  # unit of the stamp; None if unknown
    beside: Mapping[str, Any] = {}  # other values by their keys


def read_frames(document: Any) -> tuple[list[Frame], dict[str, Any]]:
    """Return the frames of a document, and its values beside them; raise TrajectoryError if there are no frames."""
    frames, beside = document, {}
    if isinstance(document, dict):
        lists = [v for v in document.values() if isinstance(v, list) and any(isinstance(e, dict | list) for e in v)]
        # An object's poses are as many.
        frames = max(lists, key=lambda each: (any(_hands(each[:MOST_ENTRIES], "", 0)), len(each)), default=[])
        beside = {key: value for key, value in document.items() if value is not frames}
    if not isinstance(frames, list) or not frames:
        raise TrajectoryError(f"no frames in JSON that is {keys_of(document)}; expected a list of frames with joints")
    # A key that has held a hand has none of the other values, also in frames that show no hand.
    hand_keys: set[str] = set()
    found = [_frame(frame, hand_keys) for frame in frames]
    others = [{key: value for key, value in frame.beside.items() if key not in hand_keys} for frame in found]
    return [frame._replace(beside=each) for frame, each in zip(found, others)], beside


def listed_joints(content: Content) -> int:
    """Return the number of joints of the first hand that is a list without names in a document; 0 for none."""

    def counted(node: Any, depth: int) -> int:
        entries = list(node.values()) if isinstance(node, dict) else node
        if not isinstance(entries, list) or depth > DEEPEST:
            return 0
        named = any(joint_name(_label(entry)).joint for entry in entries if isinstance(entry, dict))
        if named or (isinstance(node, dict) and sum(bool(joint_name(str(key)).joint) for key in node) >= FEWEST):
            return 0
        inner = (counted(entry, depth + 1) for entry in entries[:MOST_ENTRIES])
        return len(_listed_hand(entries)) or next((count for count in inner if count), 0)

    try:
        return counted(content.document, 0) if content.is_json else 0
    except TrajectoryError:
        return 0


def _frame(frame: Any, hand_keys: set[str]) -> Frame:
    """Return a frame, and add the keys of its hands to `hand_keys`."""
    hands: dict[HandSide, Mapping[str, Joint]] = {}
    for side, hand in _hands(frame, "", 0):
        hands.setdefault(side, hand)
    if not isinstance(frame, dict):
        return Frame(hands, np.nan, None)
    # A message of ROS has its stamp in its header.
    clock = frame | dict(flat({key: frame[key] for key in frame if key in STAMPED and isinstance(frame[key], dict)}))
    column = time_column(clock)
    names = () if column is None else column.names
    unknown = {key: value for key, value in frame.items() if key not in hand_keys and not joint_name(key).joint}
    hand_keys |= {key for key, value in unknown.items() if any(_hands(value, "", 1))}
    beside = {key: value for key, value in unknown.items() if key not in {name.split("/")[0] for name in names}}
    stamp = np.nan if column is None else float(column.stamps(lambda name: np.array(number(clock.get(name)))))
    return Frame(hands, stamp, None if column is None else column.unit, beside)


def joints_of_frames(
    frames: Sequence[Frame],
    beside: Mapping[str, Any],
    form: str,
    options: ReadOptions,
    *,
    up: str | None = None,
    may_be_mirrored: bool = False,
    device: str = "",
) -> JointPositions:
    """Return the joint centres of the hand of the options, else of the one in more frames, and the object's poses.

    `beside` has the values of the file beside its frames, one a frame or a single one. Raises TrajectoryError for no
    such hand, one of the 21 joints in no frame, or an object's pose that is none.
    """
    side, shown, findings = frames_with_hand([frame.hands for frame in frames], options.hand)
    hands = [frames[k].hands[side] for k in shown]
    what = recognised({joint for hand in hands for joint in hand}, side)
    joints = [[hand.get(joint, Joint()) for joint in KEYPOINTS] for hand in hands]
    arrays = record_arrays([beside]) | record_arrays(frame.beside for frame in frames)
    arrays = {name: values[0] if name in beside else values for name, values in arrays.items()}
    poses = poses_in(arrays, len(frames), options)
    held = [(key, value) for frame in frames for key, value in frame.beside.items()]
    used = {key for key, value in held if hand_statement(key) and not isinstance(value, list | dict)}
    used |= {name.split(".")[0] for name in poses.names} if poses is not None else set()
    findings += unused(dict.fromkeys([*beside, *(key for key, _ in held)]), used)
    validity = {
        kind: np.array([[joint.validity.get(kind, np.nan) for joint in hand] for hand in joints])
        for kind in sorted({kind for hand in joints for joint in hand for kind in joint.validity})
    }
    radius = np.array([[joint.radius for joint in hand] for hand in joints])
    stamps = np.array([frames[k].stamp for k in shown])
    return JointPositions(
        position=np.array([[joint.position for joint in hand] for hand in joints]),
        form=form,
        what=what,
        time=stamps if np.isfinite(stamps).any() else None,
        time_unit=next((frames[k].unit for k in shown if frames[k].unit is not None), None),
        hand=side,
        up=up,
        may_be_mirrored=may_be_mirrored,
        radius=radius if np.isfinite(radius).any(axis=0).all() else None,
        validity=validity,
        device=device,
        object_poses=poses and poses.at(shown),
        findings=tuple(findings),
        rows=shown,
    )


def frame_edits(
    numbers: PlacedJson, frames: Sequence[Frame], options: ReadOptions, made: Changes
) -> Iterator[NumberEdit]:
    """Yield the edits of a document's text for a correction of the hand that `joints_of_frames` reads.

    Joints beyond the 21 move with the palm; orientations turn with their bone. Raises InputError for orientations that
    are no quaternions.
    """
    side, _, _ = frames_with_hand([frame.hands for frame in frames], options.hand)
    hands = [frames[row].hands[side] for row in made.rows]
    for name in {name: None for hand in hands for name in hand}:
        joints = [hand.get(name, Joint()) for hand in hands]
        if any(_parts(joint.turn) not in (0, 4) for joint in joints):
            raise InputError(f"the orientation of {name} is no quaternion (x, y, z, w), so it cannot be corrected")
        places = made.moved(name, np.array([joint.position for joint in joints]))
        turns = made.turned(name, np.array([vector(joint.turn, "xyzw") for joint in joints])[:, [3, 0, 1, 2]])
        for joint, place, turn in zip(joints, places, turns[:, [1, 2, 3, 0]]):
            yield from numbers.edits(joint.place, place, made.digits)
            yield from numbers.edits(joint.turn, turn, ANGLE_DIGITS, "xyzw")


def _hands(node: Any, side: HandSide, depth: int) -> Iterator[tuple[HandSide, Mapping[str, Joint]]]:
    """Yield hands anywhere in a node, each with the side of the nearest key or value around it.

    What an object around a hand says of its joints is said of each.
    """
    if depth > DEEPEST:
        return
    if isinstance(node, dict) and "0" in node and all(str(k) == key for k, key in enumerate(node)):
        # A typed array of JavaScript, such as that of fillPoses.
        node = list(node.values())
    if isinstance(node, dict):
        side = side_in(node) or side
        hand = {joint: _joint(value) for key, value in node.items() if (joint := joint_name(str(key)).joint)}
        if len(hand) >= FEWEST:
            sides = [joint_name(str(key)).side for key in node]
            side = next((each for each in sides if each), side)
            yield side, _also_stated(hand, _validity(node, side))
            return
        for key, value in node.items():
            for found, joints in _hands(value, joint_name(str(key)).side or side, depth + 1):
                yield found, _also_stated(joints, _validity(node, found))
    elif isinstance(node, list):
        hand = _listed_hand(node)
        if hand:
            yield side, hand
            return
        for entry in node[:MOST_ENTRIES]:
            yield from _hands(entry, side, depth + 1)


def _also_stated(hand: Mapping[str, Joint], stated: Mapping[str, float]) -> Mapping[str, Joint]:
    """Return a hand whose joints have a further statement each; of two of a kind the smaller one is kept."""

    def least(joint: Joint) -> Joint:
        both = {kind: np.fmin(value, joint.validity.get(kind, np.nan)) for kind, value in stated.items()}
        return joint._replace(validity={**joint.validity, **both})

    return {name: least(joint) for name, joint in hand.items()} if stated else hand


def _listed_hand(node: list[Any]) -> dict[str, Joint]:
    """Return the joints in a list, by their names or by its length; empty if it is no hand."""
    named = [(joint_name(_label(entry)).joint, entry) for entry in node if isinstance(entry, dict)]
    if sum(bool(name) for name, _ in named) >= FEWEST:
        return {name: _joint(entry) for name, entry in named if name}
    size = MATRIX if len(node) in {MATRIX * count for count in ORDERS} else 3
    if len(node) == 3 * len(KEYPOINTS) or size == MATRIX:
        node = [node[k : k + size] for k in range(0, len(node), size)]
    order = ORDERS.get(len(node), ())
    joints = {name: _joint(entry) for name, entry in zip(order, node)}
    if order is OPENXR_JOINTS:
        # The wrist is farther from the knuckles than the palm is.
        knuckle, *first = (np.array(joints[name].position) for name in ("middle_proximal", "palm", "wrist"))
        palm, wrist = (np.linalg.norm(place - knuckle) for place in first)
        joints = dict(zip(UNITY_JOINTS, joints.values())) if palm > wrist else joints
    return joints if any(np.isfinite(joint.position).all() for joint in joints.values()) else {}


def _label(entry: Mapping[str, Any]) -> str:
    return next((str(entry[key]) for key in ("name", "joint", "jointName", "joint_name", "id") if key in entry), "")


def _parts(node: Any) -> int:
    """Return the number of entries of a list or an object, those of lists in it counted; 0 for anything else."""
    return sum(_parts(entry) or 1 for entry in node) if isinstance(node, dict | list) else 0


def _shift(value: Any) -> Any:
    """Return the numbers of a matrix that are its translation; anything else as it is."""
    if not isinstance(value, list):
        return value
    if len(value) == 4 and all(isinstance(row, list) and len(row) == 4 for row in value):
        return [row[3] for row in value[:3]]
    if len(value) != MATRIX:
        return value
    if value[3:16:4] == [0, 0, 0, 1]:
        return value[12:15]
    return value[3:12:4] if value[12:] == [0, 0, 0, 1] else value


def _joint(value: Any) -> Joint:
    if not isinstance(value, dict):
        place = _shift(value)
        return Joint(vector(place), place=place, turn=None if place is value else value)
    inner = next((value[key] for key in ("pose", "transform") if isinstance(value.get(key), dict)), value)
    whole = inner if "x" in inner else None
    place = next((inner[key] for key in ("position", "translation", "pos") if key in inner), whole)
    if place is None:
        keys = ("matrix", "transform", "pose")
        place = next((_shift(node[key]) for node in (inner, value) for key in keys if key in node), None)
    turn = next((node[key] for node in (inner, value) for key in TURNS if key in node), None)
    return Joint(vector(place), number(value.get("radius")), _validity(value), place, turn)


def _validity(node: Mapping[str, Any], side: HandSide = "") -> dict[str, float]:
    """Return what an object says of the joint, or of all joints of the hand of a side, that it is or holds."""
    found = {name.part: node[key] for key in node if (name := hand_statement(str(key))) and name.side in ("", side)}
    return {kind: stated_value(value) for kind, value in found.items()}


WORLD_JOINTS = {"palm", *(f"{finger}_metacarpal" for finger in FINGERS[1:])}
"""Joints that OpenXR and WebXR alone have, whose world has y up."""

Columns = dict[HandSide, dict[str, dict[str, str]]]
"""Columns by hand, joint and part."""


def joint_columns(names: Mapping[str, JointName]) -> Columns:
    """Return the columns of each hand that has a joint with all three coordinates, from the meanings of columns."""
    found: Columns = {}
    for column, name in names.items():
        if name.joint and name.part in ("x", "y", "z", "radius", *VALIDITY_WORDS):
            found.setdefault(name.side, {}).setdefault(name.joint, {}).setdefault(name.part, column)
    return {side: joints for side, joints in found.items() if located(joints)}


def located(joints: Mapping[str, Mapping[str, str]]) -> set[str]:
    """Return the joints that have columns of all three coordinates."""
    return {joint for joint, parts in joints.items() if {"x", "y", "z"} <= set(parts)}


def joints_of_table(
    table: Table, names: Mapping[str, JointName], form: str, options: ReadOptions, *, may_be_mirrored: bool = False
) -> JointPositions:
    """Return the joint centres of the hand of the options, else of the one with more columns, whose meanings are given.

    Raises TrajectoryError for no joints, no such hand, or a missing one of the 21 joints.
    """
    hands = joint_columns(names)
    if not hands:
        raise TrajectoryError("no columns named after the joints of a hand, such as left_index_tip_x")
    side, findings = chosen_side({side: len(located(joints)) for side, joints in hands.items()}, options.hand)
    joints = hands[side]
    what = recognised(located(joints), side)
    findings = [*map(note, table.notes), *findings]

    def numbers(*columns: str) -> FloatArray:
        values, broken = table.numbers(columns)
        findings.extend(unreadable(broken, f" of {columns[0]} and its like"))
        return values

    stamps = time_column(column for column in table.header if column not in names or not names[column].joint)
    if stamps is not None and stamps.others:
        findings.append(note(f"stamps from column '{stamps.name}'; there are also {', '.join(stamps.others[:3])}"))
    arrays, moved = table_arrays(table, findings)
    parts_used = {column for parts in joints.values() for column in parts.values()}
    of_hand = {
        column: name.part
        for column in table.header
        if column not in parts_used and (name := hand_statement(column)) and name.side in ("", side)
    }
    stamped = {*stamps.names, *stamps.others} if stamps is not None else set()
    others = {column for column, name in names.items() if name.joint and name.side in hands and name.side != side}
    findings += unused(dict.fromkeys(table.header), parts_used | moved | stamped | others | of_hand.keys())

    def stated(columns: list[str]) -> FloatArray:
        """Return the statements in columns, shape (T, n), NaN for a column "" that there is not."""
        missing = [np.nan] * len(table.rows)
        return np.array([[*map(stated_value, table.text(column))] if column else missing for column in columns]).T

    validity: dict[str, FloatArray] = {}
    for kind in dict.fromkeys(VALIDITY_WORDS.values()):
        columns = [joints[joint].get(kind, "") for joint in KEYPOINTS]
        whole = [column for column, part in of_hand.items() if part == kind]
        if any(columns) or whole:
            validity[kind] = reduce(np.fmin, [stated(each) for each in (columns, *([name] for name in whole))])
    has_radii = all("radius" in joints[joint] for joint in KEYPOINTS)
    return JointPositions(
        position=np.stack([numbers(*(joints[joint][axis] for axis in "xyz")) for joint in KEYPOINTS], axis=1),
        form=form,
        what=what,
        time=None if stamps is None else stamps.stamps(lambda name: numbers(name)[:, 0]),
        time_unit=None if stamps is None else stamps.unit,
        hand=side,
        up="y" if located(joints) & WORLD_JOINTS else None,
        may_be_mirrored=may_be_mirrored,
        radius=numbers(*(joints[joint]["radius"] for joint in KEYPOINTS)) if has_radii else None,
        validity=validity,
        object_poses=poses_in(arrays, len(table.rows), options),
        findings=tuple(findings),
    )


def joint_edits(
    text: str, table: Table, names: Mapping[str, JointName], options: ReadOptions, made: Changes
) -> Iterator[NumberEdit]:
    """Return the edits of a table's text for a correction of the hand that `joints_of_table` reads.

    Joints beyond the 21 move with the palm; orientations turn with their bone. Raises InputError for orientations that
    are no quaternions.
    """
    hands = joint_columns(names)
    side, _ = chosen_side({side: len(located(joints)) for side, joints in hands.items()}, options.hand)
    columns: dict[str, NewColumn] = {}

    def put(cells: list[str], values: FloatArray, digits: int) -> None:
        columns.update({cell: NewColumn(column, digits) for cell, column in zip(cells, values.T)})

    for joint in located(hands[side]):
        places = [hands[side][joint][axis] for axis in "xyz"]
        put(places, made.moved(joint, table.numbers(places)[0][made.rows]), made.digits)
    # Columns of each joint's orientation by the last letter of their names.
    orientations: dict[str, dict[str, str]] = {}
    for column, name in names.items():
        if name.joint and name.side == side and name.part == "rotation":
            orientations.setdefault(name.joint, {})[column.strip().lower()[-1:]] = column
    for joint, turns in orientations.items():
        cells = [turns.get(part, "") for part in "wxyz"]
        if not all(cells) or len(turns) > 4:
            known = ", ".join(turns.values())
            raise InputError(f"the orientation of {joint} is {known}: no quaternion, so it cannot be corrected")
        put(cells, made.turned(joint, table.numbers(cells)[0][made.rows]), ANGLE_DIGITS)
    return cell_edits(text, table, made.rows.tolist(), columns)


def table_of_joints(motion: HandMotion, names: Sequence[str], points: FloatArray) -> bytes:
    """Return a new table of stamps [s] and of points, shape (T, n, 3), whose columns begin with the side and a name."""
    header = ["time_s", *(f"{motion.side}_{name}_{axis}" for name in names for axis in "xyz")]
    rows = np.column_stack([motion.time, points.reshape(len(points), -1)]).tolist()
    return format_table({}, header, (list(map(repr, row)) for row in rows)).encode()
