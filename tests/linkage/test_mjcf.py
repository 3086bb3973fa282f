"""MJCF: places of links by MuJoCo, shapes, friction, and what is refused."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import sampled
from linkage_samples import CUBE, assert_corners, assert_volume, places, write_box

from hhsim.errors import InputError
from hhsim.linkage import file as linkage_file
from hhsim.linkage.file import read_linkage, read_robot
from hhsim.linkage.linkage import Mimic, Robot
from hhsim.robots.touching_pairs import link_poses
from hhsim.system.child_reader import read_in_child

mujoco = pytest.importorskip("mujoco", reason="pip install 'hhsim[mjcf]' brings MuJoCo")
SEEDS = sampled(range(24), lambda place, _: place < 4)


def _read(
    tmp_path: Path, world: str, before: str = "", after: str = "", read: Callable[[Path], Robot] = read_linkage
) -> Robot:
    path = tmp_path / "thing.xml"
    path.write_text(f"<mujoco>{before}<worldbody>{world}</worldbody>{after}</mujoco>")
    return read(path)


def _random_bodies(rng: np.random.Generator, count: int = 8) -> str:
    """Bodies in each other, on hinges and slides with anchors and values of their own at the start, or on nothing."""

    def row(*values: float) -> str:
        return " ".join(f"{value:.17g}" for value in values)

    def body(k: int, within: str) -> str:
        type_ = rng.choice(["hinge", "slide", ""])
        start, axis, anchor = rng.uniform(-0.5, 0.5), rng.normal(size=3), rng.uniform(-0.1, 0.1, 3)
        joint = f'<joint name="j{k}" type="{type_}" axis="{row(*axis)}" pos="{row(*anchor)}" ref="{start:.17g}"/>'
        size, at = row(*rng.uniform(0.01, 0.05, 3)), row(*rng.uniform(-0.1, 0.1, 3))
        geom = f'<geom type="box" size="{size}" pos="{at}" euler="10 20 30"/>'
        place = f'pos="{row(*rng.uniform(-0.2, 0.2, 3))}" quat="{row(*rng.normal(size=4))}"'
        return f'<body name="b{k}" {place}>{joint if type_ else ""}{geom}{within}</body>'

    text = ""
    for k in range(count):
        # The next body is in this one, or beside it.
        text = body(k, text) if rng.random() < 0.7 else body(k, "") + text
    return text


@pytest.mark.parametrize("seed", SEEDS)
def test_links_are_where_mujoco_has_them(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    linkage = _read(tmp_path, _random_bodies(rng), '<compiler angle="radian"/>')
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "thing.xml"))
    data = mujoco.MjData(model)
    begin = {each.name: each.start for each in linkage.joints}
    for values in (begin, {name: float(rng.uniform(-2.0, 2.0)) for name in begin}):
        for name, value in values.items():
            data.joint(name).qpos = value
        mujoco.mj_forward(model, data)
        found = places(linkage, values)
        assert len(values) == model.njnt
        for each in linkage.joints:
            body = model.body(each.child).id
            np.testing.assert_allclose(found[each.child][:3, 3], data.xpos[body], atol=1e-9)
            np.testing.assert_allclose(found[each.child][:3, :3], data.xmat[body].reshape(3, 3), atol=1e-9)
        geoms = zip(model.geom_size, data.geom_xmat, data.geom_xpos)
        assert_corners(
            linkage, found, [2.0 * CUBE * size @ turn.reshape(3, 3).T + place for size, turn, place in geoms]
        )


DOOR = """
<geom type="plane" size="1 1 0.1" pos="0 0 -0.01"/>
<body name="frame"><geom name="post" type="box" size="0.02 0.02 0.3"/>
  <body name="leaf" pos="0.03 0 0"><joint name="swing" axis="0 0 1" range="-10 90" frictionloss="0.2" damping="1"/>
    <geom type="box" size="0.2 0.01 0.3" pos="0.21 0 0" friction="0.7 0.01 0" condim="4" mass="1.5"/>
    <geom type="box" size="1 1 1" contype="0" conaffinity="0" mass="0"/>
    <body name="knob" pos="0.38 -0.05 0"><geom size="0.03" friction="0.5" mass="0.1"/></body></body></body>
