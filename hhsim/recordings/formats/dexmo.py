"""Recordings of a Dexmo glove: a CSV with its eleven channels, by linear regression to joint angles.

Columns: thumb_rotate, thumb_split, thumb_bend, index_split, … little_bend (or pinky_…), time [s], and px, py, pz, qw,
qx, qy, qz of a tracker's palm pose, as the glove has none. The channels are kept beside the motion.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.motion.csv_file import CSV_SUFFIX
from hhsim.motion.csv_table import read_table
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import RawChannel
from hhsim.recordings.column_map import ColumnMap, OrientationColumns, PositionColumns, TimeColumn, mapped
from hhsim.recordings.content import Content, ReadOptions
from hhsim.recordings.dexmo_regression import CHANNELS, DexmoRegression, calibrated
from hhsim.recordings.recording import Recording, note, unreadable, unused
from hhsim.recordings.registry import RecordingFormat
from hhsim.recordings.unit_detection import in_seconds, in_units

ALIAS = {"pinky_split": "little_split", "pinky_bend": "little_bend"}
MOST_NORMALISED = 1.5
"""Larger channels are raw counts."""


def has_dexmo_channels(header: tuple[str, ...]) -> bool:
    """True if a table has all eleven channels."""
    return set(CHANNELS) <= {ALIAS.get(name, name) for name in header}


def _calibrated(content: Content, options: ReadOptions) -> tuple[Recording, DexmoRegression]:
    """Read a table of channels; returns the recording and the calibration used."""
    table = read_table(content.text)
    table = replace(table, header=tuple(ALIAS.get(column, column) for column in table.header))
    places = {"px", "py", "pz"} <= set(table.header)
    turns = {"qw", "qx", "qy", "qz"} <= set(table.header)
    columns = ColumnMap(
        joints={},
        time=TimeColumn("time"),
        position=PositionColumns(("px", "py", "pz")) if places else None,
        orientation=OrientationColumns(("qw", "qx", "qy", "qz")) if turns else None,
        device="Dexmo",
        mirror=options.mirror,
    )
    recording = mapped(table, columns, content.name, "dexmo")
    readings, broken = table.numbers(CHANNELS)
    chosen, poses = options.dexmo or DexmoRegression.default(), options.poses
    if poses is not None:
        time = in_seconds(in_units(recording, time=options.time_unit)).time
        spread = None if poses.spread is None else _within(time, readings, poses.spread, "spread")
        flat = _within(time, readings, poses.open, "open")
        fist = _within(time, readings, poses.fist, "a fist")
        chosen = calibrated(chosen, flat, fist, spread)
    elif not chosen.counts_raw and np.nanpercentile(np.abs(readings), 95.0) > MOST_NORMALISED:
        expected = "expected 0 to 1, or a calibration: --calibration, or --open and --fist"
        raise InputError(f"channels reach {np.nanmax(np.abs(readings)):g}: raw counts; {expected}")
    flexion, abduction = chosen.angles(readings)
    recording = recording.found(*unused(dict.fromkeys(table.header), columns.names | {*CHANNELS}))
    recording = recording.changed(
        flexion=flexion,
        abduction=abduction,
        stated=frozenset({"angle"}),
        raw=tuple(RawChannel(key, readings[:, k], "1", "Dexmo, as it was read") for k, key in enumerate(CHANNELS)),
    )
    text = "joints beyond the first by linear regression"
    recording = recording.flagged(np.ones(len(readings), dtype=bool), SampleFlag.ESTIMATED, text)
    return recording.found(*unreadable(broken, " of channels"), *map(note, chosen.hints)), chosen


def _within(time: FloatArray, readings: FloatArray, span: tuple[float, float], word: str) -> FloatArray:
    inside = (time >= span[0]) & (time <= span[1])
    if not inside.any():
        stamps = f"the stamps are from {np.nanmin(time):g} to {np.nanmax(time):g} s"
        raise InputError(f"no sample from {span[0]:g} to {span[1]:g} s, where the hand is said to be {word}; {stamps}")
    return np.asarray(readings[inside])


def calibration_of(path: Path, options: ReadOptions) -> DexmoRegression:
    """Return the calibration of a recording by the poses of the options; InputError without samples in them."""
    return _calibrated(Content(path), options)[1]


FORMAT = RecordingFormat(
    "dexmo",
    "a table of a Dexmo glove's eleven channels",
    (CSV_SUFFIX,),
    lambda content, options: options.columns is None and has_dexmo_channels(content.header),
    lambda content, options: _calibrated(content, options)[0],
)
