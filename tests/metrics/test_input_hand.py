"""How deep the user's hand was: the deepest of all ticks, of which most are not looked at."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from sampled import sampled
from sphere_scenes import bumpy_ball

from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.metrics.input_hand import SAME_DEPTH, Depths, deepest, input_hand, object_depths
from hhsim.motion.analytic_motion import random_targets, still
from hhsim.trees.contact_surface import contact_surface
from tools.shapes.generators import sphere

HAND = HandModel.default()
SHAPE = hand_shape(HAND)
ALL = np.ones(5, dtype=bool)
RADIUS = 0.04
BALL = sphere(2.0 * RADIUS, 4)
PALM = HAND.palm_tree.leaf_center


def depths(name: str, fingers: NDArray[np.bool_] = ALL) -> Depths:
    return object_depths(contact_surface(name, BALL, bumpy_ball(400)).arrays, BALL, SHAPE, fingers)


@pytest.mark.parametrize(
    ("name", "seed"),
    sampled([(name, seed) for name in ("spheres", "mesh") for seed in range(4)], lambda _, case: case[1] == 0),
)
def test_the_deepest_tick_is_found_and_most_are_not_looked_at(name: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    targets = random_targets(HAND, 4, random, hold=1)
    motion = targets.part(0, 1).line(targets.part(1, 2), 150).line(targets.part(2, 3), 150).hold(100)
    placed = forward_kinematics(HAND, *motion)
    of, looks = depths(name), 0

    def counted(some: PlacedHand) -> NDArray[np.float64]:
        nonlocal looks
        looks += len(some.joints)
        return of(some)

    found, most = deepest(counted, PALM, placed), float(of(placed).max())
    assert max(0.0, most) - SAME_DEPTH <= found <= max(0.0, most)
    assert looks < 0.6 * len(placed.joints)


def at_distance(gap: float) -> PlacedHand:
    """The hand flat over the ball, its palm's spheres so far from it [m], fingers stretched."""
    lowest = float((PALM[:, 2] - HAND.palm_tree.leaf_radius).min())
    return forward_kinematics(HAND, *still((0.0, -0.01, RADIUS - lowest + gap)))


@pytest.mark.parametrize("gap", [0.004, -0.003, -0.006])
def test_the_depth_of_a_palm_on_a_ball_is_how_far_it_is_lowered_in_the_mesh(gap: float) -> None:
    palm = np.zeros(5, dtype=bool)
    measured = depths("mesh", palm)(at_distance(gap))[0, 5]
    assert measured <= -gap + 2e-4
    assert deepest(depths("mesh", palm), PALM, at_distance(gap)) == max(0.0, measured)


def test_a_finger_deep_through_the_surface_is_as_deep_as_its_deepest_point() -> None:
    """The axis crosses the mesh: the distance to the nearest triangle alone would stop at the finger's radius."""
    index = np.array([False, True, False, False, False])
    tip = forward_kinematics(HAND, *still((0.0, 0.0, 0.0))).joints[0, 1, 3]
    placed = forward_kinematics(HAND, *still(-tip + [0.0, -0.01, 0.0]))
    # The tip is 10 mm beside the middle of the ball.
    expected = RADIUS - 0.01 + float(HAND.radius[1, 3])
    assert float(depths("mesh", index)(placed)[0, 1]) >= expected - 2e-3
    assert depths("mesh", index)(placed)[0, [0, 2, 3, 4, 5]].max() <= 0.0


def test_a_finger_in_a_solid_of_parts_that_cross_is_inside_both() -> None:
    """Beyond the wall of one ball and within the other, the closest face has the finger on its outer side."""
    balls = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, RADIUS]])
    vertices = np.concatenate([BALL.vertices + center for center in balls])
    pair = replace(BALL, vertices=vertices, faces=np.concatenate([BALL.faces, BALL.faces + len(BALL.vertices)]))
    index = np.array([False, True, False, False, False])
    tip = forward_kinematics(HAND, *still((0.0, 0.0, 0.0))).joints[0, 1, 3]
    placed = forward_kinematics(HAND, *still(-tip + [0.0, 0.0, RADIUS + 0.01]))
    share = np.linspace(0.0, 1.0, 100)[:, None]
    # Centres along the bones, and how deep the balls around them are: as deep in the walls as they are wide.
    joints, radius = placed.joints[0, 1], HAND.radius[1]
    centers = np.concatenate([a + share * (b - a) for a, b in pairwise(joints)])
    around = np.concatenate([a + share[:, 0] * (b - a) for a, b in pairwise(radius)])
    off = np.linalg.norm(centers[:, None] - balls, axis=2) - RADIUS
    expected = (around + np.abs(off).min(axis=1))[off.min(axis=1) < 0.0].max()
    surface = contact_surface("mesh", pair, bumpy_ball(400)).arrays
    assert object_depths(surface, pair, SHAPE, index)(placed)[0, 1] == pytest.approx(expected, abs=5e-4)


def test_correction_is_the_way_between_two_hands_in_the_ticks_that_touch() -> None:
    haptic = still((0.0, 0.0, 0.2), ticks=6)
    shown = forward_kinematics(HAND, *still((0.0, 0.003, 0.204), ticks=6))
    touch = np.array([True, True, False, True, False, False])
    haptic.position[3] = np.nan
    found = input_hand(HAND, depths("spheres"), haptic, shown, touch, touch)
    assert found.depth == 0.0
    for values in found.correction:
        np.testing.assert_allclose(values, [0.005, 0.005], atol=1e-12)


@pytest.mark.parametrize(
    ("near", "inside", "expected"),
    [(False, False, 0.02), (True, False, 0.01), (False, True, 0.01)],
    ids=["both free", "the shown hand is kept by the object", "the user's hand is inside"],
)
def test_in_free_space_the_shown_hand_is_to_be_where_the_users_is(near: bool, inside: bool, expected: float) -> None:
    """Of three ticks, off by 0, 10 and 20 mm, the last counts unless something may keep the shown hand."""
    haptic, shown = still((0.0, 0.0, 0.2), ticks=3), still((0.0, 0.0, 0.2), ticks=3)
    haptic.position[2] = (0.0, 0.0, 0.0) if inside else (0.0, 0.0, 0.2)
    shown.position[:] = haptic.position
    shown.position[:, 0] += [0.0, 0.01, 0.02]
    placed, none = forward_kinematics(HAND, *shown), np.zeros(3, bool)
    found = input_hand(HAND, depths("spheres"), haptic, placed, none, np.array([False, False, near]))
    assert found.free == pytest.approx(expected, abs=1e-12)


def test_no_tick_that_is_a_hand_has_no_depth_and_no_correction() -> None:
    nothing = still((np.nan, 0.0, 0.0), ticks=3)
    shown = forward_kinematics(HAND, *still((0.0, 0.0, 0.0), ticks=3))
    found = input_hand(HAND, depths("spheres"), nothing, shown, np.ones(3, bool), np.zeros(3, bool))
    assert found.depth == 0.0 and all(len(values) == 0 for values in found.correction) and np.isnan(found.free)
