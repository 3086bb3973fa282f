"""Bodies of a file as scenes: what it may say, where joints bring each body, and faults told in one line."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from contact_scenes import transform
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.errors import HhsimError, InputError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.catalogue import body_file_names, names_a_body_file
from hhsim.scene.body import BodySettings, Driven, Fixed, Free, Joint
from hhsim.scene.declared_bodies import DeclaredBodies, load_object
from hhsim.scene.described_scene import FreeWords, SceneWords, load_words
from hhsim.scene.engine_scene import engine_scene
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.scene import open_scene

TWO = """
[[body]]
name = "peg"
box = [0.02, 0.02, 0.06]
position = [0.0, 0.0, 0.03]
mass = 0.05

[[body]]
name = "wall"
box = [0.1, 0.1, 0.1]
position = [0.2, 0.0, 0.05]
fixed = true

[[body]]
name = "table"
plane = "under"
"""
DRIVEN = """joint.type = "slider"
joint.axis = [0.0, 2.0, 0.0]
joint.limits = [0.0, 0.2]
joint.motion = [[0.0, 0.02], [1.0, 0.1]]"""
HINGE = 'joint.type = "hinge"\njoint.axis = [0.0, 0.0, 1.0]\n'


def written(folder: Path, text: str) -> str:
    path = folder / "bodies.toml"
    path.write_text(text)
    return str(path)


def test_a_file_of_bodies_makes_a_scene_of_all_of_them(tmp_path: Path) -> None:
    scene = open_scene(written(tmp_path, TWO), "never", solid=False, level=2)
    peg, wall = scene.solids
    assert isinstance(peg.motion, Free) and peg.motion.mass == 0.05
    assert isinstance(wall.motion, Fixed) and [body.name for body in scene.bodies] == ["peg", "wall", "table"]
    np.testing.assert_allclose(wall.placed_mesh.bounds, [[0.15, -0.05, 0.0], [0.25, 0.05, 0.1]], atol=1e-12)
    np.testing.assert_array_equal(wall.mesh.bounds, [[-0.05] * 3, [0.05] * 3])
    assert scene.plane is not None and scene.plane.height == pytest.approx(0.0, abs=1e-6)
    seen = engine_scene(scene)
    assert seen.free is peg and seen.others == (wall, scene.plane)
    assert seen.parts is not None and seen.parts.names == ("peg", "wall") and seen.parts.free
    assert wall.solid.mass == pytest.approx(1.0)


def test_a_file_of_bodies_says_itself_how_they_move(tmp_path: Path) -> None:
    # Of one body and a plane, too: another mass, friction and table would take the place of what the file says.
    _, peg, _, table = TWO.split("[[body]]")
    for text in (TWO, f"[[body]]{peg}[[body]]{table}"):
        words = SceneWords(object=written(tmp_path, text), trajectory="grasp", free=FreeWords())
        with pytest.raises(InputError, match="says itself how its bodies move"):
            load_words(words)


def test_what_is_free_need_not_come_first_and_places_are_those_of_its_bearer(tmp_path: Path) -> None:
    text = TWO.replace("mass = 0.05", HINGE + 'joint.on = "wall"\njoint.start = 0.5\njoint.limits = [-1.0, 0.6]')
    text = text.replace("[0.0, 0.0, 0.03]", "[-0.2, 0.0, 0.03]")
    first, second, last = text.split("[[body]]")[1:]
    scene = open_scene(written(tmp_path, "".join(f"[[body]]{one}" for one in (second, first, last))), "never", level=2)
    wall, peg = scene.solids
    assert (wall.name, peg.name) == ("wall", "peg") and peg.joint is not None
    np.testing.assert_allclose(peg.position, [0.2 - 0.2 * np.cos(0.5), -0.2 * np.sin(0.5), 0.08], atol=1e-12)
    np.testing.assert_allclose(peg.joint.origin, wall.position, atol=1e-12)
    seen = engine_scene(scene)
    assert seen.parts is not None and seen.parts.names == ("peg", "wall") and seen.free is not None
    assert seen.free.limits == pytest.approx((-1.5, 0.1))


def test_a_driven_body_begins_where_its_joint_has_it_and_goes_on_from_there(tmp_path: Path) -> None:
    word = written(tmp_path, TWO.replace("fixed = true", DRIVEN))
    scene = open_scene(word, "never", solid=False, level=2)
    wall = scene.solids[1]
    np.testing.assert_allclose(wall.placed_mesh.bounds, [[0.15, -0.03, 0.0], [0.25, 0.07, 0.1]], atol=1e-12)
    assert isinstance(wall.motion, Driven)
    wanted = np.interp(scene.ticks.time, [0.0, 1.0], [0.02, 0.1])
    np.testing.assert_allclose(wall.motion.values, wanted, atol=1e-12)
    shift = wall.motion.poses.position - [0.2, 0.0, 0.05]
    np.testing.assert_allclose(shift, wanted[:, None] * [0.0, 1.0, 0.0], atol=1e-12)
    assert (wall.motion.poses.orientation == [1.0, 0.0, 0.0, 0.0]).all()
    script = SimpleNamespace(name="", joints=(("wall", ((0.0, 0.0), (1.0, 0.2))),))
    poses = load_object(word, script, solid=False).poses_at(np.array([0.5]))
    np.testing.assert_allclose(poses["wall"].position, [[0.2, 0.1, 0.05]])
    with pytest.raises(InputError, match="unknown joint 'lid'"):
        load_object(word, SimpleNamespace(name="", joints=(("lid", ((0.0, 0.0),)),)), solid=False)


def test_a_body_is_driven_by_poses_of_a_file_and_stands_before_and_after(tmp_path: Path) -> None:
    angle, rows = np.linspace(0.0, 1.0, 31), np.tile(np.eye(4), (31, 1, 1))
    rows[:, 0, 0] = rows[:, 1, 1] = np.cos(angle)
    rows[:, 1, 0], rows[:, 0, 1] = np.sin(angle), -np.sin(angle)
    rows[:, 0, 3] = 0.2 + 0.1 * angle
    word = recorded(tmp_path, "wall.npy", rows, POSED.replace("[0.2, 0.0, 0.05]", "[0.0, 0.0, 0.05]"))
    found = load_object(word, solid=False).poses_at(np.array([-1.0, 0.0, 0.5, 1.0, 9.0]))["wall"]
    np.testing.assert_allclose(found.position, [[x, 0.0, 0.05] for x in (0.2, 0.2, 0.25, 0.3, 0.3)], atol=1e-9)
    turned = 2.0 * np.arctan2(found.orientation[:, 3], found.orientation[:, 0])
    np.testing.assert_allclose(turned, [0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-9)


def test_joints_that_a_script_moves_are_those_of_the_bodies() -> None:
    close = resolve_trajectory("close")
    with pytest.raises(InputError, match="close moves the joint lid; cube has none"):
        load_object("cube", close)
    with pytest.raises(HhsimError, match="lid"):
        load_object("book", close)


def test_the_catalogue_has_bodies_that_open_and_close_and_others_that_are_free() -> None:
    assert [*map(names_a_body_file, ("laptop", "my/bodies.toml", "cube"))] == [True, True, False]
    loaded = {name: load_object(name) for name in body_file_names()}
    driven = [name for name, bodies in loaded.items() if not any(body.is_free for body in bodies.settings)]
    assert driven == ["book", "laptop", "scissors"]
    assert sorted(loaded.keys() - driven) == ["blocks", "chest", "door", "drawer", "peg", "pot"]
    assert all(bodies.mesh.volume > 0.0 and len(bodies.meshes) > 1 for bodies in loaded.values())


def test_bodies_are_where_their_joints_bring_them_in_the_scene() -> None:
    scene = open_scene("laptop", "open", solid=False, level=2)
    seen = engine_scene(scene)
    parts = seen.parts
    lid = parts.values["lid"]
    assert parts.path.shape == (scene.ticks.tick_count, 2, 7)
    assert lid[0] == 0.35
    turned = rotation_matrix(parts.path[:, 1, 3:])[:, 2]
    assert turned[:, 1] == pytest.approx(-np.sin(lid), abs=1e-12)
    still = np.flatnonzero(np.diff(lid) == 0.0)
    assert np.array_equal(parts.path[still], parts.path[still + 1])
    # Mesh and tree of the scene are those of the first tick.
    first = [rotation_matrix(pose[None, 3:])[0] @ mesh.vertices.T for pose, mesh in zip(parts.path[0], parts.meshes)]
    corners = np.concatenate([turned.T + pose[:3] for turned, pose in zip(first, parts.path[0])])
    assert seen.mesh.vertices == pytest.approx(corners, abs=1e-12)
    assert seen.tree.leaf_count == sum(tree.leaf_count for tree in parts.trees)


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
    "a hand's name": (TWO.replace('"wall"', '"left"'), "a body has the name 'left', which is a hand's"),
    "two weights": (TWO.replace("mass = 0.05", "mass = 0.05\ndensity = 900.0"), "both mass and density"),
    "negative mass": (TWO.replace("mass = 0.05", "mass = -1.0"), "mass"),
    "no such key": (TWO.replace("fixed = true", "glued = true"), "glued"),
    "on a plane": (TWO.replace("mass = 0.05", HINGE + 'joint.on = "table"'), "unknown body 'table'"),
    "fixed on a joint": (TWO.replace("fixed = true", f"fixed = true\n{DRIVEN}"), "'wall' has both fixed and joint"),
    "plane on a joint": (TWO + HINGE, "'table' is a plane, which stays where it is"),
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
    path = written(tmp_path, text)
    with pytest.raises(HhsimError) as raised:
        load_object(path)
    message = str(raised.value)
    assert message.startswith(f"{path}: ")
    assert expected in message
    assert "\n" not in message


RECORDED = BASE + LID.replace("motion = [[0.0, 0.0], [1.0, 1.5]]", 'recording = {{ file = "{}", column = "angle" }}')
ROWS = RECORDED.replace('"angle"', "0, rate = 30.0")
NAMED = RECORDED.replace('"angle"', '"params/obj_arti", rate = 30.0')
POSED = TWO.replace("fixed = true", 'poses = {{ file = "{}", rate = 30.0, unit = "m" }}')
ANGLES = np.linspace(0.0, 1.5, 31, dtype=np.float32)
HELD = np.array({"params": {"obj_arti": ANGLES, "obj_rot": np.zeros((31, 3))}}, dtype=object)
MOTIONS: dict[str, tuple[Any, str]] = {
    # Content of a file of this name beside the bodies', and their text.
    "none": (None, BASE + LID),
    "lid.csv": ("t,angle\n0.0,0.0\n1.0,1.5\n", RECORDED),
    "lid.npz": ({"t": [0.0, 1.0], "angle": [0.0, 1.5]}, RECORDED),
    # ARCTIC's articulation, beside a pose in millimetres.
    "box.object.npy": (np.column_stack([ANGLES, 1e3 * np.ones((31, 6), np.float32)]), ROWS),
    "box.npy": (HELD, NAMED),
}


def recorded(folder: Path, name: str, content: Any, text: str) -> str:
    """Write a file of bodies, and the one beside it that it names."""
    file = folder / name
    if isinstance(content, np.ndarray):
        np.save(file, content)
    elif isinstance(content, dict):
        np.savez(file, **content)
    elif content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return written(folder, text.format(name))


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_by_keyframes_or_of_a_file_is_straight_between_its_values_and_constant_outside(
    name: str, tmp_path: Path
) -> None:
    bodies = load_object(recorded(tmp_path, name, *MOTIONS[name]))
    values = bodies.values(np.array([-1.0, 0.0, 1.0 / 60.0, 0.5, 1.0, 9.0]))
    assert list(values) == ["lid"]
    wanted = [0.0, 0.0, 0.025, 0.75, 1.5, 1.5]
    np.testing.assert_allclose(values["lid"], wanted, rtol=0.0, atol=1e-6 if name.endswith("npy") else 1e-16)


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
    "other key": (HELD, NAMED.replace("obj_arti", "arti"), "'params/arti': did you mean params/obj_arti"),
    "another of its keys": (HELD, NAMED.replace("obj_arti", "obj_rot"), "shapes (31,) and (31, 3)"),
    "a row without a pose": (np.stack([np.eye(4), np.full((4, 4), np.nan)]), POSED, "lacks the pose of row 1"),
    "poses without stamps": (
        np.eye(4)[None],
        POSED.replace(", rate = 30.0", ""),
        "has no stamps; expected rate = 30.0",
    ),
    "no poses": (None, POSED, "no such file"),
    "table beyond": ("t,angle\n0.0,0.0\n1.0,2.5\n", RECORDED, "motion[2] has the value 2.5, beyond the limits"),
    "table with NaN": ("t,angle\n0.0,0.0\n1.0,nan\n", RECORDED, "lacks a number"),
    "other column": ("t,angel\n0.0,0.0\n", RECORDED, "angle"),
    "no table": (None, RECORDED, "lid.csv: "),
}


@pytest.mark.parametrize("fault", RECORDED_FAULTS)
def test_a_fault_of_a_recorded_motion_names_its_file(fault: str, tmp_path: Path) -> None:
    content, text, expected = RECORDED_FAULTS[fault]
    name = "lid.csv" if text is RECORDED else "lid.npy"
    with pytest.raises(InputError) as raised:
        load_object(recorded(tmp_path, name, content, text))
    # Poses are told of by the file of bodies, which names it.
    message = str(raised.value).removeprefix(f"{tmp_path / 'bodies.toml'}: ")
    assert message.startswith(f"{tmp_path / name}: ")
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
    path = written(tmp_path, RECORDED.replace('column = "angle"', keys).format(file))
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
    poses = DeclaredBodies("bodies", bodies, {}).poses_at(np.array([0.0]))

    none, unit, at = Rotation.identity(), np.array(axis) / np.linalg.norm(axis), np.array(position)
    about = transform(none, origin) @ transform(Rotation.from_rotvec(angle * unit)) @ transform(none, -np.array(origin))
    base = transform(none, at)
    lid = base @ about @ transform(Rotation.from_quat(given_turn, scalar_first=True), at)
    drawer = lid @ transform(none, at + shift * np.array(way) / np.linalg.norm(way))
    for name, expected in (("base", base), ("lid", lid), ("drawer", drawer)):
        place, orientation = poses[name]
        assert np.allclose(place[0], expected[:3, 3], atol=1e-12)
        assert np.allclose(rotation_matrix(orientation)[0], expected[:3, :3], atol=1e-12)
