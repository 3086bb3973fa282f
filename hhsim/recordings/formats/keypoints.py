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
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.npz_arrays import array_names, numbers, read_npy, read_npz
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.csv_table import lacks_names, read_header, read_table
from hhsim.recordings.joint_names import KEYPOINTS, joint_name
from hhsim.recordings.joint_positions import JointPositions, chosen_side, recording_of_joints, sample_times
from hhsim.recordings.json_document import keys_of, number, read_json, vector
from hhsim.recordings.recording import Finding, Recording, note
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat
from hhsim.recordings.unit_detection import time_column
from hhsim.system.counted import counted

COUNT = len(KEYPOINTS)
SHAPES = f"(T, {COUNT}, 3) or (T, {3 * COUNT})"
COORDINATES = tuple(f"{axis}{k}" for k in range(COUNT) for axis in "xyz")
NAMES = ("keypoints", "landmarks", "joints", "hand_keypoints", "hand_landmarks", "kp3d", "joints_3d")
TIMES = ("t", "time", "times", "timestamp", "timestamps")
NUMBERED = re.compile(r"(?:^|[^0-9a-zA-Z])(?:[a-zA-Z]*?)([0-9]{1,2})[^0-9a-zA-Z]*([xyz])$", re.IGNORECASE)
PLAIN = re.compile(r"^([xyz])[_ ]?([0-9]{1,2})$", re.IGNORECASE)
LISTS = re.compile(r'"[a-zA-Z_]*(landmarks|keypoints)[a-zA-Z_]*"', re.IGNORECASE)
DEEPEST = 6
FEWEST_NAMED = 4
"""Number of joints in the names of columns that mark another format."""
NPY = b"\x93NUMPY"


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the only one; raises TrajectoryError."""
    findings: list[Finding] = []
    side: HandSide = ""
    zipped = content.head.startswith(b"PK")
    if content.head.startswith(NPY):
        points, time, unit = _points(read_npy(content.data), "the array"), None, None
    elif zipped:
        points, time, unit = _from_npz(content.data)
    elif content.beginning.lstrip()[:1] in ("{", "["):
        points, time, unit, side = _from_json(read_json(content.text), options.hand, findings)
    else:
        points, time, unit, side = _from_table(content, options.hand, findings)
    time, in_seconds, remarks = sample_times(time, unit, len(points), options)
    joints = JointPositions(
        time=time,
        position=points,
        form="keypoints",
        hand=side or options.hand,
        time_stated=in_seconds,
        findings=(*findings, *remarks, note("21 keypoints in MediaPipe's order: wrist, thumb to little finger")),
    )
    return recording_of_joints(joints, content.name, options).changed(checksums="held" if zipped else "")


def _points(array: Any, where: str) -> FloatArray:
    """Return an array as points, shape (T, 21, 3)."""
    try:
        values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise TrajectoryError(f"{where} does not hold numbers; expected {SHAPES}") from None
    if not _is_points(values):
        raise TrajectoryError(f"{where} has shape {values.shape}; expected {SHAPES}")
    return values.reshape(-1, COUNT, 3)


def _from_npz(data: bytes) -> tuple[FloatArray, FloatArray | None, str | None]:
    arrays = read_npz(data)
    if not arrays:
        files = ", ".join(sorted(array_names(data))[:4]) or "nothing"
        raise TrajectoryError(f"a zip archive of {files}, without an array; expected .npz, or the recording unpacked")
    fitting = [key for key, value in arrays.items() if _is_points(value)]
    named = [key for key in fitting if key in NAMES] or fitting
    if len(named) != 1:
        held = ", ".join(f"{key} {np.shape(value)}" for key, value in list(arrays.items())[:6])
        reason = "more than one" if named else "no"
        raise TrajectoryError(f"{reason} array of shape {SHAPES}; it holds {held}")
    points = _points(arrays[named[0]], f"array '{named[0]}'")
    key = next((key for key in arrays if key in TIMES or time_column([key]) is not None), None)
    if key is None:
        return points, None, None
    column = time_column([key])
    return points, numbers(arrays, key, len(points)), column.unit if column is not None else None


def _is_points(value: Any) -> bool:
    return np.shape(value)[1:] in ((COUNT, 3), (3 * COUNT,))


def _from_json(
    document: Any, wanted: HandSide, findings: list[Finding]
) -> tuple[FloatArray, FloatArray | None, str | None, HandSide]:
    frames = document
    if isinstance(document, dict):
        lists = [value for value in document.values() if isinstance(value, list)]
        frames = max(lists, key=len, default=None)
    if not isinstance(frames, list) or not frames:
        raise TrajectoryError(f"JSON that is {keys_of(document)}; expected a list of frames of {COUNT} points")
    if all(isinstance(frame, int | float) for frame in frames[:3]):
        raise TrajectoryError(f"JSON that is {keys_of(document)}; expected frames of {COUNT} points each")
    hands: list[dict[HandSide, list[list[float]]]] = [dict(_hands(frame, "", 0)) for frame in frames]
    seen = Counter(side for hand in hands for side in hand)
    if not seen:
        raise TrajectoryError(f"{len(frames)} frames, but no list of {COUNT} points in any")
    side, remarks = chosen_side(seen, wanted)
    findings += remarks
    if seen[side] < len(frames):
        findings.append(note(f"{len(frames) - seen[side]} of {len(frames)} frames show no such hand: no samples"))
    shown = [k for k, hand in enumerate(hands) if side in hand]
    points = np.array([hands[k][side] for k in shown])
    columns = [time_column(frames[k]) if isinstance(frames[k], dict) else None for k in shown]
    if all(column is None for column in columns):
        return points, None, None, side
    time = np.array([number(frames[k].get(c.name)) if c is not None else np.nan for k, c in zip(shown, columns)])
    return points, time, next((c.unit for c in columns if c is not None), None), side


def _hands(node: Any, side: HandSide, depth: int) -> Iterator[tuple[HandSide, list[list[float]]]]:
    """Yield lists of 21 points in a frame, each with the side of the nearest key or value around it."""
    if depth > DEEPEST:
        return
    if isinstance(node, dict):
        said = node.get("handedness", node.get("hand"))
        if isinstance(said, str) and said.lower() in ("right", "left"):
            side = "right" if said.lower() == "right" else "left"
        for key, value in node.items():
            yield from _hands(value, joint_name(str(key)).side or side, depth + 1)
    elif isinstance(node, list):
        if len(node) == COUNT and all(isinstance(point, list | dict) for point in node):
            yield side, [vector(point) for point in node]
        elif len(node) == 3 * COUNT and all(isinstance(value, int | float) for value in node):
            flat = [number(value) for value in node]
            yield side, [flat[k : k + 3] for k in range(0, 3 * COUNT, 3)]
        else:
            for value in node[: 2 * COUNT]:
                yield from _hands(value, side, depth + 1)


def _numbered(name: str) -> tuple[HandSide, int] | None:
    """Return side and place among 63 of a column such as left_lm05_y, y5 or 5_y; None for another."""
    plain = PLAIN.match(name.strip())
    found = plain or NUMBERED.search(name.strip())
    if found is None:
        return None
    digits, axis = (found.group(2), found.group(1)) if plain else (found.group(1), found.group(2))
    if int(digits) >= COUNT:
        return None
    return joint_name(name).side, 3 * int(digits) + "xyz".index(axis.lower())


def _numbered_columns(header: tuple[str, ...]) -> dict[HandSide, dict[int, str]]:
    hands: dict[HandSide, dict[int, str]] = {}
    for name in header:
        place = _numbered(name)
        if place is not None:
            hands.setdefault(place[0], {}).setdefault(place[1], name)
    return {side: columns for side, columns in hands.items() if len(columns) == 3 * COUNT}


def _from_table(
    content: Content, wanted: HandSide, findings: list[Finding]
) -> tuple[FloatArray, FloatArray | None, str | None, HandSide]:
    header = read_header(content.text)
    bare = len(header) == len(COORDINATES) and lacks_names(header)
    table = read_table(content.text, names=COORDINATES if bare else None)
    if bare:
        findings.append(note("no header line: the first line is a sample"))
    findings += table.findings
    hands = _numbered_columns(table.header)
    side: HandSide = ""
    stamps = time_column(name for name in table.header if _numbered(name) is None)
    if hands:
        side, remarks = chosen_side(dict.fromkeys(hands, 1), wanted)
        findings += remarks
        names = [hands[side][k] for k in range(3 * COUNT)]
    else:
        names = [name for name in table.header if stamps is None or name not in (stamps.name, *stamps.others)]
        if len(names) != 3 * COUNT:
            given = f"{len(names)} columns{' and a time' if stamps else ''}"
            raise TrajectoryError(f"{given}; expected {3 * COUNT} coordinates of {COUNT} points")
        findings.append(note(f"{3 * COUNT} columns without numbered names: taken as x, y, z of each point in turn"))
    values, broken = table.numbers(names)
    if broken:
        findings.append(note(f"{counted(broken, 'cell')} without a number: taken as missing"))
    time = None if stamps is None else table.numbers([stamps.name])[0][:, 0]
    return values.reshape(-1, COUNT, 3), time, stamps.unit if stamps is not None else None, side


def _sniff(content: Content, options: ReadOptions) -> bool:
    if content.head.startswith(NPY):
        return True
    if content.head.startswith(b"PK"):
        names = array_names(content.data)
        return bool(names) and not names & {"wrist_pos", "flex", "poses", "pose", "hand_pose", "mano_pose"}
    text = content.beginning.lstrip()
    if text[:1] in ("{", "["):
        return LISTS.search(text) is not None or re.match(r"\[\s*\[\s*(\[\s*)?-?[0-9]", text) is not None
    if options.columns is not None or not content.is_text:
        return False
    try:
        header = read_header(content.text)
    except (TrajectoryError, InputError):
        return False
    said = map(joint_name, header)
    if len({name.joint for name in said if name.joint and name.part in ("x", "y", "z")}) >= FEWEST_NAMED:
        # Columns named after joints may stand in any order: format openxr.
        return False
    others = len(header) - 3 * COUNT
    return bool(_numbered_columns(header)) or (others == 0 or (others == 1 and time_column(header) is not None))


FORMAT = RecordingFormat(
    "keypoints", "21 keypoints in MediaPipe's order as bare numbers", (".npy", ".npz", ".csv", ".json"), _sniff, _read
)
