"""Recordings from CSV: our own columns, or any others by a `hhsim.recordings.column_map.ColumnMap`."""

import numpy as np

from hhsim.errors import InputError
from hhsim.motion.csv_file import (
    COLUMNS,
    CSV_SUFFIX,
    FLAGS,
    OBJECT_COLUMNS,
    PHASE,
    POSE_SIZES,
    SAMPLES,
    csv_fields,
    format_csv,
)
from hhsim.motion.csv_table import NewColumn
from hhsim.motion.trajectory import ObjectMotion, Trajectory
from hhsim.recordings.column_map import mapped
from hhsim.recordings.frames import FileFrame
from hhsim.recordings.recording import MOTION, SIDES, Recording
from hhsim.recordings.registry import ANGLE_DIGITS, Changes, Content, ReadOptions, RecordingFormat


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read a table by the mapping of the options, or of our own columns; raises TrajectoryError or InputError."""
    if options.dexmo is not None:
        raise InputError("a calibration of the Dexmo glove, but the file holds other columns than its channels")
    if options.columns is not None:
        return mapped(content, content.table, options.columns, options)
    table = content.table
    fields, broken = csv_fields(table)
    content.note(*table.notes)
    content.unreadable(broken)
    stated, count = table.remarks.get(SAMPLES, ""), len(table.rows)
    if stated not in ("", str(count)):
        content.note(f"{count} samples where the file says # {SAMPLES}: {stated}: some are lost")
    if FLAGS in fields:
        fields[FLAGS] = np.nan_to_num(fields[FLAGS]).clip(0.0, 2.0**32 - 1.0).astype(np.uint32)
    frame = FileFrame.of(options.world_up, options.mirror)
    pose = frame.poses(fields["position"], fields["orientation"], options.palm_axes)
    fields["position"], fields["orientation"] = pose
    if "object_motion" in fields:
        fields["object_motion"] = ObjectMotion(*frame.poses(*fields["object_motion"]))
    elif POSE_SIZES.keys() & fields.keys():
        place, turn = fields.get("object_position", np.zeros(3)), fields.get("object_orientation", np.eye(4)[0])
        place, turn = frame.poses(place[None], turn[None])
        fields |= {"object_position": place[0], "object_orientation": turn[0]}
    content.unused(dict.fromkeys(table.header), {*COLUMNS, *OBJECT_COLUMNS, PHASE, FLAGS})
    recording = Recording(**fields, form="hhsim csv", file_frame=frame)
    if recording.hand not in SIDES:
        return recording.changed(hand="")
    # The side that a remark names is part of the format.
    content.stated.hide("side")
    return recording


def _write(content: Content, options: ReadOptions, made: Changes) -> bytes:
    """Return a table of our own columns with the changes."""
    values = csv_fields(content.table)[0]
    moved = made.motion(*(values[key] for key in MOTION))
    rows = np.concatenate([part[made.rows].reshape(len(made.rows), -1) for part in moved], axis=1)
    digits = [made.digits] * 3 + [ANGLE_DIGITS] * 24
    new = {name: NewColumn(*column) for name, *column in zip(COLUMNS[1:], rows.T, digits)}
    return content.edited(content.table, made.rows, new)


def _make(suffix: str, recording: Recording) -> bytes:
    motion = {key: getattr(recording, key) for key in ("time", *MOTION, "hand")}
    return format_csv(Trajectory(**motion)).encode()


FORMAT = RecordingFormat(
    "csv",
    "a table: hhsim's own columns, or any with --columns",
    (CSV_SUFFIX,),
    lambda content, options: content.is_text,
    _read,
    rank=2,
    takes_columns=True,
    write=_write,
    make=_make,
)
