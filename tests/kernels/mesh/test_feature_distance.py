"""Round cones against vertices, edges and faces by search along the axis; bounds by motions that try to beat them."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import Cones, along_axes, least_of_features, random_cones, to_line, to_segment, to_triangle
from numpy.typing import NDArray
from sampled import sampled
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.kernels.contact.surface import cone_distance
from hhsim.kernels.mesh.feature_distance import ELSEWHERE, ON, edge_witness, line_witness, vertex_witness
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.round_cone import RoundCone
from hhsim.kernels.sphere_tree import STACK_SIZE
from hhsim.mesh.features import mesh_features

EXACT = 1e-12
"""Of distances of centimetres [m]."""
SEEDS = st.integers(0, 2**32 - 1)
ONE_FACE = np.array([[0, 1, 2]])
STACK = np.zeros(STACK_SIZE, np.int64)


def alone(corners: FloatArray) -> MeshFeatures:
    """A triangle, shape (3, 3), as a mesh."""
    return mesh_features(corners, ONE_FACE, closed=False)[0]


def random_triangles(random: np.random.Generator, count: int) -> FloatArray:
    """Of centimetres, and no slivers: their least height is above 3 % of the longest side."""
    found = np.empty((0, 3, 3))
    while len(found) < count:
        corners = random.normal(0.0, 0.02, (count, 3, 3))
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        found = np.concatenate([found, corners[area > 0.03 * sides**2]])
    return found[:count]


def crossing(cones: Cones, corners: FloatArray) -> NDArray[np.bool_]:
    """Which axes come within 1 µm of their triangles: there a distance has a kink."""
    axes = Cones(cones.a, cones.b, np.zeros(len(cones.a)), np.zeros(len(cones.a)))
    return np.asarray(along_axes(axes, lambda x: to_triangle(x, corners)) < 1e-6)


@given(SEEDS)
@settings(max_examples=40)
def test_vertices_lines_and_edges(seed: int) -> None:
    random = np.random.default_rng(seed)
    cones = random_cones(random, 20)
    p, q = random.normal(0.0, 0.02, (2, 20, 3))
    vertex = along_axes(cones, lambda x: np.asarray(np.linalg.norm(x - p, axis=-1)))
    line = along_axes(cones, lambda x: to_line(x, p, q))
    edge = along_axes(cones, lambda x: to_segment(x, p, q))
    for i in range(20):
        cone = cones.kernel(i)
        length = float(np.linalg.norm(q[i] - p[i]))
        along = (q[i] - p[i]) / length
        found, s = vertex_witness(cone, *(p[i] - cones.a[i]).tolist())
        assert found == pytest.approx(vertex[i], abs=EXACT)
        assert_on_axis(cone, s, np.linalg.norm(center(cone, s) - p[i]), found)
        found, s, foot = line_witness(cone, *(cones.a[i] - p[i]).tolist(), *along.tolist())
        assert found == pytest.approx(line[i], abs=EXACT)
        assert_on_axis(cone, s, np.linalg.norm(center(cone, s) - p[i] - foot * along), found)
        inside, at = at_edge(cone, p[i], along, length)
        assert (inside == ELSEWHERE) == (not -ON <= foot <= length + ON)
        assert inside == ELSEWHERE or (inside, at) == (found, s)
        # What is not an edge's is one of its ends'.
        ends = [vertex_witness(cone, *(end[i] - cones.a[i]).tolist())[0] for end in (p, q)]
        assert min(inside, *ends) == pytest.approx(edge[i], abs=EXACT)


def at_edge(cone: RoundCone, start: FloatArray, along: FloatArray, extent: float) -> tuple[float, float]:
    """The kernel's (distance, s) for the edge from `start` on."""
    dx, dy, dz = cone.x - float(start[0]), cone.y - float(start[1]), cone.z - float(start[2])
    found: tuple[float, float] = edge_witness(
        cone, dx, dy, dz, float(along[0]), float(along[1]), float(along[2]), extent
    )
    return found


