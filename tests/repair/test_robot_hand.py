"""A robot's hand: its points against a chain written out, what mimics, its shapes, and files that are none."""

import os
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robot_files import BASES, BOX, JOINTS, RANGE, expected_tips, write_robot

from hhsim.errors import InputError, UnknownNameError
from hhsim.repair import robot_hand
from hhsim.repair.robot_hand import TIP_RADIUS, RobotHand, find_robot
from hhsim.system.child_reader import read_in_child
from tools.shapes.generators import cube

pytest.importorskip("mujoco")

angle = st.floats(*RANGE)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotHand:
    return RobotHand(write_robot(tmp_path_factory.mktemp("robot") / "two.urdf"))


def test_joints_ranges_and_fingers_are_those_of_the_file(robot: RobotHand) -> None:
    assert robot.fingers == tuple(BASES) == ("thumb", "index", "little")
    assert robot.joints == tuple(f"{finger}_{k}" for finger in BASES for k in range(3))
    assert robot.links == tuple(f"{finger}_tip" for finger in BASES)
    np.testing.assert_array_equal([robot.lower, robot.upper], np.repeat([RANGE], JOINTS, axis=0).T)
    np.testing.assert_allclose(robot.points(np.zeros(JOINTS)).bases, list(BASES.values()), atol=1e-15)


@given(angles=st.lists(angle, min_size=JOINTS, max_size=JOINTS).map(np.array))
def test_fingertips_are_where_the_chain_leads_and_move_as_they_are_said_to(
    robot: RobotHand, angles: np.ndarray
) -> None:
    found = robot.points(angles)
    np.testing.assert_allclose(found.tips, expected_tips(angles), atol=1e-12)
    for joint, step in enumerate(1e-6 * np.eye(JOINTS)):
        difference = (expected_tips(angles + step) - expected_tips(angles - step)) / 2e-6
        np.testing.assert_allclose(found.tips_by_joint[:, :, joint], difference, atol=1e-9)


def test_a_joint_that_mimics_another_one_follows_it(tmp_path: Path) -> None:
    robot = RobotHand(write_robot(tmp_path / "two.urdf", mimic=True))
    assert robot.joints == tuple(f"{finger}_{k}" for finger in BASES for k in range(2))
    a, b, c, d, e, f = angles = np.array([0.3, 0.8, -0.1, 1.2, 0.0, 0.5])
    found = robot.points(angles)
    whole = np.array([a, b, 0.5 * b + 0.1, c, d, 0.5 * d + 0.1, e, f, 0.5 * f + 0.1])
    np.testing.assert_allclose(found.tips, expected_tips(whole), atol=1e-12)
    step = np.append([0.0, 1e-6, 0.5e-6], np.zeros(6))
    difference = (expected_tips(whole + step) - expected_tips(whole - step)) / 2e-6
    np.testing.assert_allclose(found.tips_by_joint[:, :, 1], difference, atol=1e-9)


def test_shapes_are_at_their_links_and_meshes_are_found_beside_the_file(tmp_path: Path) -> None:
    import trimesh

    mesh = cube(0.02)
    (tmp_path / "hand" / "meshes").mkdir(parents=True)
    (tmp_path / "hand" / "urdf").mkdir()
    trimesh.Trimesh(1e3 * mesh.vertices, mesh.faces).export(tmp_path / "hand" / "meshes" / "tip.ply")
    named = '<mesh filename="package://some_hand/meshes/tip.ply" scale="0.001 0.001 0.001"/>'
    robots = [
        RobotHand(write_robot(tmp_path / "hand" / "urdf" / f"{len(shape)}.urdf", shape=shape)) for shape in ("", named)
    ]
    angles = np.full(JOINTS, 0.4)
    for robot, edges in zip(robots, (BOX, (0.02, 0.02, 0.02))):
        assert [shape.link for shape in robot.shapes] == list(robot.links)
        places, turns = robot.shape_poses(angles)
        np.testing.assert_allclose(places, expected_tips(angles), atol=1e-8)
        for shape, turn in zip(robot.shapes, turns):
            assert len(shape.vertices) == 8
            # Along the link, however MuJoCo turned a mesh.
            size = np.ptp(shape.vertices @ turn.T @ robots[0].shape_poses(angles)[1][robot.shapes.index(shape)], axis=0)
            np.testing.assert_allclose(size, edges, atol=1e-7)


def test_of_a_last_link_that_moves_the_tip_is_near_its_end(tmp_path: Path) -> None:
    path = tmp_path / "two.xml"
    finger = (
        '<body name="rh_{0}distal" pos="0 {1} 0"><joint name="{0}J1" axis="0 1 0" range="0 90"/>'
        '<geom type="capsule" size="0.01" fromto="0 0 0 0 0 0.04"/></body>'
    )
    path.write_text(f"<mujoco><worldbody>{finger.format('th', 0)}{finger.format('ff', 0.05)}</worldbody></mujoco>")
    robot = RobotHand(path)
    assert robot.fingers == ("thumb", "index")
    np.testing.assert_allclose(robot.upper, np.pi / 2)
    np.testing.assert_allclose(
        robot.points(np.zeros(2)).tips, [[0, 0, 0.05 - TIP_RADIUS], [0, 0.05, 0.05 - TIP_RADIUS]], atol=1e-9
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no robot", "cannot be read as a robot's URDF or MJCF"),
        ("<svg/>", r"<svg>; expected a URDF"),
        ("<robot name='r'><link name='a'/><joint name='j' type='x'/></robot>", "MuJoCo cannot read it"),
        ("<mujoco/>", "whose joints turn or slide"),
        ("<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>", "on a fixed root"),
    ],
)
def test_files_of_no_hand_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        RobotHand(path)
    assert str(caught.value).startswith(str(path))


