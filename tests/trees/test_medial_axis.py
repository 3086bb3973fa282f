"""Medial balls against closed forms: a ball's, a box's, a cylinder's; and what a Voronoi vertex is."""

import numpy as np
import pytest
from numpy.typing import NDArray

from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.mesh.generators import cube, cylinder, sphere
from hhsim.mesh.mesh import Mesh
from hhsim.trees.error import sample_mesh
from hhsim.trees.medial_axis import medial_axis, refined_medial_axis, with_new_samples

Array = NDArray[np.float64]


def samples(mesh: Mesh, count: int) -> Array:
    return sample_mesh(mesh.vertices, mesh.faces, count, np.random.default_rng(5))


def test_every_ball_touches_four_samples_and_holds_none() -> None:
    mesh = cube(0.1)
    axis = medial_axis(build_mesh_bvh(mesh.vertices, mesh.faces), samples(mesh, 300))
    distance = np.linalg.norm(axis.center[:, None] - axis.sample[None], axis=2)
    assert axis.radius == pytest.approx(distance.min(axis=1), rel=1e-6)
    for ball in range(len(axis.radius)):
        touching = axis.touching[axis.touching[:, 1] == ball, 0]
        assert len(touching) >= 4
        # Where balls are so near each other that they count as one, their samples are nearly as far.
        assert distance[ball, touching] == pytest.approx(axis.radius[ball], abs=3e-5)
    assert axis.depth == pytest.approx((0.05 - np.abs(axis.center)).min(axis=1), abs=1e-12)
    assert (axis.depth > 0.0).all() and (axis.error > -1e-12).all()
    assert np.linalg.norm(axis.closest - axis.center, axis=1) == pytest.approx(axis.depth)


def test_a_ball_has_one_medial_ball() -> None:
    mesh = sphere(0.1, 4)
    axis = medial_axis(build_mesh_bvh(mesh.vertices, mesh.faces), mesh.vertices)
    deepest = axis.depth > 0.04
    assert deepest.any()
    assert np.abs(axis.center[deepest]).max() < 1e-4
    assert axis.depth[deepest] == pytest.approx(0.05, rel=1e-2)


def test_refinement_finds_the_medial_sheets_of_a_box() -> None:
    mesh = cube(0.1)
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces)
    first = medial_axis(bvh, samples(mesh, 100))
    axis = refined_medial_axis(bvh, samples(mesh, 100), 3000)
    assert len(axis.sample) > len(first.sample) and len(axis.depth) >= 2850
    assert (axis.sample[: len(first.sample)] == first.sample).all()
    assert np.median(axis.error) < 0.3 * np.median(first.error)
    # On the medial axis of a cube two faces are equally near: the two largest coordinates are equal. The share of the
    # balls, by how deep they lie, that is near to it grows as the samples get dense.
    room = np.sort(0.05 - np.abs(axis.center), axis=1)
    off = (room[:, 1] - room[:, 0])[axis.depth > 0.02]
    assert np.median(off) < 2e-3


def test_the_deepest_ball_of_a_long_cylinder_lies_on_its_axis() -> None:
    mesh = cylinder(0.04, 0.2, 96)
    axis = refined_medial_axis(build_mesh_bvh(mesh.vertices, mesh.faces), samples(mesh, 300), 2000)
    deep = axis.depth > 0.0195
    assert deep.sum() > 20
    assert np.hypot(*axis.center[deep, :2].T).max() < 1e-3
    assert np.abs(axis.center[deep, 2]).max() <= 0.1 - 0.019
    assert np.ptp(axis.center[deep, 2]) > 0.12


def test_samples_that_are_there_are_not_added_again() -> None:
    have = np.random.default_rng(0).random((20, 3))
    new = np.array([[2.0, 2.0, 2.0], [2.0, 2.0, 2.0], [3.0, 0.0, 0.0]])
    grown = with_new_samples(have, np.concatenate([have[:5] + 1e-9, new]))
    assert grown.shape == (22, 3)
    assert (grown[:20] == have).all()
    assert (grown[20:] == new[1:]).all() or (grown[20:] == new[[0, 2]]).all()
    assert len(with_new_samples(have, have)) == 20
