"""Elementary functions against mpmath, rotations against scipy, distances of round cones by search."""

import math
import struct
from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import Cones, to_cone
from scipy.spatial.transform import Rotation
from sphere_scenes import spheres_of

from hhsim.arrays import FloatArray
from hhsim.kernels.arithmetic import LARGEST_ANGLE, arc_tangent, exponential, hypotenuse, sine_cosine
from hhsim.kernels.rotation import euler_quaternion, quaternion_to_matrix, rotate_quaternion, rotation_vector_between
from hhsim.kernels.round_cone import round_cone_distances, round_cone_pair
from hhsim.reproducible import arc_tangent as arc_tangents
from hhsim.reproducible import exponential as exponentials
from hhsim.reproducible import sine_and_cosine

WORST = 1.5
"""Error of any result [units in the last place]: it is the correctly rounded number or a neighbour of that."""
ARGUMENTS = 2000


def ulps(value: float, exact: mpmath.mpf) -> float:
    """Error in units in the last place of the exact value."""
    rounded = float(exact)
    if math.isinf(rounded) or math.isinf(value):
        return 0.0 if rounded == value else math.inf
    return float(abs(mpmath.mpf(value) - exact) / math.ulp(rounded))


def worst(found: FloatArray, exact: Callable[..., mpmath.mpf], *arguments: FloatArray) -> float:
    with mpmath.workprec(120):
        errors = (
            ulps(float(value), exact(*map(mpmath.mpf, map(float, given)))) for value, *given in zip(found, *arguments)
        )
        return max(errors)


def angles(random: np.random.Generator, count: int) -> FloatArray:
    """Angles of all magnitudes, and near the multiples of a quarter turn, where what is left is small."""
    third = count // 3
    quarters = random.integers(-600_000, 600_000, third) * (0.5 * math.pi)
    nearby = quarters + quarters * random.choice([0.0, 2.3e-16, -1e-12, 1e-8], third)
    magnitudes = 10.0 ** random.uniform(-12.0, 6.0, third) * random.choice([-1.0, 1.0], third)
    return np.concatenate([nearby, magnitudes, random.uniform(-4.0, 4.0, count - 2 * third)])


def lengths(random: np.random.Generator, count: int) -> FloatArray:
    values: FloatArray = random.normal(size=count) * 10.0 ** random.choice([0.0, 0.0, -3.0, 5.0, -150.0, 150.0], count)
    return values


