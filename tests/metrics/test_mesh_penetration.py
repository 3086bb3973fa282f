"""The hand and its contacts against the true mesh: against its own surface, trimesh, and a ball in closed form."""

from typing import Any

import numpy as np
import pytest
import trimesh
from short_grasp import short_grasp, short_scene

from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.metrics.mesh_penetration import contact_error, find_contact_points
from hhsim.metrics.run_ticks import PLACED, result_ticks
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.solver.options import TOUCH, SolverOptions


def test_contact_error_is_the_distance_from_the_mesh() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    bvh = build_mesh_bvh(np.array(box.vertices, np.float64), np.array(box.faces, np.int64))
    found = contact_error(bvh, np.array([[0.0, 0.0, 0.051], [0.0, 0.01, 0.048], [0.05, 0.05, 0.05]]))
    assert found == pytest.approx([1e-3, 2e-3, 0.0], abs=1e-12)
    assert contact_error(bvh, np.zeros((0, 3))).shape == (0,)


@pytest.fixture(scope="module")
def grasp(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A grasp of a coarse tree."""
    path = tmp_path_factory.mktemp("grasp") / "grasp.h5"
    summary = replay_scene(short_scene(short_grasp(), "cylinder", 2, "right"), SolverOptions(), path)
    assert any("off the mesh: 64 spheres (level 2)" in note and "--level 3" in note for note in summary.notes)
    return load_result(path)


def test_it_is_what_trimesh_measures_at_every_contact(grasp: Result) -> None:
    run = result_ticks(grasp)
    touched = run.touched
    assert touched is not None
    placed = PlacedHand(*(grasp[name] for name in PLACED))
    contacts = find_contact_points(touched.surface, touched.shape, placed, touched.touch)
    points = [contacts.point[contacts.tick == tick] for tick in range(grasp.ticks)]
    surface = trimesh.Trimesh(touched.mesh.vertices, touched.mesh.faces, process=False)
    closest: Any = trimesh.proximity.closest_point
    expected = np.full(grasp.ticks, np.nan)
    for tick in np.flatnonzero([len(found) > 0 for found in points])[::7]:
        expected[tick] = closest(surface, points[tick])[1].max()
    looked = np.isfinite(expected)
    assert looked.sum() > 10
    np.testing.assert_allclose(run.contact_error[looked], expected[looked], atol=1e-9)
    assert grasp.summary["contact_error_max"] == np.nanmax(run.contact_error) > 1e-3
    assert (np.isfinite(run.contact_error) == [len(found) > 0 for found in points]).all()


def test_what_touches_the_spheres_is_no_farther_from_the_mesh_than_the_bound(grasp: Result) -> None:
    bound = short_scene(short_grasp(), "cylinder", 2, "right").solids[0].placed_tree.errors[-1].bound
    assert 0.5 * bound < grasp.summary["contact_error_max"] <= bound + TOUCH
