"""The kernels' sine, cosine, arc tangent, hypotenuse and exponential against mpmath, edges included."""

import math
import struct
from collections.abc import Callable

import mpmath
import numpy as np

from hhsim.arrays import FloatArray
from hhsim.kernels.arithmetic import LARGEST_ANGLE, arc_tangent, exponential, hypotenuse, sine_cosine
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