def test_links_whose_names_say_nothing_are_listed(tmp_path: Path) -> None:
    path = write_robot(tmp_path / "two.urdf")
    path.write_text(path.read_text().replace("thumb_tip", "a").replace("index_tip", "b").replace("little_tip", "c"))
    with pytest.raises(InputError, match="do not tell the fingers: a, b, c; name them: --map thumb=LINK"):
        RobotHand(path)
    assert RobotHand(path, {"index": "b", "thumb": "a"}).links == ("a", "b")
    with pytest.raises(UnknownNameError, match="'d'"):
        RobotHand(path, {"index": "b", "thumb": "d"})
    with pytest.raises(InputError, match="at least two"):
        RobotHand(path, {"index": "b"})


def test_what_is_not_installed_and_names_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_robot(tmp_path / "two.urdf")
    assert find_robot(str(path)) == path
    with pytest.raises(InputError, match="no such file; expected a URDF or an MJCF, or one of allegro, shadow"):
        find_robot("nowhere.urdf")
    missing = {"mujoco", "robot_descriptions"}
    monkeypatch.setattr(robot_hand, "find_spec", lambda name: None if name in missing else find_spec(name))
    with pytest.raises(InputError, match=r"pip install 'hhsim\[retarget\]'"):
        RobotHand(path)
    with pytest.raises(InputError, match="pip install robot_descriptions, or name a file"):
        find_robot("allegro")
    monkeypatch.setattr(robot_hand, "find_spec", lambda name: name)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"mujoco cannot be loaded .*: pip install 'hhsim\[retarget\]'"):
        RobotHand(path)

    def described(name: str) -> SimpleNamespace:
        if "shadow" in name:
            raise OSError("no\nnetwork")
        return SimpleNamespace(MJCF_PATH_LEFT="left.xml", MJCF_PATH_RIGHT="right.xml")

    monkeypatch.setattr(robot_hand, "import_module", described)
    assert find_robot("allegro", "left") == Path("left.xml")
    with pytest.raises(InputError, match="cannot get the shadow hand: no network"):
        find_robot("shadow")


SHARED = {
    "nan.urdf": r"body_pos of body 'index_tip' is \[0\.02, nan, 0\.0\]; expected numbers up to 1000",
    "hfield.xml": "MuJoCo breaks down over it, as over a shape that is too large",
    "many.xml": "reading it does not end within 1 s",
}


@pytest.mark.parametrize("name", SHARED)
def test_robots_without_bounds_are_refused(name: str, shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_hand, "read_in_child", partial(read_in_child, seconds=0))
    path = shared_data / "field" / "robot" / name
    with pytest.raises(InputError, match=SHARED[name]) as caught:
        RobotHand(path)
    assert str(caught.value).startswith(f"{path}: ")


FINGER = '<body name="th"><joint name="a" range="0 90"/><geom size="{size}"/><site name="s" pos="{place} 0 0"/></body>'


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            FINGER.format(size="1e4", place="0"),
            r"geom_size of geom '.*' is \[10000\.0, .*\]; expected numbers up to 1000",
        ),
        (FINGER.format(size="1", place="-1e9"), "site_pos of site 's' is .*; expected numbers up to 1000"),
        (f'<replicate count="201">{FINGER.format(size="1", place="0")}</replicate>', "201 joints; expected a hand"),
        ('<body><replicate count="3000"><geom size="1"/></replicate></body>', "3,000 shapes; .* 2,000 at most"),
    ],
)
def test_more_or_larger_parts_than_a_hand_has_are_refused(tmp_path: Path, body: str, message: str) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(InputError, match=message):
        RobotHand(path)


def test_a_robot_that_names_a_pipe_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    monkeypatch.setattr(robot_hand, "read_in_child", partial(read_in_child, seconds=0, patience=0.1))
    mesh = '<asset><mesh name="m" file="pipe.stl"/></asset>'
    (tmp_path / "robot.xml").write_text(f"<mujoco>{mesh}<worldbody><geom type='mesh' mesh='m'/></worldbody></mujoco>")
    with pytest.raises(InputError, match="does not end within 1 s"):
        RobotHand(tmp_path / "robot.xml")
    urdf = write_robot(tmp_path / "robot.urdf", shape='<mesh filename="pipe.stl"/>')
    with pytest.raises(InputError, match=r"pipe\.stl: a named pipe, no ordinary file"):
        RobotHand(urdf)


def test_a_joint_that_mimics_by_no_number_is_refused(tmp_path: Path) -> None:
    path = write_robot(tmp_path / "two.urdf", mimic=True)
    path.write_text(path.read_text().replace('multiplier="0.5"', 'multiplier="nan"'))
    with pytest.raises(InputError, match=r"joint 'thumb_2' mimics another nan times, 0\.1 off; expected numbers"):
        RobotHand(path)
