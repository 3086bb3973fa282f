"""Joint centres of a hand among the columns of a table, the frames of JSON, or named arrays.

Joints have names, or stand in rows of points: 21 in MediaPipe's order, 25 in WebXR's, or in another one that is stated.
An order that is not stated is refused where the bones are none of a hand, or change their lengths.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import reduce
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.csv_table import Table
from hhsim.motion.npz_arrays import numbers
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.content import MOST, ROWS, Content, ReadOptions, keys_of, number, objects, vector
from hhsim.recordings.finger_ik import usual_hand
from hhsim.recordings.joint_names import (
    KEYPOINTS,
    MANO_JOINTS,
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
from hhsim.recordings.joint_positions import TINY, JointPositions
from hhsim.recordings.object_poses import poses_in, table_arrays
from hhsim.recordings.unit_detection import time_column

T = TypeVar("T")
Hands = dict[HandSide, dict[str, dict[str, T]]]
"""What hands have, by side, joint and part: the name of a joint's part, "" for its whole place."""
KINDS = tuple(dict.fromkeys(VALIDITY_WORDS.values()))
WORLD_JOINTS = {"palm", *(f"{finger}_metacarpal" for finger in FINGERS[1:])}
"""Joints that OpenXR and WebXR alone have, whose world has y up."""
RADII = ("radius", "radii", "joint_radius", "joint_radii")
"""Names of an array of the joints' radii, in the unit and the order of the points."""
STAMPED = ("header", "stamp", "timestamp", "time")
"""Keys of objects that hold a stamp."""
SEARCHED = 64
"""Number of frames, or of entries of a list, that are searched for hands."""
LABELS = ("name", "joint", "jointName", "joint_name", "id")
"""Keys of the name of an object in a list."""
FEWEST = 8
"""Number of joints among the objects of a list that make it a hand."""
DEEPEST = 12
"""Deepest nesting of a value in a frame."""
Leaf = tuple[HandSide, str, FloatArray]
"""Numbers in a document: side of the hand, name, and values."""

ORDERS: dict[int, dict[str, tuple[str, ...]]] = {
    21: {"mediapipe": KEYPOINTS, "mano": MANO_JOINTS, "smplx": MANO_JOINTS},
    25: {"openxr": WEBXR_JOINTS},
    26: {"openxr": OPENXR_JOINTS, "unity": UNITY_JOINTS},
}
"""Known orders of the joints of a row by their number, and by the words of `--joint-order`."""
USUAL_ORDER = {21: "mediapipe", 25: "openxr"}
"""Orders that need not be stated; those of 26 joints differ in wrist and palm alone, which their bones hardly tell."""
PROPORTIONS = (0.4, 2.5)
"""Shortest and longest bone of a hand by the usual one's, as shares of all bones."""
MOST_CHANGE = 0.05
"""Largest usual change of a bone's share of all bones: noise of 10 mm makes it 0.03."""
MOST_JUDGED = 1000
"""Number of samples, evenly over the recording, that are enough to tell the order of the joints."""


def named_hands(named: Iterable[tuple[JointName, T]]) -> Hands[T]:
    """Return what each hand has that has a joint with a place, of two of a kind the first."""
    found: Hands[T] = {}
    for name, value in named:
        if name.joint and name.part in ("", "x", "y", "z", "radius", *KINDS):
            found.setdefault(name.side, {}).setdefault(name.joint, {}).setdefault(name.part, value)
    return {side: joints for side, joints in found.items() if located(joints)}


