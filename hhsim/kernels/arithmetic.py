"""Arithmetic with the same bits on every machine: products, sums, and elementary functions.

Fused products and sums in vector lanes, each rounded as the source says: the same bits on every machine.

A compiler that may fuse or reorder chooses by the processor. `fused` rounds once everywhere. In `dot`, term i is added
in lane i modulo `LANES`, and the lanes are added by halves at the end.

Sine, cosine, arc tangent and hypotenuse of the kernels, with the same bits on every machine.

The system's mathematical library rounds the last bit by processor and version. These functions use sums, products,
fused products, quotients and square roots only, which IEEE 754 rounds in one way. Each result is within one unit in the
last place of the correctly rounded one.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils

from hhsim.kernels.jit import Array, jit, jit_inline, lowered

LANES = 8
"""Numbers in one vector instruction, or in two; vectors are padded with zeros to whole multiples."""
VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INT = ir.IntType(32)


def _of_lanes(builder: Any, lanes: Any, join: Callable[[Any, Any], Any]) -> Any:
    """Join the lanes of a vector by halves."""
    while (width := lanes.type.count // 2) > 0:
        places = [ir.Constant(ir.VectorType(_INT, width), [*range(first, first + width)]) for first in (0, width)]
        lanes = join(*(builder.shuffle_vector(lanes, lanes, half) for half in places))
    return builder.extract_element(lanes, _INT(0))


@lowered(float)
def fused(builder: Any, first: Any, second: Any, third: Any) -> Any:
    """Return first * second + third, rounded once."""
    return builder.fma(first, second, third)


@lowered(float)
def dot(builder: Any, first: Any, second: Any, chunks: Any) -> Any:
    """Return the sum of products of the first `chunks` times `LANES` numbers of two contiguous vectors."""
    data = [builder.bitcast(array.data, VECTOR.as_pointer()) for array in (first, second)]
    kind = ir.FunctionType(VECTOR, (VECTOR, VECTOR, VECTOR))
    fma = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{LANES}f64")
    total = cgutils.alloca_once_value(builder, ir.Constant(VECTOR, [0.0] * LANES))
    with cgutils.for_range(builder, chunks) as loop:
        left, right = (builder.load(builder.gep(place, [loop.index]), align=8) for place in data)
        builder.store(builder.call(fma, (left, right, builder.load(total))), total)
    return _of_lanes(builder, builder.load(total), builder.fadd)


@lowered(float)
def least_of_chunks(builder: Any, values: Any, first: Any, chunks: Any, above: Any) -> Any:
    """Return the least of `chunks` times `LANES` numbers from `first` on that are greater than `above`, or ∞."""
    place = builder.bitcast(builder.gep(values.data, [first]), VECTOR.as_pointer())
    floor = ir.Constant(VECTOR, ir.Undefined)
    for lane in range(LANES):
        floor = builder.insert_element(floor, above, _INT(lane))
    least = cgutils.alloca_once_value(builder, ir.Constant(VECTOR, [math.inf] * LANES))
    with cgutils.for_range(builder, chunks) as loop:
        value, before = builder.load(builder.gep(place, [loop.index]), align=8), builder.load(least)
        less = builder.fcmp_ordered("<", value, before)
        counts = builder.and_(less, builder.fcmp_ordered(">", value, floor))
        builder.store(builder.select(counts, value, before), least)

    def smaller(low: Any, high: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", low, high), low, high)

    return _of_lanes(builder, builder.load(least), smaller)


@jit_inline
def least_above(values: Array, start: int, stop: int, above: float) -> float:
    """Compute the least of values[start:stop] that is greater than `above`; infinite if there is none."""
    chunks = (stop - start) // LANES
    least = least_of_chunks(values, start, chunks, above)
    for i in range(start + LANES * chunks, stop):
        least = values[i] if (values[i] < least) & (values[i] > above) else least
    return least


@jit_inline
def product(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Compute the scalar product of two vectors, rounded once a term."""
    return fused(az, bz, fused(ay, by, ax * bx))


LARGEST_ANGLE = 1e6
"""Largest angle [rad] that is reduced to an octant; beyond, and for NaN, sine and cosine are NaN."""

