"""LeRobot data sets, v2.1 and v3: one Parquet file, with meta/info.json of the data set above it.

Joint centres are a feature whose name ends in `hand_joints`: two hands, left then right, of 25 joints in WebXR's order;
y up. Other features are mapped by --columns as `feature.name`, by the names of info.json, or `feature.0` and so on.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.column_map import mapped
from hhsim.recordings.csv_table import Table
from hhsim.recordings.joint_names import KEYPOINTS, WEBXR_JOINTS
from hhsim.recordings.joint_positions import JointPositions, chosen_side, recording_of_joints
from hhsim.recordings.recording import Finding, Recording, note
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat

MAGIC = b"PAR1"
JOINTS = len(WEBXR_JOINTS)
SIDES: tuple[HandSide, HandSide] = ("left", "right")
LEVELS_UP = 4
"""Most folders from the file up to that of meta/."""
MOST_CELLS = 1 << 28
"""Largest file, rows times columns."""
MOST_BYTES = 1 << 28
"""Largest column of an episode [bytes]: half an hour of two hands at 100 Hz in doubles."""


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read one episode and hand; raises TrajectoryError, and InputError for an episode that is not there."""
    columns, checked = _columns(content.data)
    info = _info(content)
    findings: list[Finding] = []
    rows = _episode(columns, options, findings)
    time = _time(columns, rows, info, options, findings)
    if options.columns is not None:
        recording = mapped(_table(columns, rows, info), options.columns, content.name, "lerobot").found(*findings)
        return recording.changed(checksums="held" if checked else "")
    names = [name for name in columns if name.split(".")[-1] == "hand_joints"]
    named = names[0] if names else None
    width = 2 * JOINTS * 3
    values = None if named is None else _numbers(columns, named, rows)
    if values is None or values.shape[1] not in (width, width // 2):
        held = ", ".join(f"{name} ({_numbers(columns, name, rows[:1]).shape[1]})" for name in list(columns)[:6])
        what = f"{named} has {values.shape[1]} numbers" if values is not None else "no hand_joints"
        raise TrajectoryError(
            f"{what}; it holds {held}; expected hand_joints of 2 × {JOINTS} × 3, or --columns that explain the others"
        )
    if len(names) > 1:
        findings.append(note(f"joints from {named}; there is also {', '.join(names[1:3])}"))
    hands = values.reshape(len(values), -1, JOINTS, 3)
    sides: tuple[HandSide, ...] = SIDES if hands.shape[1] == 2 else ("",)
    with np.errstate(invalid="ignore", over="ignore"):
        seen = {side: int((np.ptp(hands[:, k], axis=1) > 0.0).any(axis=1).sum()) for k, side in enumerate(sides)}
    side, remarks = chosen_side(seen, options.hand)
    if len(sides) == 2:
        findings.append(note("two hands of 25 joints in WebXR's order, taken as left, then right"))
    places = [WEBXR_JOINTS.index(joint) for joint in KEYPOINTS]
    joints = JointPositions(
        time=time,
        position=hands[:, sides.index(side)][:, places],
        form="lerobot",
        hand=side,
        up="y",
        device=str(info.get("robot_type") or ""),
        findings=(*findings, *remarks),
    )
    return recording_of_joints(joints, content.name, options).changed(checksums="held" if checked else "")


def _columns(data: bytes) -> tuple[dict[str, Any], bool]:
    """Return the columns as pyarrow's lists, and whether each of their pages agreed with a checksum."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise TrajectoryError("a Parquet file: pip install pyarrow") from None
    try:
        file = parquet.ParquetFile(pyarrow.BufferReader(data), page_checksum_verification=True)
        if file.metadata.num_rows * max(file.metadata.num_columns, 1) > MOST_CELLS:
            raise TrajectoryError(f"{file.metadata.num_rows:,} rows; expected a recording of a hand")
        table = file.read()
        table.validate(full=True)
        # After the reading: asked for a column that it cannot read, the library ends the process.
        groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
        checked = all(_has_checksums(data, group.column(k)) for group in groups for k in range(group.num_columns))
        return {str(name): table.column(k) for k, name in enumerate(table.column_names)}, checked
    except TrajectoryError:
        raise
    except (pyarrow.ArrowException, OSError, ValueError, KeyError, MemoryError, OverflowError) as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise TrajectoryError(f"not a Parquet file, or a damaged one: {reason}") from None


def _has_checksums(data: bytes, chunk: Any) -> bool:
    """True if every page of a column chunk has a CRC-32 (field 4 of its header; field 3 is its size)."""
    place = min(filter(None, (chunk.dictionary_page_offset, chunk.data_page_offset)))
    end = place + chunk.total_compressed_size
    try:
        while place != end:
            header, place = _thrift_struct(data, place)
            place += header[3]
            if 4 not in header or header[3] < 0 or place > end:
                return False
    except (IndexError, KeyError, RecursionError):
        return False
    return True


def _thrift_struct(data: bytes, place: int) -> tuple[dict[int, int], int]:
    """Return the 32-bit numbers of a struct in Thrift's compact protocol by field, and its end."""
    fields: dict[int, int] = {}
    field = 0
    while head := data[place]:
        step, kind = head >> 4, head & 15
        field, place = (field + step, place + 1) if step else _zigzag(data, place + 1)
        if kind in (4, 5, 6):
            value, place = _zigzag(data, place)
            # A number of another width is skipped.
            fields |= {field: value} if kind == 5 else {}
        elif kind == 8:
            size, place = _varint(data, place)
            place += size
        elif kind == 12:
            _, place = _thrift_struct(data, place)
        else:
            # A flag is in its head; no page header has other kinds.
            place += {1: 0, 2: 0, 3: 1, 7: 8}[kind]
    return fields, place + 1


def _zigzag(data: bytes, place: int) -> tuple[int, int]:
    """Return a number with its sign in the lowest bit, and its end."""
    value, place = _varint(data, place)
    return (value >> 1) ^ -(value & 1), place


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """Return a number of seven bits a byte, at most ten bytes, and its end."""
    value = 0
    for k in range(10):
        value |= (data[place + k] & 127) << 7 * k
        if data[place + k] < 128:
            return value, place + k + 1
    raise IndexError


def _info(content: Content) -> dict[str, Any]:
    """Read meta/info.json of the data set; empty where there is none."""
    if content.path is None:
        return {}
    for folder in list(content.path.resolve().parents)[:LEVELS_UP]:
        path: Path = folder / "meta" / "info.json"
        if path.is_file():
            try:
                document = json.loads(path.read_bytes())
            except (OSError, ValueError, RecursionError):
                raise TrajectoryError(f"{path} of the data set cannot be read, or is not JSON") from None
            return document if isinstance(document, dict) else {}
    return {}


def _episode(columns: dict[str, Any], options: ReadOptions, findings: list[Finding]) -> IntArray:
    """Return the rows of the episode of the options, else of the only one."""
    if "episode_index" not in columns:
        if options.episode is not None:
            raise InputError("--episode: the file has no episode_index")
        return np.arange(len(next(iter(columns.values()), [])))
    index = _numbers(columns, "episode_index", None)[:, 0]
    episodes = sorted({int(value) for value in index[np.isfinite(index)]})
    if options.episode is None and len(episodes) > 1:
        raise TrajectoryError(f"{len(episodes)} episodes, {episodes[0]} to {episodes[-1]}; say which: --episode")
    wanted = options.episode if options.episode is not None else episodes[0] if episodes else 0
    if wanted not in episodes:
        raise InputError(f"--episode {wanted}: the file has {', '.join(map(str, episodes[:8])) or 'none'}")
    rows = np.flatnonzero(index == wanted)
    if len(episodes) > 1:
        findings.append(note(f"episode {wanted} of {len(episodes)}"))
    return rows


def _time(
    columns: dict[str, Any], rows: IntArray, info: dict[str, Any], options: ReadOptions, findings: list[Finding]
) -> FloatArray:
    if "timestamp" in columns:
        return _numbers(columns, "timestamp", rows)[:, 0]
    rate = options.rate or info.get("fps")
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0.1 <= rate <= 1e5:
        raise TrajectoryError("no column timestamp, and no fps in meta/info.json: --rate")
    findings.append(note(f"no stamps: made from the rate, {rate:g} Hz"))
    return np.arange(len(rows)) / rate


def _numbers(columns: dict[str, Any], name: str, rows: IntArray | None) -> FloatArray:
    """Return the numbers of a column, nested lists flattened, shape (T, N); NaN where missing."""
    chosen = columns[name] if rows is None else columns[name].take(rows)
    if chosen.nbytes > MOST_BYTES and "binary" not in str(chosen.type):
        raise TrajectoryError(f"{name} has {chosen.nbytes >> 20:,} MB; expected the recording of a hand")
    flat = [_flat(cell, 0) for cell in chosen.to_pylist()]
    width = max((len(row) for row in flat), default=0)
    values = np.full((len(flat), max(width, 1)), np.nan)
    for place, row in zip(values, flat):
        if len(row) == width:
            place[:] = row
    return values


def _flat(cell: Any, depth: int) -> list[float]:
    if isinstance(cell, list) and depth < 6:
        return [number for item in cell for number in _flat(item, depth + 1)]
    return [float(cell)] if isinstance(cell, int | float) and not isinstance(cell, bool) else [float("nan")]


def _table(columns: dict[str, Any], rows: IntArray, info: dict[str, Any]) -> Table:
    """Return all numbers as a table, each column named after its feature and its place in it."""
    header: list[str] = []
    parts: list[FloatArray] = []
    features = info.get("features")
    for name in columns:
        values = _numbers(columns, name, rows)
        feature = features.get(name) if isinstance(features, dict) else None
        names = _names(feature.get("names") if isinstance(feature, dict) else None)
        words = names if len(names) == values.shape[1] else [str(k) for k in range(values.shape[1])]
        header += [name] if values.shape[1] == 1 else [f"{name}.{word}" for word in words]
        parts.append(values)
    cells = np.concatenate(parts, axis=1) if parts else np.zeros((0, 0))
    return Table(tuple(header), tuple(tuple(repr(value) for value in row) for row in cells.tolist()), {}, ".", ())


def _names(value: Any) -> list[str]:
    if isinstance(value, dict):
        value = next((part for part in value.values() if isinstance(part, list)), [])
    while isinstance(value, list) and len(value) == 1 and isinstance(value[0], list):
        value = value[0]
    return [str(item) for item in value] if isinstance(value, list) else []


FORMAT = RecordingFormat(
    "lerobot",
    "a LeRobot data set's Parquet file: hand_joints, or any feature with --columns",
    (".parquet",),
    lambda content, options: content.head.startswith(MAGIC),
    _read,
    takes_columns=True,
)
