"""URDF and MJCF as bodies of a scene: what stands, what follows the motion, what is free."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from linkage_samples import BOX, joint, link, places, random_urdf, urdf

from hhsim.errors import InputError
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.linkage.file import read_linkage
from hhsim.linkage.object_mesh import resolve_object
from hhsim.motion.trajectory import Trajectory
from hhsim.scene.linkage_bodies import free_link, linkage_parts, linkage_things, names_links
from hhsim.scene.parts_of_thing import ThingParts
from hhsim.scene.scene import open_scene

MOMENTS = '<inertia ixx="1e-3" iyy="2e-3" izz="2.5e-3" ixy="1e-4"/>'
INERTIAL = '<inertial><origin xyz="0 0 0.01"/><mass value="{}"/>' + MOMENTS + "</inertial>"
BASE = link(
    "base", BOX.format("0.3 0.2 0.02") + INERTIAL.format(2.0) + '<contact><lateral_friction value="0.9"/></contact>'
)
LID = link(
    "lid", BOX.format("0.3 0.2 0.01").replace("<geometry", '<origin xyz="0 0.1 0"/><geometry') + INERTIAL.format(0.5)
)
HINGE = {"name": "hinge", "origin": 'xyz="0 -0.1 0.0151"', "axis": "1 0 0", "limit": 'lower="0" upper="2"'}


def _laptop(tmp_path: Path, *more: str, **about: str) -> Path:
    path = tmp_path / "laptop.urdf"
    friction = '<dynamics friction="0.05"/>'
    path.write_text(urdf(BASE, LID, joint("base", "lid", **({"more": friction} | HINGE | about)), *more))
    return path


def _moved(**joints: list[tuple[float, float]]) -> Any:
    return SimpleNamespace(name="script", joints=tuple(joints.items()))


@pytest.mark.parametrize("seed", range(3))
def test_parts_are_where_the_linkage_has_them_at_each_value(
    tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "thing.urdf"
    path.write_text(random_urdf(seed, 5))
    linkage = read_linkage(path)
    rng = np.random.default_rng(seed)
    ends = {each.name: (rng.uniform(-1.0, 0.0), rng.uniform(0.0, 2.0)) for each in linkage.joints.values()}
    moved = _moved(**{name: [(0.0, first), (1.0, last)] for name, (first, last) in ends.items()})
    # Random links may well begin inside each other.
    monkeypatch.setattr(ThingParts, "require_apart", lambda parts: None)
    found = linkage_parts(path, moved, solid=False)
    poses = found.path(np.array([0.0, 1.0]))
    for row in range(2):
        wanted = places(linkage, {name: values[row] for name, values in ends.items()})
        for part, each in enumerate(linkage.links):
            np.testing.assert_allclose(poses[row, part, :3], wanted[each.name][:3, 3], atol=1e-9)
            np.testing.assert_allclose(rotation_matrix(poses[row, part, 3:]), wanted[each.name][:3, :3], atol=1e-9)


def test_a_joint_stands_at_its_start_or_follows_its_name_its_links_or_the_only_one(tmp_path: Path) -> None:
    path, values = _laptop(tmp_path, limit='lower="0.3" upper="2"'), [(0.0, 0.5), (1.0, 1.0)]
    assert names_links(path)
    still = linkage_parts(path, None, solid=True)
    assert still.thing.joint_values(np.array([0.0, 9.0]))["lid"].tolist() == [0.3, 0.3]
    for name in ("hinge", "lid", "cover"):
        moved = linkage_parts(path, _moved(**{name: values}), solid=True)
        np.testing.assert_allclose(moved.thing.joint_values(np.array([0.0, 0.5, 2.0]))["lid"], [0.5, 0.75, 1.0])
        assert not moved.mesh.warnings
    with pytest.raises(InputError, match=r"laptop\.urdf: unknown joint 'cover': known: hinge, lid"):
        linkage_parts(path, _moved(cover=values, lid=values), solid=True)


def test_values_beyond_the_limits_are_taken_the_other_way_round_or_refused(tmp_path: Path) -> None:
    path = _laptop(tmp_path, limit='lower="-2" upper="0"', axis="-1 0 0")
    moved = linkage_parts(path, _moved(lid=[(0.0, 0.2), (1.0, 1.0)]), solid=True)
    np.testing.assert_allclose(moved.thing.joint_values(np.array([0.0, 1.0]))["lid"], [-0.2, -1.0])
    assert moved.mesh.warnings == ("joint 'hinge' turns the other way round than 'lid' in the motion: see its limits",)
    for values in ([(0.0, 0.2), (1.0, 2.5)], [(0.0, 0.2), (1.0, -1.0)]):
        with pytest.raises(
            InputError, match=r"laptop\.urdf: joint 'hinge': motion\[\d\] has the value .*, beyond the limits"
        ):
            linkage_parts(path, _moved(lid=values), solid=True)


def test_links_that_begin_inside_each_other_and_links_on_the_world_alone_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"laptop\.urdf: part 'lid' begins .* mm inside part 'base'"):
        linkage_parts(_laptop(tmp_path, origin='xyz="0 -0.1 0"'), None, solid=True)
    path = tmp_path / "doors.urdf"
    path.write_text(
        urdf(link("world", ""), link("a"), link("b"), joint("world", "a"), joint("world", "b", origin='xyz="1 0 0"'))
    )
    with pytest.raises(
        InputError, match=r"doors\.urdf: links a, b move on the world; expected one that is fixed, or --free"
    ):
        linkage_parts(path, None, solid=True)


def test_a_free_laptop_has_the_masses_inertias_and_frictions_of_the_file(tmp_path: Path) -> None:
    things = linkage_things(_laptop(tmp_path), None, solid=True)
    base, lid = things.settings.thing
    assert (base.name, base.fixed, base.joint, base.friction) == ("base", False, None, 0.9)
    assert things.settings.table == "under"
    assert lid.hinge is not None and lid.friction == 0.6
    assert (lid.hinge.on, lid.hinge.friction, lid.hinge.limits) == ("base", 0.05, (0.0, 2.0))
    np.testing.assert_allclose(lid.hinge.origin, [0.0, -0.1, 0.0151])
    turn, place = rotation_matrix(quaternion(np.array([0.3, -0.2, 0.5]))), np.array([1.0, 2.0, 3.0])
    free = lid.free_object(things.meshes[1].transformed(turn, place), None, turn, place)
    assert free.mass == 0.5
    np.testing.assert_allclose(free.center, turn @ [0.0, -0.1, 0.0251] + place)
    inertia = np.array([[1e-3, 1e-4, 0.0], [1e-4, 2e-3, 0.0], [0.0, 0.0, 2.5e-3]])
    np.testing.assert_allclose(free.inertia, turn @ inertia @ turn.T, atol=1e-12)


def test_on_the_world_the_root_is_fixed_and_what_the_motion_moves_is_driven(tmp_path: Path) -> None:
    fixed = link("world", ""), joint("world", "base", "fixed")
    things = linkage_things(_laptop(tmp_path, *fixed), None, solid=True)
    assert [(one.name, one.fixed) for one in things.settings.thing] == [("lid", False), ("base", True)]
    assert things.settings.table == "none"
    block = link("block", BOX.format("0.04 0.04 0.04")), joint("base", "block", "prismatic", origin='xyz="0 0.5 0"')
    driven = linkage_things(_laptop(tmp_path, *fixed, *block), _moved(hinge=[(0.0, 0.5), (1.0, 1.0)]), solid=True)
    assert [one.name for one in driven.settings.thing] == ["block", "base", "lid"]
    lid, drive = driven.settings.thing[2], driven.drives[2]
    assert lid.driven is not None and drive is not None
    at_end = drive(np.array([1.0]))
    wanted = places(read_linkage(tmp_path / "laptop.urdf"), {"hinge": 1.0})["lid"]
    np.testing.assert_allclose(at_end.position[0], wanted[:3, 3], atol=1e-9)
    np.testing.assert_allclose(rotation_matrix(at_end.orientation[0]), wanted[:3, :3], atol=1e-9)
    # Its mesh is where it begins.
    begin = places(read_linkage(tmp_path / "laptop.urdf"), {"hinge": 0.5})["lid"]
    own, _ = resolve_object(tmp_path / "laptop.urdf", link="lid")
    np.testing.assert_allclose(driven.meshes[2].vertices, own.vertices @ begin[:3, :3].T + begin[:3, 3], atol=1e-12)
    with pytest.raises(InputError, match="joint 'hinge' is moved on 'base', which is free; expected one that is fixed"):
        linkage_things(_laptop(tmp_path), _moved(hinge=[(0.0, 0.5)]), solid=True)
    with pytest.raises(InputError, match="the motion moves all of its joints, so nothing is free: leave --free out"):
        linkage_things(_laptop(tmp_path, *fixed), _moved(hinge=[(0.0, 0.5)]), solid=True)


def test_more_links_than_can_be_free_are_refused(tmp_path: Path) -> None:
    rows = (link(f"l{k}") + joint("l0", f"l{k}", origin=f'xyz="0 {k} 0"') for k in range(1, 7))
    path = tmp_path / "many.urdf"
    path.write_text(urdf(link("l0"), *rows))
    with pytest.raises(InputError, match=r"many\.urdf: 7 links; expected up to 6 where one is free"):
        linkage_things(path, None, solid=True)


def test_one_link_is_a_free_object_of_its_own_mass_and_joint(tmp_path: Path) -> None:
    path = tmp_path / "door.urdf"
    path.write_text(urdf(link("world", ""), LID, joint("world", "lid", "revolute", **HINGE)))
    mesh, _ = resolve_object(path)
    motion = _placed()
    turn = rotation_matrix(motion.object_orientation)
    free = free_link(path, mesh.transformed(turn, motion.object_position), motion, {"table": None})
    assert free.mass == 0.5 and free.hinge is not None and free.hinge.limits == (0.0, 2.0)
    np.testing.assert_allclose(free.hinge.axis, turn @ [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(free.hinge.origin, turn @ [0.0, -0.1, 0.0151] + motion.object_position)
    np.testing.assert_allclose(free.center, turn @ [0.0, -0.1, 0.0251] + motion.object_position)
    heavier = free_link(path, mesh, None, {"mass": 3.0, "friction": 0.2})
    assert (heavier.mass, heavier.friction) == (3.0, 0.2)
    np.testing.assert_allclose(heavier.center, mesh.bounds.mean(axis=0), atol=1e-9)
    path.write_text(urdf(link("world", ""), LID, joint("world", "lid", "fixed")))
    with pytest.raises(InputError, match=r"door\.urdf: link 'lid' is fixed to the world, so it cannot be free"):
        free_link(path, mesh, None, {})


def _placed() -> Trajectory:
    time = np.array([0.0, 1.0])
    return Trajectory(
        time=time,
        position=np.zeros((2, 3)),
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
        flexion=np.zeros((2, 5, 3)),
        abduction=np.zeros((2, 5)),
        object_position=np.array([0.1, 0.2, 0.3]),
        object_orientation=quaternion(np.array([0.3, -0.2, 0.5])),
    )


def test_the_laptop_of_the_field_opens(shared_data: Path) -> None:
    scene = open_scene(shared_data / "field" / "laptop.urdf", "open")
    assert scene.parts is not None and scene.parts.names == ("base", "lid")
    lid = scene.parts.values["lid"]
    assert (lid.min(), lid.max()) == (-0.55, -0.35)
