"""CSV of any maker, by a mapping; our own CSV; and what a table may be like."""

from pathlib import Path

import numpy as np
import pytest
from column_map_sample import GLOVE, TABLE
from recording_samples import read_as, smooth_recording

from hhsim.errors import HhsimError, InputError, TrajectoryError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.csv_file import ABDUCTION_COLUMNS, FLEXION_COLUMNS, format_csv
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.column_map import OWN_COLUMNS, ColumnMap, euler_quaternion, read_column_map
from hhsim.recordings.csv_table import read_table
from hhsim.recordings.frames import turned
from hhsim.recordings.repair import RepairOptions, repair
from hhsim.system.settings_file import parse_settings


def test_a_mapping_says_what_columns_are() -> None:
    recording = read_as("csv", TABLE, columns=parse_settings(GLOVE, ColumnMap, "glove.toml"), name="take 1")
    assert np.allclose(recording.time, [0.0, 0.01, 0.02])
    assert np.allclose(recording.flexion[:, 1], np.radians([[10, 10, 6.67], [20, 20, 13.34], [30, 30, 20.01]]))
    assert np.allclose(recording.abduction[:, 1], 0.1)
    assert (recording.flexion[:, [0, 2, 3, 4]] == 0.0).all()
    assert (recording.device, recording.hand, recording.hand_length) == ("ExampleGlove 2", "left", 0.182)
    assert recording.raw[0].unit == "V" and recording.raw[0].values.tolist() == [0.5, 0.6, 0.7]
    assert marked(recording.flags, SampleFlag.ESTIMATED).all()
    # The recording's world has y up and its palm x to the fingers, z out of the back: ours, seen from our world.
    palm = rotation_matrix(recording.orientation[0])
    assert np.allclose(palm[:, 1], [1.0, 0.0, 0.0]) and np.allclose(palm[:, 2], [0.0, -1.0, 0.0])
    assert np.allclose(recording.position[0], [0.1 + 0.075, -0.3, 0.2])


def test_a_recording_without_a_palm_says_where_it_is() -> None:
    text = 'time = { column = "t", unit = "s" }\n[joint]\nindex_flex1 = "a"\n'
    fingers = parse_settings(text, ColumnMap, "fingers.toml")
    recording = read_as("csv", "t,a\n0,0\n0.01,0.1\n0.02,0.2\n", columns=fingers)
    assert (recording.position == 0.0).all()
    assert any("--place-object auto" in finding.text for finding in recording.findings)
    whole = read_as("csv", TABLE, columns=parse_settings(GLOVE, ColumnMap, "glove.toml"), name="take 1")
    assert not any("palm's place" in finding.text for finding in whole.findings)


@pytest.mark.parametrize("order", ["XYZ", "ZYX", "ZXY", "XYX", "xyz", "zyx", "yxz"])
def test_euler_angles_are_scipys(order: str) -> None:
    from scipy.spatial.transform import Rotation

    angles = np.random.default_rng(2).uniform(-2.0, 2.0, (20, 3))
    expected = Rotation.from_euler(order, angles).as_matrix()
    for quaternion, matrix in zip(euler_quaternion(angles, order), expected):
        assert np.allclose(rotation_matrix(quaternion), matrix)
    point = np.array([1.0, -2.0, 0.5])
    assert np.allclose(turned(euler_quaternion(angles, order), point), expected @ point)


def test_our_own_csv_comes_in_bit_for_bit() -> None:
    motion = repair(smooth_recording()).trajectory
    again = repair(read_as("csv", format_csv(motion)))
    assert again.findings == ()
    assert format_csv(again.trajectory) == format_csv(motion)
    header = next(line for line in format_csv(motion).splitlines() if not line.startswith("#"))
    assert set(OWN_COLUMNS.joints) <= set(header.split(","))


def test_a_sample_is_no_header() -> None:
    with pytest.raises(TrajectoryError, match=r"no header line, the first one holds 0\.5, 1, 1, …; expected the names"):
        read_table("0.5,1,1\n1.5,2,2\n")
    assert read_table("0,1,2\n1.5,2,2\n").header == ("0", "1", "2"), "as pandas names columns without names"
    assert len(read_table("0.5 1\n1.5 2\n", names=("a", "b")).rows) == 2


def test_tables_of_many_makers() -> None:
    texts = ("a,b\n1,2\n", "a;b\n1;2\n", "a\tb\n1\t2\n", "a b\n1  2\n", "# by: me\n\na,b\r\n1,2\r\n", "a,b\n1,2\n3")
    for text in texts:
        table = read_table(text)
        values, broken = table.numbers(["b", "a"])
        assert table.header == ("a", "b") and values.tolist() == [[2.0, 1.0]] and broken == 0
    assert read_table("# by: me\na\n1\n").remarks == {"by": "me"}
    german = read_table("a;b\n1,5;2,25\n", decimal=",")
    assert german.numbers(["a", "b"])[0].tolist() == [[1.5, 2.25]]


