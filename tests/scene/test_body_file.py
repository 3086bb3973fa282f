"""Bodies of a file as scenes: what it may say, some of them free, and where the bodies are."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hhsim.errors import HhsimError, InputError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.catalogue import body_file_names, names_a_body_file
from hhsim.mesh.shapes import box_mesh
from hhsim.scene.body import Driven, Fixed, Free
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.scene import open_scene
from hhsim.solver.scene_solver import seen_scene

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
HINGE, SLIDER = (f'joint.type = "{kind}"\njoint.axis = [0.0, 0.0, 1.0]\n' for kind in ("hinge", "slider"))


def written(folder: Path, text: str) -> str:
    path = folder / "two.toml"
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
    seen = seen_scene(scene)
    assert seen.free is peg and seen.others == (wall, scene.plane)
    assert seen.parts is not None and seen.parts.names == ("peg", "wall") and seen.parts.free
    assert wall.solid.mass == pytest.approx(1.0)


def test_what_is_free_need_not_come_first_and_places_are_those_of_its_bearer(tmp_path: Path) -> None:
    text = TWO.replace("mass = 0.05", HINGE + 'joint.on = "wall"\njoint.start = 0.5\njoint.limits = [-1.0, 0.6]')
    text = text.replace("[0.0, 0.0, 0.03]", "[-0.2, 0.0, 0.03]")
    first, second, last = text.split("[[body]]")[1:]
    scene = open_scene(written(tmp_path, "".join(f"[[body]]{one}" for one in (second, first, last))), "never", level=2)
    wall, peg = scene.solids
    assert (wall.name, peg.name) == ("wall", "peg") and peg.joint is not None
    np.testing.assert_allclose(peg.position, [0.2 - 0.2 * np.cos(0.5), -0.2 * np.sin(0.5), 0.08], atol=1e-12)
    np.testing.assert_allclose(peg.joint.origin, wall.position, atol=1e-12)
    seen = seen_scene(scene)
    assert seen.parts is not None and seen.parts.names == ("peg", "wall") and seen.free is not None
    assert seen.free.limits == pytest.approx((-1.5, 0.1))


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('name = "wall"', 'name = "left"', "a body has the name 'left', which is a hand's"),
        ("mass = 0.05", "mass = 0.05\ndensity = 900.0", "both mass and density"),
        ("[0.2, 0.0, 0.05]", "[0.05, 0.0, 0.05]", r"begins in body .* mm or more"),
        ("mass = 0.05", "mass = -1.0", "mass"),
        ("fixed = true", "glued = true", "glued"),
        ("mass = 0.05", HINGE + "joint.limits = [0.1, 1.0]", "start has the value 0, beyond the limits; expected 0.1"),
        ("mass = 0.05", HINGE + 'joint.on = "table"', "unknown body 'table'"),
        ("fixed = true", "fixed = true\n" + HINGE, "'wall' has both fixed and joint"),
        ("mass = 0.05", SLIDER.replace("1.0]", "0.0]"), "the axis of the slider has length 0"),
        ("mass = 0.05", SLIDER + "joint.limits = [0.1, 1.0]", "start has the value 0, beyond the limits"),
        ("fixed = true", f"fixed = true\n{DRIVEN}", "'wall' has both fixed and joint"),
        ('plane = "under"', 'plane = "under"\n' + HINGE, "'table' is a plane, which stays where it is"),
        ("fixed = true", 'poses = { file = "gone.npy", rate = 30.0 }', "gone.npy: no such file"),
    ],
)
def test_bad_files_of_bodies_are_refused_in_one_line(tmp_path: Path, before: str, after: str, message: str) -> None:
    assert before in TWO
    with pytest.raises(InputError, match=message) as refused:
        load_object(written(tmp_path, TWO.replace(before, after)))
    assert "\n" not in str(refused.value)


def test_a_driven_body_begins_where_its_joint_has_it_and_goes_on_from_there(tmp_path: Path) -> None:
    word = written(tmp_path, TWO.replace("fixed = true", DRIVEN))
    scene = open_scene(word, "never", solid=False, level=2)
    wall = scene.solids[1]
    np.testing.assert_allclose(wall.placed_mesh.bounds, [[0.15, -0.03, 0.0], [0.25, 0.07, 0.1]], atol=1e-12)
    assert isinstance(wall.motion, Driven) and wall.motion.values is not None
    wanted = np.interp(scene.ticks.time, [0.0, 1.0], [0.02, 0.1])
    np.testing.assert_allclose(wall.motion.values, wanted, atol=1e-12)
    shift = wall.motion.poses.position - [0.2, 0.0, 0.05]
    np.testing.assert_allclose(shift, wanted[:, None] * [0.0, 1.0, 0.0], atol=1e-12)
    assert (wall.motion.poses.orientation == [1.0, 0.0, 0.0, 0.0]).all()
    script = SimpleNamespace(name="", joints=(("wall", ((0.0, 0.0), (1.0, 0.2))),))
    path = load_object(word, script, solid=False).path(np.array([0.5]))
    np.testing.assert_allclose(path["wall"].position, [[0.2, 0.1, 0.05]])
    with pytest.raises(InputError, match="unknown joint 'lid'"):
        load_object(word, SimpleNamespace(name="", joints=(("lid", ((0.0, 0.0),)),)), solid=False)


def test_a_body_is_driven_by_poses_of_a_file_and_stands_before_and_after(tmp_path: Path) -> None:
    angle, rows = np.linspace(0.0, 1.0, 31), np.tile(np.eye(4), (31, 1, 1))
    rows[:, 0, 0] = rows[:, 1, 1] = np.cos(angle)
    rows[:, 1, 0], rows[:, 0, 1] = np.sin(angle), -np.sin(angle)
    rows[:, 0, 3] = 0.2 + 0.1 * angle
    np.save(tmp_path / "wall.npy", rows)
    given = TWO.replace("fixed = true", 'poses = { file = "wall.npy", rate = 30.0, unit = "m" }')
    word = written(tmp_path, given.replace("[0.2, 0.0, 0.05]", "[0.0, 0.0, 0.05]"))
    found = load_object(word, solid=False).path(np.array([-1.0, 0.0, 0.5, 1.0, 9.0]))["wall"]
    np.testing.assert_allclose(found.position, [[x, 0.0, 0.05] for x in (0.2, 0.2, 0.25, 0.3, 0.3)], atol=1e-9)
    turned = 2.0 * np.arctan2(found.orientation[:, 3], found.orientation[:, 0])
    np.testing.assert_allclose(turned, [0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-9)
    rows[7] = np.nan
    np.save(tmp_path / "wall.npy", rows)
    with pytest.raises(InputError, match="lacks the pose of row 7"):
        load_object(word, solid=False)
    with pytest.raises(InputError, match=r"has no stamps; expected rate = 30\.0"):
        load_object(written(tmp_path, given.replace(", rate = 30.0", "")), solid=False)


def test_joints_that_a_script_moves_are_those_of_the_bodies() -> None:
    close = resolve_trajectory("close")
    with pytest.raises(InputError, match="close moves the joint lid; cube has none"):
        load_object("cube", close)
    with pytest.raises(HhsimError, match="lid"):
        load_object("book", close)


def test_the_catalogue_has_bodies_that_open_and_close_and_others_that_are_free() -> None:
    assert names_a_body_file("laptop")
    assert names_a_body_file("my/bodies.toml")
    assert not names_a_body_file("cube")
    loaded = {name: load_object(name) for name in body_file_names()}
    driven = [name for name, bodies in loaded.items() if not any(body.is_free for body in bodies.settings)]
    assert driven == ["book", "laptop", "scissors"]
    assert sorted(loaded.keys() - driven) == ["blocks", "chest", "door", "drawer", "peg", "pot"]
    assert all(bodies.mesh.volume > 0.0 and len(bodies.meshes) > 1 for bodies in loaded.values())


def test_bodies_are_where_their_joints_bring_them_in_the_scene() -> None:
    scene = open_scene("laptop", "open", solid=False, level=2)
    seen = seen_scene(scene)
    parts = seen.parts
    assert parts is not None
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


def test_values_beyond_the_limits_are_told() -> None:
    script = SimpleNamespace(name="", joints=(("lid", ((0.0, 3.0),)),))
    with pytest.raises(InputError, match=r"joint 'lid': motion\[1\] has the value 3, beyond the limits"):
        load_object("laptop", script)


def test_a_box_is_closed_and_wound_outward() -> None:
    assert box_mesh((1.0, 2.0, 3.0)).volume == pytest.approx(6.0)
