"""JSON of any maker, one document or one a line: its numbers as arrays; values that are no numbers become NaN.

Hand poses as HOT3D has them are an object a line: a stamp [ns], and of each hand the wrist's pose and numbers,
`{"timestamp_ns": …, "hand_poses": {"0": {"wrist_xform": {"t_xyz": […], "q_wxyz": […]}, "joint_angles": […]}}}`; hand 0
is the left one, 1 the right. UmeTrack's numbers are `joint_angles`, MANO's `pose`, with the shape in `betas`.
"""

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.joint_names import VALIDITY_WORDS, joint_name, side_in, stated_value
from hhsim.recordings.recording import Finding, frames_with_hand, note, unused

MOST = 1e20
"""Largest magnitude of a reading: nanoseconds since 1970 are less."""
SHOWN_KEYS = 6
ROWS = "rows"
"""Name of an array or a list that has none."""
LABELS = ("name", "joint", "jointName", "joint_name", "id")
"""Keys of the name of an object in a list."""
COUNTS = (21, 25, 26)
"""Numbers of joints in a row without names."""
FEWEST = 8
"""Number of joints among the objects of a list that make it a hand."""
DEEPEST = 12
"""Deepest nesting of a value in a frame."""
MOST_ENTRIES = 64
"""Number of entries of a list that are searched for hands."""
Leaf = tuple[HandSide, str, FloatArray]
"""Numbers in a document: side of the hand, name, and values."""


def read_json(text: str) -> Any:
    """Return the document, or a list of the documents of its lines; raise TrajectoryError with the place of a fault."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = str(error)
    documents = []
    # Other signs that end a line may stand in a string.
    lines = text.replace("\r", "\n").split("\n")
    for place, line in enumerate((line for line in lines if line.strip()), start=1):
        try:
            documents.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            # Of a text whose first line alone is none, the whole is one document.
            where, reason = (f"line {place} is ", str(error)) if place > 1 else ("", reason)
            raise TrajectoryError(f"{where}not JSON: {reason[:120]}; was the file cut short?") from None
    return documents


def nested(value: Any) -> dict[str, Any]:
    """Return the object that an array of one JSON text holds; empty for anything else."""
    try:
        found = json.loads(str(value)) if np.ndim(value) == 0 and str(value)[:1] == "{" else {}
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def number(value: Any) -> float:
    """Return a number as float, NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return float("nan")
    # Beyond that it is damage, and what is computed from it overflows.
    return float(value) if -MOST <= value <= MOST else float("nan")


def vector(value: Any, names: str = "xyz") -> list[float]:
    """Return the numbers of a list as long as `names`, or of an object with these keys, NaN for missing ones."""
    if isinstance(value, dict):
        return [number(value.get(name)) for name in names]
    if not isinstance(value, list) or len(value) != len(names):
        return [float("nan")] * len(names)
    return [number(item) for item in value]


def objects(node: Any) -> Iterator[dict[str, Any]]:
    """Yield the objects of a list; none of anything else."""
    if isinstance(node, list):
        yield from (item for item in node if isinstance(item, dict))


def keys_of(document: Any) -> str:
    """Describe the content of a document, for messages."""
    if isinstance(document, dict):
        names = [str(key)[:24] for key in document]
        more = ", …" if len(names) > SHOWN_KEYS else ""
        return f"an object with {', '.join(names[:SHOWN_KEYS]) or 'nothing'}{more}"
    if isinstance(document, list):
        return f"a list of {len(document)}, the first {keys_of(document[0])}" if document else "an empty list"
    return repr(document)[:40]