def center(cone: Any, s: float) -> FloatArray:
    return np.array([cone.x + s * cone.ux, cone.y + s * cone.uy, cone.z + s * cone.uz])


def assert_on_axis(cone: Any, s: float, away: Any, distance: float) -> None:
    """The parameter is one of the axis, and the distance that of the sphere there."""
    assert 0.0 <= s <= cone.length
    assert away - cone.radius + cone.drop * cone.inverse_length * s == pytest.approx(distance, abs=EXACT)


def check_pairs(count: int, seed: int) -> int:
    """Random cones against random triangles; returns how many axes went through theirs."""
    random = np.random.default_rng(seed)
    corners, cones = random_triangles(random, count), random_cones(random, count)
    expected = along_axes(cones, lambda x: to_triangle(x, corners))
    through = crossing(cones, corners)
    for i in range(count):
        mesh = alone(corners[i])
        assert cone_distance(mesh, cones.kernel(i), math.inf, STACK) == pytest.approx(expected[i], abs=EXACT)
        least = least_of_features(mesh, cones.kernel(i))
        # Where the axis goes through, a face knows nothing of it: it is never asked about a body that deep.
        assert least >= expected[i] - EXACT
        if not through[i]:
            assert least == pytest.approx(expected[i], abs=EXACT)
    return int(through.sum())


@pytest.mark.parametrize(("count", "seed"), sampled([(600, 1), (100_000, 2)], lambda place, _: place == 0))
def test_a_cone_and_a_triangle(count: int, seed: int) -> None:
    assert 0.004 * count < check_pairs(count, seed) < 0.5 * count


def unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


def sliver(random: np.random.Generator, aspect: float) -> tuple[FloatArray, FloatArray]:
    """A triangle whose longest side is `aspect` times its height, and its normal; a corner is anywhere along it."""
    side = random.uniform(0.01, 0.05)
    foot = random.choice([0.0, 0.02, 0.5, 1.0])
    corners = np.array([[0.0, 0.0, 0.0], [side, 0.0, 0.0], [foot * side, side / aspect, 0.0]])
    turn = Rotation.random(rng=random).as_matrix()
    corners = np.roll(corners, random.integers(3), axis=0)
    return corners @ turn.T + random.normal(0.0, 0.01, 3), turn[:, 2]


@given(SEEDS, st.sampled_from([1e2, 1e3, 1e4, 1e5, 1e6, 1e8, 1e10, 1e12]))
@settings(max_examples=32)
def test_slivers(seed: int, aspect: float) -> None:
    random = np.random.default_rng(seed)
    corners, normal = sliver(random, aspect)
    cones = random_cones(random, 8, 0.02)
    # Half of them over its plane beyond a tip, where it ends but its long sides, produced, are still near.
    tip = corners[random.integers(3)]
    onwards = unit(tip - corners.mean(axis=0))
    cones.a[:4] = tip + random.uniform(0.0, 0.01, 4)[:, None] * onwards + 0.009 * normal
    cones.b[:4] = cones.a[:4] + 0.01 * normal + random.normal(0.0, 0.004, (4, 3))
    # Seen from a distance d a sliver of height h is as far as its nearest side, but for h²/2d.
    height = 0.05 / aspect
    if aspect <= 1e3:
        expected = along_axes(cones, lambda x: to_triangle(x, corners))
    else:
        ends = [(corners[k], corners[(k + 1) % 3]) for k in range(3)]
        expected = np.min([along_axes(cones, partial(to_segment, p=e[0], q=e[1])) for e in ends], axis=0)
    mesh = alone(corners)
    judged = 0
    for i in range(8):
        if expected[i] + cones.radius_b[i] < 1e-3:
            continue
        tolerance = 1e-10 + (0.0 if aspect <= 1e3 else height**2 / 1e-3)
        assert cone_distance(mesh, cones.kernel(i), math.inf, STACK) == pytest.approx(expected[i], abs=tolerance)
        assert least_of_features(mesh, cones.kernel(i)) == pytest.approx(expected[i], abs=tolerance)
        judged += 1
    assert judged >= 4
