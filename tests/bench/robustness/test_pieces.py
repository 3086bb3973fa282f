"""Distances to leaf spheres and to triangles by brute force: known answers, and the kernels' beside them."""

from typing import Any

import numpy as np
import pytest
import trimesh
from plain_clearance import brute_clearance
from sphere_scenes import bumpy_ball, cloud

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.pieces import Body, Pieces, Triangles, hand_bodies, hand_distance, pieces_of
from hhsim.bench.robustness.random_targets import RandomTargets
from hhsim.bench.robustness.triangle_objects import ball_mesh, box_mesh, ring_mesh, sheet_mesh
from hhsim.errors import InputError
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import hand_clearance
from hhsim.trees.contact_surface import contact_surface
from hhsim.verify.tree_checks import winding_number

HAND = HandModel.default()
SHAPE = hand_shape(HAND)


def phalanx(a: tuple[float, ...], b: tuple[float, ...], radius_a: float = 0.01, radius_b: float = 0.008) -> Body:
    return Body(np.array([a, b], np.float64), np.array([radius_a, radius_b]))


def ball_at(center: tuple[float, ...], radius: float = 0.01) -> Body:
    return phalanx(center, center, radius, radius)


def hands(seed: int, ticks: int) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Every 60th hand of random targets: on its way through the object, or in it."""
    placed = forward_kinematics(HAND, *RandomTargets(HAND, seed).take(60 * ticks))
    return [(placed.joints[t], placed.position[t], placed.orientation[t]) for t in range(59, 60 * ticks, 60)]


def sampled(body: Body, mesh: Mesh, samples: int = 2001) -> float:
    """Least distance of balls along the axis to the mesh by trimesh, without a sign [m]."""
    share = np.linspace(0.0, 1.0, 1 if body.is_sphere else samples)[:, None]
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    closest: Any = trimesh.proximity.closest_point
    away = closest(surface, body.ends[0] + share * (body.ends[1] - body.ends[0]))[1]
    return float((away - body.radius[0] - share[:, 0] * (body.radius[1] - body.radius[0])).min())


def test_spheres_give_what_brute_force_over_leaves_gives() -> None:
    for tree in (bumpy_ball(300), cloud(np.random.default_rng(3), 120)):
        pieces = pieces_of("spheres", None, tree)
        for shown in hands(1, 8):
            expected = brute_clearance(tree.leaf_center, tree.leaf_radius, *SHAPE, *shown)
            assert hand_distance(pieces, SHAPE, *shown) == expected


def test_a_ball_and_a_phalanx_on_a_plane() -> None:
    plane: Pieces = Triangles(sheet_mesh(1.0, 1.0).triangles)
    assert plane.least(ball_at((0.1, 0.02, 0.03))) == pytest.approx(0.02, abs=1e-15)
    # Both sides of a sheet are outside, and what is cut by it is as deep as it must move.
    assert plane.least(ball_at((0.1, 0.02, -0.03))) == pytest.approx(0.02, abs=1e-15)
    assert plane.least(ball_at((0.1, 0.02, 0.004))) == pytest.approx(-0.006, abs=1e-15)
    lying = phalanx((0.0, 0.05, 0.011), (0.03, 0.05, 0.0105))
    assert plane.least(lying) == pytest.approx(0.001, abs=1e-15)
    # Two triangles, one under it: its least distance, and those of its two ends.
    (found,) = plane.distances([lying])
    assert found.shape == (6,)
    for value in (0.001, 0.0025):
        assert np.isclose(found, value, atol=1e-15).any()
    assert plane.distances([lying, lying]).shape == (2, 6)
    assert Triangles(np.zeros((0, 3, 3))).least(lying) == np.inf


def test_an_axis_across_an_edge_is_nearest_between_its_ends() -> None:
    blade = Triangles(np.array([[[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, -0.1]]]))
    across = phalanx((0.0, -0.02, 0.0101), (0.0, 0.02, 0.0101), 0.01, 0.01)
    assert blade.least(across) == pytest.approx(1e-4, abs=1e-12)


@pytest.mark.parametrize("name", ["bunny", pytest.param("cup", marks=pytest.mark.soak)])
def test_against_a_library_and_the_kernels(name: str) -> None:
    mesh = load_object(name).mesh
    pieces = pieces_of("mesh", mesh, None)
    surface = contact_surface("mesh", mesh, None).arrays
    inside = 0
    for shown in hands(5, 12)[2::4]:
        palm, finger = hand_clearance(surface, *SHAPE, *PlacedHand(*(values[None] for values in shown)), limit=0.05)
        ours = hand_distance(pieces, SHAPE, *shown)
        assert min(ours, 0.05) == pytest.approx(min(palm[0], finger.min()), abs=1e-9)
        inside += ours < -1e-3
    assert inside > 1
    shown = hands(5, 2)[1]
    # Two phalanges and a sphere of the palm.
    for body in hand_bodies(SHAPE, *shown)[:30:13]:
        (unsigned,) = Triangles(mesh.triangles).distances([body])
        assert unsigned.min() == pytest.approx(sampled(body, mesh), abs=1e-7)


def test_near_leaves_out_nothing_that_is_near() -> None:
    mesh = load_object("bunny").mesh
    pieces = Triangles(mesh.triangles)
    for body in hand_bodies(SHAPE, *hands(2, 3)[2])[::7]:
        (everything,), (near,) = pieces.distances([body]), pieces.near(body, 0.02).distances([body])
        assert len(near) < len(everything)
        np.testing.assert_array_equal(np.sort(near[near <= 0.02]), np.sort(everything[everything <= 0.02]))


def test_what_is_inside_is_told_by_the_winding_number() -> None:
    box, ball = box_mesh(0.1, 0.1, 0.1), ball_mesh(0.05, 2)
    for mesh in (box, ball):
        assert winding_number(mesh.triangles, np.array([0.01, 0.02, -0.01])) == pytest.approx(1.0, abs=1e-12)
        assert winding_number(mesh.triangles, np.array([0.1, 0.02, -0.01])) == pytest.approx(0.0, abs=1e-12)
    pieces = pieces_of("mesh", box, None)
    assert pieces.least(ball_at((0.03, 0.0, 0.0))) == pytest.approx(-0.03, abs=1e-15)
    # Of open triangles nothing is inside.
    opened = Mesh(box.vertices, box.faces[2:])
    assert pieces_of("mesh", opened, None).least(ball_at((0.03, 0.0, 0.0))) == pytest.approx(0.01, abs=1e-15)


def test_bodies_together_are_as_near_as_the_nearest_alone() -> None:
    least: list[float] = []
    for mesh in (ball_mesh(0.02, 2), ring_mesh((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.03, 0.02)):
        pieces = pieces_of("mesh", mesh, None)
        for shown in hands(5, 12)[2::4]:
            bodies = hand_bodies(SHAPE, *shown)[::4]
            alone = np.array([pieces.least(body) for body in bodies])
            for part in (slice(None), slice(0, None, 3), slice(3, 12)):
                assert pieces.least(*bodies[part]) == pytest.approx(alone[part].min(), abs=1e-15)
            least.extend(alone)
    # Deeper than a body's radius is inside.
    assert min(least) < -0.02 and max(least) > 0.02


def test_a_hand_that_is_nowhere_has_no_distance() -> None:
    joints, position, orientation = hands(0, 1)[0]
    for pieces in (pieces_of("mesh", box_mesh(0.1, 0.1, 0.1), None), pieces_of("spheres", None, bumpy_ball(100))):
        assert np.isnan(hand_distance(pieces, SHAPE, np.full_like(joints, np.nan), position, orientation))


def test_what_an_object_does_not_have_is_refused() -> None:
    with pytest.raises(InputError, match="this object has no mesh"):
        pieces_of("mesh", None, bumpy_ball(20))
    with pytest.raises(InputError, match="this object has no spheres"):
        contact_surface("spheres", box_mesh(0.1, 0.1, 0.1), None)