_QUARTERS = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)
"""π/2 rounded, what is left of it rounded, and what is left of that."""

_TO_WHOLE = 1.5 * 2.0**52
"""Number whose sum with one of magnitude up to 2⁵¹ is rounded to a whole number."""

_SIXTEENTHS = np.array(
    [
        (0.0, 0.0),
        (0.06241880999595735, -1.5490756308295046e-18),
        (0.12435499454676144, -3.1253241424539383e-18),
        (0.18534794999569476, 4.180692268843079e-18),
        (0.24497866312686414, 1.0698755618734451e-17),
        (0.3028848683749714, -1.1010827903001369e-17),
        (0.35877067027057225, -2.4623815582638635e-17),
        (0.4124104415973873, -1.587652227770689e-17),
        (0.4636476090008061, 2.2698777452961687e-17),
        (0.5123894603107377, -2.5462781472855804e-17),
        (0.5585993153435624, -5.4556305485916264e-18),
        (0.6022873461349642, 2.950430737228402e-17),
        (0.6435011087932844, 1.5834785051444286e-17),
        (0.6823165548747481, 6.943223671560008e-18),
        (0.7188299996216245, -2.1478388444456983e-17),
        (0.7531512809621944, -2.4256934659182068e-17),
        (0.7853981633974483, 3.061616997868383e-17),
    ]
)
"""Arc tangents [rad] of k/16, k = 0 to 16: rounded, and what is left."""

_LOG_2, _LOG_2_REST = 0.6931471805599453, 2.3190468138462996e-17
"""Natural logarithm of 2: rounded, and what is left of it."""
MOST_EXPONENT = 745.2
"""Exponent beyond whose magnitude the exponential is no float."""

_HUGE, _TINY = 2.0**500, 2.0**-500
"""Magnitudes beyond which squares and sums of squares leave the range of a float."""
_DOWN, _UP = 2.0**-600, 2.0**600


@jit_inline
def sine_cosine(angle: float) -> tuple[float, float]:
    """Compute sine and cosine of an angle [rad] of magnitude up to `LARGEST_ANGLE`."""
    if not abs(angle) <= LARGEST_ANGLE:
        return math.nan, math.nan
    quarters = fused(angle, 1.0 / _QUARTERS[0], _TO_WHOLE) - _TO_WHOLE
    # The angle less whole quarters, and the rounding of that: `first` is exact, near a whole quarter it is small.
    first, second = fused(quarters, -_QUARTERS[0], angle), quarters * _QUARTERS[1]
    x = first - second
    back = x - first
    rest = (first - (x - back)) - (second + back) - fused(quarters, _QUARTERS[1], -second)
    rest = fused(quarters, -_QUARTERS[2], rest)
    # Series of (sin x - x) / x³ and (cos x - 1 + x²/2) / x⁴, to 10⁻¹⁸ in the octant.
    z = x * x
    z2 = z * z
    z4 = z2 * z2
    odd = fused(z2, fused(z, 1.0 / 362880.0, -1.0 / 5040.0), fused(z, 1.0 / 120.0, -1.0 / 6.0))
    odd_rest = fused(z, 1.0 / 355687428096000.0, -1.0 / 1307674368000.0)
    odd = fused(z4, fused(z2, odd_rest, fused(z, 1.0 / 6227020800.0, -1.0 / 39916800.0)), odd)
    even = fused(z2, fused(z, -1.0 / 3628800.0, 1.0 / 40320.0), fused(z, -1.0 / 720.0, 1.0 / 24.0))
    even_rest = fused(z, -1.0 / 87178291200.0, 1.0 / 479001600.0)
    even = fused(z4, fused(z2, 1.0 / 20922789888000.0, even_rest), even)
    sine = x + fused(x * z, odd, fused(-0.5 * z, rest, rest))
    most = 1.0 - 0.5 * z
    cosine = most + (((1.0 - most) - 0.5 * z) + fused(z2, even, -x * rest))
    quadrant = int(quarters)
    swapped = quadrant & 1 != 0
    return (
        (cosine if swapped else sine) * (1 - (quadrant & 2)),
        (sine if swapped else cosine) * (1 - (quadrant + 1 & 2)),
    )


