"""Spheres and pairs of a robot's links: poses against yourdfpy, pairs by brute force, files read back as they were."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from linkage_samples import SHAPES, joint, link, urdf, write_arm
from scipy.spatial.transform import Rotation

from hhsim.errors import InputError
from hhsim.linkage.file import read_robot
from hhsim.robots.formats import FORMATS, RobotSpheres, digits, format_of, read_spheres
from hhsim.robots.link_spheres import build_link, build_links, link_meshes
from hhsim.robots.touching_pairs import adjacent_links, drawn_poses, link_poses, touching_pairs
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import TreeOptions

pytestmark = pytest.mark.usefixtures("read_here")
LINKS = [*SHAPES, "left", "right"]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> RobotSpheres:
    path = write_arm(tmp_path_factory.mktemp("arm"))
    robot = read_robot(path)
    meshes = link_meshes(robot, path)
    built = build_links(robot, meshes, dict.fromkeys(meshes, TreeOptions(leaves=4)))
    ignored = touching_pairs(robot, {name: each.spheres for name, each in built.items()})[0]
    return RobotSpheres(robot, path, tuple(built.values()), ignored)


def test_a_level_of_a_link_is_that_of_its_mesh_and_no_search(arm: RobotSpheres) -> None:
    whole, options = arm.robot.link("base"), TreeOptions(level=1)
    mesh = next(each.mesh for each in arm.links if each.name == whole.name)
    tree = build_sphere_tree(mesh, options)
    found = build_link(whole, mesh, options)
    assert np.array_equal(found.tree.leaf_center, tree.leaf_center) and found.proved


def written(arm: RobotSpheres, name: str) -> Path:
    path = arm.source.with_name(f"spheres{FORMATS[name].suffixes[0]}")
    path.write_bytes(FORMATS[name].write(arm))
    return path


@pytest.mark.parametrize("name", list(FORMATS))
@pytest.mark.quick("urdf", "curobo", "json", "mjcf", "srdf", "xrdf")
def test_what_is_written_has_its_mark_and_is_read_with_every_digit(arm: RobotSpheres, name: str) -> None:
    if name == "mjcf":
        pytest.importorskip("mujoco")
    path = written(arm, name)
    assert FORMATS[name].mark in path.read_bytes() and format_of(path) == name
    found = read_spheres(path)
    assert sorted(found) == sorted(LINKS)
    for name, spheres in arm.spheres.items():
        np.testing.assert_array_equal(found[name], spheres)


def test_a_link_of_a_sphere_is_that_sphere(arm: RobotSpheres) -> None:
    (ball,) = [each for each in arm.links if each.name == "ball"]
    assert ball.spheres.tolist() == [[0.0, 0.0, 0.0, 0.05]] and ball.proved
    assert all(each.proved and each.fit.surface_coverage == 1.0 for each in arm.links)


def test_a_urdf_keeps_all_but_its_collisions(arm: RobotSpheres) -> None:
    before, after = (ElementTree.fromstring(path.read_text()) for path in (arm.source, written(arm, "urdf")))
    counts = {link.get("name"): len(link.findall("collision")) for link in after}
    assert {name: counts[name] for name in LINKS} == {name: len(each) for name, each in arm.spheres.items()}
    assert {shape.tag for shape in after.iterfind("link/collision/geometry/*")} == {"sphere"}
    for root in (before, after):
        for each in root:
            for collision in each.findall("collision"):
                each.remove(collision)
    assert [(each.tag, each.attrib) for each in after.iter()] == [(each.tag, each.attrib) for each in before.iter()]
    assert "<!-- > </link> -->" in written(arm, "urdf").read_text()


def test_yourdfpy_and_mujoco_load_what_is_for_them(arm: RobotSpheres) -> None:
    yourdfpy, mujoco = pytest.importorskip("yourdfpy"), pytest.importorskip("mujoco")
    loaded = yourdfpy.URDF.load(str(written(arm, "urdf")), load_meshes=False, load_collision_meshes=True)
    assert {name: len(link.collisions) for name, link in loaded.link_map.items() if link.collisions} == {
        name: len(each) for name, each in arm.spheres.items()
    }
    model = mujoco.MjModel.from_xml_path(str(written(arm, "mjcf")))
    data = mujoco.MjData(model)
    assert model.ngeom == sum(map(len, arm.spheres.values())) and model.njnt == 5
    values = {"turret_joint": 0.3, "upper_joint": 1.0, "lower_joint": -0.4, "left_joint": 0.03, "right_joint": -0.03}
    for name, value in values.items():
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    loaded.update_cfg({name: value for name, value in values.items() if name != "right_joint"})
    for name in LINKS:
        expected = loaded.get_transform(name)
        np.testing.assert_allclose(data.body(name).xmat.reshape(3, 3), expected[:3, :3], atol=1e-9)
        np.testing.assert_allclose(data.body(name).xpos, expected[:3, 3], atol=1e-9)
        own = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == data.body(name).id]
        np.testing.assert_allclose(model.geom_pos[own], arm.spheres[name][:, :3], atol=1e-12)


NUMBER, TEXT = float, str
SPHERES = {"center": [NUMBER], "radius": NUMBER}
CUROBO = {
    "format_version": NUMBER,
    "urdf_path": TEXT,
    "asset_root_path": TEXT,
    "base_link": TEXT,
    "tool_frames": [TEXT],
    "collision_link_names": [TEXT],
    "mesh_link_names": [TEXT],
    "collision_sphere_buffer": NUMBER,
    "collision_spheres": {TEXT: [SPHERES]},
    "self_collision_buffer": {TEXT: NUMBER},
    "self_collision_ignore": {TEXT: [TEXT]},
    "cspace": {
        "joint_names": [TEXT],
        "default_joint_position": [NUMBER],
        "cspace_distance_weight": [NUMBER],
        "null_space_weight": [NUMBER],
        "max_acceleration": NUMBER,
        "max_jerk": NUMBER,
    },
}
"""Keys of cuRobo's KinematicsLoaderCfg and CSpaceParams, which take no others, and kinds of their values."""
XRDF = {
    "format": TEXT,
    "format_version": NUMBER,
    "modifiers": [{"set_base_frame": TEXT}],
    "default_joint_positions": {TEXT: NUMBER},
    "cspace": {"joint_names": [TEXT], "acceleration_limits": [NUMBER], "jerk_limits": [NUMBER]},
    "tool_frames": [TEXT],
    "collision": {"geometry": TEXT},
    "self_collision": {"geometry": TEXT, "ignore": {TEXT: [TEXT]}},
    "geometry": {TEXT: {"spheres": {TEXT: [SPHERES]}}},
}
"""Sections of XRDF 1.0 and kinds of their values."""


