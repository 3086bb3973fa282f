"""Poses of a robot's links against closed forms and yourdfpy, and pairs that always touch against brute force."""

from pathlib import Path

import numpy as np
import pytest
from linkage_samples import joint, link, random_urdf, urdf
from robot_arms import write_arm
from scipy.spatial.transform import Rotation

from hhsim.linkage.file import read_robot
from hhsim.robots.touching_pairs import adjacent_links, drawn_poses, link_poses, touching_pairs

pytestmark = pytest.mark.usefixtures("read_here")


def test_a_fingertip_is_where_the_closed_form_has_it_and_a_mimic_follows(tmp_path: Path) -> None:
    path, first = tmp_path / "finger.urdf", Rotation.from_euler("xyz", (1.2, 0.3, -0.4))
    follows = '<mimic joint="bend" multiplier="0.5" offset="0.1"/>'
    knuckles = (
        joint("palm", "a", name="spread", origin='xyz="0.01 0.03 0.08" rpy="1.2 0.3 -0.4"', axis="1 0 0"),
        joint("a", "b", name="bend", origin='xyz="0 0 0.05"', axis="0 1 0"),
        joint("b", "c", origin='xyz="0 0 0.03"', axis="0 1 0", more=follows),
        joint("c", "tip", "fixed", name="end", origin='xyz="0 0 0.02"'),
    )
    path.write_text(urdf(*(link(name) for name in ("palm", "a", "b", "c", "tip")), *knuckles))
    spread, bend = 0.7, 1.1
    values = {"spread": np.array([spread]), "bend": np.array([bend]), "end": np.zeros(1)}
    turn, tip = first * Rotation.from_euler("x", spread), np.array([0.01, 0.03, 0.08])
    for angle, length in ((0.0, 0.05), (bend, 0.03), (0.5 * bend + 0.1, 0.02)):
        turn = turn * Rotation.from_euler("y", angle)
        tip = tip + turn.apply([0.0, 0.0, length])
    np.testing.assert_allclose(link_poses(read_robot(path), values, None)["tip"][1][0], tip, atol=1e-12)


@pytest.mark.parametrize("seed", [1, 2])
def test_links_are_where_yourdfpy_has_them(tmp_path: Path, seed: int) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    path = tmp_path / "robot.urdf"
    path.write_text(random_urdf(seed))
    robot, other = read_robot(path), yourdfpy.URDF.load(str(path))
    rng = np.random.default_rng(seed)
    values = {each.name: rng.uniform(-1.0, 1.0, 1) for each in robot.joints}
    other.update_cfg({name: value[0] for name, value in values.items() if name in other.actuated_joint_names})
    for name, (turn, place) in link_poses(robot, values, None).items():
        if name:
            expected = other.get_transform(name)
            np.testing.assert_allclose(turn[0], expected[:3, :3], atol=1e-9)
            np.testing.assert_allclose(place[0], expected[:3, 3], atol=1e-9)


def test_loose_joints_move_as_their_type_lets_them(tmp_path: Path) -> None:
    path = tmp_path / "loose.urdf"
    moves = joint("a", "b", "planar", axis="0 0 1"), joint("b", "c", "floating", origin='xyz="0 0 1"')
    path.write_text(urdf(link("a"), link("b"), link("c"), *moves))
    poses = drawn_poses(read_robot(path), 500, np.random.default_rng(0))
    turn, place = poses["b"]
    assert np.abs(place[:, 2]).max() < 1e-12 and np.ptp(place[:, :2], axis=0).min() > 1.5
    np.testing.assert_allclose(turn[:, 2, 2], 1.0, atol=1e-12)
    relative = np.einsum("pji,pj->pi", turn, poses["c"][1] - place) - [0.0, 0.0, 1.0]
    assert np.ptp(relative, axis=0).min() > 1.5


def test_pairs_that_touch_in_every_pose_are_ignored_beside_adjacent_ones(tmp_path: Path) -> None:
    robot = read_robot(write_arm(tmp_path))
    rng = np.random.default_rng(3)
    spheres = {one.name: np.column_stack([rng.normal(0, 0.03, (3, 3)), [0.05, 0.06, 0.07]]) for one in robot.solid}
    found, _ = touching_pairs(robot, spheres, seed=5)
    pairs = {frozenset((one, other)) for one, others in found.items() for other in others}
    adjacent = adjacent_links(robot, spheres)
    assert frozenset(("lower", "ball")) in adjacent, "a frame without shapes is between them"
    poses = drawn_poses(robot, 10_000, np.random.default_rng(5))
    names = [one.name for one in robot.solid]
    expected = set(adjacent)
    for k, one in enumerate(names):
        for other in names[k + 1 :]:
            first, second = (
                np.einsum("pij,nj->pni", poses[name][0], spheres[name][:, :3]) + poses[name][1][:, None]
                for name in (one, other)
            )
            apart = np.linalg.norm(first[:, :, None] - second[:, None], axis=3)
            reach = spheres[one][:, None, 3] + spheres[other][None, :, 3]
            if (apart <= reach).any(axis=(1, 2)).all():
                expected.add(frozenset((one, other)))
    assert pairs == expected and len(expected) > len(adjacent)


@pytest.mark.parametrize(
    ("kind", "reason", "left"), [("always", "Always", ["c"]), ("default", "Always", []), ("adjacent", None, ["b", "c"])]
)
def test_links_that_touch_are_ignored_by_kind_or_told(
    tmp_path: Path, kind: str, reason: str | None, left: list[str]
) -> None:
    # On a hub of no shape: b spins in reach of a, c leaves it, and d only passes by.
    path = tmp_path / "hub.urdf"
    slide = joint("b", "c", "prismatic", axis="1 0 0", limit='lower="0" upper="10"')
    passing = joint("c", "d", "prismatic", axis="0 1 0", limit='lower="0.5" upper="9"')
    names = "a", "h", "b", "c", "d"
    path.write_text(
        urdf(*map(link, names), joint("a", "h", "continuous"), joint("h", "b", "continuous"), slide, passing)
    )
    ball = np.array([[0.0, 0.0, 0.0, 0.1]])
    spheres = {"a": ball, "h": ball + [9.0, 0, 0, 0], "b": ball, "c": ball - [0.05, 0, 0, 0], "d": ball}
    found, touching = touching_pairs(read_robot(path), spheres, kind=kind)
    assert found["a"].get("b") == reason and found["a"]["h"] == found["b"]["c"] == "Adjacent"
    assert found["a"].get("c") == ("Default" if kind == "default" else None)
    assert [pair.other for pair in touching if pair.one == "a"] == left
    if left:
        assert touching[-1].depth == pytest.approx(0.15) and 0.0 < touching[-1].share < 0.2