"""


def test_a_door_has_a_leaf_on_a_hinge_its_friction_and_the_floor_as_its_table(tmp_path: Path) -> None:
    door = _read(tmp_path, DOOR)
    assert [each.name for each in door.links] == ["frame", "leaf"]
    leaf, swing = door.links[1], door.joint_of["leaf"]
    assert [len(each.shapes) for each in door.links] == [1, 2], "what is only seen does not touch"
    assert (swing.type, swing.parent, swing.friction) == ("hinge", "frame", 0.2)
    np.testing.assert_allclose(np.array(swing.limits), np.radians([-10.0, 90.0]))
    assert (leaf.friction, leaf.torsion) == (0.7, 0.01)
    assert leaf.inertial is not None and leaf.inertial.mass == pytest.approx(1.6)
    assert door.on_world and door.table == -0.01
    assert door.notes == ("joint 'swing': its damping is left out: hhsim has dry friction alone",)


def test_shapes_are_of_their_size_and_meshes_are_scaled(tmp_path: Path) -> None:
    write_box(tmp_path / "box.obj")
    asset = '<asset><mesh name="m" file="box.obj" scale="0.001 0.001 0.001"/></asset>'
    ball = 4.0 / 3.0 * np.pi * 0.05**3
    shapes = {
        'type="box" size="0.1 0.05 0.15"': 0.2 * 0.1 * 0.3,
        'type="cylinder" size="0.05 0.1"': np.pi * 0.05**2 * 0.2,
        'type="capsule" fromto="0 0 0 0.2 0 0" size="0.05"': np.pi * 0.05**2 * 0.2 + ball,
        'type="sphere" size="0.05"': ball,
        'type="ellipsoid" size="0.05 0.1 0.05"': 2.0 * ball,
        'type="mesh" mesh="m"': 0.1 * 0.06 * 0.02,
    }
    for shape, volume in shapes.items():
        found = _read(tmp_path, f'<body name="a" pos="0 0 1"><geom {shape} euler="30 0 20"/></body>', asset)
        assert not found.on_world and [each.name for each in found.links] == ["a"]
        vertices, faces = found.links[0].triangles
        assert_volume((vertices, faces), volume, shape)
        assert vertices[:, 2].mean() == pytest.approx(1.0, abs=0.08)


GEOM = '<geom type="box" size="0.1 0.1 0.1"/>'
BODY = f'<body name="a">{{}}{GEOM}</body>'
HINGE = '<joint name="j" axis="0 0 1"/>'
FIXED = "<fixed name='t'><joint joint='j' coef='1'/></fixed>"
HFIELD = "<asset><hfield name='h' nrow='4' ncol='4' size='1 1 1 1'/></asset>"
SOFT = '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" radius=".01" dim="2"/>'
COMPOSITE = '<composite type="cable" curve="s" count="5 1 1" size="1" prefix="c"/>'
WALL = '<geom name="w" type="plane" size="1 1 1" euler="0 90 0"/>'
MESH = "<asset><mesh name='m' file='box.obj' scale='1e-10 1e-10 1e-10'/></asset>"
GONE = "<asset><mesh name='m' file='gone.stl'/></asset>"
OF_MESH = '<body name="a"><geom name="g" type="mesh" mesh="m"/></body>'
TWO = '<joint name="k" axis="1 0 0"/>'
REFUSED = {
    "tendon": (BODY.format(HINGE), "", f"<tendon>{FIXED}</tendon>", "<fixed> 't'; expected joints that move by"),
    "soft": (SOFT, "", "", "<flexcomp> 'cloth'; expected rigid bodies: hhsim has no soft ones"),
    "composite": (f"<body>{COMPOSITE}</body>", "", "", "<composite> ''; expected rigid bodies"),
    "equality": (
        BODY.format(HINGE),
        "",
        "<equality><joint name='e' joint1='j'/></equality>",
        "<joint> 'e'; expected joints",
    ),
    "height field": (f'<geom name="g" type="hfield" hfield="h"/>{BODY.format("")}', HFIELD, "", "'g': its type is"),
    "ball": (BODY.format('<joint name="j" type="ball"/>'), "", "", "joint 'j': its type is ball; expected hinge"),
    "two joints": (BODY.format(HINGE + TWO), "", "", "body 'a': it has 2 joints, 'j', 'k'; expected one a body"),
    "a wall": (WALL + BODY.format(""), "", "", "geom 'w' is a plane; expected a level one of the world, as the table"),
    "nothing": ("", "", "", "no link has a collision or a visual shape"),
    "missing mesh": (OF_MESH, GONE, "", "MuJoCo cannot read it: .*gone.stl"),
    "scaled to nothing": (
        OF_MESH,
        MESH,
        "",
        "(MuJoCo cannot read it: .*mesh|geom 'g': its longest extent is 1e-08 m; .* scale)",
    ),
    "too large": ('<body><geom name="g" type="box" size="1 1 1e5"/></body>', "", "", "geom 'g': its longest extent"),
    "unknown element": ("<cone/>", "", "", "MuJoCo cannot read it: .*cone"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_cannot_be_used_is_refused_in_one_line(tmp_path: Path, fault: str) -> None:
    write_box(tmp_path / "box.obj")
    world, before, after, message = REFUSED[fault]
    with pytest.raises(InputError, match=message) as caught:
        _read(tmp_path, world, before, after)
    assert str(caught.value).startswith(f"{tmp_path / 'thing.xml'}: ") and "\n" not in str(caught.value)


def test_a_file_that_multiplies_itself_is_refused(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linkage_file, "read_in_child", partial(read_in_child, seconds=0))
    for name, message in (
        ("hfield.xml", "breaks down|cannot be read|memory"),
        ("many.xml", "does not end within|joints|links"),
    ):
        with pytest.raises(InputError, match=message):
            read_linkage(shared_data / "field" / "robot" / name)


def test_without_mujoco_it_is_said_what_brings_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linkage_file, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"thing\.xml: an MJCF is read by mujoco, .*: pip install 'hhsim\[mjcf\]'"):
        _read(tmp_path, DOOR)


def test_what_an_included_file_brings_is_refused_too(tmp_path: Path) -> None:
    (tmp_path / "more.xml").write_text(f"<mujoco><tendon>{FIXED}</tendon></mujoco>")
    with pytest.raises(
        InputError, match="a file that it includes has a <tendon>; expected joints that move by themselves"
    ):
        _read(tmp_path, BODY.format(HINGE), "", "<include file='more.xml'/>")


FOLLOWS = (
    '<body name="{0}" pos="0.1 0 0"><joint name="{0}" axis="0 0 1" ref="{1}"/>'
    '<geom size="0.01" pos="0.05 0 0"/>{2}</body>'
)


def test_a_robots_joint_follows_another_by_an_equality_and_other_equalities_are_noted(tmp_path: Path) -> None:
    bodies = FOLLOWS.format("x", 0.2, FOLLOWS.format("y", -0.3, FOLLOWS.format("z", 0.0, "")))
    ties = (
        '<joint joint1="y" joint2="x" polycoef="0.1 -0.5 0 0 0"/><joint joint1="z" joint2="y"/>'
        '<joint joint1="y" joint2="x" active="false"/><joint name="back" joint1="x" joint2="z"/>'
        '<joint name="held" joint1="x"/><joint name="bent" joint1="x" joint2="z" polycoef="0 1 1 0 0"/>'
        '<weld name="tied" body1="x" body2="z"/>'
    )
    robot = _read(tmp_path, bodies, '<compiler angle="radian"/>', f"<equality>{ties}</equality>", read_robot)
    mimics = {each.name: each.mimic for each in robot.joints}
    assert mimics["x"] is None and mimics["z"] == Mimic("y", 1.0, pytest.approx(0.3))
    assert [note.split()[1:3] for note in robot.notes] == [
        [f"'{name}'", f"({kind})"]
        for name, kind in (("back", "joint"), ("held", "joint"), ("bent", "joint"), ("tied", "weld"))
    ]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "thing.xml"))
    data = mujoco.MjData(model)
    x = 0.9
    y = -0.3 + 0.1 - 0.5 * (x - 0.2)
    data.qpos[:] = x, y, y + 0.3
    mujoco.mj_forward(model, data)
    poses = link_poses(robot, {name: np.array([value]) for name, value in zip("xyz", (x, 7.0, 8.0))}, None)
    for name in "xyz":
        np.testing.assert_allclose(poses[name][1][0], data.body(name).xpos, atol=1e-12)


def test_of_a_robot_a_body_that_only_looks_is_noted_and_any_mass_is_taken(tmp_path: Path) -> None:
    seen = '<geom type="box" size="0.1 0.1 0.1" contype="0" conaffinity="0" mass="2000"/>'
    bodies = f"{BODY.format(HINGE)}<body name='seen'>{seen}</body>"
    robot = _read(tmp_path, bodies, read=read_robot)
    assert robot.notes == ("seen: nothing there collides, so without spheres; --visual takes what is seen",)
    found = _read(tmp_path, bodies, read=partial(read_robot, looks=True)).link("seen").inertial
    assert found is not None and found.mass == pytest.approx(2000.0)
