"""Retargeting: a motion of the robot itself comes back, ranges hold, depths in closed form, and files that agree."""

import csv
import json
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from conftest import Run
from driven_scenes import swung_result
from hypothesis import given, settings
from hypothesis import strategies as st
from robot_files import BOX, JOINTS, RANGE, write_robot
from scipy.spatial.transform import Rotation
from short_grasp import short_grasp, short_result, short_scene

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.repair.retarget import DEPTH_FRAMES, Retargeted, link_depths, retarget, robot_motion
from hhsim.repair.robot_hand import RobotHand
from hhsim.result.reader import Result
from tools.shapes.generators import cube

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotHand:
    return RobotHand(write_robot(tmp_path_factory.mktemp("robot") / "two.urdf"))


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("result") / "short.h5")


def placed(robot: RobotHand, angles: FloatArray, turn: Rotation, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fingertips and finger bases of a robot in the world at each frame, shapes (T, F, 3)."""
    found = [robot.points(row) for row in angles]
    return tuple(np.array([turn.apply(getattr(f, name)) + shift for f in found]) for name in ("tips", "bases"))  # type: ignore[return-value]


@settings(max_examples=6)
@given(seed=st.integers(0, 10**6))
def test_angles_and_wrist_of_the_robot_itself_come_back(robot: RobotHand, seed: int) -> None:
    random = np.random.default_rng(seed)
    # A straight finger has no way to tell to which side it will bend.
    start = random.uniform(0.3, 1.2, JOINTS) * np.tile([0.5, 1.0, 1.0], 3)
    angles = start + np.linspace(0.0, 0.2, 10)[:, None] * random.uniform(-1.0, 1.0, JOINTS)
    turn, shift = Rotation.random(random_state=seed), random.normal(size=3)
    wanted = placed(robot, angles, turn, shift)
    usual = retarget(robot, *wanted)
    assert usual.error.max() < 1e-5
    # The terms of change make joints follow late where fingertips do not tell: they are what tips leave open.
    with patch.multiple("hhsim.repair.retarget", CHANGE_WEIGHT=1e-7, FIRST_WEIGHT=1e-7):
        motion = retarget(robot, *wanted)
    np.testing.assert_allclose(motion.angles, angles, atol=1e-4)
    np.testing.assert_allclose(motion.position, np.tile(shift, (len(angles), 1)), atol=1e-5)
    assert (Rotation.from_quat(np.roll(motion.orientation, -1, axis=1)) * turn.inv()).magnitude().max() < 1e-4


def test_ranges_hold_where_the_fingertips_are_out_of_reach(robot: RobotHand) -> None:
    tips, bases = placed(robot, np.full((3, JOINTS), 0.6), Rotation.identity(), np.zeros(3))
    motion = retarget(robot, bases + 5.0 * (tips - bases), bases)
    assert (motion.angles >= RANGE[0]).all() and (motion.angles <= RANGE[1]).all()
    assert motion.error.min() > 0.05


def still(robot: RobotHand, positions: FloatArray) -> Retargeted:
    """The robot with straight fingers, its root unturned, at these places."""
    count = len(positions)
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    return Retargeted(np.zeros((count, JOINTS)), positions, quaternion, np.zeros((count, 3)))


def test_depth_of_a_box_in_a_cube_is_as_far_as_it_was_pushed(robot: RobotHand) -> None:
    mesh = cube(0.07)
    pose = robot.shape_poses(np.zeros(JOINTS))
    own = [(shape.vertices @ turn.T + place).max(axis=0) for shape, place, turn in zip(robot.shapes, *pose)]
    index = [shape.link for shape in robot.shapes].index("index_tip")
    depth = np.array([-0.003, 0.001, 0.004])
    # From beside the cube along x, the index finger's box in the middle of a face.
    position = np.array([[-0.035 + d - own[index][0], -pose[0][index][1], -pose[0][index][2]] for d in depth])
    found = link_depths(robot, still(robot, position), mesh)
    np.testing.assert_allclose(found.depth, np.maximum(depth, 0.0), atol=1e-9)
    assert found.link == ("", "index_tip", "index_tip")
    np.testing.assert_array_equal(found.frames, [0, 1, 2])


def test_depth_of_a_small_cube_in_a_link_is_that_of_its_deepest_corner(robot: RobotHand) -> None:
    (place, *_), (turn, *_) = robot.shape_poses(np.zeros(JOINTS))
    small, depth = cube(0.004), 0.0015
    center = place + turn @ [0.5 * BOX[0] + 0.002 - depth, 0.0, 0.0]
    beside = Mesh(small.vertices @ turn.T + center, small.faces)
    found = link_depths(robot, still(robot, np.zeros((1, 3))), beside)
    np.testing.assert_allclose(found.depth, [depth], atol=1e-8)


def test_long_motions_are_measured_at_frames_spread_evenly(robot: RobotHand) -> None:
    far = np.tile([1.0, 0.0, 0.0], (3 * DEPTH_FRAMES, 1))
    found = link_depths(robot, still(robot, far), cube(0.07))
    assert len(found.frames) == DEPTH_FRAMES and found.frames[[0, -1]].tolist() == [0, 3 * DEPTH_FRAMES - 1]
    assert (found.depth == 0.0).all() and set(found.link) == {""}


def test_fingertips_are_the_shown_hands_where_the_object_moves_too(robot: RobotHand, tmp_path: Path) -> None:
    result = swung_result(short_scene(short_grasp(hold=0.01)), tmp_path / "moving.h5")
    assert result.frame
    found = robot_motion(result, robot)
    turns = rotation_matrix(found.motion.orientation)
    own = np.array([robot.points(row).tips for row in found.motion.angles])
    reached = np.einsum("tij,tfj->tfi", turns, own) + found.motion.position[:, None]
    wanted = result["graphic/joints"][:, [FINGERS.index(finger) for finger in robot.fingers], 3]
    np.testing.assert_allclose(np.linalg.norm(reached - wanted, axis=2), found.motion.error, atol=1e-9)


def test_the_command_writes_both_kinds_of_file_and_says_what_is_in_them(
    robot: RobotHand, result: Result, run: Run, tmp_path: Path
) -> None:
    path = write_robot(tmp_path / "two.urdf")
    line = ("retarget", str(result.path), "--robot", str(path))
    answer = run(*line, "--out", "a.npz")
    assert answer.code == 0 and "9 joints of" in answer.out and "written: a.npz" in answer.out
    document = json.loads(run(*line, "--out", "a.csv", "--json").out)
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["joint_names"].tolist() == document["joints"]
        assert arrays["angles"].shape == (result.ticks, JOINTS)
        errors = arrays["fingertip_error"]
        for number, told in enumerate(document["fingertip_error"]):
            assert (told["finger"], told["link"]) == (robot.fingers[number], robot.links[number])
            assert told["max"] == errors[:, number].max() and told["mean"] == pytest.approx(errors[:, number].mean())
        with Path("a.csv").open(encoding="utf-8", newline="") as file:
            heading, *rows = csv.reader(file)
        table = np.array(rows, dtype=np.float64)
        assert heading[:2] == ["time [s]", "thumb_0"] and heading[-1] == "little_error [m]"
        names = ("angles", "root_position", "root_orientation", "fingertip_error")
        np.testing.assert_array_equal(table, np.column_stack([arrays["time"], *(arrays[name] for name in names)]))
    assert document["link_depth"]["ticks"] == min(result.ticks, DEPTH_FRAMES)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--out", "a.h5"), "written as .npz or .csv"),
        (("--out", "a.npz", "--map", "thumb"), "expected finger=link"),
        (("--out", "a.npz", "--map", "toe=a,thumb=b"), "expected finger=link"),
        (("--out", "a.npz", "--map", "thumb=index_tip,index=none"), "unknown link"),
    ],
)
def test_what_cannot_be_done_is_told_in_a_line(
    result: Result, run: Run, tmp_path: Path, more: tuple[str, ...], message: str
) -> None:
    path = write_robot(tmp_path / "two.urdf")
    answer = run("retarget", str(result.path), "--robot", str(path), *more)
    assert answer.code == 2 and message in answer.err and len(answer.err.splitlines()) == 1
    assert not Path("a.npz").exists()
