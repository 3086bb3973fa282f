"""Joints of bodies: where a joint's value brings each body, and faults told in one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.errors import HhsimError, InputError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.scene.body import BodySettings, Joint
from hhsim.scene.declared_bodies import DeclaredBodies, load_object

BASE = '[[body]]\nname = "base"\nmesh = "cube"\nfixed = true\n'
LID = """[[body]]
name = "lid"
mesh = "cube"
position = [1.0, 0.0, 0.0]
[body.joint]
on = "base"
type = "hinge"
axis = [0.0, 2.0, 0.0]
limits = [0.0, 2.0]
motion = [[0.0, 0.0], [1.0, 1.5]]
"""
BOOK = """[[body]]
name = "back"
box = [0.1, 0.1, 0.01]
fixed = true

[[body]]
name = "front"
box = [0.1, 0.1, 0.01]
position = [0.0, 0.0, {height}]
joint.on = "back"
joint.type = "slider"
joint.axis = [0.0, 0.0, 1.0]
joint.limits = [0.0, 0.1]
joint.motion = [[0.0, 0.0], [1.0, 0.05]]
"""
FAULTS = {
    "overlap": (BOOK.format(height=0.007), "body 'front' begins in body 'back': a shift of 3 mm or more takes them"),
    "crossing": (
        # No corner of one is in the other.
        BOOK.format(height=0.0).replace("[0.1, 0.1, 0.01]", "[0.3, 0.01, 0.01]", 1),
        "a shift of 10 mm or more",
    ),
    "no shape": (BOOK.format(height=0.01).replace("box = [0.1, 0.1, 0.01]\n", "", 1), "no mesh and no box"),
    "two shapes": (BOOK.format(height=0.01).replace("box =", 'mesh = "cube"\nbox =', 1), "both a mesh and a box"),
    "missing mesh": (BOOK.format(height=0.01).replace("box = [0.1, 0.1, 0.01]", 'mesh = "b.ply"', 1), "b.ply"),
    "size": (BOOK.format(height=0.01).replace("[0.1, 0.1, 0.01]", "[0.1, 0.1, 0.0]", 1), "box[3]"),
    "names": (BASE + BASE, "two bodies have the name 'base'"),
    "parent": (BASE + LID.replace('on = "base"', 'on = "bass"'), "'bass'"),
    "circle": (
        LID + LID.replace('name = "lid"', 'name = "base"').replace('on = "base"', 'on = "lid"'),
        "joints in a circle: lid on base on lid",
    ),
    "itself": (BASE + LID.replace('on = "base"', 'on = "lid"'), "joints in a circle: lid on lid"),
    "axis": (BASE + LID.replace("2.0, 0.0]\nlimits", "0.0, 0.0]\nlimits"), "the axis of the hinge has length 0"),
    "not a number": (BASE + LID.replace("1.5", "nan"), "body[2].joint.motion[2]"),
    "limits": (BASE + LID.replace("[0.0, 2.0]\n", "[2.0, 0.0]\n"), "limits are reversed: 2 is above 0"),
    "value": (BASE + LID.replace("1.5", "2.5"), "motion[2] has the value 2.5, beyond the limits; expected 0 to 2 rad"),
    "times": (BASE + LID.replace("[1.0,", "[0.0,"), "motion[2] is at 0 s, not after 0 s"),
    "start": (BASE + LID.replace("motion", "start = 1.0\nmotion"), "both a motion and a start; expected one of them"),
    "begin": (BASE + LID.replace("motion = [[0.0, 0.0], [1.0, 1.5]]", "start = 2.5"), "start has the value 2.5"),
    "free": (BASE.replace("fixed = true", "mass = 1.0") + LID, "body 'lid' is driven on 'base', which is free"),
    "two": (BASE + "poses = { file = 'base.npy' }\n" + LID, "body 'base' has both fixed and poses"),
    "many": (
        "".join(BASE.replace("base", f"b{k}").replace("fixed = true\n", "") for k in range(7)),
        "7 bodies, of which some are free; expected up to 6",
    ),
    "planes": (
        BASE + "".join(f'[[body]]\nname = "{name}"\nplane = "under"\n' for name in ("floor", "table")),
        "bodies floor and table are planes; expected one at most",
    ),
    "only a plane": ('[[body]]\nname = "floor"\nplane = 0.0\n', "body 'floor' is a plane; expected a body with"),
    "inertia": (BASE.replace("fixed = true", "center = [0.0, 0.0, 0.0]"), "one of inertia and center without"),
    "type": (BASE + LID.replace("hinge", "ball"), "ball"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_that_names_the_file_and_what_is_wrong(fault: str, tmp_path: Path) -> None:
    text, expected = FAULTS[fault]
    path = tmp_path / "bodies.toml"
    path.write_text(text)
    with pytest.raises(HhsimError) as raised:
        load_object(path)
    message = str(raised.value)
    assert message.startswith(f"{path}: ")
    assert expected in message
    assert "\n" not in message


def test_a_motion_is_straight_between_its_keyframes_and_constant_outside(tmp_path: Path) -> None:
    path = tmp_path / "bodies.toml"
    path.write_text(BASE + LID)
    values = load_object(path).values(np.array([-1.0, 0.0, 0.5, 1.0, 9.0]))
    assert list(values) == ["lid"]
    assert np.array_equal(values["lid"], [0.0, 0.0, 0.75, 1.5, 1.5])


RECORDED = BASE + LID.replace("motion = [[0.0, 0.0], [1.0, 1.5]]", 'recording = {{ file = "{}", column = "angle" }}')


def test_a_recorded_motion_of_either_kind_is_as_its_keyframes(tmp_path: Path) -> None:
    (tmp_path / "lid.csv").write_text("t,angle\n0.0,0.0\n1.0,1.5\n")
    np.savez(tmp_path / "lid.npz", t=[0.0, 1.0], angle=[0.0, 1.5])
    for file in ("lid.csv", "lid.npz"):
        path = tmp_path / "bodies.toml"
        path.write_text(RECORDED.format(file))
        assert load_object(path).values(np.array([0.5]))["lid"] == 0.75


ROWS = RECORDED.replace('"angle"', "0, rate = 30.0")


def test_arctics_articulation_is_a_column_of_rows_at_a_rate(tmp_path: Path) -> None:
    rows = np.zeros((31, 7), np.float32)
    rows[:, 0] = np.linspace(0.0, 1.5, 31)
    rows[:, 4:] = [1500.0, -900.0, 1200.0]
    np.save(tmp_path / "box.object.npy", rows)
    path = tmp_path / "bodies.toml"
    path.write_text(ROWS.format("box.object.npy"))
    values = load_object(path).values(np.array([0.0, 1.0 / 60.0, 0.5, 1.0, 2.0]))["lid"]
    assert values == pytest.approx([0.0, 0.025, 0.75, 1.5, 1.5], abs=1e-6)


NAMED = RECORDED.replace('"angle"', '"params/obj_arti", rate = 30.0')


def test_an_articulation_in_nested_dictionaries_is_named_by_its_keys(tmp_path: Path) -> None:
    held = {"params": {"obj_arti": np.linspace(0.0, 1.5, 31, dtype=np.float32), "obj_rot": np.zeros((31, 3))}}
    np.save(tmp_path / "box.npy", np.array(held, dtype=object))
    path = tmp_path / "bodies.toml"
    path.write_text(NAMED.format("box.npy"))
    values = load_object(path).values(np.array([0.0, 1.0 / 60.0, 0.5, 2.0]))["lid"]
    assert values == pytest.approx([0.0, 0.025, 0.75, 1.5], abs=1e-6)
    path.write_text(NAMED.replace("obj_arti", "arti").format("box.npy"))
    with pytest.raises(InputError, match=r"box\.npy: .*params/arti.*params/obj_arti"):
        load_object(path)
    path.write_text(NAMED.replace("obj_arti", "obj_rot").format("box.npy"))
    with pytest.raises(InputError, match=r"box\.npy: shapes \(31,\) and \(31, 3\)"):
        load_object(path)


RECORDED_FAULTS: dict[str, tuple[Any, str, str]] = {
    # Content of the file beside the bodies', their text, and what is said of it.
    "one dimension": (np.zeros(7), ROWS, "no column 0 in an array of shape (7,); expected (T, 7)"),
    "column 7": (np.zeros((4, 7)), ROWS.replace("column = 0", "column = 7"), "no column 7 in an array of shape (4, 7)"),
    "column -1": (np.zeros((4, 7)), ROWS.replace("column = 0", "column = -1"), "no column -1"),
    "no rows": (np.zeros((0, 7)), ROWS, "column 0 is empty or lacks a number"),
    "NaN": (np.full((4, 7), np.nan), ROWS, "column 0 is empty or lacks a number"),
    "beyond": (np.full((4, 7), 2.5), ROWS, "motion[1] has the value 2.5, beyond the limits"),
    "words": (np.array([["a"] * 7]), ROWS, "array does not hold"),
    "cut": (b"\x93NUMPY", ROWS, "not an .npy array"),
    "no array": (None, ROWS, "lid.npy: "),
    "table beyond": ("t,angle\n0.0,0.0\n1.0,2.5\n", RECORDED, "motion[2] has the value 2.5, beyond the limits"),
    "table with NaN": ("t,angle\n0.0,0.0\n1.0,nan\n", RECORDED, "lacks a number"),
    "other column": ("t,angel\n0.0,0.0\n", RECORDED, "angle"),
    "no table": (None, RECORDED, "lid.csv: "),
}


@pytest.mark.parametrize("fault", RECORDED_FAULTS)
def test_a_fault_of_a_recorded_motion_names_its_file(fault: str, tmp_path: Path) -> None:
    content, text, expected = RECORDED_FAULTS[fault]
    file = tmp_path / ("lid.csv" if text is RECORDED else "lid.npy")
    if isinstance(content, np.ndarray):
        np.save(file, content)
    elif content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    path = tmp_path / "bodies.toml"
    path.write_text(text.format(file.name))
    with pytest.raises(InputError) as raised:
        load_object(path)
    message = str(raised.value)
    assert message.startswith(f"{file}: ")
    assert expected in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("file", "keys"),
    [
        ("lid.npy", "column = 0"),
        ("lid.npy", 'column = "angle"'),
        ("lid.npy", 'column = 0, rate = 30.0, time = "t"'),
        ("lid.csv", "column = 0, rate = 30.0"),
        ("lid.csv", "column = 0"),
        ("lid.npz", 'column = "angle", rate = 30.0'),
    ],
)
def test_rows_are_named_by_number_and_rate_and_tables_by_names(file: str, keys: str, tmp_path: Path) -> None:
    path = tmp_path / "bodies.toml"
    path.write_text(RECORDED.replace('column = "angle"', keys).format(file))
    with pytest.raises(InputError) as raised:
        load_object(path)
    rows = file.endswith("npy")
    expected = "column = 0 and rate = 30.0, no time" if rows else "names of column and time, no rate"
    assert str(raised.value).startswith(f"{path}: body[2].joint.recording: {file} has ")
    assert str(raised.value).endswith(f"expected {expected}")


three = st.tuples(*[st.floats(-0.5, 0.5)] * 3)
direction = three.filter(lambda axis: np.linalg.norm(axis) > 1e-3)


@given(direction, three, three, direction, st.floats(-3.0, 3.0), st.floats(-0.3, 0.3))
def test_poses_are_the_products_of_homogeneous_matrices(
    axis: tuple[float, float, float],
    origin: tuple[float, float, float],
    position: tuple[float, float, float],
    way: tuple[float, float, float],
    angle: float,
    shift: float,
) -> None:
    hinge = Joint("hinge", axis, origin, (-3.0, 3.0), on="base", motion=((0.0, angle),))
    slider = Joint("slider", way, on="lid", limits=(-0.3, 0.3), motion=((0.0, shift),))
    given: dict[str, Any] = {"mesh": "cube", "position": position}
    given_turn = (0.5, 0.5, -0.5, 0.5)
    # The bodies are not in the order of their joints.
    bodies = (
        BodySettings(name="drawer", joint=slider, **given),
        BodySettings(name="lid", orientation=given_turn, joint=hinge, **given),
        BodySettings(name="base", fixed=True, **given),
    )
    poses = DeclaredBodies("bodies", bodies, {}).path(np.array([0.0]))

    def matrix(turn: Rotation, place: np.ndarray) -> np.ndarray:
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = turn.as_matrix(), place
        return out

    none, unit = Rotation.identity(), np.array(axis) / np.linalg.norm(axis)
    base = matrix(none, np.array(position))
    about = matrix(none, np.array(origin)) @ matrix(Rotation.from_rotvec(angle * unit), np.zeros(3))
    about = about @ matrix(none, -np.array(origin))
    lid = base @ about @ matrix(Rotation.from_quat(np.roll(given_turn, -1)), np.array(position))
    drawer = lid @ matrix(none, np.array(position) + shift * np.array(way) / np.linalg.norm(way))
    for name, expected in (("base", base), ("lid", lid), ("drawer", drawer)):
        place, orientation = poses[name]
        assert np.allclose(place[0], expected[:3, 3], atol=1e-12)
        assert np.allclose(rotation_matrix(orientation)[0], expected[:3, :3], atol=1e-12)
