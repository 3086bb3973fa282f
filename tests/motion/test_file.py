"""Files of motions and tables of text: what is read back, habits of others, and faults in one line."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from file_faults import changed
from hypothesis import given
from hypothesis import strategies as st

from hhsim.errors import HhsimError, OutputError, TrajectoryError
from hhsim.motion.csv_table import NewColumn, edited, read_table
from hhsim.motion.file import FORMAT, load_trajectory, save_trajectory
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import ObjectMotion, Phase, Trajectory
from hhsim.system.checksummed_file import SIZE, seal_holds


@pytest.fixture
def motion() -> Trajectory:
    rng = np.random.default_rng(5)
    time = np.concatenate([[100.0], 100.0 + np.cumsum(rng.uniform(0.005, 0.03, 49))])
    return Trajectory(
        time=time,
        position=rng.normal(size=(50, 3)),
        orientation=rng.normal(size=(50, 4)),
        flexion=rng.uniform(0.0, 1.5, size=(50, 5, 3)),
        abduction=rng.uniform(-0.2, 0.2, size=(50, 5)),
        phases=(Phase("approach", 100.0, float(time[20])), Phase("grasp", float(time[20]), float(time[-1]))),
        object_position=np.array([0.1, 0.2, 0.3]),
        object_orientation=rng.normal(size=4),
        name="reach, grasp",
        source="made for a test: µ",
        licence="Apache-2.0",
        device="Dexmo",
        hand="left",
        flags=np.arange(50, dtype=np.uint32),
    )


def assert_same(one: Trajectory, other: Trajectory) -> None:
    for key in ("time", "position", "orientation", "flexion", "abduction", "object_position", "object_orientation"):
        assert getattr(one, key).tobytes() == getattr(other, key).tobytes(), key
    for key in ("phases", "name", "source", "licence", "device", "hand"):
        assert getattr(one, key) == getattr(other, key)
    assert (one.object_motion is None) == (other.object_motion is None)
    for mine, theirs in zip(one.object_motion or (), other.object_motion or ()):
        assert mine.tobytes() == theirs.tobytes()
    assert (one.flags is None) == (other.flags is None)
    assert one.flags is None or (one.flags == other.flags).all()


@pytest.mark.parametrize(
    ("name", "kind"),
    [("m.h5", "whole"), ("m.csv", "whole"), ("m.csv", "bare"), ("m.h5", "moving"), ("m.csv", "moving")],
)
def test_a_file_gives_back_every_bit(motion: Trajectory, tmp_path: Path, name: str, kind: str) -> None:
    if kind == "bare":
        motion = Trajectory(
            motion.time, motion.position, motion.orientation, motion.flexion, motion.abduction, name="m"
        )
    elif kind == "moving":
        motion = replace(motion, object_motion=ObjectMotion(motion.position[::-1], motion.orientation[::-1]))
    save_trajectory(motion, tmp_path / name)
    assert_same(load_trajectory(tmp_path / name), motion)


def test_every_dataset_carries_its_unit_and_meaning(motion: Trajectory, tmp_path: Path) -> None:
    save_trajectory(motion, tmp_path / "m.h5")
    seen = {}
    with h5py.File(tmp_path / "m.h5") as file:
        assert file.attrs["format"] == FORMAT
        assert file.attrs["schema_version"] == 1
        file.visititems(lambda key, item: seen.update({key: dict(item.attrs)}) if hasattr(item, "shape") else None)
    assert set(seen) == {
        "time", "position", "orientation", "flexion", "abduction", "object/position", "object/orientation",
        "phase/name", "phase/start_time", "phase/end_time", "flags",
    }  # fmt: skip
    for key, attributes in seen.items():
        assert set(attributes) - {"flag_masks", "flag_meanings"} == {"units", "long_name"}, key
        assert attributes["long_name"], key
    assert seen["time"]["units"] == "s" and seen["flexion"]["units"] == "rad" and seen["position"]["units"] == "m"
    assert seen["flags"]["flag_meanings"].split() == [flag.word for flag in SampleFlag]
    assert seen["flags"]["flag_masks"].tolist() == [flag.value for flag in SampleFlag]


def test_a_file_has_a_seal_that_need_not_be_there(motion: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "m.h5"
    save_trajectory(motion, path)
    assert seal_holds(path) is True
    path.write_bytes(path.read_bytes()[:-SIZE])
    assert seal_holds(path) is None
    assert_same(load_trajectory(path), motion)
    path.write_bytes(path.read_bytes() + b"more")
    with pytest.raises(TrajectoryError, match="a damaged HDF5 file: bytes behind its end, which are no seal"):
        load_trajectory(path)


def test_a_csv_that_was_cut_short_is_noticed(motion: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    save_trajectory(motion, path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:-10]))
    with pytest.raises(TrajectoryError, match=r"it holds 40 samples but says # samples: 50"):
        load_trajectory(path)
    path.write_text("".join(line for line in lines[:-10] if not line.startswith("# samples")))
    assert load_trajectory(path).sample_count == 40


@pytest.mark.parametrize("name", ["m.h5", "m.csv"])
def test_the_same_motion_gives_the_same_bytes(motion: Trajectory, tmp_path: Path, name: str) -> None:
    save_trajectory(motion, tmp_path / name)
    first = (tmp_path / name).read_bytes()
    save_trajectory(motion, tmp_path / name)
    assert (tmp_path / name).read_bytes() == first
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_unwritable_places_and_suffixes_are_refused(motion: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"cannot write [^:]*: No such file or directory$"):
        save_trajectory(motion, tmp_path / "nowhere" / "m.h5")
    with pytest.raises(OutputError, match=r"unknown suffix '.npz'; expected .h5 or .csv"):
        save_trajectory(motion, tmp_path / "m.npz")


HEADER = (
    "time,px,py,pz,qw,qx,qy,qz,"
    + ",".join(
        f"{finger}_flex{joint}" for finger in ("thumb", "index", "middle", "ring", "little") for joint in (1, 2, 3)
    )
    + ",thumb_abd,index_abd,middle_abd,ring_abd,little_abd"
)
OBJECT = ",".join(f"object_{name}" for name in ("px", "py", "pz", "qq", "qx", "qy", "qz"))
ROW = "0.0,0,0,0.1,1,0,0,0" + ",0.2" * 15 + ",0" * 5


def test_csv_of_others_is_read_with_its_habits(tmp_path: Path) -> None:
    columns = [*HEADER.split(","), "phase"]
    order = list(reversed(range(len(columns))))
    rows = [[*ROW.split(","), "hold"], ["0.5", *ROW.split(",")[1:], ""], ["0.75", *ROW.split(",")[1:], "slide"]]
    text = "\r\n".join(
        [" , ".join(columns[i] for i in order)] + [",".join(row[i] for i in order) for row in rows] + ["", ""]
    )
    path = tmp_path / "other.csv"
    path.write_text("# a remark\r\n# device: glove: left\r\n\r\n" + text, encoding="utf-8-sig", newline="")
    read = load_trajectory(path)
    assert read.time.tolist() == [0.0, 0.5, 0.75]
    assert read.device == "glove: left"
    assert read.name == "other"
    assert read.phases == (Phase("hold", 0.0, 0.5), Phase("slide", 0.75, 0.75))
    assert (read.flexion == 0.2).all()
    path.write_text(text.replace(",", ";").replace(".", ","), encoding="utf-8-sig", newline="")
    for field in ("time", "position", "flexion", "abduction"):
        np.testing.assert_array_equal(getattr(load_trajectory(path), field), getattr(read, field))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def attribute(name: str, value: object) -> Callable[[Path], object]:
    def change(path: Path) -> None:
        with changed(path) as file:
            file.attrs[name] = value

    return change


def flexion(values: Any) -> Callable[[Path], object]:
    """Another dataset in place of the joint angles, or none."""

    def change(path: Path) -> None:
        with changed(path) as file:
            del file["flexion"]
            if values is not None:
                file["flexion"] = values

    return change


def text(content: str) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content.encode())


FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    # What is done to a file of a motion, whose suffix is that of the name, and what is said of it.
    "gone.h5": (Path.unlink, "no such file; expected a trajectory"),
    "text.h5": (text("time,px"), "no hhsim-trajectory file, or a damaged one: no HDF5 file"),
    "cut.h5": (cut, "a damaged HDF5 file: cut short"),
    "format.h5": (attribute("format", "hhsim-tree"), "format 'hhsim-tree'; expected hhsim-trajectory"),
    "no format.h5": (attribute("format", 1), r"or an .npz of the arrays: abduction \(50, 5\), "),
    "newer.h5": (attribute("schema_version", 2), "schema_version 2; expected 1"),
    "word.h5": (attribute("schema_version", "one"), "schema_version one; expected 1"),
    "no flexion.h5": (flexion(None), "no dataset flexion; expected one in every"),
    "shape.h5": (flexion(np.zeros((50, 15))), r"flexion has shape \(50, 15\); expected \(50, 5, 3\)"),
    "no header.csv": (text("# name: x\n\n"), "no header line"),
    "columns.csv": (text("time,px,py\n0,0,0"), "no column pz, qw, qx, qy, qz, thumb_flex1, … of hhsim's own"),
    "column.csv": (text(f"{HEADER},phaze\n{ROW},x"), "unknown column 'phaze': did you mean phase"),
    "object.csv": (
        text(f"{HEADER},{OBJECT}\n{ROW}" + ",0" * 7),
        "no column object_qw of hhsim's own; it has object_qq",
    ),
    "row.csv": (text(f"# name: x\n{HEADER}\n{ROW}\n{ROW},7"), "line 4 has 29 values; expected 28"),
    "NaN.csv": (text(f"{HEADER}\n" + ROW.replace("0.1,1", "nan,1")), "position has 1 NaN or infinite value"),
    "place.csv": (text(f"# object_position: 1 2\n{HEADER}\n{ROW}"), "# object_position: 1 2; expected 3 numbers"),
    "turn.csv": (text(f"# object_orientation: a b c d\n{HEADER}\n{ROW}"), "a b c d; expected 4 numbers"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_one_line_that_names_the_file(name: str, motion: Trajectory, tmp_path: Path) -> None:
    change, message = FAULTS[name]
    path = tmp_path / name
    save_trajectory(motion, path)
    change(path)
    with pytest.raises(TrajectoryError, match=message) as caught:
        load_trajectory(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_tables_of_many_makers() -> None:
    texts = ("a,b\n1,2\n", "a;b\n1;2\n", "a\tb\n1\t2\n", "a b\n1  2\n", "# by: me\n\na , b\r\n1,2\r\n", "a,b\n1,2\n3")
    for text in texts:
        table = read_table(text)
        values, broken = table.numbers(["b", "a"])
        assert table.header == ("a", "b") and values.tolist() == [[2.0, 1.0]] and broken == 0
    assert read_table("# by: me\na\n1\n").remarks == {"by": "me"}


@pytest.mark.parametrize("sign", [";", "\t", " "])
def test_decimal_commas_are_found_where_no_comma_parts_cells_and_told(sign: str) -> None:
    for text in ("\ufeffa;b;c\r\n3;-2,5e1;x, y\r\n1,5;2;z\r\n", "a;b\n3;-25\n1,5;2\n", "a;b\n3;-25,0\n1,50;2,\n"):
        table = read_table(text.removeprefix("\ufeff").replace(", ", ",").replace(";", sign))
        assert table.numbers(["a", "b"])[0].tolist() == [[3.0, -25.0], [1.5, 2.0]]
        assert table.notes[0].startswith("decimal commas") and table.decimal == ","
    if sign != " ":
        bare = f"0,5{sign}1{sign}-1,25\n1,5{sign}2{sign}2,75\n"
        table = read_table(bare, names=("a", "b", "c"))
        assert table.numbers(["a", "b", "c"])[0].tolist() == [[0.5, 1.0, -1.25], [1.5, 2.0, 2.75]]
        with pytest.raises(HhsimError, match="no header line"):
            read_table(bare)


def test_whole_numbers_may_be_a_header_and_names_stand_for_one() -> None:
    assert read_table("0,1,2\n1.5,2,2\n").header == ("0", "1", "2"), "as pandas names columns without names"
    assert len(read_table("0.5 1\n1.5 2\n", names=("a", "b")).rows) == 2


def test_what_cannot_be_read_is_missing_and_counted_or_refused() -> None:
    text = "a,b\n" + "1,2\n" * 8 + "x,2\n1,2,3\n1,nan\n1,\n1_0,2\n1,2"
    table = read_table(text)
    values, broken = table.numbers(["a", "b"])
    assert len(values) == 12 and broken == 2 and np.isnan(values).sum() == 4
    assert [sentence[:20] for sentence in table.notes] == ["line 15, the last on", "1 line with another "]
    with pytest.raises(HhsimError, match="line 11 has 3 values; expected 2"):
        read_table(text, strict=True)
    with pytest.raises(HhsimError, match="line 10: a is 'x'; expected a number"):
        read_table(text.replace("1,2,3\n", ""), strict=True).numbers(["a"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# only: remarks\n", "no header line"),
        ("0.5,1,1\n1.5,2,2\n", "no header line"),
        ("a,b\n", "no line below the header"),
        ("a,a\n1,2\n", "column a twice"),
        ("a,b\n1\n2\n3,4\n", "line 2 has 1 value; expected 2"),
        ("a;b\n0,5;1.5\n0,6;2.5\n", "line 2: a is '0,5'; expected a number with a decimal point"),
        ('a,b\n"0,5",1\n"0,6",2\n', "line 2: a is '0,5'; expected a number with a decimal point"),
        ("c,b\n1,1\n1,2\n", "unknown column 'a'"),
    ],
)
def test_what_is_no_table_is_refused(text: str, words: str) -> None:
    with pytest.raises(HhsimError, match=words):
        read_table(text).numbers(["a"])


@pytest.mark.parametrize(
    ("old", "value", "decimals", "new"),
    [
        ("0.25", 0.5, 0, "0.50"),
        ("0.25", 0.25, 6, "0.25"),
        ("2.5e-1", 0.25, 6, "2.5e-1"),
        ("-1E-9", 0.25, 3, "0.250000000"),
        ("1e3", 1000.5, 2, "1000.50"),
        ("7", 7.04, 1, "7.0"),
        ("0.1", float("nan"), 6, "0.1"),
        ("", 1.0, 6, ""),
        ("n/a", 1.0, 6, "n/a"),
        ("0.000000000000000000001", 0.1, 2, "0.10000000000000001"),
        ("1,50", 2.25, 1, "2,25"),
    ],
)
def test_a_number_keeps_its_decimals_or_gets_those_it_needs(old: str, value: float, decimals: int, new: str) -> None:
    text = f"a;b\n{old};x\n"
    table = read_table(text)
    assert edited(text, table, [0], {"a": NewColumn(np.array([value]), decimals)}) == f"a;b\n{new};x\n"


CELLS = st.one_of(
    st.floats(-1e3, 1e3).map(repr), st.sampled_from(["", "nan", '"0.5"', ' "a ""b"" c"', "x", " 1.25 ", '"1e-3" '])
)


@given(
    st.lists(st.lists(CELLS, min_size=4, max_size=4), min_size=2, max_size=6),
    st.sampled_from([",", ";", "\t"]),
    st.sampled_from(["\n", "\r\n"]),
    st.integers(0, 3),
)
def test_the_cells_are_those_of_the_reader(rows: list[list[str]], sign: str, end: str, column: int) -> None:
    for row in rows:
        row[column] = row[column] if row[column].strip(' "')[-1:].isdigit() else "0.125"
    text = end.join(["# made: by hand", sign.join("abcd"), *(sign.join(row) for row in rows)]) + end
    table = read_table(text)
    name, picked = "abcd"[column], list(range(0, len(table.rows), 2))
    new = np.linspace(5.0, 6.0, len(picked))
    made = edited(text, table, picked, {name: NewColumn(new, 12)})
    again = read_table(made)
    for k, (one, other) in enumerate(zip(table.rows, again.rows, strict=True)):
        assert [cell for j, cell in enumerate(one) if j != column] == [c for j, c in enumerate(other) if j != column]
        if k not in picked:
            assert one == other
    assert np.allclose(again.numbers([name])[0][picked, 0], new, atol=1e-12)
    assert made.count(end) == text.count(end)


def test_words_between_blanks_are_cells_too() -> None:
    text = "t  x   y\n0  1.0   2.0  \n 1  3.0 4.0\n"
    new = {"y": NewColumn(np.array([7.0, 8.0]), 0)}
    assert edited(text, read_table(text), [0, 1], new) == "t  x   y\n0  1.0   7.0  \n 1  3.0 8.0\n"
