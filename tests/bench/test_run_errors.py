"""Errors of runs that were tampered with by known amounts, and of hands beside a box at known distances and depths."""

from typing import Any

import numpy as np
import pytest

from hhsim.bench.run_errors import NEAR, ErrorScene, MeshReferee, error_scene, hand_clearance, placed_of, run_errors
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import mesh_clearance
from hhsim.motion.analytic_motion import still
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.options import TreeOptions

OPTIONS = SolverOptions()
ON_MESH = SolverOptions(surface="mesh")
MESH = load_object("cube").mesh
HAND = HandModel.default()
SHAPE = hand_shape(HAND)
TOUCH = 1e-3
NONE = np.zeros(0, np.int64)
World = tuple[ErrorScene, TreeArrays, TickRecord]


@pytest.fixture(scope="module")
def world() -> World:
    """One finger touches the cube, 200 ticks a second; and the run of the method as it comes."""
    tree = cached_sphere_tree(MESH, TreeOptions(level=3))
    scene = make_scene(MESH, tree, HAND, load_script("touch"), rate=200.0)
    errors = error_scene(HAND, MeshReferee(MESH), scene.hands[0].ticks, triangles(), OPTIONS)
    return errors, tree.arrays(), run(errors, tree.arrays(), OPTIONS)


def triangles(mesh: Mesh = MESH) -> Any:
    return contact_surface("mesh", mesh, None).arrays


def run(scene: ErrorScene, surface: Any, options: SolverOptions) -> TickRecord:
    return HandSolver(scene.hand, surface, options).run(*HandConfiguration.of(scene.haptic))


def shifted(record: TickRecord, shift: np.ndarray) -> TickRecord:
    """The same run with the graphic hand elsewhere; shift [m], shape (T, 3)."""
    return record._replace(position=record.position + shift, joints=record.joints + shift[:, None, None, :])


def test_ticks_in_contact_are_those_where_the_haptic_hand_is_near(world: World) -> None:
    scene, *_ = world
    bvh = build_mesh_bvh(MESH.vertices, MESH.faces)
    clearance = mesh_clearance(bvh, hand_shape(scene.hand), scene.haptic_placed)
    assert np.array_equal(scene.contact, clearance < NEAR)
    assert 0 < scene.contact.sum() < scene.contact.size
    hold = scene.holds[0]
    assert scene.contact[hold].all()
    assert [(hold.start, hold.stop)] == [
        (p.first_tick, p.last_tick + 1) for p in scene.haptic.phases if p.name == "hold"
    ]


def test_a_good_run_is_good(world: World) -> None:
    scene, tree, record = world
    found = run_errors(scene, tree, OPTIONS, record)
    assert found.penetration_max <= 1e-6
    # Spheres cover the mesh, so a hand outside of them is outside of it.
    assert found.mesh_depth_max <= found.mesh_depth_p95 + 1e-6 <= 2e-6
    assert 0.0 < found.contact_error_mean <= found.contact_error_max == found.mesh_error
    assert abs(found.tracking_excess) < 1e-3
    # The spheres' own error, and hardly more.
    assert found.off_optimum_mean < found.contact_error_max
    assert found.force_hold > 0.1
    assert found.force_variation_hold < 1e-3 < found.force_variation_tremor
    assert (found.stuck_ticks, found.lag_max) == (0, 0.0)
    # Spheres stick out: the shown hand touches them before the user's hand is near the mesh.
    assert scene.contact.sum() <= found.samples < len(scene.contact)
    assert found.contact_points > 0


def test_on_the_mesh_the_contacts_lie_on_it_and_the_pose_is_the_optimum(world: World) -> None:
    scene, tree, record = world
    found = run_errors(scene, triangles(), ON_MESH, run(scene, triangles(), ON_MESH))
    spheres = run_errors(scene, tree, OPTIONS, record)
    assert (found.penetration_max, found.mesh_depth_max) == (0.0, 0.0)
    assert 0.0 < found.contact_error_mean <= found.contact_error_max <= ON_MESH.touch + 1e-9
    assert found.contact_error_max < 0.01 * spheres.contact_error_max
    assert found.off_optimum_mean < 0.01 * spheres.off_optimum_mean
    assert abs(found.tracking_excess) < 1e-3


def test_a_hand_beside_the_optimum_is_off_by_that_much(world: World) -> None:
    scene, tree, record = world
    best = record._replace(joints=scene.optimum.joints.copy(), position=scene.optimum.position.copy())
    shift = np.tile([0.001, 0.002, 0.002], (len(record.position), 1))
    found = run_errors(scene, tree, OPTIONS, shifted(best, shift))
    assert found.off_optimum_mean == pytest.approx(0.003)
    assert found.off_optimum_max == pytest.approx(0.003)


def test_a_hand_pushed_in_is_as_deep_as_mesh_and_spheres_say(world: World) -> None:
    scene, tree, record = world
    hold = scene.holds[0]
    tick = hold.start + 20
    tip = record.joints[tick, 1, 3]
    inward = -tip / np.linalg.norm(tip)
    shift = np.zeros((len(record.position), 3))
    shift[tick] = 0.004 * inward
    pushed = shifted(record, shift)
    found = run_errors(scene, tree, OPTIONS, pushed)
    placed = placed_of(pushed).at([tick])
    assert found.penetration_max == pytest.approx(-hand_clearance(scene.hand, tree, placed, 0.0)[0])
    bvh = build_mesh_bvh(MESH.vertices, MESH.faces)
    assert found.mesh_depth_max == pytest.approx(-mesh_clearance(bvh, hand_shape(scene.hand), placed)[0], abs=1e-6)
    assert found.mesh_depth_max > 5e-4
    assert found.mesh_depth_p95 == 0.0
    assert found.posture_jump_max == pytest.approx(0.004, rel=0.02)
    assert np.isfinite(found.tracking_excess)


