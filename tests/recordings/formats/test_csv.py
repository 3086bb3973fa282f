"""CSV of any maker, by a mapping; our own CSV; and what a table may be like."""

import numpy as np
import pytest
from joint_samples import words
from recording_samples import read_as, smooth_recording

from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.csv_file import format_csv
from hhsim.recordings.cleaning import CleaningOptions, clean_recording
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.frames import turned, world_matrix
from hhsim.system.settings_file import parse_settings


def test_stamps_of_two_columns_are_one() -> None:
    columns = parse_settings("[time]\ncolumn = 'sec'\n[joint]\nindex_flex1 = 'a'", ColumnMap, "ros.toml")
    recording = read_as("csv", "sec,nanosec,a\n7,900000000,1\n8,0,2\n8,100000000,3\n", columns=columns)
    assert np.allclose(recording.time, [7.9, 8.0, 8.1]) and "not used" not in words(recording)


def test_euler_angles_turn_about_turned_or_fixed_axes() -> None:
    table = "t,a,b,c,f\n" + "".join(f"{0.01 * k},90,0,90,0\n" for k in range(3))
    for order, expected in (("ZYX", [0.0, 1.0, 0.0]), ("XYZ", [0.0, 0.0, 1.0]), ("zyx", [0.0, 0.0, 1.0])):
        text = f"columns = ['a', 'b', 'c']\norder = '{order}'\nunit = 'deg'\n[joint]\nindex_flex1 = 'f'"
        columns = parse_settings(f"[time]\ncolumn = 't'\n[orientation]\n{text}", ColumnMap, "map.toml")
        orientation = read_as("csv", table, columns=columns).orientation
        np.testing.assert_allclose(turned(orientation, np.eye(3)[0]), np.tile(expected, (3, 1)), atol=1e-15)


def test_our_own_csv_comes_in_bit_for_bit() -> None:
    motion = clean_recording(smooth_recording()).trajectory
    again = clean_recording(read_as("csv", format_csv(motion)))
    assert again.findings == ()
    assert format_csv(again.trajectory) == format_csv(motion)
    raised = read_as("csv", format_csv(motion), world_up="y")
    assert raised.name == motion.name and raised.hand == motion.hand
    np.testing.assert_allclose(raised.position, motion.position @ world_matrix("y").T)


@pytest.mark.parametrize(
    ("remark", "side"),
    [("hand: Left", "left"), ("hand: L", "left"), ("side: left", "left"), ("hand: none", ""), ("hand: both", None)],
)
def test_the_hand_of_our_own_csv_in_other_words(remark: str, side: str | None) -> None:
    text = format_csv(clean_recording(smooth_recording()).trajectory).replace("hand: right", remark)
    if side is None:
        with pytest.raises(TrajectoryError, match="hand is 'both'; expected right, left, or nothing: say --hand"):
            read_as("csv", text)
        assert read_as("csv", text, hand="left").hand == "left"
    else:
        recording = read_as("csv", text)
        assert recording.hand == side and ("left hand, as" in words(recording)) == (side == "left")


UNITLESS = """
hand = "right"

[time]
column = "Time"

[position]
columns = ["X", "Y", "Z"]

[joint]
index_flex1 = "MCP"
"""


def _table(seconds: float, metres: float, radians: float) -> str:
    """A second of a finger that bends, in units so many times smaller than ours."""
    rows = [(0.01 * k * seconds, 0.2 * metres, 0.1 * metres, 0.0, 0.01 * k * radians) for k in range(100)]
    return "Time,X,Y,Z,MCP\n" + "".join(",".join(repr(cell) for cell in row) + "\n" for row in rows)


def test_a_unit_that_the_mapping_does_not_name_is_an_options_or_is_found() -> None:
    columns = parse_settings(UNITLESS, ColumnMap, "glove.toml")
    assert columns.stated == frozenset()
    sound = clean_recording(read_as("csv", _table(1.0, 1.0, 1.0), columns=columns)).trajectory
    degrees = 180.0 / np.pi
    units = CleaningOptions(time_unit="ms", length_unit="mm", angle_unit="deg")
    told = clean_recording(read_as("csv", _table(1e3, 1e3, degrees), columns=columns), units)
    assert told.findings == ()
    # Large enough for no joint, or the numbers could be radians.
    found = clean_recording(read_as("csv", _table(1e3, 1e3, degrees), columns=columns))
    assert {finding.kind for finding in found.findings} == {"unit"}
    for motion in (told.trajectory, found.trajectory):
        assert np.allclose(motion.time, sound.time) and np.allclose(motion.position, sound.position)
        assert np.allclose(motion.flexion, sound.flexion)


@pytest.mark.parametrize(
    ("text", "stated"),
    [
        (UNITLESS.replace('"Time"', '"Time"\nunit = "s"'), {"time"}),
        (UNITLESS.replace("[position]", "[angle]\nunit = 'rad'\n[position]"), {"angle"}),
        (UNITLESS.replace('"MCP"', "{ column = 'MCP', unit = 'rad' }"), {"angle"}),
        ("palm_offset = [0.0, 0.1, 0.0]\n" + UNITLESS.replace('"Z"]', '"Z"]\nunit = "m"'), {"length"}),
    ],
)
def test_a_unit_that_the_mapping_names_is_stated(text: str, stated: set[str]) -> None:
    columns = parse_settings(text, ColumnMap, "glove.toml")
    assert columns.stated == stated
    recording = read_as("csv", _table(1e3, 1.0, 1.0), columns=columns)
    if "time" in stated:
        with pytest.raises(InputError, match="--time-unit ms: the file, or the mapping of its"):
            clean_recording(recording, CleaningOptions(time_unit="ms"))
        with pytest.raises(TrajectoryError, match="than the one stated"):
            clean_recording(recording)
    else:
        assert clean_recording(recording, CleaningOptions(time_unit="ms")).trajectory.duration == pytest.approx(0.99)