def require(value: Any, schema: Any, where: str = "") -> None:
    """Hold a document against a schema: every key of it and no other."""
    if isinstance(schema, list):
        assert isinstance(value, list) and value, where
        for each in value:
            require(each, schema[0], where)
    elif isinstance(schema, dict):
        assert isinstance(value, dict) and value, where
        if TEXT not in schema:
            assert sorted(value) == sorted(schema), where
        for key, each in value.items():
            assert isinstance(key, str), where
            require(each, schema.get(key, schema.get(TEXT)), f"{where}/{key}")
    else:
        assert type(value) is schema, f"{where} is {value!r}"


def test_the_file_of_curobo_is_by_its_schema(arm: RobotSpheres) -> None:
    document = yaml.safe_load(written(arm, "curobo").read_text())["robot_cfg"]["kinematics"]
    require(document, CUROBO)
    assert document["format_version"] == 2.0 and document["base_link"] == "base"
    assert Path(document["urdf_path"]) == arm.source.resolve()
    assert document["tool_frames"] == ["left", "right"]
    joints = document["cspace"]["joint_names"]
    assert joints == ["turret_joint", "upper_joint", "lower_joint", "left_joint"], "what mimics is none of them"
    assert document["cspace"]["default_joint_position"] == [0.0, 0.5, 0.0, 0.02]
    assert document["collision_link_names"] == list(document["collision_spheres"]) == list(arm.spheres)
    ignored = document["self_collision_ignore"]
    assert {"upper"} <= set(ignored["turret"]) and "ball" in ignored["lower"]


