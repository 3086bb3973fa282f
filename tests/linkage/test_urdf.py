"""URDF: places of links by yourdfpy and MuJoCo, shapes, masses, one link's mesh, and what is refused."""

import os
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import sampled
from linkage_samples import BOX, CUBE, assert_corners, assert_volume, joint, link, places, random_urdf, urdf, write_box

from hhsim.errors import InputError, MeshError
from hhsim.linkage import file as linkage_file
from hhsim.linkage.file import read_linkage, read_robot, resolve_object
from hhsim.linkage.linkage import Robot
from hhsim.mesh.shapes import ENCLOSING, capsule, cylinder
from hhsim.scene.scene import open_scene
from hhsim.system.child_reader import read_in_child

SEEDS = sampled(range(24), lambda place, _: place < 4)
MESH = '<collision><geometry><mesh filename="{}" scale="{}"/></geometry></collision>'


def _read(tmp_path: Path, *content: str, text: str = "", read: Callable[[Path], Any] = read_linkage) -> Any:
    path = tmp_path / "thing.urdf"
    path.write_text(text or urdf(*content))
    return read(path)


def _values(linkage: Robot, seed: int) -> dict[str, float]:
    rng = np.random.default_rng(1000 + seed)
    return {each.name: float(rng.uniform(-1.0, 2.0)) for each in linkage.joints}


@pytest.mark.parametrize("seed", SEEDS)
def test_links_are_where_yourdfpy_has_them(tmp_path: Path, seed: int) -> None:
    yourdfpy = pytest.importorskip("yourdfpy", reason="pip install yourdfpy, the oracle of this test")
    linkage = _read(tmp_path, text=random_urdf(seed))
    robot = yourdfpy.URDF.load(str(tmp_path / "thing.urdf"))
    values = _values(linkage, seed)
    robot.update_cfg(values)
    found = places(linkage, values)
    assert len(found) == 1 + sum(each.type != "fixed" for each in robot.robot.joints)
    for name, place in found.items():
        np.testing.assert_allclose(place, robot.get_transform(name), rtol=0.0, atol=1e-9)
    wanted = []
    for each in robot.robot.links:
        place = robot.get_transform(each.name) @ each.collisions[0].origin
        wanted.append(CUBE * each.collisions[0].geometry.box.size @ place[:3, :3].T + place[:3, 3])
    assert_corners(linkage, found, wanted)


@pytest.mark.parametrize("seed", SEEDS)
def test_mass_centre_and_inertia_of_all_links_are_as_mujoco_has_them(tmp_path: Path, seed: int) -> None:
    mujoco = pytest.importorskip("mujoco")
    linkage = _read(tmp_path, text=random_urdf(seed))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "thing.urdf"))
    data = mujoco.MjData(model)
    values = _values(linkage, seed)
    for name, value in values.items():
        data.joint(name).qpos = value
    mujoco.mj_forward(model, data)
    found = places(linkage, values)
    for each in linkage.links:
        place, body = found[each.name], model.body(each.name).id if each.name in linkage.joint_of else 0
        if body:
            # MuJoCo merges links on fixed joints, too, but for those of the world, which need no mass there.
            np.testing.assert_allclose(place[:3, 3], data.xpos[body], atol=1e-9)
            np.testing.assert_allclose(each.inertial.mass, model.body_mass[body], rtol=1e-9)
            center = place[:3, :3] @ each.inertial.center + place[:3, 3]
            np.testing.assert_allclose(center, data.xipos[body], atol=1e-9)
            turn = data.ximat[body].reshape(3, 3)
            inertia = place[:3, :3] @ each.inertial.inertia @ place[:3, :3].T
            np.testing.assert_allclose(inertia, turn * model.body_inertia[body] @ turn.T, atol=1e-9)


def test_the_example_is_the_shipped_laptop() -> None:
    example = Path(__file__).parents[2] / "examples" / "laptop.urdf"
    scenes = [open_scene(name, "close", level=1) for name in (example, "laptop")]
    for ours, theirs in zip(*(scene.solids for scene in scenes), strict=True):
        assert (ours.name, type(ours.motion)) == (theirs.name, type(theirs.motion))
        np.testing.assert_allclose(ours.placed_mesh.bounds, theirs.placed_mesh.bounds, atol=1e-12)
    lids = [scene.solids[1].joint for scene in scenes]
    assert (lids[0].type, lids[0].on, lids[0].limits) == (lids[1].type, lids[1].on, lids[1].limits)


