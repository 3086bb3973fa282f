"""Distances of round cones to spheres and to each other, against minimisation over their axes."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import Cones, to_cone
from sphere_scenes import spheres_of

from hhsim.arrays import FloatArray
from hhsim.kernels.round_cone import round_cone_distances, round_cone_pair

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
    round_cone_distances(spheres_of(center[None], np.array([radius])), 1, cone, out[0], out[1])
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
