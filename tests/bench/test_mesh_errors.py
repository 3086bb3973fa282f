"""Hands beside a box, at distances and depths that are known."""

import numpy as np
import pytest

from hhsim.bench.run_errors import MeshReferee, sampled
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree

pytest.importorskip("coal", reason="the true mesh is measured with coal: pip install 'hhsim[verify]'")

MESH = load_object("cube").mesh
HAND = HandModel.default()
SHAPE = hand_shape(HAND)
TOUCH = 1e-3
NONE = np.zeros(0, np.int64)


def over(heights: list[float]) -> PlacedHand:
    """A flat hand whose lowest point is so high over the middle of the cube's top [m], at one tick each."""
    ticks = len(heights)
    pose = HandConfiguration(
        np.zeros((ticks, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1)), np.zeros((ticks, 5, 3)), np.zeros((ticks, 5))
    )
    placed = forward_kinematics(HAND, *pose)
    center = np.concatenate([placed.joints[0].reshape(-1, 3), SHAPE.palm_center])
    radius = np.concatenate([SHAPE.phalanx_radius.ravel(), SHAPE.palm_radius])
    lowest = int((center[:, 2] - radius).argmin())
    top = np.array([0.0, 0.0, float(MESH.bounds[1, 2]) + radius[lowest]])
    shift = top - center[lowest] + np.array(heights)[:, None] * [0.0, 0.0, 1.0]
    return PlacedHand(placed.joints + shift[:, None, None], shift, placed.orientation)


def surface_of(mesh: Mesh) -> object:
    """Its triangles; the mesh has no use for a tree."""
    tree = SphereTree(np.zeros((1, 3)), np.ones(1), np.zeros(1, np.int64), np.full(1, -1))
    return contact_surface("mesh", mesh, tree).arrays


def ticks(*numbers: int) -> np.ndarray:
    return np.array(numbers, np.int64)


def test_every_contact_point_of_every_tick_is_measured() -> None:
    placed = over([5e-4, 2e-4, 0.01, 5e-4])
    found = MeshReferee(MESH).errors(surface_of(MESH), SHAPE, placed, TOUCH, ticks(0, 1, 2, 3), NONE)
    assert found.contact_error_mean == pytest.approx((5e-4 + 2e-4 + 5e-4) / 3.0, abs=1e-12)
    assert found.contact_error_max == pytest.approx(5e-4, abs=1e-12)
    assert (found.mesh_depth_max, found.mesh_depth_p95, found.samples) == (0.0, 0.0, 4)
    alone = [MeshReferee(MESH).errors(surface_of(MESH), SHAPE, placed, TOUCH, ticks(i), NONE) for i in (0, 1)]
    assert found.contact_points == sum(one.contact_points for one in alone), "the last tick is the first one again"


def test_a_hand_is_as_deep_as_it_was_pushed_in() -> None:
    placed = over([-1e-3, -2e-3, 1e-3])
    found = MeshReferee(MESH).errors(surface_of(MESH), SHAPE, placed, TOUCH, ticks(0, 1, 2), NONE)
    assert found.mesh_depth_max == pytest.approx(2e-3, abs=1e-7)
    assert found.samples == 3


def test_of_more_hands_than_there_is_time_for_some_are_measured_and_those_that_must_be() -> None:
    heights = [1e-4 * i for i in range(1, 21)]
    heights[7] = -3e-3
    placed = over(heights)
    referee = MeshReferee(MESH, most_hands=4)
    everything = np.arange(20)
    some = referee.errors(surface_of(MESH), SHAPE, placed, TOUCH, everything, NONE)
    assert (some.samples, some.mesh_depth_max) == (4, 0.0)
    deepest = referee.errors(surface_of(MESH), SHAPE, placed, TOUCH, everything, ticks(7))
    assert deepest.samples == 5
    assert deepest.mesh_depth_max == pytest.approx(3e-3, abs=1e-7)
    assert some.contact_points == deepest.contact_points


def test_the_same_hand_is_measured_once_and_counts_at_every_tick() -> None:
    found = MeshReferee(MESH, most_hands=2).errors(
        surface_of(MESH), SHAPE, over([-1e-3, 1e-3] * 10), TOUCH, np.arange(20), NONE
    )
    assert found.samples == 20
    assert found.mesh_depth_p95 == pytest.approx(1e-3, abs=1e-7)


def test_where_nothing_is_in_contact_nothing_is_known() -> None:
    found = MeshReferee(MESH).errors(surface_of(MESH), SHAPE, over([0.1]), TOUCH, NONE, NONE)
    assert (found.contact_points, found.samples) == (0, 0)
    assert np.isnan(found[:4]).all()
    above = MeshReferee(MESH).errors(surface_of(MESH), SHAPE, over([0.1]), TOUCH, ticks(0), NONE)
    assert (above.mesh_depth_max, above.contact_points, above.samples) == (0.0, 0, 1)
    assert np.isnan([above.contact_error_mean, above.contact_error_max]).all()


def test_nothing_is_deep_in_a_mesh_that_encloses_nothing() -> None:
    sheet = Mesh(MESH.vertices, MESH.faces[:-1], name="open")
    referee = MeshReferee(sheet)
    assert (referee.closed, MeshReferee(MESH).closed) == (False, True)
    found = referee.errors(surface_of(sheet), SHAPE, over([5e-4]), TOUCH, ticks(0), NONE)
    assert np.isnan([found.mesh_depth_max, found.mesh_depth_p95]).all()
    assert (found.samples, found.contact_points > 0) == (0, True)
    assert found.contact_error_max == pytest.approx(5e-4, abs=1e-12)


def test_samples_are_spread_over_the_ticks() -> None:
    many = np.arange(100, 300, 2)
    assert sampled(many, 5).tolist() == [100, 148, 198, 248, 298]
    assert sampled(many, 3, [7]).tolist() == [7, 100, 198, 298]
    assert sampled(many[:2], 5).tolist() == [100, 102]
    assert sampled(np.zeros(0, np.int64), 5).tolist() == []