def test_shapes_are_closed_and_of_their_size_and_what_collides_comes_before_what_is_seen(tmp_path: Path) -> None:
    write_box(tmp_path / "box.obj")
    shapes = {
        '<box size="0.2 0.1 0.3"/>': 0.2 * 0.1 * 0.3,
        '<cylinder radius="0.05" length="0.2"/>': np.pi * 0.05**2 * 0.2,
        '<sphere radius="0.05"/>': 4.0 / 3.0 * np.pi * 0.05**3,
        '<capsule radius="0.05" length="0.2"/>': np.pi * 0.05**2 * 0.2 + 4.0 / 3.0 * np.pi * 0.05**3,
        '<mesh filename="box.obj" scale="0.001 0.001 0.001"/>': 0.1 * 0.06 * 0.02,
        '<mesh filename="box.obj" scale="-0.001 0.002 0.001"/>': 2.0 * 0.1 * 0.06 * 0.02,
        f'<mesh filename="file://{tmp_path}/box.obj" scale="0.001"/>': 0.1 * 0.06 * 0.02,
    }
    for shape, volume in shapes.items():
        seen = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
        for content in (
            f"{seen}<collision><geometry>{shape}</geometry></collision>",
            f"<visual><geometry>{shape}</geometry></visual>",
        ):
            assert_volume(_read(tmp_path, link("a", content)).links[0].triangles, volume, shape)