def located(joints: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Return the joints that have a place."""
    return {joint for joint, parts in joints.items() if "" in parts or {"x", "y", "z"} <= set(parts)}


def named_joints(
    joints: Mapping[str, Mapping[str, FloatArray]], whole: Sequence[tuple[str, FloatArray]], count: int
) -> dict[str, Any]:
    """Return fields of `JointPositions` of joints by their parts, and of statements on the whole hand by kind."""

    def part(joint: str, name: str) -> FloatArray:
        return joints.get(joint, {}).get(name, np.full(count, np.nan))

    def place(joint: str) -> FloatArray:
        given = place_in(joints.get(joint, {}).get("", np.zeros(count)))
        return np.stack([part(joint, axis) for axis in "xyz"], axis=1) if given is None else given

    validity = {}
    for kind in KINDS:
        stated = [np.stack([part(joint, kind) for joint in KEYPOINTS], axis=1)]
        stated += [values.reshape(count, 1) for each, values in whole if each == kind]
        if len(stated) > 1 or np.isfinite(stated[0]).any():
            validity[kind] = reduce(np.fmin, stated)
    radius = np.stack([part(joint, "radius") for joint in KEYPOINTS], axis=1)
    has_radii = np.isfinite(radius).any(axis=0).all()
    position = np.stack([place(joint) for joint in KEYPOINTS], axis=1)
    return {"position": position, "radius": radius if has_radii else None, "validity": validity}


def joint_columns(names: Mapping[str, JointName]) -> Hands[str]:
    """Return the columns of each hand that has a joint with all three coordinates, from the meanings of columns."""
    return named_hands((name, column) for column, name in names.items() if name.part)


def columns_of_hand(
    content: Content, names: Mapping[str, JointName], options: ReadOptions
) -> tuple[HandSide, dict[str, dict[str, str]]]:
    """Return the hand of the options, else that of more columns, and its columns; error for none."""
    hands = joint_columns(names)
    if not hands:
        raise TrajectoryError("no columns named after the joints of a hand, such as left_index_tip_x")
    side = content.chosen_side({side: len(located(joints)) for side, joints in hands.items()}, options.hand)
    return side, hands[side]


def joints_of_table(
    content: Content, table: Table, names: Mapping[str, JointName], options: ReadOptions, **more: Any
) -> JointPositions:
    """Return the joint centres in a table, whose columns have these meanings, with more fields of `JointPositions`.

    It is the hand of the options, else the one with more columns. Raises TrajectoryError for no joints, no such hand,
    or a missing one of the 21 joints.
    """
    content.note(*table.notes)
    side, joints = columns_of_hand(content, names, options)
    what = recognised(located(joints), side)

    def cells(*columns: str) -> FloatArray:
        return content.numbers(table, columns)

    def stated(column: str) -> FloatArray:
        return np.array([*map(stated_value, table.text(column))])

    stamps = time_column(column for column in table.header if column not in names or not names[column].joint)
    if stamps.others:
        content.note(f"stamps from column '{stamps.name}'; there are also {', '.join(stamps.others[:3])}")
    arrays, moved = table_arrays(content, table)
    used = {column for parts in joints.values() for column in parts.values()}
    said = {column: name for column in table.header if column not in used and (name := hand_statement(column))}
    whole = {column: name.part for column, name in said.items() if name.side in ("", side)}
    others = {
        column
        for column, name in names.items()
        if name.joint and name.side in joint_columns(names) and name.side != side
    }
    used |= {*stamps.names, *stamps.others, *whole}
    content.unused(dict.fromkeys(table.header), used | moved | others)
    measured = [column for j in KEYPOINTS for part, column in joints[j].items() if part in ("x", "y", "z", "radius")]
    held = dict(zip(measured, cells(*measured).T))
    parts = {
        joint: {part: held[column] if column in held else stated(column) for part, column in joints[joint].items()}
        for joint in KEYPOINTS
    }
    fields = named_joints(parts, [(kind, stated(column)) for column, kind in whole.items()], len(table.rows))
    return JointPositions(
        **{"up": "y" if located(joints) & WORLD_JOINTS else None, "what": what} | fields | more,
        time=stamps.stamps(lambda name: cells(name)[:, 0]),
        time_unit=stamps.unit,
        hand=side,
        object_poses=poses_in(arrays, len(table.rows), options),
    )


def joints_in(shape: tuple[int, ...]) -> int:
    """Return the number of joints in points, or in matrices, of this shape; 0 for another one."""
    return next((n for n in ORDERS if shape in ((n, 3), (3 * n,), (n, 16), (n, 4, 4), (16 * n,))), 0)


def is_place(values: FloatArray) -> bool:
    """Return True for a point or a matrix."""
    return values.shape in ((3,), (16,), (4, 4))


def place_in(values: FloatArray) -> FloatArray | None:
    """Return the points, or the translations of matrices, of an array with this last shape, (…, 3); None for others.

    16 numbers are a matrix column by column, as WebXR has them, or row by row.
    """
    if values.shape[-1:] == (16,):
        by_columns = (values[..., 3:16:4] == [0.0, 0.0, 0.0, 1.0]).all(axis=-1, keepdims=True)
        return np.where(by_columns, values[..., 12:15], values[..., 3:12:4])
    if values.shape[-2:] == (4, 4):
        return values[..., :3, 3]
    return values if values.shape[-1:] == (3,) else None


def leaves(node: Any, name: str = "", side: HandSide = "", depth: int = 0) -> Iterator[Leaf]:
    """Yield the numbers in JSON by the keys above them, and the side that the nearest object states; "" for none.

    x, y, z, with w or without it, are one value, and so is a list of numbers. Of objects in a list those that name
    their joint have its name, 21, 25 or 26 others are points; else the first that has a name counts.
    """
    if depth > DEEPEST:
        return
    if isinstance(node, dict) and "0" in node and all(str(k) == key for k, key in enumerate(node)):
        # A typed array of JavaScript, such as that of fillPoses.
        node = list(node.values())
    if isinstance(node, dict):
        side = side_in(node) or side
        whole = {"x", "y", "z"} <= node.keys() and name != ""
        if whole and "w" in node:
            yield side, f"{name}_wxyz", np.array(vector(node, "wxyz"))
        elif whole and joint_name(name).part != "rotation":
            yield side, name, np.array(vector(node))
        for key, value in node.items():
            if not (whole and key in "xyzw"):
                yield from leaves(value, f"{name}.{key}" if name else str(key), side, depth + 1)
    elif isinstance(node, list):
        yield from _of_list(node, name, side, depth)
    else:
        value = stated_value(node) if joint_name(name).part in VALIDITY_WORDS.values() else number(node)
        if value == value:
            yield side, name, np.array(value)


def _of_list(node: list[Any], name: str, side: HandSide, depth: int) -> Iterator[Leaf]:
    """Yield the numbers in a list as `leaves` does."""
    labels = [str(next((entry[key] for key in LABELS if key in entry), "")) for entry in objects(node)]
    if sum(bool(joint_name(label).joint) for label in labels) >= FEWEST:
        for label, entry in zip(labels, objects(node)):
            yield from leaves(entry, f"{name}.{label}", side, depth + 1)
        return
    with suppress(TypeError, ValueError, OverflowError):
        values = np.array(node, dtype=np.float64)
        while values.ndim > 1 and not joints_in(values.shape) and joints_in(values.shape[1:]):
            values = values[0]
        yield side, name, values
        return
    if len(node) in ORDERS:
        given = [list(leaves(entry, "joint")) for entry in node]
        found = [[v for _, key, v in each if is_place(v) and joint_name(key).part != "rotation"] for each in given]
        places = np.array([place_in(each[0]) if each else np.full(3, np.nan) for each in found])
        if np.isfinite(places).all(axis=1).any():
            yield side, name, places
            scalars = [{key: float(v) for _, key, v in each if v.ndim == 0} for each in given]
            for key in dict.fromkeys(key for each in scalars for key in each):
                yield side, key.replace("joint", name, 1), np.array([each.get(key, np.nan) for each in scalars])
            return
    for entry in node[:SEARCHED]:
        yield from leaves(entry, name, side, depth + 1)


def frame_arrays(frames: Sequence[Any]) -> dict[tuple[HandSide, str], FloatArray]:
    """Return the numbers of frames by side and name, as `leaves` yields them, a row a frame, NaN where missing.

    A frame that is no object has its numbers under `ROWS`. Of values of several shapes the largest count.
    """
    rows: list[dict[tuple[HandSide, str], FloatArray]] = []
    for frame in frames:
        rows.append({})
        for side, name, values in leaves(frame if isinstance(frame, dict) else {ROWS: frame}):
            rows[-1].setdefault((side, name), values)
    arrays = {}
    for key in dict.fromkeys(key for row in rows for key in row):
        shape = max((row[key].shape for row in rows if key in row), key=math.prod)
        arrays[key] = np.full((len(rows), *shape), np.nan)
        for k, row in enumerate(rows):
            if key in row and row[key].shape == shape:
                arrays[key][k] = row[key]
        # Beyond that it is damage, and what is computed from it overflows.
        arrays[key][~(np.abs(arrays[key]) <= MOST)] = np.nan
    return arrays


def frames_in(document: Any) -> tuple[list[Any], dict[str, Any]]:
    """Return the frames of a document, and its values beside them; raise TrajectoryError if there are no frames."""
    frames, beside = document, {}
    if isinstance(document, dict):
        lists = [v for v in document.values() if isinstance(v, list) and any(isinstance(e, dict | list) for e in v)]
        # An object's poses are as many.
        frames = max(lists, key=lambda each: (any(map(_shows_hand, each[:SEARCHED])), len(each)), default=[])
        beside = {key: value for key, value in document.items() if value is not frames}
    if not isinstance(frames, list) or not frames:
        raise TrajectoryError(f"no frames in JSON that is {keys_of(document)}; expected a list of frames with joints")
    return frames, beside


def _shows_hand(frame: Any) -> bool:
    found = list(leaves(frame, "frame"))
    places = [name for _, name, values in found if joint_name(name).joint and is_place(values)]
    return len(places) >= len(FINGERS) or any(joints_in(values.shape) for _, _, values in found)


def listed_joints(content: Content) -> int:
    """Return the number of joints of the first hand that is a list without names in a document; 0 for none."""
    try:
        if not content.is_json:
            return 0
        frames, _ = frames_in(content.document)
    except TrajectoryError:
        return 0
    found = (joints_in(values.shape) for frame in frames[:SEARCHED] for _, _, values in leaves(frame, "frame"))
    return next((count for count in found if count), 0)


def joints_of_frames(
    content: Content, options: ReadOptions, frames: Sequence[Any], beside: Mapping[str, Any], **more: Any
) -> JointPositions:
    """Return the joint centres of the hand of the options, else of the one in more frames, and the object's poses.

    `beside` has the values of the file beside its frames, one a frame or a single one; there may be more fields of
    `JointPositions`. Raises TrajectoryError for no such hand, one of the 21 joints in no frame, or an object's pose
    that is none.
    """
    arrays, count, held = frame_arrays(frames), len(frames), dict[str, FloatArray]()
    # What stands beside the hands counts whichever hand its frame states.
    for (_, name), values in arrays.items():
        known = held.setdefault(name, values)
        held[name] = np.where(np.isnan(known), values, known) if known.shape == values.shape else known
    meanings = {key: joint_name(key[1]) for key in arrays}
    meanings = {key: name._replace(side=name.side or key[0]) for key, name in meanings.items()}
    hands = named_hands((meanings[key], v) for key, v in arrays.items() if meanings[key].part or is_place(v[0]))
    # Of hands without named joints the first rows of points, with their name.
    rows: dict[HandSide, tuple[str, FloatArray]] = {}
    for key, values in arrays.items():
        if joints_in(values.shape[1:]) and meanings[key].side not in hands:
            if values.ndim == 2:
                values = values.reshape(count, -1, 3 if values.shape[1] % 16 else 16)
            points = place_in(values)
            assert points is not None
            rows.setdefault(meanings[key].side, (key[1], points))
    places = {side: points.reshape(count, -1) for side, (_, points) in rows.items()}
    for side, joints in hands.items():
        given = [parts[axis].reshape(count, -1) for parts in joints.values() for axis in ("", "x") if axis in parts]
        places[side] = np.concatenate(given, axis=1)
    seen = {side: np.asarray(np.isfinite(values).any(axis=1)) for side, values in places.items()}
    side, shown = content.frames_with_hand([[s for s in seen if seen[s][k]] for k in range(count)], options.hand)
    poses = poses_in(held | {name: values for _, name, values in leaves(dict(beside))}, count, options)
    single = (name for name, values in held.items() if values.ndim == 1 and not joint_name(name).joint)
    stamps = time_column(name for name in single if "." not in name or name.partition(".")[0] in STAMPED)
    hand = {key[1] for key in arrays if meanings[key].joint or joints_in(arrays[key].shape[1:])}
    whole = [(key, said) for key in arrays if (said := _statement(key[1], arrays[key], hand))]
    stated = [(said.part, arrays[key]) for key, said in whole if {said.side, key[0]} <= {"", side}]
    used = {*hand, *(key[1] for key, _ in whole), *(poses.names if poses else ()), *stamps.names}
    keys = dict.fromkeys(str(key) for frame in frames if isinstance(frame, dict) for key in frame)
    content.unused(dict.fromkeys(beside) | keys, {name.split(".")[0] for name in used})
    if side in hands:
        fields = named_joints(hands[side], stated, count) | {"what": recognised(located(hands[side]), side)}
    else:
        name, points = rows[side]
        below = {key.removeprefix(f"{name}."): values for key, values in held.items() if key.startswith(f"{name}.")}
        fields, _ = joints_of_rows(points, content, options, below)
        fields["validity"] = fields.get("validity", {}) | {kind: values.reshape(count, 1) for kind, values in stated}
        if more and points.shape[1] > len(KEYPOINTS):
            # A world with y up has joints of OpenXR or WebXR, whether their names stand there or not.
            fields["what"] = recognised(ORDERS[points.shape[1]]["openxr"], side)
    found = JointPositions(
        **fields | more, time=stamps.stamps(held.__getitem__), time_unit=stamps.unit, hand=side, object_poses=poses
    )
    return found if len(shown) == count else found.chosen(shown)


def _statement(name: str, values: FloatArray, hand: Iterable[str]) -> JointName | None:
    """Return what a value says of a whole hand, whose values have these names, that it is beside; None for others."""
    above, _, last = name.rpartition(".")
    said = None if joint_name(name).joint or values.ndim != 1 else hand_statement(last)
    return said if said and any(each.startswith(above) for each in hand) else None


def joints_of_rows(
    points: FloatArray, content: Content, options: ReadOptions, beside: Mapping[str, Any] = MappingProxyType({})
) -> tuple[dict[str, Any], set[str]]:
    """Return fields of `JointPositions` for the joints of rows, shape (T, n, 3); errors as of `row_names`.

    Radii and validity are among the arrays beside them, whose names are returned, too.
    """
    names, what, misfit = row_names(points, content, options)
    count, width, order = len(points), len(names), [names.index(joint) for joint in KEYPOINTS]
    fields: dict[str, Any] = {"position": points[:, order], "what": what, "misfit": misfit}
    fields |= {"up": "y"} if set(names) >= set(WEBXR_JOINTS) else {}
    used = set()
    for name, given in beside.items():
        shape, said = np.shape(given), hand_statement(name)
        if name.rpartition("/")[2] in RADII and shape in ((width,), (count, width)):
            fields["radius"] = np.broadcast_to(numbers(beside, name), (count, width))[:, order]
        elif said and shape in ((count,), (count, 1), (count, width)):
            values = numbers(beside, name).reshape(count, -1)
            fields.setdefault("validity", {})[said.part] = values[:, order] if values.shape[1] == width else values
        else:
            continue
        used.add(name)
    return fields, used


def row_names(points: FloatArray, content: Content, options: ReadOptions) -> tuple[tuple[str, ...], str, str]:
    """Return the joints of rows, shape (T, n, 3), what they are, and what is wrong with them in a stated order, or "".

    Raises TrajectoryError if neither the options nor a field of the file state the order and there is no usual one, or
    it makes no hand of them; InputError if the options state an order of other joints.
    """
    count, word = points.shape[1], options.joint_order
    known, told = ORDERS.get(count, {}), content.stated.seen("order") or ()
    if word is not None and word not in known:
        expected = " or ".join(str(number) for number, orders in ORDERS.items() if word in orders)
        raise InputError(f"--joint-order {word}: {count} joints a sample; expected {expected}")
    if word is None and len(told) == count:
        content.stated.take("order")
        return told, f"{count} joints in the order that the file states", ""
    usual = USUAL_ORDER.get(count, "")
    ask = f"say their order, --joint-order {' or '.join(known)}, or name them in joint_names"
    if not (word or usual):
        raise TrajectoryError(f"{count} joints a sample, without names: {ask}")
    misfit = bone_misfit(points, known[word or usual])
    if misfit and word is None:
        raise TrajectoryError(f"{count} joints that are not in the order {usual}, by their bones: {misfit}; {ask}")
    what = f"{count} joints in the order {word or usual}"
    return known[word or usual], what, misfit and "in this order the bones are not those of a hand"


def bone_misfit(points: FloatArray, names: tuple[str, ...]) -> str:
    """Return how far the worst bone is off where rows of joints, (T, n, 3), are no hand in this order, else "".

    The bones' proportions are none of a hand, or they change their lengths.
    """
    whole = points[np.isfinite(points).all(axis=(1, 2)) & (np.ptp(points, axis=1) > 0.0).any(axis=1)]
    if not len(whole):
        return ""
    hand = whole[:: len(whole) // MOST_JUDGED + 1][:, [names.index(joint) for joint in KEYPOINTS]]
    ends = hand[:, 1:].reshape(-1, 5, 4, 3)
    starts = np.concatenate([np.broadcast_to(hand[:, None, None, 0], (len(hand), 5, 1, 3)), ends[:, :, :3]], axis=2)
    bones = np.linalg.norm(ends - starts, axis=3).reshape(-1, 20)
    # Shares of all bones: a tracker without scale may see the hand grow and shrink.
    total = np.maximum(bones.sum(axis=1, keepdims=True), TINY)
    share = np.median(bones / total, axis=0)
    sizes = usual_hand()
    palm = np.linalg.norm(sizes.base - sizes.wrist, axis=1, keepdims=True)
    usual = np.concatenate([palm, sizes.length], axis=1).ravel()
    ratio = np.maximum(share / max(float(share.sum()), TINY) * usual.sum() / usual, 1e-3)
    change = float(np.percentile(np.abs(bones / total - share), 90.0, axis=0).max())
    if PROPORTIONS[0] <= ratio.min() and ratio.max() <= PROPORTIONS[1] and change <= MOST_CHANGE:
        return ""
    worst = int(np.argmax(np.abs(np.log(ratio))))
    return f"the bone to {KEYPOINTS[1 + worst]} is {ratio[worst]:.2g} times a hand's, and bones change by {change:.0%}"