def test_they_are_within_a_unit_of_the_last_place() -> None:
    random, count = np.random.default_rng(0), ARGUMENTS
    angle, x, y = angles(random, count), lengths(random, count), lengths(random, count)
    sine, cosine = sine_and_cosine(angle)
    assert worst(sine, mpmath.sin, angle) <= WORST
    assert worst(cosine, mpmath.cos, angle) <= WORST
    assert worst(arc_tangents(y, x), mpmath.atan2, y, x) <= WORST
    of_unit, to_unit = random.uniform(-1.0, 1.0, count), random.uniform(-1.0, 1.0, count)
    assert worst(arc_tangents(of_unit, to_unit), mpmath.atan2, of_unit, to_unit) <= WORST
    length = np.array([hypotenuse(*sides) for sides in zip(x, y, strict=True)])
    assert worst(length, mpmath.hypot, x, y) <= WORST
    exponent = np.concatenate([random.uniform(-700.0, 700.0, count // 2), random.normal(size=count - count // 2)])
    assert worst(exponentials(exponent), mpmath.exp, exponent) <= WORST


def test_edges() -> None:
    signs = [0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, 5e-324, -1.7e308]
    bits = [
        struct.pack("d", found(y, x)) == struct.pack("d", known(y, x))
        for y in signs
        for x in signs
        for found, known in ((arc_tangent, math.atan2), (lambda a, b: hypotenuse(a, b), math.hypot))
    ]
    assert all(bits)
    for bad in (math.nan, math.inf, -math.inf, 2.0 * LARGEST_ANGLE):
        assert all(map(math.isnan, sine_cosine(bad)))
    assert math.isnan(arc_tangent(math.nan, 1.0)) and math.isnan(exponential(math.nan))
    assert sine_cosine(0.0) == (0.0, 1.0) and exponential(0.0) == 1.0


def unit(seed: int) -> FloatArray:
    values = np.random.default_rng(seed).normal(size=4)
    return values / np.linalg.norm(values)


def scipy_rotation(quaternion: FloatArray) -> Rotation:
    return Rotation.from_quat(quaternion, scalar_first=True)


def matrix(quaternion: FloatArray) -> FloatArray:
    out = np.empty((3, 3))
    quaternion_to_matrix(quaternion, out)
    return out


quaternions = st.integers(0, 2**32 - 1).map(unit)
axes = st.integers(0, 2**32 - 1).map(lambda seed: unit(seed)[:3] / np.linalg.norm(unit(seed)[:3]))
euler_angles = st.one_of(
    st.floats(0.0, 4.0 * math.pi),
    st.sampled_from([0.0, 1e-300, 1e-12, 0.9e-8, 1.1e-8, 1e-6, math.pi, math.nextafter(math.pi, 0.0), 2.0 * math.pi]),
)


@given(quaternions, axes, euler_angles)
@settings(max_examples=100)
def test_left_increment_is_scipys(quaternion: FloatArray, axis: FloatArray, angle: float) -> None:
    moved, step = np.empty(4), angle * axis
    rotate_quaternion(quaternion, *step.tolist(), moved)
    expected = Rotation.from_rotvec(step) * scipy_rotation(quaternion)
    np.testing.assert_allclose(matrix(moved), expected.as_matrix(), atol=4e-15)
    assert abs(np.linalg.norm(moved) - 1.0) <= 4e-16


@given(quaternions, quaternions)
@settings(max_examples=100)
def test_vector_between_is_scipys(source: FloatArray, target: FloatArray) -> None:
    expected = scipy_rotation(target) * scipy_rotation(source).inv()
    vector = np.empty(3)
    rotation_vector_between(source, target, vector)
    assert np.linalg.norm(vector) <= math.pi * (1.0 + 1e-15)
    np.testing.assert_allclose(Rotation.from_rotvec(vector).as_matrix(), expected.as_matrix(), atol=4e-15)
    if expected.magnitude() < math.pi - 1e-6:
        np.testing.assert_allclose(vector, expected.as_rotvec(), atol=1e-9)


ANGLES = st.tuples(*[st.floats(-7.0, 7.0)] * 3).map(np.array)


def paper_matrix(euler: FloatArray) -> FloatArray:
    """R_L^W as the paper prints it."""
    (ca, sa), (cb, sb), (cc, sc) = ((math.cos(angle), math.sin(angle)) for angle in euler)
    return np.array(
        [
            [cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa],
            [sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa],
            [-sb, cb * sa, cb * ca],
        ]
    )


def matrix_of(euler: FloatArray) -> FloatArray:
    quaternion = np.empty(4)
    euler_quaternion(euler, quaternion)
    assert abs(np.linalg.norm(quaternion) - 1.0) < 1e-15
    return matrix(quaternion)


@given(ANGLES)
def test_the_quaternion_is_the_printed_matrix(euler: FloatArray) -> None:
    np.testing.assert_allclose(matrix_of(euler), paper_matrix(euler), atol=1e-14)
    np.testing.assert_allclose(Rotation.from_euler("xyz", euler).as_matrix(), paper_matrix(euler), atol=1e-14)


Scene = tuple[FloatArray, float, FloatArray, FloatArray, float, float]
TOLERANCE = 1e-12
"""Allowed error relative to the size of the scene [-]."""
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
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
    center, radius, a, b, radius_a, radius_b = scene
    cone = Cones(a[None], b[None], np.array([radius_a]), np.array([radius_b])).kernel(0)
    out = np.full((2, 4), np.nan)
    round_cone_distances(spheres_of(center[None], np.array([radius])), 0, 1, cone, out[0], out[1])
    assert np.isnan(out[:, 1:]).all()
    distance, s = out[:, 0].tolist()
    assert 0.0 <= s <= 1.0
    size = max(float(np.abs(part).max()) for part in scene[:5])
    # Just off tangency tan φ is known only to half the digits, but the minimum is flat there: the distance is good.
    brute = float(to_cone(center[None], a, b, radius_a, radius_b)[0]) - radius
    assert distance == pytest.approx(brute, abs=1e-9 * size)
    there = float(np.linalg.norm(center - (a + s * (b - a)))) - (radius_a + s * (radius_b - radius_a)) - radius
    assert distance == pytest.approx(there, abs=TOLERANCE * size)


def least(function: Callable[[float], float]) -> float:
    low, high = 0.0, 1.0
    for _ in range(48):
        one, other = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        low, high = (low, other) if function(one) < function(other) else (one, high)
    return min(function(0.0), function(1.0), function((low + high) / 2.0))


@st.composite
def pairs(draw: st.DrawFn) -> tuple[FloatArray, FloatArray]:
    """Axis ends of shape (4, 3) and radii of two cones: free, parallel, nearly parallel, crossing, one a sphere."""
    a, b, c, d = draw(points), draw(points), draw(points), draw(points)
    kind = draw(st.sampled_from(["free", "parallel", "nearly parallel", "crossing", "sphere"]))
    if "parallel" in kind:
        d = c + (b - a) * draw(st.sampled_from([1.0, -0.5])) + (1e-6 * d if kind != "parallel" else 0.0)
    elif kind == "crossing":
        c, d = (a + b) / 2.0 - d, (a + b) / 2.0 + d
    elif kind == "sphere":
        d = c.copy()
    one, two = sorted((draw(radii), draw(radii))), sorted((draw(radii), draw(radii)))
    return np.stack([a, b, c, d]), np.array([one[1], one[0], two[1], two[0]])


@settings(max_examples=100, deadline=None)
@given(pairs())
def test_distance_is_the_least_over_both_axes(pair: tuple[FloatArray, FloatArray]) -> None:
    ends, radius = pair
    a, b, c, d = ends.tolist()
    cones = Cones(ends[[0, 2]], ends[[1, 3]], radius[[0, 2]], radius[[1, 3]])

    def at(s: float, t: float) -> float:
        gap = [x + s * (y - x) - z - t * (w - z) for x, y, z, w in zip(a, b, c, d)]
        own = radius[0] + s * (radius[1] - radius[0]), radius[2] + t * (radius[3] - radius[2])
        return float(math.hypot(*gap) - own[0] - own[1])

    distance, s, t, *normal = round_cone_pair(cones.kernel(0), cones.kernel(1))
    assert abs(distance - least(lambda one: least(lambda two: at(one, two)))) < 1e-9
    assert abs(distance - at(s, t)) < 1e-12
    assert abs(math.hypot(*normal) - 1.0) < 1e-12
    back, *_ = round_cone_pair(cones.kernel(1), cones.kernel(0))
    assert abs(back - distance) < 1e-9
