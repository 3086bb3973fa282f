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
from hhsim.motion.trajectory import Trajectory
from hhsim.scene import declared_bodies
from hhsim.scene.body import Body, Driven, Fixed, Free, HalfSpace
from hhsim.scene.declared_bodies import DeclaredBodies, load_object
from hhsim.trees.triangle_tree import tree_of_any

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
def test_bodies_are_where_the_linkage_has_them_at_each_value(
    tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "thing.urdf"
    path.write_text(random_urdf(seed, 5))
    linkage = read_linkage(path)
    rng = np.random.default_rng(seed)
    ends = {each.name: (rng.uniform(-1.0, 0.0), rng.uniform(0.0, 2.0)) for each in linkage.joints}
    moved = _moved(**{name: [(0.0, first), (1.0, last)] for name, (first, last) in ends.items()})
    # Random links may well begin inside each other.
    monkeypatch.setattr(declared_bodies, "_require_apart", lambda bodies: None)
    poses = load_object(path, moved, solid=False).path(np.array([0.0, 1.0]))
    for row in range(2):
        for name, wanted in places(linkage, {name: values[row] for name, values in ends.items()}).items():
            np.testing.assert_allclose(poses[name].position[row], wanted[:3, 3], atol=1e-9)
            np.testing.assert_allclose(rotation_matrix(poses[name].orientation[row]), wanted[:3, :3], atol=1e-9)


def test_a_joint_stands_at_its_start_or_follows_its_name_its_links_or_the_only_one(tmp_path: Path) -> None:
    path, values = _laptop(tmp_path, limit='lower="0.3" upper="2"'), [(0.0, 0.5), (1.0, 1.0)]
    still = load_object(path)
    assert [(one.name, one.fixed, one.is_free) for one in still.settings] == [
        ("base", True, False),
        ("lid", False, False),
    ]
    assert still.values(np.array([0.0, 9.0]))["lid"].tolist() == [0.3, 0.3]
    for name in ("hinge", "lid", "cover"):
        moved = load_object(path, _moved(**{name: values}))
        np.testing.assert_allclose(moved.values(np.array([0.0, 0.5, 2.0]))["lid"], [0.5, 0.75, 1.0])
        assert not moved.mesh.warnings
    with pytest.raises(InputError, match=r"laptop\.urdf: unknown joint 'cover': known: hinge, lid"):
        load_object(path, _moved(cover=values, lid=values))


def test_values_beyond_the_limits_are_refused(tmp_path: Path) -> None:
    path = _laptop(tmp_path, limit='lower="-2" upper="0"', axis="-1 0 0")
    with pytest.raises(InputError, match=r"laptop\.urdf: joint 'lid': motion\[\d\] has the value .*, beyond the"):
        load_object(path, _moved(lid=[(0.0, 0.2), (1.0, 1.0)]))


def test_links_that_begin_inside_each_other_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"laptop\.urdf: body 'lid' begins in body 'base'"):
        load_object(_laptop(tmp_path, origin='xyz="0 -0.1 0"'))


