"""Round cone and sphere distances against minimisation over the axis, and what any distance must obey."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import Cones, to_cone
from sphere_scenes import spheres_of

from hhsim.arrays import FloatArray
from hhsim.kernels.round_cone_distance import cone_slope, round_cone_distances, sphere_pair_distances

Scene = tuple[FloatArray, float, FloatArray, FloatArray, float, float]
TOLERANCE = 1e-12
"""Allowed error relative to the size of the scene [-]."""


def brute_force(
    center: FloatArray, radius: float, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> float:
    return float(to_cone(center[None], a, b, radius_a, radius_b)[0]) - radius


def kernel(
    center: FloatArray, radius: float, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> tuple[float, float]:
    distance, s = distances(center[None], np.array([radius]), a, b, radius_a, radius_b)
    return float(distance[0]), float(s[0])


def distances(
    center: FloatArray, radius: FloatArray, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> tuple[FloatArray, FloatArray]:
    cone = Cones(a[None], b[None], np.array([radius_a]), np.array([radius_b])).kernel(0)
    out, count = np.full((2, len(radius) + 3), np.nan), len(radius)
    round_cone_distances(spheres_of(center, radius), count, cone, out[0], out[1])
    assert np.isnan(out[:, count:]).all()
    return out[0, :count], out[1, :count]


def size(*parts: FloatArray | float) -> float:
    return max(float(np.abs(part).max()) for part in parts)


points = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
radii = st.one_of(st.floats(0.0, 0.5), st.sampled_from([0.0, 1e-3, 0.5]))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """A sphere and a round cone, often degenerate: a sphere, a capsule, one end inside the other, radii 1000 to 1."""
    center, a, b = draw(points), draw(points), draw(points)
    radius, one, other = draw(radii), draw(radii), draw(radii)
    kind = draw(st.sampled_from(["free", "coincident", "capsule", "contained", "tangent", "needle", "on the axis"]))
    small, large = sorted((one, other))
    if kind == "coincident":
        b = a.copy()
    elif kind == "capsule":
        small = large
    elif kind == "contained":
        b = a + (b - a) * min(1.0, 0.9 * (large - small) / max(float(np.linalg.norm(b - a)), 1e-9))
    elif kind == "tangent":
        direction = np.array([1.0, 0.0, 0.0])
        b = a + (large - small) * (1.0 + draw(st.sampled_from([-1e-15, 0.0, 1e-15, 1e-9, 1e-4]))) * direction
    elif kind == "needle":
        large, small = 0.5, 0.0005
    elif kind == "on the axis":
        center = a + draw(st.floats(-0.5, 1.5)) * (b - a)
    return center, radius, a, b, large, small


@given(scenes())
@settings(max_examples=400)
def test_distance_is_the_least_over_the_axis(scene: Scene) -> None:
    distance, s = kernel(*scene)
    center, radius, a, b, radius_a, radius_b = scene
    assert 0.0 <= s <= 1.0
    # Just off tangency tan φ is known only to half the digits, but the minimum is flat there: the distance is good.
    assert distance == pytest.approx(brute_force(*scene), abs=1e-9 * size(center, radius, a, b, radius_a))
    there = float(np.linalg.norm(center - (a + s * (b - a)))) - (radius_a + s * (radius_b - radius_a)) - radius
    assert distance == pytest.approx(there, abs=TOLERANCE * size(center, radius, a, b, radius_a))


def test_ordinary_cones_agree_to_rounding() -> None:
    random = np.random.default_rng(1)
    for _ in range(100):
        center, a = random.uniform(-0.1, 0.1, (2, 3))
        direction = random.normal(size=3)
        b = a + direction / np.linalg.norm(direction) * random.uniform(0.02, 0.05)
        radius_a = random.uniform(0.005, 0.02)
        scene = (center, random.uniform(0.0, 0.02), a, b, radius_a, radius_a * random.uniform(0.3, 1.0))
        assert kernel(*scene)[0] == pytest.approx(brute_force(*scene), abs=1e-15)


@pytest.mark.parametrize(
    ("length", "radius_a", "radius_b"),
    [(0.0, 1.0, 1.0), (0.0, 1.0, 0.0), (0.5, 1.0, 0.5), (0.4, 1.0, 0.5), (0.0, 0.0, 0.0)],
)
def test_a_cone_that_is_one_sphere_has_no_slope(length: float, radius_a: float, radius_b: float) -> None:
    assert cone_slope(length, radius_a, radius_b) == (0.0, 0.0)


def test_slope_is_the_half_angle() -> None:
    tangent, inverse = cone_slope(2.0, 1.0, 0.0)
    assert tangent == pytest.approx(math.tan(math.asin(0.5)), abs=1e-16)
    assert inverse == 0.5
    tangent, _ = cone_slope(math.nextafter(0.5, 1.0), 0.75, 0.25)
    assert math.isfinite(tangent)


@given(scenes(), points)
@settings(max_examples=200)
def test_distance_is_convex_and_changes_no_faster_than_the_sphere_moves(scene: Scene, other: FloatArray) -> None:
    """A round cone is convex, so its signed distance is convex and 1-Lipschitz: what bounded motion rests on."""
    center, radius, a, b, radius_a, radius_b = scene
    here = kernel(center, radius, a, b, radius_a, radius_b)[0]
    there = kernel(other, radius, a, b, radius_a, radius_b)[0]
    middle = kernel(0.5 * (center + other), radius, a, b, radius_a, radius_b)[0]
    assert abs(here - there) <= float(np.linalg.norm(other - center)) + 1e-9
    assert middle <= 0.5 * (here + there) + 1e-9


@given(scenes(), st.integers(0, 40), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_many_spheres_on_the_vector_unit_are_each_alone(scene: Scene, count: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    center, radius = random.uniform(-1.0, 1.0, (count, 3)), random.uniform(0.0, 0.3, count)
    together = np.array(distances(center, radius, *scene[2:])).T
    for i in range(count):
        np.testing.assert_allclose(together[i], kernel(center[i], float(radius[i]), *scene[2:]), rtol=0.0, atol=1e-13)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_sphere_pairs_are_numpys(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(0, 20))
    hand, thing = random.uniform(-1.0, 1.0, (2, count + 2, 3))
    hand_radius, thing_radius = random.uniform(0.0, 0.3, (2, count + 2))
    position = random.uniform(-1.0, 1.0, 3)
    rotation = np.ascontiguousarray(np.linalg.qr(random.normal(size=(3, 3)))[0])
    out = np.full(count + 2, np.nan)
    ours, others = spheres_of(hand, hand_radius), spheres_of(thing, thing_radius)
    sphere_pair_distances(ours, others, count, position, rotation, out)
    expected = np.linalg.norm(position + hand @ rotation.T - thing, axis=1) - hand_radius - thing_radius
    np.testing.assert_allclose(out[:count], expected[:count], atol=1e-14)
    assert np.isnan(out[count:]).all()
