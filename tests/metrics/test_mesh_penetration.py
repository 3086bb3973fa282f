"""The hand and its contacts against the true mesh: against its own surface, trimesh, and a ball in closed form."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import ArrayLike
from short_grasp import short_grasp, short_scene

from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance, winding_numbers
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.mesh_penetration import contact_error, find_contact_points, mesh_clearance
from hhsim.metrics.run_ticks import PLACED, result_ticks
from hhsim.render.triangle_soup import FINE, SPHERE, Surface, hand_surface, joined, piece_surfaces, round_cone_surface
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.solver.options import TOUCH, SolverOptions


def hybrid_surface(hand: HandModel, pose: Iterable[ArrayLike]) -> Surface:
    """Return the hand's surface, world frame, with its palm as leaf spheres; arguments as of `hand_surface`."""
    palm = zip(hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius, strict=True)
    spheres = [round_cone_surface(center, center, size, size, SPHERE, rings=14, sides=44) for center, size in palm]
    pieces = (*piece_surfaces(hand, *FINE)[:PALM_BODY], joined(spheres))
    return hand_surface(hand, pose, pieces)


def over(hand: HandModel, height: float, ticks: int = 1) -> PlacedHand:
    """An open hand, palm down, over the origin."""
    return forward_kinematics(
        hand,
        np.tile([0.0, -0.06, height], (ticks, 1)),
        np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1)),
        np.full((ticks, 5, 3), 0.2),
        np.zeros((ticks, 5)),
    )


@pytest.mark.parametrize("name", ["bunny", "teapot"])
def test_depth_is_that_of_the_deepest_point_of_the_surface(name: str) -> None:
    hand, mesh = HandModel.default(), load_object(name).mesh
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces)
    top = float(mesh.bounds[1, 2])
    depths = []
    for height in np.linspace(top, top + 0.05, 26):
        placed = over(hand, float(height))
        depth = -mesh_clearance(bvh, hand_shape(hand), placed)[0]
        if not 0.0 < depth < 0.003:
            continue
        pose = placed.position[0], placed.orientation[0], np.full((5, 3), 0.2), np.zeros(5)
        surface = hybrid_surface(hand, pose)
        points = surface.points.copy()
        deepest = float(-mesh_signed_distance(bvh, points).min())
        # The surface is sampled about 1 mm apart on radii of 5 mm and more: 0.05 mm flatter at worst.
        assert deepest <= depth + 1e-6
        assert depth - deepest < 1e-4
        winding = np.empty(1)
        row = points[mesh_signed_distance(bvh, points).argmin()]
        winding_numbers(mesh.triangles, row[None].copy(), winding)
        assert winding[0] == pytest.approx(1.0 if deepest > 0.0 else 0.0, abs=1e-6)
        depths.append(depth)
    assert len(depths) >= 1


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
