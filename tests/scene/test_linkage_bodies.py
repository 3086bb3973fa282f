"""URDF and MJCF as bodies of a scene: what stands, moves, is free; and how deep bodies are in each other."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from linkage_samples import BOX, joint, link, places, random_urdf, urdf
from mesh_oracle import mesh_of, shift_of_boxes
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.linkage.file import read_linkage
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.motion.analytic_motion import still
from hhsim.motion.trajectory import Trajectory
from hhsim.scene import declared_bodies
from hhsim.scene.body import Body, Driven, Fixed, Free, HalfSpace
from hhsim.scene.declared_bodies import DeclaredBodies, load_object
from hhsim.scene.overlap import Solid, overlap
from hhsim.trees.triangle_tree import tree_of_any
from hhsim.verify.free_object_checks import _Solid

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
    poses = load_object(path, moved, solid=False).poses_at(np.array([0.0, 1.0]))
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


def test_a_free_laptop_has_the_masses_inertias_and_frictions_of_the_file(tmp_path: Path) -> None:
    base, lid, table = _scene(load_object(_laptop(tmp_path), free={}))
    assert isinstance(table, HalfSpace)
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
    assert isinstance(base.motion, Fixed) and isinstance(lid.motion, Free)
    block = link("block", BOX.format("0.04 0.04 0.04")), joint("base", "block", "prismatic", origin='xyz="0 0.5 0"')
    values = [(0.0, 0.5), (1.0, 1.0)]
    _, lid, free = _scene(load_object(_laptop(tmp_path, *fixed, *block), _moved(hinge=values), free={}))
    assert isinstance(lid.motion, Driven) and isinstance(free.motion, Free)
    with pytest.raises(InputError, match="body 'lid' is driven on 'base', which is free; expected one that is not"):
        load_object(_laptop(tmp_path), _moved(hinge=[(0.0, 0.5)]), free={})
    with pytest.raises(InputError, match="nothing is free: its links are fixed to the world, or moved by the motion"):
        load_object(_laptop(tmp_path, *fixed), _moved(hinge=[(0.0, 0.5)]), free={})


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


PLACED = Trajectory(
    np.array([0.0, 1.0]),
    *still(np.zeros(3), ticks=2),
    object_position=np.array([0.1, 0.2, 0.3]),
    object_orientation=quaternion(np.array([0.3, -0.2, 0.5])),
)


def _scene(bodies: DeclaredBodies) -> tuple[Body | HalfSpace, ...]:
    return bodies.with_trees(lambda mesh: tree_of_any(mesh, 1)).placed(PLACED.resampled(10.0), PLACED)


FALSE_DEPTH = 1e-12
"""Rounding of a depth [m]."""
SHARE = 0.25
"""Least share of a depth that is found of boxes in each other."""


def of_scene(one: Mesh, two: Mesh) -> float:
    return overlap(Solid(one), Solid(two))


def of_referee(one: Mesh, two: Mesh) -> float:
    here, there = _Solid(one), _Solid(two)
    still = np.eye(3)[None], np.zeros((1, 3))
    return float(max(here.depths_of(there, *still)[0], there.depths_of(here, *still)[0]))


WAYS = pytest.mark.parametrize("depth", [of_scene, of_referee])


def turned_boxes(rng: np.random.Generator) -> tuple[Mesh, Mesh]:
    """Two boxes anywhere near each other."""
    one, two = (
        box_mesh(rng.uniform(0.002, 0.1, 3).tolist()).transformed(
            Rotation.random(random_state=rng).as_matrix(), 0.02 * rng.normal(size=3)
        )
        for _ in range(2)
    )
    return one, two


def boxes_that_touch(rng: np.random.Generator) -> tuple[Mesh, Mesh]:
    """Two boxes that enter each other by 10 µm to 3 mm with a face each."""
    (a, b), depth, turn = rng.uniform(0.01, 0.1, (2, 3)), 10.0 ** rng.uniform(-5.0, -2.5), Rotation.random(None, rng)
    place = [0.5 * (a[0] + b[0]) - depth, *rng.uniform(-0.01, 0.01, 2)]
    one, two = box_mesh(a), box_mesh(b).transformed(np.eye(3), place)
    return one.transformed(turn.as_matrix(), np.zeros(3)), two.transformed(turn.as_matrix(), np.zeros(3))


@WAYS
@pytest.mark.parametrize("made", [turned_boxes, boxes_that_touch])
def test_no_more_is_found_than_separates_boxes_and_always_a_share_of_it(
    made: Callable[[np.random.Generator], tuple[Mesh, Mesh]], depth: Callable[[Mesh, Mesh], float]
) -> None:
    rng, deep = np.random.default_rng(3), 0
    for _ in range(10):
        pair = made(rng)
        wanted, found = shift_of_boxes(*(box.vertices for box in pair)), depth(*pair)
        assert found <= max(wanted, 0.0) + FALSE_DEPTH
        if wanted > FALSE_DEPTH:
            deep += 1
            assert found > (0.999 if made is boxes_that_touch else SHARE) * wanted
    assert deep >= 4


PLATE, CROSSED = box_mesh([2.0, 3e-5, 2.0]), np.array([0.0153, 0.011, 0.0])
RING = mesh_of(trimesh.creation.annulus(0.0101, 0.02, 0.03, sections=24))
NUT = mesh_of(trimesh.creation.annulus(0.0101, 0.02, 0.03, sections=6))
KNOWN: dict[str, tuple[Mesh, Mesh, float, float]] = {
    # Two meshes, and between what their depth is [m].
    "one in the middle of another": (box_mesh([0.1] * 3), mesh_of(trimesh.creation.icosphere(1, 0.01)), 0.049, 0.06),
    "one in its own place": (NUT, NUT, 0.004, 0.01),
    "thin plates that cross": (PLATE, box_mesh([3e-5, 2.0, 2.0]).transformed(np.eye(3), CROSSED), 0.01, 1.0),
    "a peg in a hole": (RING, mesh_of(trimesh.creation.cylinder(0.01, 0.05, 24)), 0.0, 0.0),
    "a peg too thick for it by 0.1 mm": (RING, mesh_of(trimesh.creation.cylinder(0.0102, 0.05, 24)), 5e-5, 2e-4),
    "a sheet through a block": (
        Mesh(np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.5, 0.0]]), np.array([[0, 1, 2]])),
        box_mesh([0.02] * 3),
        0.009,
        0.011,
    ),
}


@WAYS
@pytest.mark.parametrize("name", KNOWN)
def test_shapes_whose_depth_is_known(name: str, depth: Callable[[Mesh, Mesh], float]) -> None:
    one, two, least, most = KNOWN[name]
    for given in ((one, two), (two, one)):
        assert least <= depth(*given) <= most + FALSE_DEPTH


def test_bodies_that_touch_are_apart() -> None:
    # As near as rounding has it, at the sizes and places that scenes have.
    found: list[float] = []
    for edge in (0.01, 0.1, 0.3, 1.0 / 3.0):
        turn: FloatArray = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
        pair = [box_mesh([edge] * 3).transformed(turn, turn @ [0.1 + k * edge, 0.2, 0.3]) for k in range(2)]
        found += [of_scene(*pair), of_referee(*pair)]
    assert max(found) < FALSE_DEPTH
