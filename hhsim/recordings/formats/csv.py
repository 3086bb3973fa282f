"""Recordings from CSV: our own columns, or any others by a `hhsim.recordings.column_map.ColumnMap`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import structs

from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.csv_file import COLUMNS, CSV_SUFFIX, FLAGS, OBJECT_COLUMNS, PHASE, POSE_COLUMNS, SAMPLES, object_pose
from hhsim.motion.object_motion import ObjectMotion
from hhsim.recordings.column_map import OWN_COLUMNS, is_own_header, mapped
from hhsim.recordings.csv_table import Table, read_header, read_table
from hhsim.recordings.recording import Recording, note
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat


def _own(table: Table, name: str) -> Recording:
    recording = mapped(table, OWN_COLUMNS, name, "hhsim csv")
    remarks = table.remarks
    stated: dict[str, Any] = {key: remarks[key] for key in ("name", "source", "licence", "device") if key in remarks}
    if remarks.get("hand") in ("right", "left"):
        stated["hand"] = remarks["hand"]
    if FLAGS in table.header:
        bits, _ = table.numbers([FLAGS])
        known = np.nan_to_num(bits[:, 0]).clip(0.0, 2.0**32 - 1.0)
        recording = recording.changed(flags=known.astype(np.uint32))
    if OBJECT_COLUMNS[0] in table.header:
        rows, _ = table.numbers(OBJECT_COLUMNS)
        recording = recording.changed(object_motion=ObjectMotion(*np.split(rows, [3], axis=1)))
    if remarks.get(SAMPLES, str(len(table.rows))) != str(len(table.rows)):
        text = f"{len(table.rows)} samples where the file says # {SAMPLES}: {remarks[SAMPLES]}: some are lost"
        recording = recording.found(note(text))
    return recording.changed(**stated, **object_pose(remarks))


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read a table by the mapping of the options, or of our own columns; raises TrajectoryError or InputError."""
    if options.dexmo is not None or options.poses is not None:
        raise InputError("a calibration of the Dexmo glove, but the file holds other columns than its channels")
    columns = options.columns
    if columns is None and (options.palm_axes or options.world_up) and is_own_header(read_header(content.text)):
        columns = OWN_COLUMNS
    if columns is not None:
        axes, up = options.palm_axes or columns.palm_axes, options.world_up or columns.world_up
        columns = structs.replace(columns, palm_axes=tuple(axes), world_up=up)
        table = read_table(content.text, delimiter=columns.delimiter, decimal=columns.decimal)
        return mapped(table, columns, content.name, "csv")
    table = read_table(content.text)
    if not is_own_header(table.header):
        raise TrajectoryError(_unexplained(table.header))
    return _own(table, content.name)


def _unexplained(header: tuple[str, ...]) -> str:
    """Describe how a table's columns differ from our own."""
    if set(POSE_COLUMNS) <= set(header):
        missing = [name for name in COLUMNS if name not in header]
        other = [name for name in header if name not in (*COLUMNS, *OBJECT_COLUMNS, PHASE, FLAGS)]
        instead = f"; it has {_some(other)} instead" if other else ""
        return f"no column {_some(missing)} of hhsim's own{instead}: rename them, or map them with --columns"
    return (
        f"the columns are {_some(header, 8)}; expected hhsim's own (time, px, …), or a mapping of these with --columns"
    )


def _some(names: Sequence[str], most: int = 3) -> str:
    return ", ".join(name[:20] for name in names[:most]) + (", …" if len(names) > most else "")


FORMAT = RecordingFormat(
    "csv",
    "a table: hhsim's own columns, or any with --columns",
    (CSV_SUFFIX,),
    lambda content, options: content.is_text,
    _read,
    rank=2,
    takes_columns=True,
)