@jit_inline
def arc_tangent(y: float, x: float) -> float:
    """Compute the angle [rad] of the vector (x, y), in [-π, π], as `math.atan2` does, signs of zero included."""
    if math.isnan(x) or math.isnan(y):
        return math.nan
    low, high = abs(y), abs(x)
    steep = low > high
    if steep:
        low, high = high, low
    if high > 2.0**1020:
        low, high = 0.0625 * low, 0.0625 * high
    elif high < 2.0**-960:
        low, high = low * 2.0**100, high * 2.0**100
    if math.isinf(high):
        low, high = (1.0 if math.isinf(low) else 0.0), 1.0
    if high == 0.0:
        high = 1.0
    k = int(16.0 * (low / high) + 0.5)
    tangent = 0.0625 * k
    ratio = (low - tangent * high) / (high + tangent * low)
    z = ratio * ratio
    change = ratio * z * (-1.0 / 3.0 + z * (1.0 / 5.0 + z * (-1.0 / 7.0 + z * (1.0 / 9.0 - z * (1.0 / 11.0)))))
    angle, rest = _SIXTEENTHS[k, 0], _SIXTEENTHS[k, 1]
    sign = 1.0
    if steep:
        whole = _QUARTERS[0] - angle
        rest = ((_QUARTERS[0] - whole) - angle) + (_QUARTERS[1] - rest)
        angle, sign = whole, -1.0
    if math.copysign(1.0, x) < 0.0:
        whole = 2.0 * _QUARTERS[0] - angle
        rest = ((2.0 * _QUARTERS[0] - whole) - angle) + (2.0 * _QUARTERS[1] - rest)
        angle, sign = whole, -sign
    return math.copysign(angle + (sign * ratio + (sign * change + rest)), y)


@jit_inline
def hypotenuse(x: float, y: float) -> float:
    """Compute the length of the vector (x, y), as `math.hypot` does: no overflow before its time."""
    x, y = abs(x), abs(y)
    if math.isinf(x) or math.isinf(y):
        return math.inf
    largest = max(x, y)
    if largest > _HUGE:
        x, y = x * _DOWN, y * _DOWN
        return math.sqrt(x * x + y * y) * _UP
    if largest < _TINY:
        x, y = x * _UP, y * _UP
        return math.sqrt(x * x + y * y) * _DOWN
    return math.sqrt(x * x + y * y)


@jit_inline
def exponential(x: float) -> float:
    """Compute e^x, infinite from `MOST_EXPONENT` on and 0 below its negative."""
    if math.isnan(x):
        return math.nan
    if x > MOST_EXPONENT:
        return math.inf
    if x < -MOST_EXPONENT:
        return 0.0
    doublings = fused(x, 1.0 / _LOG_2, _TO_WHOLE) - _TO_WHOLE
    high = fused(doublings, -_LOG_2, x)
    r = fused(doublings, -_LOG_2_REST, high)
    rest = fused(doublings, -_LOG_2_REST, high - r)
    series = 1.0 / 6227020800.0 + r * (1.0 / 87178291200.0)
    series = 1.0 / 3628800.0 + r * (1.0 / 39916800.0 + r * (1.0 / 479001600.0 + r * series))
    series = 1.0 / 5040.0 + r * (1.0 / 40320.0 + r * (1.0 / 362880.0 + r * series))
    series = 1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r * series))
    value = 1.0 + (r + (rest + r * r * (0.5 + r * (1.0 / 6.0 + r * series))))
    return math.ldexp(value, int(doublings))


@jit
def sines_and_cosines(angle: Array, sine_out: Array, cosine_out: Array) -> None:
    """Compute `sine_cosine` of angles [rad], shape (n,)."""
    for i in range(angle.shape[0]):
        sine_out[i], cosine_out[i] = sine_cosine(angle[i])


@jit
def arc_tangents(y: Array, x: Array, angle_out: Array) -> None:
    """Compute `arc_tangent` of vectors (x, y), shapes (n,)."""
    for i in range(x.shape[0]):
        angle_out[i] = arc_tangent(y[i], x[i])


@jit
def exponentials(x: Array, value_out: Array) -> None:
    """Compute `exponential` of values, shape (n,)."""
    for i in range(x.shape[0]):
        value_out[i] = exponential(x[i])
