"""Metrics against closed forms, with undefined cases, and how deep the user's hand was."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import sampled
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from sphere_scenes import ball, bumpy_ball

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.metrics import metrics
from hhsim.metrics.input_hand import SAME_DEPTH, Depths, deepest, input_hand, object_depths
from hhsim.motion.analytic_motion import random_targets, still
from hhsim.trees.contact_surface import contact_surface
from tools.shapes.generators import sphere

RATE = 1000.0
STIFFNESS = np.concatenate([np.full(3, 1000.0), np.full(3, 5.0), np.full(15, 0.5)])


def along(axis: int, size: ArrayLike) -> FloatArray:
    values = np.asarray(size, dtype=np.float64)
    force = np.zeros((values.size, 3))
    force[:, axis] = values
    return force


def poses(ticks: int) -> HandConfiguration:
    return still(np.zeros(3), ticks=ticks)


class TestPostureJump:
    def test_it_is_what_the_graphic_hand_moved_more(self) -> None:
        haptic, graphic = np.zeros((4, 2, 3)), np.zeros((4, 3, 3))
        haptic[1:, 0, 0] = 0.002
        graphic[1:, 2, 1] = 0.005
        graphic[2:, 1, 2] = -0.001
        haptic[3:, 1, 0] = 0.01
        graphic[3:, 0, 0] = 0.004
        np.testing.assert_allclose(metrics.posture_jump(haptic, graphic), [np.nan, 0.003, 0.001, 0.0], atol=1e-15)

    @pytest.mark.parametrize("ticks", [0, 1])
    def test_no_tick_before_no_jump(self, ticks: int) -> None:
        assert np.isnan(metrics.posture_jump(np.zeros((ticks, 2, 3)), np.zeros((ticks, 2, 3)))).sum() == ticks


class TestForceVariation:
    def test_rate_is_the_relative_change_of_the_size_in_percent(self) -> None:
        force = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 5.5], [5.5, 0.0, 0.0], [0.0, 1.1, 0.0]])
        np.testing.assert_allclose(metrics.force_variation_rate(force), [np.nan, 10.0, 0.0, 80.0], rtol=1e-12)

    def test_rate_is_undefined_after_a_force_below_the_floor(self) -> None:
        force = along(2, np.array([0.0, 1.0, 0.0099, 2.0, 0.01, 0.02]))
        np.testing.assert_allclose(metrics.force_variation_rate(force), [np.nan, np.nan, 99.01, np.nan, 99.5, 100.0])

    def test_fingers_are_measured_each_by_itself(self) -> None:
        force = np.random.default_rng(0).normal(size=(20, 5, 3))
        force[:, 3] = 0.0
        rate = metrics.force_variation_rate(force)
        assert rate.shape == (20, 5)
        for finger in range(5):
            np.testing.assert_array_equal(rate[:, finger], metrics.force_variation_rate(force[:, finger]))
        assert np.isnan(rate[:, 3]).all()

    def test_components_have_their_own_floor(self) -> None:
        force = np.array([[10.0, 0.001, -2.0], [11.0, 0.5, 2.0]])
        rate = metrics.component_variation_rate(force)
        np.testing.assert_allclose(rate[1], [10.0, np.nan, 200.0])
        assert np.isnan(rate[0]).all()

    @pytest.mark.parametrize("ticks", [0, 1])
    def test_too_few_ticks_have_no_rate(self, ticks: int) -> None:
        force = np.ones((ticks, 3))
        assert np.isnan(metrics.force_variation_rate(force)).all()
        assert metrics.component_variation_rate(force).shape == (ticks, 3)


class TestStatistics:
    def test_undefined_values_do_not_count(self) -> None:
        values = np.array([np.nan, 1.0, 3.0, np.nan, 100.0])
        result = metrics.statistics(values, np.arange(5) < 4)
        assert (result.mean, result.std, result.max) == (2.0, 1.0, 3.0)

    @pytest.mark.parametrize("values", [np.full(4, np.nan), np.zeros(0)])
    def test_an_empty_phase_is_nan_without_a_warning(self, values: FloatArray) -> None:
        result = metrics.statistics(values)
        assert np.isnan([result.mean, result.std, result.max]).all()


class TestRipple:
    @pytest.mark.parametrize("frequency", [60.0, 123.4, 250.0, 390.0])
    @pytest.mark.parametrize("ticks", [500, 777, 1000])
    def test_a_vibration_in_the_band_gives_its_rms(self, frequency: float, ticks: int) -> None:
        time = np.arange(ticks) / RATE
        force = along(1, 5.0 + 0.2 * np.sin(2.0 * np.pi * frequency * time + 0.7))
        assert metrics.force_ripple(force, RATE) == pytest.approx(0.2 / np.sqrt(2.0), rel=1e-2)

    @pytest.mark.parametrize("frequency", [1.0, 10.0, 30.0, 450.0])
    def test_a_vibration_outside_does_not(self, frequency: float) -> None:
        time = np.arange(1000) / RATE
        force = along(1, 5.0 + np.sin(2.0 * np.pi * frequency * time + 0.7))
        assert metrics.force_ripple(force, RATE) < 1e-4

    def test_mean_and_drift_are_no_ripple(self) -> None:
        time = np.arange(300)[:, None] / RATE
        assert metrics.force_ripple(np.array([1.0, -20.0, 300.0]) + time * [100.0, 0.0, -7.0], RATE) < 1e-10

    def test_white_noise_gives_the_share_of_its_band_and_the_whole_spectrum_all_power(self) -> None:
        force = np.random.default_rng(3).normal(size=(50_000, 3))
        share = (400.0 - 50.0) / 500.0
        assert metrics.force_ripple(force, RATE) == pytest.approx(np.sqrt(3.0 * share), rel=1e-2)
        force = along(0, np.where(np.arange(400) % 2, 1.0, -1.0))
        assert metrics.force_ripple(force, RATE, high=500.0) == pytest.approx(1.0, rel=1e-3)

    def test_too_few_ticks_too_slow_a_rate_or_nan_are_undefined(self) -> None:
        noise = np.random.default_rng(4).normal(size=(80, 3))
        assert metrics.force_ripple(noise, RATE) > 0.0
        cases = (noise[:79], RATE), (noise[:0], RATE), (noise, 100.0), (np.where(noise > 2.0, np.nan, 1.0), RATE)
        for force, rate in cases:
            assert np.isnan(metrics.force_ripple(force, rate))


class TestForceStep:
    def test_largest_change_while_moving_relative_to_the_hold(self) -> None:
        force = along(0, np.array([0.0, 1.0, 4.0, 4.0, 4.0, 40.0]))
        moving, hold = np.arange(6) < 3, np.isin(np.arange(6), (3, 4))
        assert metrics.force_step(force, moving, hold, np.full(6, 12.0)) == pytest.approx(25.0)

    def test_a_turning_force_steps_even_at_constant_size(self) -> None:
        force = np.array([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 2.0, 0.0]])
        step = metrics.force_step(force, np.arange(3) == 1, np.arange(3) == 2, np.full(3, 2.0))
        assert step == pytest.approx(100.0 * np.sqrt(2.0))

    def test_empty_phases_and_no_hold_force_are_undefined(self) -> None:
        force, whole, none = np.ones((4, 3)), np.ones(4, dtype=bool), np.zeros(4, dtype=bool)
        first = np.array([True, False, False, False])
        undefined = [(force, none, whole), (force, whole, none), (0.0 * force, whole, whole), (force, first, whole)]
        for case in [*undefined, (force[:0], none[:0], none[:0])]:
            assert np.isnan(metrics.force_step(*case, np.linalg.norm(case[0], axis=1)))
        assert metrics.force_step(force, whole, whole, np.ones(4)) == 0.0


class TestForceStepInContact:
    def test_without_a_touch_or_a_tick_before_it_is_undefined(self) -> None:
        for touch in (np.zeros(6, bool), np.ones(1, bool), np.zeros(0, bool)):
            assert np.isnan(metrics.contact_force_step(np.ones((len(touch), 3)), touch))

    def test_as_a_plain_loop_has_it(self) -> None:
        generator = np.random.default_rng(3)
        for _ in range(20):
            force, touch = generator.normal(size=(30, 3)), generator.random(30) < 0.4
            steps = [np.linalg.norm(force[t] - force[t - 1]) for t in range(1, 30) if touch[t] or touch[t - 1]]
            assert metrics.contact_force_step(force, touch) == pytest.approx(max(steps), rel=1e-15)


class TestFrozenDecay:
    @pytest.mark.parametrize(
        ("force", "settled"),
        [
            # The change at tick t is 0.9 · 0.1^t; it is above 1e-6 up to t = 5.
            (along(2, 1.0 + 0.1 ** np.arange(1, 30)), 5),
            # Limit cycles: of the size, and of the direction alone.
            (along(0, 1.0 + 1e-5 * (np.arange(50) % 2)), None),
            (np.eye(3)[np.arange(50) % 2], None),
            # A jump, and one in the last tick.
            (along(0, np.repeat([1.0, 2.0], [12, 8])), 12),
            (along(0, np.repeat([1.0, 2.0], [19, 1])), None),
            *((np.full((10, 3), size), 0) for size in (0.0, 1.0)),
            *((force, None) for force in (np.ones((1, 3)), along(0, np.array([1.0, 1.0, np.nan])))),
        ],
    )
    def test_it_ends_with_the_last_change_that_ticks_without_one_follow(
        self, force: FloatArray, settled: int | None
    ) -> None:
        assert metrics.frozen_decay(force) == settled


class TestTracking:
    def test_energy_is_the_coupling_of_each_part(self) -> None:
        haptic, graphic = poses(4), poses(4)
        haptic.position[1] = [3e-3, 0.0, 4e-3]
        haptic.orientation[2] = np.roll(Rotation.from_rotvec([0.0, 0.2, 0.0]).as_quat(), 1)
        haptic.flexion[3, 2] = [0.1, 0.2, -0.2]
        energy = metrics.tracking_energy(haptic, graphic, STIFFNESS)
        np.testing.assert_allclose(energy, [0.0, 500.0 * 25e-6, 2.5 * 0.04, 0.25 * 0.09], rtol=1e-12)

    def test_stiffness_of_rotation_is_taken_in_the_world(self) -> None:
        haptic, graphic = poses(1), poses(1)
        start = Rotation.from_rotvec([0.0, 0.0, np.pi / 2.0])
        graphic.orientation[0] = np.roll(start.as_quat(), 1)
        haptic.orientation[0] = np.roll((Rotation.from_rotvec([0.1, 0.0, 0.0]) * start).as_quat(), 1)
        stiffness = np.zeros(21)
        stiffness[3] = 2.0
        np.testing.assert_allclose(metrics.tracking_energy(haptic, graphic, stiffness), [0.01], rtol=1e-12)

    @settings(max_examples=50)
    @given(st.integers(0, 2**32 - 1), st.floats(0.0, np.pi))
    def test_rotation_angle_is_right_for_any_pair_and_sign(self, seed: int, angle: float) -> None:
        rng = np.random.default_rng(seed)
        axis = rng.normal(size=3)
        start = Rotation.random(rng=rng)
        turned = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)) * start
        haptic, graphic = poses(2), poses(2)
        graphic.orientation[:] = np.roll(start.as_quat(), 1)
        haptic.orientation[0] = np.roll(turned.as_quat(), 1)
        haptic.orientation[1] = -haptic.orientation[0]
        stiffness = np.repeat([0.0, 2.0, 0.0], [3, 3, 15])
        turned_by = np.sqrt(metrics.tracking_energy(haptic, graphic, stiffness))
        np.testing.assert_allclose(turned_by, angle, atol=1e-6)

    def test_no_ticks_have_no_energy(self) -> None:
        assert metrics.tracking_energy(poses(0), poses(0), STIFFNESS).shape == (0,)

    def test_excess_over_the_reference(self) -> None:
        excess = metrics.tracking_excess([2.0, 1.0, 1.0, np.nan], [1.0, 1.0, 0.0, 1.0])
        np.testing.assert_allclose(excess, [1.0, 0.0, np.nan, np.nan])


def test_percentiles_of_ticks_are_in_microseconds() -> None:
    duration = np.arange(1, 102, dtype=np.int64) * 1000
    duration[-1] = 2_000_000
    result = metrics.tick_statistics(duration)
    assert (result.p50, result.p99, result.max) == (51.0, 100.0, 2000.0)
    assert result.over_budget == pytest.approx(1.0 / 101.0)
    assert metrics.tick_statistics([1_000_000]).over_budget == 0.0
    result = metrics.tick_statistics(np.zeros(0, dtype=np.int64))
    assert np.isnan([result.p50, result.p99, result.max, result.over_budget]).all()


@pytest.mark.parametrize("place", ["joint", "palm"])
def test_nan_of_a_joint_or_the_palm_is_no_depth(place: str) -> None:
    joints, position = np.full((1, 5, 4, 3), 1.0), np.zeros((1, 3))
    if place == "joint":
        joints[0, 4, 3, 0] = np.nan
    else:
        position[0, 0] = np.nan
    palm, turn = (np.ones((1, 3)), np.array([0.01])), np.array([[1.0, 0.0, 0.0, 0.0]])
    shape = HandShape(np.full((5, 4), 0.005), *palm)
    result = metrics.penetration(ball(0.03).arrays(), shape, PlacedHand(joints, position, turn))
    assert np.isnan(result.depth[0])
    assert np.isnan(result.palm[0]) == (place == "palm")
    np.testing.assert_array_equal(np.isnan(result.finger[0]), [False] * 4 + [place == "joint"])


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
