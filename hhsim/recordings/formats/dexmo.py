"""Recordings of a Dexmo glove: a CSV with its eleven channels, by linear regression to joint angles.

Columns: thumb_rotate, thumb_split, thumb_bend, index_split, … little_bend (or pinky_…), time [s], and px, py, pz, qw,
qx, qy, qz of a tracker's palm pose, as the glove has none.
"""

from dataclasses import replace

import numpy as np

from hhsim.errors import InputError
from hhsim.motion.csv_file import CSV_SUFFIX
from hhsim.motion.sample_flags import SampleFlag
from hhsim.recordings.column_map import ColumnMap, OrientationColumns, PositionColumns, TimeColumn, mapped
from hhsim.recordings.dexmo_regression import CHANNELS, MOST_NORMALISED, DexmoRegression
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat

ALIAS = {"pinky_split": "little_split", "pinky_bend": "little_bend"}


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read a table of channels; InputError for raw counts without a calibration."""
    table = replace(content.table, header=tuple(ALIAS.get(column, column) for column in content.table.header))
    places = {"px", "py", "pz"} <= set(table.header)
    turns = {"qw", "qx", "qy", "qz"} <= set(table.header)
    columns = ColumnMap(
        joints={},
        time=TimeColumn("time"),
        position=PositionColumns(("px", "py", "pz")) if places else None,
        orientation=OrientationColumns(("qw", "qx", "qy", "qz")) if turns else None,
        device="Dexmo",
    )
    recording = mapped(content, table, columns, options, CHANNELS)
    readings = content.numbers(table, CHANNELS)
    calibration = options.dexmo or DexmoRegression.default()
    if not calibration.in_counts and np.nanpercentile(np.abs(readings), 95.0) > MOST_NORMALISED:
        reached = np.nanmax(np.abs(readings))
        raise InputError(f"channels reach {reached:g}: raw counts; expected 0 to 1, or a calibration: --calibration")
    flexion, abduction = calibration.angles(readings)
    recording = recording.changed(flexion=flexion, abduction=abduction, stated=frozenset({"angle"}))
    text = "joints beyond the first by linear regression"
    return recording.flagged(np.ones(len(readings), dtype=bool), SampleFlag.ESTIMATED, text)


FORMAT = RecordingFormat(
    "dexmo",
    "a table of a Dexmo glove's eleven channels",
    (CSV_SUFFIX,),
    lambda content, options: (
        options.columns is None and {*CHANNELS} <= {ALIAS.get(name, name) for name in content.header}
    ),
    _read,
)