def test_triangles_of_round_shapes_are_as_far_from_them_as_the_pages_say(repository: Path) -> None:
    away = {"enclose them, by": ENCLOSING - 1.0}
    for words, (vertices, faces) in {
        "triangles, at most": cylinder(1.0, 0.5), "a cylinder and": capsule(1.0, 0.0)
    }.items():  # fmt: skip
        corners = vertices[faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        planes = np.einsum("fi,fi->f", normal, corners[:, 0]) / np.linalg.norm(normal, axis=1)
        # All but the ends of the cylinder.
        away[words] = 1.0 - float(planes[planes > 0.5].min())
    text = " ".join((repository / "docs" / f"{page}.md").read_text("utf-8") for page in ("urdf", "robot-spheres"))
    for words, share in away.items():
        (stated,) = re.findall(rf"{words} ([\d.]+) %", " ".join(text.split()))
        assert 100.0 * share <= float(stated) < 100.0 * share + 0.01, words
    assert ENCLOSING * (1.0 - away["a cylinder and"]) >= 1.0, "or they would not enclose"


def test_a_mesh_of_a_package_is_found_up_the_tree_by_its_folder_or_by_the_rest_of_its_path(tmp_path: Path) -> None:
    (tmp_path / "my_things" / "urdf").mkdir(parents=True)
    (tmp_path / "my_things" / "meshes").mkdir()
    write_box(tmp_path / "my_things" / "meshes" / "box.obj")
    for package in ("my_things", "renamed"):
        path = tmp_path / "my_things" / "urdf" / f"{package}.urdf"
        mesh = MESH.format(f"package://{package}/meshes/box.obj", ".001 .001 .001")
        path.write_text(urdf(link("a", mesh)))
        assert read_linkage(path).links[0].triangles[0].max() == pytest.approx(0.05)


def test_fixed_joints_make_one_link_and_links_without_shapes_fall_away(tmp_path: Path) -> None:
    found = _read(
        tmp_path,
        link("base", ""),
        link("frame"),
        link("handle", BOX.format("0.02 0.02 0.1")),
        link("door"),
        link("tip", ""),
        joint("base", "frame", "fixed", origin='xyz="0 0 0.5"'),
        joint("frame", "door", origin='xyz="0.1 0 0" rpy="0 0 1.5707963267948966"', axis="1 0 0"),
        joint("door", "handle", "fixed", origin='xyz="0 0 0.2"'),
        joint("door", "tip", "prismatic"),
    )
    assert [each.name for each in found.links] == ["base", "door"]
    assert [len(each.shapes) for each in found.links] == [1, 2]
    np.testing.assert_allclose(found.joint_of["door"].origin, [0.1, 0.0, 0.5])
    np.testing.assert_allclose(found.joint_of["door"].axis, [0.0, 1.0, 0.0], atol=1e-12)
    assert found.links[1].shapes[1][0][:, 2].max() == pytest.approx(0.25)
    assert not found.on_world
    assert found.notes == ("link 'tip' has no shape: it is left out, with the joint 'tip_joint'",)


def test_what_is_fixed_to_world_is_on_the_world_and_a_root_without_a_shape_is_the_world(tmp_path: Path) -> None:
    fixed = _read(tmp_path, link("world", ""), link("a"), joint("world", "a", "fixed"))
    assert fixed.on_world and [each.name for each in fixed.links] == ["a"]
    door = _read(tmp_path, link("root", ""), link("a"), joint("root", "a", origin='xyz="0 0 1"'))
    assert door.on_world and door.joint_of["a"].parent == ""
    np.testing.assert_allclose(door.joint_of["a"].frame.position, [0.0, 0.0, 1.0])
    alone = _read(tmp_path, link("a"))
    assert not alone.on_world and not alone.joints


def test_mass_friction_and_start_are_as_stated(tmp_path: Path) -> None:
    inertial = '<inertial><mass value="{}"/><inertia ixx="{}" iyy="1e-3" izz="1e-3"/></inertial>'
    friction = '<contact><lateral_friction value="0.8"/></contact>'
    found = _read(
        tmp_path,
        link("a", BOX.format("1 1 1") + inertial.format(2.0, 1e-3) + friction),
        link("b", BOX.format("1 1 1") + inertial.format(3.0, 5e-3)),
        link("c", BOX.format("1 1 1") + inertial.format(0.0, 0.0)),
        joint("a", "b", limit='lower="0.5" upper="1"', more='<dynamics friction="0.3" damping="2"/>'),
        joint("a", "c", "continuous", axis=""),
    )
    a, b, c = found.links
    assert a.inertial is not None and a.inertial.inertia is not None and a.inertial.mass == 2.0
    assert b.inertial is not None and b.inertial.inertia is None and b.inertial.mass == 3.0, "no solid has such moments"
    assert c.inertial is None
    assert (a.friction, b.friction) == (0.8, None)
    assert (found.joint_of["b"].friction, found.joint_of["b"].start) == (0.3, 0.5)
    assert found.joint_of["c"].limits is None and found.joint_of["c"].axis.tolist() == [1.0, 0.0, 0.0]
    assert found.notes == ("joint 'b_joint': its damping, 2, is left out: hhsim has dry friction alone",)


def test_names_become_those_that_files_can_hold_each_once(tmp_path: Path) -> None:
    found = _read(tmp_path, link("a/b"), link("a b"), joint("a/b", "a b", name="turns here"))
    assert [each.name for each in found.links] == ["a_b", "a_b-2"]
    assert found.joint_of["a_b-2"].parent == "a_b" and found.joint_of["a_b-2"].name == "turns_here"


A, B = link("a"), link("b")
REFUSED = {
    "no XML": ("<robot", r"no XML: .*; expected a URDF or an MJCF file"),
    "other XML": ("<svg/>", r"its first element is <svg>; expected <robot> \(URDF\) or <mujoco> \(MJCF\)"),
    "no links": (urdf(), "no links; expected at least one, with a shape"),
    "no shape": (urdf(link("a", "")), "no link has a collision or a visual shape; expected a mesh, box, cylinder"),
    "planar": (urdf(A, B, joint("a", "b", "planar")), "joint 'b_joint': its type is 'planar'; expected revolute"),
    "floating": (urdf(A, B, joint("a", "b", "floating")), "joint 'b_joint': its type is 'floating'"),
    "unknown type": (urdf(A, B, joint("a", "b", "screw")), "joint 'b_joint': its type is 'screw'; expected revolute"),
    "mimic": (urdf(A, B, joint("a", "b", more='<mimic joint="x"/>')), "joint 'b_joint': it mimics 'x'; .* remove"),
    "missing mesh": (urdf(link("a", MESH.format("gone.stl", "1 1 1"))), "link 'a': mesh 'gone.stl' is missing"),
    "missing package": (
        urdf(link("a", MESH.format("package://p/gone.stl", "1 1 1"))),
        "link 'a': mesh 'package://p/gone.stl' is missing; expected it beside thing.urdf or in a folder above it",
    ),
    "an address": (urdf(link("a", MESH.format("http://x/y.stl", "1"))), r"link \'a\': <mesh"),
    "scaled to 0": (urdf(link("a", MESH.format("box.obj", "0 1 1"))), r'link \'a\': <mesh scale="0 1 1">; .* numbers'),
    "scaled to nothing": (urdf(link("a", MESH.format("box.obj", "1e-9 1e-9 1e-9"))), r"link 'a': <mesh>: its longest"),
    "scaled to all": (urdf(link("a", MESH.format("box.obj", "100 100 100"))), r"link 'a': <mesh>: its longest extent"),
    "no size": (urdf(link("a", BOX.format("0 1 1"))), r'link \'a\': <box size="0 1 1">; expected lengths above 0'),
    "two numbers": (urdf(link("a", BOX.format("1 1"))), r'link \'a\': <box size="1 1">; expected 3'),
    "nan": (urdf(link("a", BOX.format("1 nan 1"))), r'link \'a\': <box size="1 nan 1">; expected 3'),
    "two shapes": (urdf(link("a", "<visual><geometry/></visual>")), "link 'a': <visual> has 0 shapes"),
    "unknown shape": (urdf(link("a", "<visual><geometry><cone/></geometry></visual>")), "link 'a': shape <cone>"),
    "no axis": (urdf(A, B, joint("a", "b", axis="0 0 0")), "joint 'b_joint': its axis is 0 0 0; expected a direction"),
    "no limit": (urdf(A, B, joint("a", "b", limit="")), "joint 'b_joint': no <limit>; .* lower and upper"),
    "limits reversed": (urdf(A, B, joint("a", "b", limit='lower="2" upper="1"')), "joint 'b_joint': its limits are 2"),
    "limits without end": (urdf(A, B, joint("a", "b", limit='lower="-1e9" upper="1e9"')), "its limits are -1e.09"),
    "no link": (urdf(A, joint("a", "c")), "joint 'c_joint': its child is 'c', which is no link of the file"),
    "two parents": (urdf(A, B, link("c"), joint("a", "c"), joint("b", "c", name="k")), "link 'c' is the child of two"),
    "a circle": (urdf(A, B, joint("a", "b"), joint("b", "a")), "joints in a circle: a on b on a; expected one link"),
    "two roots": (urdf(A, B), "links a, b hang on no joint; expected one such link"),
    "named twice": (urdf(A, A), "two links have the name 'a'; expected a name for each"),
    "no name": (urdf("<link/>"), "a <link> without a name; expected one for each"),
    "no shape between": (
        urdf(A, link("b", ""), link("c"), joint("a", "b"), joint("b", "c")),
        "link 'b' has no collision and no visual shape, and moves between the joints 'b_joint' and 'c_joint'",
    ),
    "mass below 0": (
        urdf(link("a", BOX.format("1 1 1") + '<inertial><mass value="-1"/></inertial>')),
        "link 'a': its mass is -1 kg; expected",
    ),
    "far away": (urdf(A, B, joint("a", "b", origin='xyz="1e9 0 0"')), r'joint \'b_joint\': <origin xyz="1e9 0 0">'),
    "xacro": ('<robot xmlns:x="http://x/xacro" name="r"><x:macro/></robot>', "macros of xacro; expected a URDF"),
    "xacro unbound": ('<robot name="r"><xacro:macro/></robot>', "macros of xacro; expected a URDF"),
    "many links": (urdf(*(link(f"l{k}") for k in range(1001))), "1,001 links; expected 1,000 at most"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_cannot_be_used_is_refused_in_one_line(tmp_path: Path, fault: str) -> None:
    write_box(tmp_path / "box.obj")
    text, message = REFUSED[fault]
    with pytest.raises(InputError, match=message) as caught:
        _read(tmp_path, text=text)
    assert str(caught.value).startswith(f"{tmp_path / 'thing.urdf'}: ") and "\n" not in str(caught.value)


def test_no_such_file_folders_and_pipes_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"gone\.urdf: no such file; expected a URDF or an MJCF file"):
        read_linkage(tmp_path / "gone.urdf")
    (tmp_path / "folder.urdf").mkdir()
    with pytest.raises(InputError, match=r"folder\.urdf: a folder; expected"):
        read_linkage(tmp_path / "folder.urdf")
    os.mkfifo(tmp_path / "pipe.urdf")
    with pytest.raises(InputError, match=r"pipe\.urdf: a named pipe, no ordinary file"):
        read_linkage(tmp_path / "pipe.urdf")
    os.mkfifo(tmp_path / "pipe.stl")
    monkeypatch.setattr(linkage_file, "read_in_child", partial(read_in_child, seconds=0))
    with pytest.raises(InputError, match=r"link 'a': mesh 'pipe\.stl' is missing"):
        _read(tmp_path, link("a", MESH.format("pipe.stl", "1")))


def test_entities_without_end_are_refused(tmp_path: Path) -> None:
    entities = '<!ENTITY a "aaaaaaaaaa">' + "".join(
        f'<!ENTITY {chr(98 + k)} "{10 * f"&{chr(97 + k)};"}">' for k in range(9)
    )
    with pytest.raises(InputError, match=r"thing\.urdf: (no XML|cannot be read)"):
        _read(tmp_path, text=f"<!DOCTYPE robot [{entities}]><robot name='&j;'><link name='a'/></robot>")


MASS = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.mark.parametrize(("mass", "kept"), [("1572.9", 1572.9), ("-1", None), ("nan", None), ("heavy", None)])
def test_a_robot_has_any_mass_and_what_is_none_is_noted(tmp_path: Path, mass: str, kept: float | None) -> None:
    heavy = link("b", BOX.format("1 1 1") + MASS.format(mass))
    robot = _read(tmp_path, A, heavy, joint("a", "b"), read=read_robot)
    inertial = robot.link("b").inertial
    assert (inertial and inertial.mass) == kept
    assert [note.partition(":")[0] for note in robot.notes] == ([] if kept else ["link 'b'"])


def test_elements_of_unbound_prefixes_are_left_out(tmp_path: Path) -> None:
    more = '<vendor:acceleration value="2"><child link="c"/></vendor:acceleration>'
    robot = _read(tmp_path, A, B, joint("a", "b", more=more), "<vendor:link name='c'/>", read=read_robot)
    assert [each.name for each in robot.links] == ["a", "b"] and robot.joints[0].child == "b"


def test_a_robot_has_one_root_and_says_what_only_looks(tmp_path: Path) -> None:
    arm = A, link("b", BOX.format("1 1 1").replace("collision", "visual")), joint("a", "b")
    robot = _read(tmp_path, *arm, read=read_robot)
    assert [each.name for each in robot.solid] == ["a"]
    assert robot.notes == ("b: nothing there collides, so without spheres; --visual takes what is seen",)
    seen = _read(tmp_path, *arm, read=partial(read_robot, looks=True))
    assert [each.name for each in seen.solid] == ["a", "b"] and seen.notes == ()
    with pytest.raises(InputError, match=r"thing\.urdf: links a, c hang on no joint; expected one such link"):
        _read(tmp_path, A, B, link("c"), joint("a", "b"), read=read_robot)


def test_a_file_of_one_link_is_its_mesh_where_the_file_begins(tmp_path: Path) -> None:
    turned = joint("root", "a", origin='xyz="0 0 1"', axis="1 0 0", limit='lower="1.5707963267948966" upper="2"')
    mesh, level = _read(tmp_path, link("root", ""), link("a"), turned, read=resolve_object)
    assert (mesh.name, level, len(mesh.faces)) == ("thing", 4, 12)
    np.testing.assert_allclose(mesh.bounds, [[-0.05, -0.01, 0.97], [0.05, 0.01, 1.03]], atol=1e-12)


def test_shapes_that_cross_become_one_solid_and_with_the_mesh_itself_stay(tmp_path: Path) -> None:
    cross = link("a", BOX.format("0.1 0.02 0.02") + BOX.format("0.02 0.1 0.02"))
    whole, _ = _read(tmp_path, cross, read=resolve_object)
    assert whole.volume == pytest.approx(2 * 0.1 * 0.02**2 - 0.02**3, rel=1e-6)
    assert len(_read(tmp_path, cross, read=partial(resolve_object, solid=False))[0].faces) == 24


def test_one_of_several_links_is_named(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(urdf(link("a"), link("b", BOX.format("0.2 0.1 0.1")), joint("a", "b", origin='xyz="0 0 1"')))
    mesh, _ = resolve_object(path, link="b")
    assert mesh.name == "b" and np.allclose(mesh.bounds, [[-0.1, -0.05, -0.05], [0.1, 0.05, 0.05]])
    with pytest.raises(InputError, match=r"two\.urdf: 2 links, a, b; expected one, or the name of one \(--link\)"):
        resolve_object(path)


def test_a_link_that_no_hand_can_use_is_told_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(
        (InputError, MeshError), match=r"thing\.urdf: link 'a': longest extent 30 m: .* is its scale wrong\?"
    ):
        _read(tmp_path, link("a", BOX.format("30 1 1")), read=resolve_object)
