"""Distances to leaf spheres and to triangles by brute force: known answers, and a library's beside them."""

from typing import Any

import numpy as np
import pytest
import trimesh
from plain_clearance import brute_clearance
from sphere_scenes import bumpy_ball, cloud

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.pieces import Body, Triangles, hand_bodies, pieces_of
from hhsim.bench.robustness.random_targets import RandomTargets
from hhsim.bench.robustness.triangle_objects import box_mesh, sheet_mesh
from hhsim.errors import InputError
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.trees.contact_surface import contact_surface

HAND = HandModel.default()
SHAPE = hand_shape(HAND)


def phalanx(a: tuple[float, ...], b: tuple[float, ...], radius_a: float = 0.01, radius_b: float = 0.008) -> Body:
    return Body(np.array([a, b], np.float64), np.array([radius_a, radius_b]))


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
            least = min(pieces.distances([body]).min() for body in hand_bodies(SHAPE, *shown))
            assert least == pytest.approx(brute_clearance(tree.leaf_center, tree.leaf_radius, *SHAPE, *shown))


def test_a_ball_and_a_phalanx_on_a_plane() -> None:
    plane = Triangles(sheet_mesh(1.0, 1.0).triangles)
    # Both sides of a sheet are outside, and what is cut by it is as deep as it must move.
    for height, expected in ((0.03, 0.02), (-0.03, 0.02), (0.004, -0.006)):
        ball = phalanx((0.1, 0.02, height), (0.1, 0.02, height), 0.01, 0.01)
        assert plane.distances([ball]).min() == pytest.approx(expected, abs=1e-15)
    lying = phalanx((0.0, 0.05, 0.011), (0.03, 0.05, 0.0105))
    # Two triangles, one under it: its least distance, and those of its two ends.
    (found,) = plane.distances([lying])
    assert found.shape == (6,) and found.min() == pytest.approx(0.001, abs=1e-15)
    assert np.isclose(found, 0.0025, atol=1e-15).any()
    assert plane.distances([lying, lying]).shape == (2, 6)


def test_an_axis_across_an_edge_is_nearest_between_its_ends() -> None:
    blade = Triangles(np.array([[[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, -0.1]]]))
    across = phalanx((0.0, -0.02, 0.0101), (0.0, 0.02, 0.0101), 0.01, 0.01)
    assert blade.distances([across]).min() == pytest.approx(1e-4, abs=1e-12)


def test_against_a_library() -> None:
    mesh, shown = load_object("bunny").mesh, hands(5, 2)[1]
    # Two phalanges and a sphere of the palm.
    for body in hand_bodies(SHAPE, *shown)[:30:13]:
        assert Triangles(mesh.triangles).distances([body]).min() == pytest.approx(sampled(body, mesh), abs=1e-7)


def test_near_leaves_out_nothing_that_is_near() -> None:
    pieces = Triangles(load_object("bunny").mesh.triangles)
    for body in hand_bodies(SHAPE, *hands(2, 3)[2])[::7]:
        (everything,), (near,) = pieces.distances([body]), pieces.near(body, 0.02).distances([body])
        assert len(near) < len(everything)
        np.testing.assert_array_equal(np.sort(near[near <= 0.02]), np.sort(everything[everything <= 0.02]))


def test_what_an_object_does_not_have_is_refused() -> None:
    with pytest.raises(InputError, match="this object has no mesh"):
        pieces_of("mesh", None, bumpy_ball(20))
    with pytest.raises(InputError, match="this object has no spheres"):
        contact_surface("spheres", box_mesh(0.1, 0.1, 0.1), None)
