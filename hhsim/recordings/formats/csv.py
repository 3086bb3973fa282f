"""Recordings from CSV: our own columns, or any others by a `hhsim.recordings.column_map.ColumnMap`."""

import numpy as np
from msgspec import structs

from hhsim.errors import InputError
from hhsim.motion.csv_file import CSV_SUFFIX, FLAGS, SAMPLES, csv_fields
from hhsim.motion.csv_table import Table, read_table
from hhsim.motion.object_motion import ObjectMotion
from hhsim.recordings.column_map import mapped
from hhsim.recordings.frames import to_our_frames
from hhsim.recordings.recording import Recording, note, unreadable
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read a table by the mapping of the options, or of our own columns; raises TrajectoryError or InputError."""
    if options.dexmo is not None or options.poses is not None:
        raise InputError("a calibration of the Dexmo glove, but the file holds other columns than its channels")
    columns = options.columns
    if columns is None:
        return _own(read_table(content.text), content.name, options)
    axes, up = options.palm_axes or columns.palm_axes, options.world_up or columns.world_up
    columns = structs.replace(columns, palm_axes=tuple(axes), world_up=up)
    table = read_table(content.text, delimiter=columns.delimiter, decimal=columns.decimal)
    return mapped(table, columns, content.name, "csv")


def _own(table: Table, name: str, options: ReadOptions) -> Recording:
    """Return the recording of a table with our own columns; TrajectoryError for others."""
    fields, broken = csv_fields(table)
    findings = [note(text) for text in table.left_out] + unreadable(broken)
    stated, count = table.remarks.get(SAMPLES, ""), len(table.rows)
    if stated not in ("", str(count)):
        findings.append(note(f"{count} samples where the file says # {SAMPLES}: {stated}: some are lost"))
    if fields.get("hand") not in ("right", "left"):
        fields["hand"] = ""
    if FLAGS in fields:
        fields[FLAGS] = np.nan_to_num(fields[FLAGS]).clip(0.0, 2.0**32 - 1.0).astype(np.uint32)
    axes, up = options.palm_axes, options.world_up
    pose = to_our_frames(fields["position"], fields["orientation"], axes, up)
    fields["position"], fields["orientation"] = pose
    if "object_motion" in fields:
        place, turn = fields["object_motion"]
        fields["object_motion"] = ObjectMotion(*to_our_frames(place, turn, None, up))
    return Recording(**{"name": name} | fields, form="hhsim csv", findings=tuple(findings))


FORMAT = RecordingFormat(
    "csv",
    "a table: hhsim's own columns, or any with --columns",
    (CSV_SUFFIX,),
    lambda content, options: content.is_text,
    _read,
    rank=2,
    takes_columns=True,
)
