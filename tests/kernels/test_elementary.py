"""Elementary functions against mpmath, rotations and Euler angles against scipy: edges and all branches included."""

import math
import struct
from collections.abc import Callable

import mpmath
import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.kernels.arithmetic import LARGEST_ANGLE, arc_tangent, exponential, hypotenuse, sine_cosine
from hhsim.kernels.rotation import euler_quaternion, quaternion_to_matrix, rotate_quaternion, rotation_vector_between
from hhsim.reproducible import arc_tangent as arc_tangents
from hhsim.reproducible import exponential as exponentials
from hhsim.reproducible import sine_and_cosine

WORST = 1.5
"""Error of any result [units in the last place]: it is the correctly rounded number or a neighbour of that."""
ARGUMENTS = 2000
SUSPECTS = 300
"""Arguments of a larger sample that mpmath judges: those with the largest errors by numpy's long double."""
WIDE: dict[Callable[..., mpmath.mpf], np.ufunc] = {
    mpmath.sin: np.sin, mpmath.cos: np.cos, mpmath.atan2: np.arctan2, mpmath.hypot: np.hypot, mpmath.exp: np.exp,
}  # fmt: skip


def ulps(value: float, exact: mpmath.mpf) -> float:
    """Error in units in the last place of the exact value."""
    rounded = float(exact)
    if math.isinf(rounded) or math.isinf(value):
        return 0.0 if rounded == value else math.inf
    return float(abs(mpmath.mpf(value) - exact) / math.ulp(rounded))


def worst(found: FloatArray, exact: Callable[..., mpmath.mpf], *arguments: FloatArray) -> float:
    if len(found) > ARGUMENTS and np.finfo(np.longdouble).nmant > 60:
        precise = WIDE[exact](*(given.astype(np.longdouble) for given in arguments))
        suspects = np.argsort(np.abs((found - precise) / np.spacing(np.abs(found))))[-SUSPECTS:]
        found, arguments = found[suspects], tuple(given[suspects] for given in arguments)
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


def check(random: np.random.Generator, count: int) -> None:
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


def test_they_are_within_a_unit_of_the_last_place() -> None:
    check(np.random.default_rng(0), ARGUMENTS)


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


def between(source: FloatArray, target: FloatArray) -> FloatArray:
    out = np.empty(3)
    rotation_vector_between(source, target, out)
    return out


def rotated(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    out = np.empty(4)
    rotate_quaternion(quaternion, float(vector[0]), float(vector[1]), float(vector[2]), out)
    return out


quaternions = st.integers(0, 2**32 - 1).map(unit)
axes = st.integers(0, 2**32 - 1).map(lambda seed: unit(seed)[:3] / np.linalg.norm(unit(seed)[:3]))
euler_angles = st.one_of(
    st.floats(0.0, 4.0 * math.pi),
    st.sampled_from([0.0, 1e-300, 1e-12, 0.9e-8, 1.1e-8, 1e-6, math.pi, math.nextafter(math.pi, 0.0), 2.0 * math.pi]),
)


@given(quaternions)
@example(np.array([1.0, 0.0, 0.0, 0.0]))
@example(np.array([0.0, 0.0, 0.0, -1.0]))
@settings(max_examples=50)
def test_matrix_is_scipys(quaternion: FloatArray) -> None:
    np.testing.assert_allclose(matrix(quaternion), scipy_rotation(quaternion).as_matrix(), atol=4e-16)
    np.testing.assert_array_equal(matrix(-quaternion), matrix(quaternion))


@given(quaternions, axes, euler_angles)
@settings(max_examples=100)
def test_left_increment_is_scipys(quaternion: FloatArray, axis: FloatArray, angle: float) -> None:
    moved = rotated(quaternion, angle * axis)
    expected = Rotation.from_rotvec(angle * axis) * scipy_rotation(quaternion)
    np.testing.assert_allclose(matrix(moved), expected.as_matrix(), atol=4e-15)
    assert abs(np.linalg.norm(moved) - 1.0) <= 4e-16


@given(quaternions, quaternions)
@settings(max_examples=100)
def test_vector_between_is_scipys(source: FloatArray, target: FloatArray) -> None:
    expected = scipy_rotation(target) * scipy_rotation(source).inv()
    vector = between(source, target)
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
    quaternion, matrix = np.empty(4), np.empty((3, 3))
    euler_quaternion(euler, quaternion)
    assert abs(np.linalg.norm(quaternion) - 1.0) < 1e-15
    quaternion_to_matrix(quaternion, matrix)
    return matrix


@given(ANGLES)
def test_the_quaternion_is_the_printed_matrix(euler: FloatArray) -> None:
    np.testing.assert_allclose(matrix_of(euler), paper_matrix(euler), atol=1e-14)
    np.testing.assert_allclose(Rotation.from_euler("xyz", euler).as_matrix(), paper_matrix(euler), atol=1e-14)