def test_what_cannot_be_read_is_missing_and_counted() -> None:
    table = read_table("a,b\n" + "1,2\n" * 8 + "x,2\n1,2,3\n1,nan\n1,\n1_0,2\n1,2")
    values, broken = table.numbers(["a", "b"])
    assert len(values) == 12 and broken == 2 and np.isnan(values).sum() == 4
    assert [finding.text[:20] for finding in table.findings] == ["line 15, the last on", "1 line with another "]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no header line"),
        ("# only: remarks\n", "no header line"),
        ("a,b\n", "no line below the header"),
        ("a,a\n1,2\n", "has column 'a' twice"),
        ("a,b\n1\n2\n3,4\n", "2 of 3 lines have another number of cells than the header's 2, first line 2"),
        ("a,b\nx,1\ny,2\n", "column 'a' holds 'x'; expected numbers"),
        ("a;b\n0,5;1\n0,6;2\n", "column 'a' holds '0,5'; expected numbers with a decimal point"),
        ("c,b\n1,1\n1,2\n", "unknown column 'a'"),
    ],
)
def test_what_is_no_table_is_refused(text: str, words: str) -> None:
    with pytest.raises(HhsimError, match=words.replace("(", r"\(")):
        read_table(text).numbers(["a"])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("[time", "not TOML"),
        ("hnad = 'left'", "unknown key 'hnad': did you mean hand"),
        ("hand = 'both'", "hand 'both'"),
        ("hand_length = 18.0", "expected a number from 0.05 to 0.4"),
        ("palm_axes = ['x', 'y', 'y']", "right-handed frame"),
        ("palm_axes = ['x', 'q', 'y']", "expected three of x, y, z"),
        ("world_up = 'up'", "expected one of x, y, z"),
        ("palm_offset = [1]", "three numbers"),
        ("delimiter = ''", "expected one character"),
        ("angle = 3", "expected a table"),
        ("[position]\ncolumns = ['X']", "position.columns"),
        ("[position]\ncolumns = ['X', 'Y', 'Z']\nunit = 'km'", "unit 'km'"),
        ("[orientation]\ncolumns = ['a', 'b', 'c']\norder = 'XyZ'", "expected an Euler order"),
        ("[orientation]\ncolumns = ['a', 'b', 'c', 'd']\norder = 'xywz'", "expected wxyz or xyzw"),
        ("[time]\nunit = 's'", "time: column is missing"),
        ("[joint]\nindex_flex4 = 'a'", "joint: unknown key 'index_flex4': did you mean index_flex"),
        ("[joint]\nindex_flex1 = { joint = 'index_flex2' }", "which has no column of its own"),
        ("[joint]\nindex_flex1 = 3", "joint.index_flex1 = 3; expected text in quotes, or a table"),
    ],
)
def test_mappings_that_are_none(line: str, words: str) -> None:
    text = line if "rate" in line or "[time" in line else f"rate = 100\n{line}"
    if "[joint]" not in text:
        text += "\n[joint]\nindex_flex1 = 'a'\n"
    with pytest.raises(InputError, match=words.replace("(", r"\(")) as error:
        parse_settings(text, ColumnMap, "m.toml")
    assert str(error.value).startswith("m.toml: ") and "\n" not in str(error.value)


def test_mappings_need_time_and_joints(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no .time. and no rate"):
        parse_settings("[joint]\nindex_flex1 = 'a'", ColumnMap, "m.toml")
    with pytest.raises(InputError, match="joint is missing"):
        parse_settings("rate = 100", ColumnMap, "m.toml")
    with pytest.raises(InputError, match=r"none.toml: no such file"):
        read_column_map(tmp_path / "none.toml")
    made = read_as("csv", "a\n1\n2\n", columns=parse_settings("rate = 50\n[joint]\nindex_flex1 = 'a'", ColumnMap, "m"))
    assert made.time.tolist() == [0.0, 0.02] and "made from the rate, 50 Hz" in made.findings[0].text
    with pytest.raises(TrajectoryError, match="the columns are a, b; expected hhsim's own"):
        read_as("csv", "a,b\n1,2\n")


def test_columns_that_are_nearly_ours_are_told_by_those_that_are_not() -> None:
    pose, angles = "time,px,py,pz,qw,qx,qy,qz", ",".join((*FLEXION_COLUMNS, *ABDUCTION_COLUMNS))
    nearly = angles.replace("thumb_", "th_").replace("little_abd", "abd_li")
    with pytest.raises(TrajectoryError) as error:
        read_as("csv", f"{pose},{nearly}\n{','.join(28 * '0')}\n")
    said = str(error.value)
    assert "no column thumb_flex1, thumb_flex2, thumb_flex3, … of" in said and "it has th_flex1, th_flex2" in said
    with pytest.raises(TrajectoryError, match="no column little_abd of hhsim's own: rename"):
        read_as("csv", f"{pose},{angles.removesuffix(',little_abd')}\n{','.join(27 * '0')}\n")


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
    sound = repair(read_as("csv", _table(1.0, 1.0, 1.0), columns=columns)).trajectory
    degrees = 180.0 / np.pi
    units = RepairOptions(time_unit="ms", length_unit="mm", angle_unit="deg")
    told = repair(read_as("csv", _table(1e3, 1e3, degrees), columns=columns), units)
    assert told.findings == ()
    # Large enough for no joint, or the numbers could be radians.
    found = repair(read_as("csv", _table(1e3, 1e3, degrees), columns=columns))
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
        (UNITLESS.replace('"Z"]', '"Z"]\nunit = "m"'), {"length"}),
        ("palm_offset = [0.0, 0.1, 0.0]\n" + UNITLESS, {"length"}),
    ],
)
def test_a_unit_that_the_mapping_names_is_stated(text: str, stated: set[str]) -> None:
    columns = parse_settings(text, ColumnMap, "glove.toml")
    assert columns.stated == stated
    recording = read_as("csv", _table(1e3, 1.0, 1.0), columns=columns)
    if "time" in stated:
        with pytest.raises(InputError, match="--time-unit ms: the file, or the mapping of its"):
            repair(recording, RepairOptions(time_unit="ms"))
        with pytest.raises(TrajectoryError, match=r"than the one stated\? check --time-unit, or the"):
            repair(recording)
    else:
        assert repair(recording, RepairOptions(time_unit="ms")).trajectory.duration == pytest.approx(0.99)