def test_a_free_laptop_has_the_masses_inertias_and_frictions_of_the_file(tmp_path: Path) -> None:
    base, lid, table = _scene(load_object(_laptop(tmp_path), free={}))
    assert isinstance(base, Body) and isinstance(lid, Body) and isinstance(table, HalfSpace)
    assert isinstance(base.motion, Free) and base.joint is None and base.friction == 0.9
    assert isinstance(lid.motion, Free) and lid.joint is not None and lid.friction == 0.6
    assert (lid.joint.on, lid.joint.friction, lid.joint.limits, lid.joint.value) == ("base", 0.05, (0.0, 2.0), 0.0)
    turn, place = rotation_matrix(PLACED.object_orientation), PLACED.object_position
    np.testing.assert_allclose(lid.joint.axis, turn @ [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(lid.joint.origin, turn @ [0.0, -0.1, 0.0151] + place)
    assert lid.motion.mass == 0.5
    np.testing.assert_allclose(lid.motion.center, turn @ [0.0, -0.1, 0.0251] + place)
    inertia = np.array([[1e-3, 1e-4, 0.0], [1e-4, 2e-3, 0.0], [0.0, 0.0, 2.5e-3]])
    np.testing.assert_allclose(lid.motion.inertia, turn @ inertia @ turn.T, atol=1e-12)


def test_on_the_world_the_root_is_fixed_and_what_the_motion_moves_is_driven(tmp_path: Path) -> None:
    fixed = link("world", ""), joint("world", "base", "fixed")
    base, lid = _scene(load_object(_laptop(tmp_path, *fixed), free={}))
    assert isinstance(base, Body) and isinstance(lid, Body)
    assert isinstance(base.motion, Fixed) and isinstance(lid.motion, Free)
    block = link("block", BOX.format("0.04 0.04 0.04")), joint("base", "block", "prismatic", origin='xyz="0 0.5 0"')
    values = [(0.0, 0.5), (1.0, 1.0)]
    _, lid, free = _scene(load_object(_laptop(tmp_path, *fixed, *block), _moved(hinge=values), free={}))
    assert isinstance(lid, Body) and isinstance(free, Body)
    assert isinstance(lid.motion, Driven) and isinstance(free.motion, Free)
    with pytest.raises(InputError, match="body 'lid' is driven on 'base', which is free; expected one that is not"):
        load_object(_laptop(tmp_path), _moved(hinge=[(0.0, 0.5)]), free={})
    with pytest.raises(InputError, match="nothing is free: its links are fixed to the world, or moved by the motion"):
        load_object(_laptop(tmp_path, *fixed), _moved(hinge=[(0.0, 0.5)]), free={})


def test_more_links_than_can_be_free_are_refused(tmp_path: Path) -> None:
    rows = (link(f"l{k}") + joint("l0", f"l{k}", origin=f'xyz="0 {k} 0"') for k in range(1, 7))
    path = tmp_path / "many.urdf"
    path.write_text(urdf(link("l0"), *rows))
    with pytest.raises(InputError, match=r"many\.urdf: 7 bodies, of which some are free; expected up to 6"):
        load_object(path, free={})


def test_one_link_is_a_free_body_of_its_own_mass_and_joint_or_of_those_that_are_given(tmp_path: Path) -> None:
    path = tmp_path / "door.urdf"
    path.write_text(urdf(link("world", ""), LID, joint("world", "lid", "revolute", **HINGE)))
    (lid,) = _scene(load_object(path, free={}))
    assert isinstance(lid, Body) and isinstance(lid.motion, Free) and lid.joint is not None
    assert (lid.motion.mass, lid.joint.on, lid.joint.limits) == (0.5, "", (0.0, 2.0))
    given = {"mass": 3.0, "friction": 0.2, "table": -1.0}
    heavier, table = _scene(load_object(path, free=given))
    assert isinstance(heavier, Body) and isinstance(heavier.motion, Free) and isinstance(table, HalfSpace)
    assert (heavier.motion.mass, heavier.friction) == (3.0, 0.2)
    # On its hinge it also goes as a motion has it.
    moved = load_object(path, _moved(hinge=[(0.0, 0.0), (1.0, 0.5)]))
    assert moved.values(np.array([1.0]))["lid"].tolist() == [0.5]
    path.write_text(urdf(link("world", ""), LID, joint("world", "lid", "fixed")))
    with pytest.raises(InputError, match=r"door\.urdf: nothing is free"):
        load_object(path, free={})
    with pytest.raises(InputError, match=r"laptop\.urdf: mass is of one body; it has 2, which state their own"):
        load_object(_laptop(tmp_path), free={"mass": 1.0})


PLACED = Trajectory(
    time=np.array([0.0, 1.0]),
    position=np.zeros((2, 3)),
    orientation=np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
    flexion=np.zeros((2, 5, 3)),
    abduction=np.zeros((2, 5)),
    object_position=np.array([0.1, 0.2, 0.3]),
    object_orientation=quaternion(np.array([0.3, -0.2, 0.5])),
)


def _scene(bodies: DeclaredBodies) -> tuple[Body | HalfSpace, ...]:
    return bodies.with_trees(lambda mesh: tree_of_any(mesh, 1)).placed(PLACED.resampled(10.0), PLACED)
