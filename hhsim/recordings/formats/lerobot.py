"""LeRobot data sets, v2.1 and v3: one Parquet file, with meta/info.json of the data set above it.

Joint centres are a feature whose name ends in `hand_joints`: two hands, left then right, of 25 joints in WebXR's order;
y up. Other features are mapped by --columns as `feature.name`, by the names of info.json, or `feature.0` and so on.
"""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.csv_table import Table
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.column_map import mapped
from hhsim.recordings.content import MOST, Content, ReadOptions, number
from hhsim.recordings.joint_arrays import bone_misfit
from hhsim.recordings.joint_names import KEYPOINTS, WEBXR_JOINTS, StatedFields, kind_of
from hhsim.recordings.object_poses import is_objects, poses_in
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import JointPositions, RecordingFormat
from hhsim.system.child_reader import read_in_child
from hhsim.system.input_file import most_unpacked

MAGIC = b"PAR1"
JOINTS = len(WEBXR_JOINTS)
LEVELS_UP = 4
"""Most folders from the file up to that of meta/."""
MOST_BYTES = 1 << 28
"""Largest column of an episode [bytes]: half an hour of two hands at 100 Hz in doubles."""


def _read(content: Content, options: ReadOptions) -> Recording | JointPositions:
    """Read one episode and hand; raises TrajectoryError, and InputError for an episode that is not there."""
    columns = _columns(content.data)
    info = _info(content)
    rows = _episode(columns, options, content)
    content.stated = StatedFields({name: cells.to_pylist() for name, cells in columns.items() if kind_of(name)})
    if options.columns is not None:
        return mapped(content, _table(columns, rows, info), options.columns, options).changed(rows=rows)
    names = [name for name in columns if name.split(".")[-1] == "hand_joints"]
    width, hands = 2 * JOINTS * 3, _numbers(columns, names[0], rows) if names else np.zeros((0, 0))
    if hands.shape[1] not in (width, width // 2):
        what = f"{names[0]} has {hands.shape[1]} numbers" if names else f"no hand_joints among {', '.join(columns)}"
        raise TrajectoryError(f"{what}; expected 2 × {JOINTS} × 3, or --columns that explain the others")
    if len(names) > 1:
        content.note(f"joints from {names[0]}; there is also {', '.join(names[1:3])}")
    points = hands.reshape(len(hands), -1, JOINTS, 3)
    sides: list[HandSide] = ["left", "right"] if points.shape[1] == 2 else [""]
    with np.errstate(invalid="ignore", over="ignore"):
        seen = (np.ptp(points, axis=2) > 0.0).any(axis=2).sum(axis=0)
    side = content.chosen_side(dict(zip(sides, seen.tolist())), options.hand)
    points = points[:, sides.index(side)]
    if misfit := bone_misfit(points, WEBXR_JOINTS):
        raise TrajectoryError(f"{JOINTS} joints that are not in WebXR's order, by their bones: {misfit}")
    places = [WEBXR_JOINTS.index(joint) for joint in KEYPOINTS]
    poses = poses_in({name: _numbers(columns, name, rows) for name in columns if is_objects(name)}, len(hands), options)
    used = {*names, "timestamp", "episode_index", *(poses.names if poses is not None else ())}
    content.unused(dict.fromkeys(columns), used)
    rate = number(info.get("fps"))
    return JointPositions(
        position=points[:, places],
        what=f"{len(sides)} × 25 joints in WebXR's order{', taken as left, then right' if len(sides) == 2 else ''}",
        time=_numbers(columns, "timestamp", rows)[:, 0] if "timestamp" in columns else None,
        time_unit="s",
        rate=rate if 0.1 <= rate <= 1e5 else None,
        hand=side,
        up="y",
        object_poses=poses,
        device=str(info.get("robot_type") or ""),
        rows=rows,
    )


def _columns(data: bytes) -> dict[str, Any]:
    """Return the columns as pyarrow's lists; pages that have a checksum agree with it."""
    import pyarrow
    from pyarrow import parquet

    def read() -> dict[str, Any]:
        file = parquet.ParquetFile(pyarrow.BufferReader(data), page_checksum_verification=True)
        table = file.read(use_threads=False)
        if table.nbytes > most_unpacked(len(data)):
            raise TrajectoryError(f"{table.nbytes:,} bytes in a file of {len(data):,}; expected a recording of a hand")
        table.validate(full=True)
        return {str(name): table.column(k) for k, name in enumerate(table.column_names)}

    return read_in_child(read, "not a Parquet file, or a damaged one", len(data))


def _info(content: Content) -> dict[str, Any]:
    """Read meta/info.json of the data set; empty where there is none."""
    if content.original is None:
        return {}
    beside = (folder / "meta" / "info.json" for folder in list(content.original.resolve().parents)[:LEVELS_UP])
    path: Path | None = next((each for each in beside if each.is_file()), None)
    try:
        document = {} if path is None else json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        raise TrajectoryError(f"{path} of the data set cannot be read, or is not JSON") from None
    return document if isinstance(document, dict) else {}


def _episode(columns: dict[str, Any], options: ReadOptions, content: Content) -> IntArray:
    """Return the rows of the episode of the options, else of the only one."""
    if "episode_index" not in columns and options.episode is not None:
        raise InputError("--episode: the file has no episode_index")
    if "episode_index" not in columns:
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
        content.note(f"episode {wanted} of {len(episodes)}")
    return rows


def _numbers(columns: dict[str, Any], name: str, rows: IntArray | None) -> FloatArray:
    """Return the numbers of a column, nested lists flattened, shape (T, N); NaN where missing."""

    def flattened(cell: Any) -> FloatArray:
        with suppress(TypeError, ValueError):
            return np.ravel(np.array(cell, dtype=np.float64))
        return np.full(1, np.nan)

    chosen = columns[name] if rows is None else columns[name].take(rows)
    if chosen.nbytes > MOST_BYTES and "binary" not in str(chosen.type):
        raise TrajectoryError(f"{name} has {chosen.nbytes >> 20:,} MB; expected the recording of a hand")
    flat = [flattened(cell) for cell in chosen.to_pylist()]
    width = max((len(row) for row in flat), default=0)
    values = np.full((len(flat), max(width, 1)), np.nan)
    for place, row in zip(values, flat):
        if len(row) == width:
            place[:] = row
    # Beyond that it is damage, and what is computed from it overflows.
    values[~(np.abs(values) <= MOST)] = np.nan
    return values


def _table(columns: dict[str, Any], rows: IntArray, info: dict[str, Any]) -> Table:
    """Return all numbers as a table, each column named after its feature and its place in it."""
    header: list[str] = []
    parts: list[FloatArray] = []
    features = info.get("features")
    for name in columns:
        values = _numbers(columns, name, rows)
        places = range(values.shape[1])
        feature = features.get(name) if isinstance(features, dict) else None
        given = feature.get("names") if isinstance(feature, dict) else None
        if isinstance(given, dict):
            given = next((part for part in given.values() if isinstance(part, list)), [])
        while isinstance(given, list) and len(given) == 1 and isinstance(given[0], list):
            given = given[0]
        words = [*map(str, given if isinstance(given, list) and len(given) == values.shape[1] else places)]
        header += [name] if values.shape[1] == 1 else [f"{name}.{word}" for word in words]
        parts.append(values)
    cells = np.concatenate(parts, axis=1) if parts else np.zeros((0, 0))
    lines = tuple(tuple(map(repr, row)) for row in cells.tolist())
    return Table(tuple(header), lines, range(1, len(lines) + 1), {})


FORMAT = RecordingFormat(
    "lerobot",
    "a LeRobot data set's Parquet file: hand_joints, or any feature with --columns",
    (".parquet",),
    lambda content, options: content.head.startswith(MAGIC),
    _read,
    takes_columns=True,
)
