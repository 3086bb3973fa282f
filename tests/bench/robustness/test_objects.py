"""The objects of the hard cases, of spheres and of triangles, and their crossings are what they are said to be."""

import numpy as np
import pytest
from sphere_scenes import brute_pairs

from hhsim.bench.robustness import triangle_cases
from hhsim.bench.robustness.postures import crossings, threaded
from hhsim.bench.robustness.sphere_objects import ball, disc, mould, right_hand, ring
from hhsim.bench.robustness.triangle_objects import ball_mesh, box_mesh, disc_mesh, ring_mesh, roof_mesh
from hhsim.hand.configuration import HandConfiguration
from hhsim.mesh.features import mesh_features
from hhsim.mesh.topology import face_areas
from hhsim.motion.analytic_motion import still
from hhsim.trees.contact_surface import encloses


def test_a_ball_and_a_disc_have_no_holes() -> None:
    tree = ball(1200, 0.038)
    reach = np.linalg.norm(tree.leaf_center, axis=1) + tree.leaf_radius
    np.testing.assert_allclose(reach, 0.038, atol=1e-12)
    random = np.random.default_rng(1)
    direction = random.normal(size=(500, 3))
    # On the sphere through the centres every point is in one of the spheres.
    points = (0.038 - tree.leaf_radius[0]) * direction / np.linalg.norm(direction, axis=1)[:, None]
    gap = np.linalg.norm(points[:, None] - tree.leaf_center, axis=2).min(axis=1) - tree.leaf_radius[0]
    assert gap.max() < 0.0
    leaf = disc(0.045, 0.8e-3, 1e-3)
    assert (leaf.leaf_radius == 0.5e-3).all()
    turn, radius = random.uniform(0.0, 2.0 * np.pi, 500), 0.044 * np.sqrt(random.uniform(0.0, 1.0, 500))
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(500)], axis=1)
    gap = np.linalg.norm(points[:, None] - leaf.leaf_center, axis=2).min(axis=1) - 0.5e-3
    assert gap.max() < 0.0


def test_a_ring_leaves_its_hole_about_its_axis() -> None:
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    center = np.array([0.1, 0.2, 0.3])
    tree = ring(center, axis, 0.01, 2e-3, 80)
    across = tree.leaf_center - center
    np.testing.assert_allclose(across @ axis, 0.0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1) - tree.leaf_radius, 0.01, atol=1e-15)
    away = ring_mesh(center, axis, 0.01, 2e-3).vertices - center
    along = away @ axis
    apart = np.linalg.norm(away - along[:, None] * axis, axis=1)
    np.testing.assert_allclose([apart.min(), apart.max()], [0.01, 0.014], atol=1e-9)
    np.testing.assert_allclose([along.min(), along.max()], [-2e-3, 2e-3], atol=1e-5)


@pytest.mark.parametrize("closed", [False, True])
def test_every_sphere_of_a_mould_is_as_near_as_it_says(closed: bool) -> None:
    pose = still(np.zeros(3), flexion=0.1)
    tree = mould(pose, 300, 0.3e-3, 1e-3, np.random.default_rng(2), closed)
    pairs = brute_pairs(right_hand(), tree.leaf_center, tree.leaf_radius, HandConfiguration(*pose))
    least = pairs.min(axis=0)
    assert least.shape == (300,)
    assert least.min() > 0.25e-3
    assert least.max() < 0.31e-3


def test_crossings_are_counted_through_the_disc_and_not_around_it() -> None:
    def way(*points: tuple[float, float, float]) -> int:
        return crossings(np.array(points)[:, None], 0.05)

    assert way((0.0, 0.0, 0.1), (0.0, 0.0, -0.1)) == 1
    assert way((0.0, 0.0, 0.1), (0.0, 0.0, -0.1), (0.01, 0.0, 0.1)) == 2
    assert way((0.0, 0.0, 0.1), (0.1, 0.0, 0.1), (0.1, 0.0, -0.1), (0.0, 0.0, -0.1)) == 0
    # Where it crosses counts, not where it was before: at x = 0.04, and at x = 0.06.
    assert way((0.0, 0.0, 0.1), (0.08, 0.0, -0.1)) == 1
    assert way((0.0, 0.0, 0.1), (0.12, 0.0, -0.1)) == 0
    assert way((0.0, 0.0, 0.1), (0.01, 0.0, 0.05), (0.02, 0.0, 0.001)) == 0


def test_a_finger_is_in_a_ring_or_it_is_not() -> None:
    line = np.array([[0.0, -0.05, 0.0], [0.0, -0.01, 0.0], [0.0, 0.01, 0.0], [0.0, 0.05, 0.0]])
    center, axis = np.zeros(3), np.array([0.0, 1.0, 0.0])
    shifts = [(0.0, 0.0, 0.0), (0.009, 0.0, 0.0), (0.011, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, -0.2, 0.0)]
    joints = np.array([line + shift for shift in shifts])
    np.testing.assert_array_equal(threaded(joints, center, axis, 0.01), [True, True, False, False, False])
    # In and out again is not in.
    bent = np.array([[[0.0, -0.05, 0.0], [0.0, 0.01, 0.0], [0.001, 0.02, 0.0], [0.002, -0.05, 0.0]]])
    assert not threaded(bent, center, axis, 0.01)[0]


def test_solids_enclose_their_volume() -> None:
    ball, disc = ball_mesh(0.038), disc_mesh(0.045, 1e-3)
    assert len(ball.faces) == 5120
    np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 0.038, atol=1e-15)
    for mesh, volume in (
        (ball, 4.0 / 3.0 * np.pi * 0.038**3),
        (disc, np.pi * 0.045**2 * 1e-3),
        (box_mesh(0.3, 0.2, 1e-9), 0.3 * 0.2 * 1e-9),
        (roof_mesh(0.2, 0.05, 0.04), 0.2 * 0.05 * 0.04),
        (ring_mesh(np.zeros(3), [0.0, 0.0, 1.0], 0.01, 2e-3), 2.0 * np.pi**2 * 0.012 * 2e-3**2),
    ):
        assert encloses(mesh), mesh.name
        np.testing.assert_allclose(mesh.volume, volume, rtol=0.02)


def test_slivers_are_slivers_and_can_be_touched() -> None:
    mesh = triangle_cases._slivers(np.random.default_rng(0))
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    aspect = longest**2 / (2.0 * face_areas(mesh.vertices, mesh.faces))
    assert (aspect > 1e6).sum() > 200
    assert mesh_features(mesh.vertices, mesh.faces, closed=False)[1] == 0