def test_a_hand_that_hovers_is_not_perfect(world: World) -> None:
    scene, tree, record = world
    away = record.joints[scene.holds[0].start, 1, 3]
    best = record._replace(joints=scene.optimum.joints.copy(), position=scene.optimum.position.copy())
    hovering = shifted(best, np.tile(0.01 * away / np.linalg.norm(away), (len(record.position), 1)))
    found = run_errors(scene, tree, OPTIONS, hovering)
    assert (found.penetration_max, found.mesh_depth_max) == (0.0, 0.0)
    assert np.isnan([found.contact_error_max, found.mesh_error]).all()
    assert found.off_optimum_mean == pytest.approx(0.01, rel=0.02)


def over(heights: list[float]) -> PlacedHand:
    """A flat hand whose lowest point is so high over the middle of the cube's top [m], at one tick each."""
    placed = forward_kinematics(HAND, *still(np.zeros(3), ticks=len(heights)))
    center = np.concatenate([placed.joints[0].reshape(-1, 3), SHAPE.palm_center])
    radius = np.concatenate([SHAPE.phalanx_radius.ravel(), SHAPE.palm_radius])
    lowest = int((center[:, 2] - radius).argmin())
    top = np.array([0.0, 0.0, float(MESH.bounds[1, 2]) + radius[lowest]])
    shift = top - center[lowest] + np.array(heights)[:, None] * [0.0, 0.0, 1.0]
    return PlacedHand(placed.joints + shift[:, None, None], shift, placed.orientation)


def ticks(*numbers: int) -> np.ndarray:
    return np.array(numbers, np.int64)


def test_every_contact_point_of_every_tick_is_measured() -> None:
    placed = over([5e-4, 2e-4, 0.01, 5e-4])
    found = MeshReferee(MESH).errors(triangles(MESH), SHAPE, placed, TOUCH, ticks(0, 1, 2, 3), NONE)
    assert found.contact_error_mean == pytest.approx((5e-4 + 2e-4 + 5e-4) / 3.0, abs=1e-12)
    assert found.contact_error_max == pytest.approx(5e-4, abs=1e-12)
    assert (found.mesh_depth_max, found.mesh_depth_p95, found.samples) == (0.0, 0.0, 4)
    alone = [MeshReferee(MESH).errors(triangles(MESH), SHAPE, placed, TOUCH, ticks(i), NONE) for i in (0, 1)]
    assert found.contact_points == sum(one.contact_points for one in alone), "the last tick is the first one again"


def test_of_more_hands_than_there_is_time_for_some_are_measured_and_those_that_must_be() -> None:
    heights = [1e-4 * i for i in range(1, 21)]
    heights[7] = -3e-3
    placed = over(heights)
    referee = MeshReferee(MESH, most_hands=4)
    everything = np.arange(20)
    some = referee.errors(triangles(MESH), SHAPE, placed, TOUCH, everything, NONE)
    assert (some.samples, some.mesh_depth_max) == (4, 0.0)
    deepest = referee.errors(triangles(MESH), SHAPE, placed, TOUCH, everything, ticks(7))
    assert deepest.samples == 5
    assert deepest.mesh_depth_max == pytest.approx(3e-3, abs=1e-7)
    assert some.contact_points == deepest.contact_points


def test_the_same_hand_is_measured_once_and_counts_at_every_tick() -> None:
    found = MeshReferee(MESH, most_hands=2).errors(
        triangles(MESH), SHAPE, over([-1e-3, 1e-3] * 10), TOUCH, np.arange(20), NONE
    )
    assert found.samples == 20
    assert found.mesh_depth_p95 == pytest.approx(1e-3, abs=1e-7)


def test_where_nothing_is_in_contact_nothing_is_known() -> None:
    found = MeshReferee(MESH).errors(triangles(MESH), SHAPE, over([0.1]), TOUCH, NONE, NONE)
    assert (found.contact_points, found.samples) == (0, 0)
    assert np.isnan([found.mesh_depth_max, found.contact_error_max]).all()
    above = MeshReferee(MESH).errors(triangles(MESH), SHAPE, over([0.1]), TOUCH, ticks(0), NONE)
    assert (above.mesh_depth_max, above.contact_points, above.samples) == (0.0, 0, 1)
    assert np.isnan([above.contact_error_mean, above.contact_error_max]).all()


def test_nothing_is_deep_in_a_mesh_that_encloses_nothing() -> None:
    sheet = Mesh(MESH.vertices, MESH.faces[:-1], name="open")
    referee = MeshReferee(sheet)
    assert (referee.closed, MeshReferee(MESH).closed) == (False, True)
    found = referee.errors(triangles(sheet), SHAPE, over([5e-4]), TOUCH, ticks(0), NONE)
    assert np.isnan([found.mesh_depth_max, found.mesh_depth_p95]).all()
    assert (found.samples, found.contact_points > 0) == (0, True)
    assert found.contact_error_max == pytest.approx(5e-4, abs=1e-12)
