"""JSON of any maker, one document or one a line: its numbers as arrays; values that are no numbers become NaN."""

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.joint_names import VALIDITY_WORDS, joint_name, side_in, stated_value

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


def leaves(
    node: Any, name: str = "", side: HandSide = "", depth: int = 0
) -> Iterator[tuple[HandSide, str, FloatArray]]:
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
        found = [[p for _, key, v in each if (p := _place(key, v)) is not None] for each in given]
        places = np.array([each[0] if each else np.full(3, np.nan) for each in found])
        if np.isfinite(places).all(axis=1).any():
            yield side, name, places
            scalars = [{key: float(v) for _, key, v in each if v.ndim == 0} for each in given]
            for key in dict.fromkeys(key for each in scalars for key in each):
                yield side, key.replace("joint", name, 1), np.array([each.get(key, np.nan) for each in scalars])
            return
    for entry in node[:MOST_ENTRIES]:
        yield from leaves(entry, name, side, depth + 1)


def _place(key: str, values: FloatArray) -> FloatArray | None:
    return None if joint_name(key).part == "rotation" or values.shape not in ((3,), (16,), (4, 4)) else place_in(values)


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