def test_the_xrdf_is_by_its_schema(arm: RobotSpheres) -> None:
    document = yaml.safe_load(written(arm, "xrdf").read_text())
    require(document, XRDF)
    assert (document["format"], document["format_version"]) == ("xrdf", 1.0)
    (name,) = document["geometry"]
    assert document["collision"]["geometry"] == document["self_collision"]["geometry"] == name
    assert len(document["cspace"]["joint_names"]) == len(document["cspace"]["acceleration_limits"]) == 4


def test_the_srdf_has_the_spheres_and_why_pairs_are_disabled(arm: RobotSpheres) -> None:
    root = ElementTree.fromstring(written(arm, "srdf").read_text())
    found = {each.get("link"): len(each) for each in root.findall("link_sphere_approximation")}
    assert root.get("name") == "arm" and found == {name: len(each) for name, each in arm.spheres.items()}
    pairs = {(each.get("link1"), each.get("link2")): each.get("reason") for each in root.findall("disable_collisions")}
    assert pairs["lower", "ball"] == "Adjacent" and len(pairs) == sum(map(len, arm.ignored.values()))


@pytest.mark.parametrize("value", [1e-9, 1.5e-5, 123.456, -3e-17, 0.1, 2.0])
def test_a_number_is_a_number_to_every_reader_of_yaml(value: float) -> None:
    assert yaml.safe_load(digits(value)) == value and "e" not in digits(value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            "a.yml",
            "collision_spheres: {a: [{center: [0, 0], radius: 1}]}",
            "link 'a': a sphere of centre [0, 0], radius",
        ),
        ("a.yml", "collision_spheres: {a: [{center: [0, 0, .nan], radius: 1}]}", "expected numbers, in metres"),
        ("a.yml", "collision_spheres: franka.yml", "its collision_spheres are in 'franka.yml': name that file"),
        ("a.yml", "collision_spheres: {a: 3}", "no spheres; expected collision_spheres:"),
        ("a.yml", "a: [", "no YAML: "),
        ("a.xrdf", "format: xrdf", "no geometry; expected geometry:"),
        (
            "a.xrdf",
            "geometry: {a: {}}\ncollision: {geometry: b}",
            "its collision geometry is 'b', which it does not have",
        ),
        ("a.json", "[1]", "no spheres; expected {LINK:"),
        ("a.json", '{"a": {"spheres": [3]}}', "'a' has no spheres"),
        ("a.urdf", "<robot", "no XML: "),
        ("a.urdf", "<robot><link name='a'/></robot>", "no link has spheres"),
        ("a.txt", "", "expected spheres of links, a file that ends in"),
        ("gone.yml", None, "No such file or directory; expected spheres of links"),
    ],
)
def test_what_holds_no_spheres_is_one_line(tmp_path: Path, name: str, text: str | None, message: str) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as raised:
        read_spheres(tmp_path / name)
    assert message in str(raised.value) and "\n" not in str(raised.value)


def test_spheres_that_a_planner_switches_off_are_none(tmp_path: Path) -> None:
    (tmp_path / "a.yml").write_text(
        "robot_cfg: {kinematics: {collision_spheres: "
        "{a: [{center: [0, 0, 1], radius: 0.5}], held: [{center: [0, 0, 0], radius: -10}]}}}"
    )
    assert {name: each.tolist() for name, each in read_spheres(tmp_path / "a.yml").items()} == {"a": [[0, 0, 1, 0.5]]}


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
