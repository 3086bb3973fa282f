"""Spheres around faces against what they must hold and find; normal cones of vertices against a linear program."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import Cones, along_axes, random_cones, to_triangle
from scipy.optimize import linprog

from hhsim.arrays import FloatArray
from hhsim.kernels.mesh.features import (
    ALONG,
    BRANCHING,
    GROUP_TESTS,
    NOWHERE,
    FaceSpheres,
    face_spheres,
    gather_faces,
    touchable_vertices,
)
from hhsim.kernels.sphere_tree import STACK_SIZE

COUNTS = (1, 2, 3, 7, 8, 9, 15, 16, 63, 64, 65, 66, 129, 513, 700)
SEEDS = st.integers(0, 2**32 - 1)


def soup(random: np.random.Generator, count: int) -> FloatArray:
    """Corners of triangles of many sizes (count, 3, 3) [m]; some coincide, some are slivers, some are points."""
    center = random.uniform(-0.05, 0.05, (count, 1, 3))
    corners = center + 10.0 ** random.uniform(-5.0, -1.5, (count, 1, 1)) * random.normal(size=(count, 3, 3))
    corners[random.random(count) < 0.1] = corners[0]
    thin = random.random(count) < 0.1
    corners[thin, 2] = 0.5 * (corners[thin, 0] + corners[thin, 1]) + 1e-9
    point = random.random(count) < 0.02
    corners[point] = corners[point, :1]
    return np.asarray(corners)


def to_point(x: FloatArray, p: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(x - p, axis=1))


def spheres_of(corners: FloatArray) -> FaceSpheres:
    return face_spheres(np.ascontiguousarray(corners.reshape(-1, 9)))


def under(spheres: FaceSpheres, node: int, i: int) -> list[int]:
    """Faces below sphere i of a block."""
    child = int(spheres.child[node, i])
    if spheres.block[node, 0, i] == NOWHERE:
        return []
    if child < 0:
        return [-1 - child]
    return [face for j in range(BRANCHING) for face in under(spheres, child, j)]


@pytest.mark.parametrize("count", COUNTS)
def test_spheres_enclose_the_faces_below_them_and_hold_each_face_once(count: int) -> None:
    corners = soup(np.random.default_rng(count), count)
    spheres = spheres_of(corners)
    assert sorted(face for i in range(BRANCHING) for face in under(spheres, 0, i)) == list(range(count))
    for node in range(len(spheres.child)):
        for i in range(BRANCHING):
            faces = under(spheres, node, i)
            center, radius = spheres.block[node, :3, i], spheres.block[node, 3, i]
            if faces:
                assert np.linalg.norm(corners[faces] - center, axis=2).max() <= radius
            else:
                assert radius == 0.0
    # No block but the root's is there for a single face or for what another one holds.
    assert len(spheres.child) <= count // 2 + 1


@given(SEEDS, st.sampled_from(COUNTS), st.sampled_from([1e-6, 1e-3, 4e-3, 0.02, 0.1]))
@settings(max_examples=25)
def test_every_face_within_reach_is_found_once(seed: int, count: int, reach: float) -> None:
    random = np.random.default_rng(seed)
    corners, cones = soup(random, count), random_cones(random, 1, 0.05)
    spheres = spheres_of(corners)
    stack, near, found = np.zeros(STACK_SIZE, np.int64), np.zeros(BRANCHING), np.zeros(count, np.int64)
    total, clearance, tests = gather_faces(spheres, cones.kernel(0), reach, reach, stack, near, found)
    faces = found[:total]
    assert len(set(faces.tolist())) == total
    assert GROUP_TESTS <= tests <= spheres.child.size
    many = Cones(*(np.repeat(values, count, axis=0) for values in cones))
    if cones.kernel(0).length == 0.0:
        many = many._replace(b=many.a, radius_b=many.radius_a)
    distance = along_axes(many, lambda x: to_triangle(x, corners))
    left_out = np.setdiff1d(np.arange(count), faces)
    assert set(np.flatnonzero(distance <= reach).tolist()) <= set(faces.tolist())
    assert clearance > reach
    assert distance[left_out].min(initial=np.inf) >= clearance - 1e-12
    # None whose own sphere is beyond reach.
    own = {
        -1 - int(spheres.child[n, i]): (n, i)
        for n, i in zip(*np.nonzero(spheres.block[:, 0] != NOWHERE))
        if spheres.child[n, i] < 0
    }
    for face in faces.tolist():
        n, i = own[face]
        away = along_axes(Cones(*(values[:1] for values in many)), partial(to_point, p=spheres.block[n, :3, i]))[0]
        assert away - spheres.block[n, 3, i] <= reach + 1e-12
        if face > 20:
            break
    if total > 0:
        room = gather_faces(spheres, cones.kernel(0), reach, reach, stack, near, found[: total - 1])
        assert room[0] == -1


def widest(spokes: FloatArray) -> tuple[float, FloatArray]:
    """The direction farthest from all spokes, and by how much it leads away from them: 0 where none does."""
    # Greatest t with spokes · d <= -t, |d| <= 1 in each coordinate.
    rows = np.column_stack([spokes, np.ones(len(spokes))])
    best = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=np.zeros(len(spokes)), bounds=[(-1, 1)] * 3 + [(0, None)])
    assert best.status == 0 and best.x is not None
    return float(best.x[3]), np.asarray(best.x[:3])


@given(SEEDS, st.integers(3, 9), st.booleans())
@settings(max_examples=150)
def test_vertices_are_touchable_where_a_direction_leads_away_from_all_spokes(
    seed: int, count: int, one_sided: bool
) -> None:
    random = np.random.default_rng(seed)
    spokes = random.normal(size=(count, 3)) + random.uniform(0.0, 1.5) * random.normal(size=3)
    spokes /= np.linalg.norm(spokes, axis=1)[:, None]
    away, direction = widest(spokes)
    if 0.0 < away < 1e-6:
        return  # as good as none
    outward = np.zeros((0, 3))
    expected = away > 0.0
    if one_sided:
        # A normal that has the whole cone on one side, as that of a closed mesh has.
        outward = (1.0 if seed % 2 else -1.0) * -spokes.sum(axis=0)[None]
        sampled = random.normal(size=(4000, 3))
        inside = sampled[(sampled @ spokes.T <= 0.0).all(axis=1)]
        rises = np.append(inside @ outward[0], direction @ outward[0])
        if expected and rises.min() < 0.0 < rises.max():
            return
        expected = expected and bool(rises.max() > 0.0)
    touchable = np.zeros(1, dtype=bool)
    touchable_vertices(np.array([0, count]), np.ascontiguousarray(spokes), outward, touchable)
    assert touchable[0] == expected


def test_degenerate_cones() -> None:
    x, y, z = np.eye(3)
    half = math.sqrt(0.5)
    kinds = {
        "an end of one edge": ([x], True),
        "a corner of two": ([x, y], True),
        "along a straight edge": ([x, -x, -z, half * (y - z)], True),
        "the middle of a flat face": ([x, y, -x, -y], True),
        "a saddle": ([half * (x + z), half * (-x + z), half * (y - z), half * (-y - z)], False),
        "a peak": ([half * (x - z), half * (-x - z), half * (y - z)], True),
        "nearly along one line": ([x, -x + 0.1 * ALONG * y, y, -y + z], True),
    }
    for name, (spokes, expected) in kinds.items():
        touchable = np.zeros(1, dtype=bool)
        touchable_vertices(np.array([0, len(spokes)]), np.array(spokes), np.zeros((0, 3)), touchable)
        assert touchable[0] == expected, name