def joints_in(shape: tuple[int, ...]) -> int:
    """Return the number of joints in points, or in matrices, of this shape; 0 for another one."""
    return next((n for n in COUNTS if shape in ((n, 3), (3 * n,), (n, 16), (n, 4, 4), (16 * n,))), 0)


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
    if len(node) in COUNTS:
        given = [list(leaves(entry, "joint")) for entry in node]
        found = [[v for _, key, v in each if is_place(v) and joint_name(key).part != "rotation"] for each in given]
        places = np.array([place_in(each[0]) if each else np.full(3, np.nan) for each in found])
        if np.isfinite(places).all(axis=1).any():
            yield side, name, places
            scalars = [{key: float(v) for _, key, v in each if v.ndim == 0} for each in given]
            for key in dict.fromkeys(key for each in scalars for key in each):
                yield side, key.replace("joint", name, 1), np.array([each.get(key, np.nan) for each in scalars])
            return
    for entry in node[:MOST_ENTRIES]:
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


HANDS: dict[str, HandSide] = {"0": "left", "1": "right"}
MOST_NUMBERS = 256
SAME_MOMENT = 1e6
"""Largest time between stamps of one moment, of two cameras [ns]."""


class PoseLines(NamedTuple):
    """Poses of one hand; missing numbers are NaN."""

    hand: HandSide
    stamps: FloatArray  # stamps [ns], shape (T,)
    translation: FloatArray  # of the wrist [m], world, shape (T, 3)
    orientation: FloatArray  # its unit quaternion (w, x, y, z), shape (T, 4)
    numbers: FloatArray  # numbers under the key, shape (T, N)
    betas: FloatArray  # shape of the hand, of the first sample that has it; empty for none
    findings: list[Finding]
    rows: list[int]  # line of each sample, shape (T,)


def read_pose_lines(document: Any, key: str, wanted: HandSide) -> PoseLines:
    """Read the poses, under a key, of the wanted hand, or for "" of the one in more lines (of equals the right one).

    The document is as of `read_json`. Raises TrajectoryError for other content, or no such hand in it.
    """
    lines = list(objects(document if isinstance(document, list) else [document]))
    frames: list[dict[HandSide, dict[str, Any]]] = []
    for line in lines:
        poses = line["hand_poses"] if isinstance(line.get("hand_poses"), dict) else {}
        given = {side: pose for index, side in HANDS.items() if isinstance(pose := poses.get(index), dict)}
        frames.append({side: pose for side, pose in given.items() if isinstance(pose.get(key), list)})
    if not any(frames):
        raise TrajectoryError(f"no hand_poses with {key} in JSON that is {keys_of(document)}")
    side, shown, findings = frames_with_hand(frames, wanted)
    findings += unused(dict.fromkeys(key for line in lines for key in line), ("timestamp_ns", "hand_poses"))
    stamps, rows = [number(line.get("timestamp_ns")) for line in lines], shown[:1]
    for row in shown[1:]:
        if not 0.0 < stamps[row] - stamps[rows[-1]] < SAME_MOMENT:
            rows.append(row)
    if len(rows) < len(shown):
        same = f"{len(shown) - len(rows)} of {len(shown)} poses are of the moment of the one before"
        findings.append(note(f"{same}, as of a second camera: no samples"))
    kept = [frames[row][side] for row in rows]
    wide = max(len(pose[key]) for pose in kept)
    if wide > MOST_NUMBERS:
        raise TrajectoryError(f"{wide} numbers a pose; expected those of a hand")
    wrists = [pose["wrist_xform"] if isinstance(pose.get("wrist_xform"), dict) else {} for pose in kept]
    turns = _rows([wrist.get("q_wxyz") for wrist in wrists], 4)
    with np.errstate(invalid="ignore", divide="ignore"):
        turns = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    shape: list[Any] = next((pose["betas"] for pose in kept if isinstance(pose.get("betas"), list)), [])
    return PoseLines(
        hand=side,
        stamps=np.array(stamps)[rows],
        translation=_rows([wrist.get("t_xyz") for wrist in wrists], 3),
        orientation=turns,
        numbers=_rows([pose[key] for pose in kept], wide),
        betas=np.array([number(value) for value in shape[:MOST_NUMBERS]]),
        findings=findings,
        rows=rows,
    )


def _rows(values: list[Any], width: int) -> FloatArray:
    whole = [value if isinstance(value, list) and len(value) == width else [None] * width for value in values]
    return np.array([[number(item) for item in value] for value in whole])
