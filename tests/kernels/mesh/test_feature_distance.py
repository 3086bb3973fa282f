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
from hhsim.kernels.mesh.feature_distance import (
    ELSEWHERE,
    ON,
    edge_bound,
    edge_distance,
    edge_distances,
    edge_end_distance,
    edge_witness,
    face_bounds,
    face_distance,
    face_distances,
    line_witness,
    vertex_bound,
    vertex_distance,
    vertex_distances,
    vertex_witness,
)
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.round_cone_distance import RoundCone, sphere_cone
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


@given(SEEDS, st.sampled_from([0.0, 1e-15, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4]), st.booleans())
@settings(max_examples=60)
def test_an_axis_along_an_edge(seed: int, angle: float, cylinder: bool) -> None:
    random = np.random.default_rng(seed)
    turn = Rotation.random(rng=random).as_matrix()
    # The edge lies along x from 0 to 40 mm; the axis beside it, turned in any direction by the angle.
    start, length = random.uniform(-0.03, 0.05), random.uniform(0.005, 0.06)
    away = random.uniform(0.0, 0.012) * unit(np.append(0.0, random.normal(size=2)))
    axis = unit(np.append(1.0, angle * unit(random.normal(size=2))) * [random.choice([-1.0, 1.0]), 1.0, 1.0])
    a = np.array([start, 0.0, 0.0]) + away
    cones = Cones(
        (turn @ a)[None],
        (turn @ (a + length * axis))[None],
        np.array([0.008]),
        np.array([0.008 if cylinder else 0.008 - min(0.002, 0.5 * length)]),
    )
    p, q = np.zeros(3), turn @ [0.04, 0.0, 0.0]
    cone, along = cones.kernel(0), q / 0.04
    found, _, _ = line_witness(cone, *(cones.a[0] - p).tolist(), *along.tolist())
    assert found == pytest.approx(along_axes(cones, lambda x: to_line(x, p, q))[0], abs=EXACT)
    edge, _ = at_edge(cone, p, along, 0.04)
    ends = [vertex_witness(cone, *(end - cones.a[0]).tolist())[0] for end in (p, q)]
    assert min(edge, *ends) == pytest.approx(along_axes(cones, lambda x: to_segment(x, p, q))[0], abs=EXACT)


def unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


@given(SEEDS)
def test_an_axis_through_an_edge_or_a_vertex(seed: int) -> None:
    random = np.random.default_rng(seed)
    p, q = random.normal(0.0, 0.02, (2, 3))
    share = random.uniform(0.1, 0.9)
    direction = unit(random.normal(size=3))
    for at in (p + share * (q - p), p):
        a = at - random.uniform(0.005, 0.02) * direction
        cones = Cones(a[None], (at + 0.02 * direction)[None], np.array([0.008]), np.array([0.006]))
        cone, along = cones.kernel(0), unit(q - p)
        edge, _ = at_edge(cone, p, along, float(np.linalg.norm(q - p)))
        least = min([edge] + [vertex_witness(cone, *(end - a).tolist())[0] for end in (p, q)])
        assert least == pytest.approx(along_axes(cones, lambda x: to_segment(x, p, q))[0], abs=EXACT)
        assert least <= -0.006 + EXACT


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


def motions(
    random: np.random.Generator, cones: Cones, i: int, towards: FloatArray, most: float
) -> list[tuple[Cones, float]]:
    """The cone moved so that no point of its axis goes further than a length [m], and that length: some go straight
    `towards` something, some turn, most lengths are below `most`."""
    found = []
    a, b = cones.a[i], cones.b[i]
    for kind in range(6):
        m = most * random.uniform(0.0, 1.02)
        if kind < 3:
            aim = towards if kind < 2 else unit(random.normal(size=3))
            new_a, new_b = a + m * aim, b + m * aim
        else:
            # About a point of the axis or beside it, by an angle that takes the farther end that far.
            pivot = a + random.uniform(-0.5, 1.5) * (b - a) + random.normal(0.0, 0.01, 3) * (kind == 5)
            turn = Rotation.from_rotvec(unit(random.normal(size=3)) * 10.0 ** random.uniform(-3.0, 0.0))
            new_a, new_b = (pivot + turn.apply(end - pivot) for end in (a, b))
        m = float(max(np.linalg.norm(new_a - a), np.linalg.norm(new_b - b)))
        found.append((Cones(new_a[None], new_b[None], cones.radius_a[i : i + 1], cones.radius_b[i : i + 1]), m))
    return found


def on_axis(cones: Cones) -> tuple[FloatArray, FloatArray]:
    """Centres and radii [m] of spheres along the axis of one cone."""
    share = np.linspace(0.0, 1.0, 201)[:, None]
    center = cones.a[0] + share * (cones.b[0] - cones.a[0])
    return center, (cones.radius_a[0] + share * (cones.radius_b[0] - cones.radius_a[0])).ravel()


@given(SEEDS)
@settings(max_examples=20)
def test_no_motion_beats_the_bounds_of_a_face(seed: int) -> None:
    random = np.random.default_rng(seed)
    corners, cones = random_triangles(random, 1), random_cones(random, 12, 0.04)
    mesh = alone(corners[0])
    normal = mesh.face[0, :3]
    through = crossing(cones, np.broadcast_to(corners[0], (12, 3, 3)))
    for i in range(12):
        cone = cones.kernel(i)
        whole, inside = face_bounds(mesh.face, 0, cone, False)
        _, outside = face_bounds(mesh.face, 0, cone, True)
        assert whole <= inside <= outside
        face = face_distance(mesh.face, 0, cone)
        assert whole <= cone_distance(mesh, cone, math.inf, STACK) + EXACT
        # How deep a body is that touches already is nobody's question.
        if not through[i]:
            assert inside <= max(face, 0.0) + EXACT
        towards = unit(corners[0].mean(axis=0) - 0.5 * (cones.a[i] + cones.b[i]))
        for bound, one_sided in ((whole, False), (inside, False), (outside, True)):
            for moved, m in motions(random, cones, i, towards, max(bound, 1e-3)):
                if m > bound:
                    continue
                new = moved.kernel(0)
                ends = [(new.x, new.y, new.z)] + ([] if new.length == 0.0 else [tuple(center(new, new.length))])
                # Behind a face is inside: no body is there.
                if one_sided and min((np.array(end) - corners[0, 0]) @ normal for end in ends) < 0.0:
                    continue
                value = face_distance(mesh.face, 0, new)
                if bound is whole:
                    value = min(value, cone_distance(mesh, new, math.inf, STACK))
                assert value >= bound - m - EXACT


def fan(random: np.random.Generator, spokes: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """A vertex with faces around it, at the origin, and one more vertex a spoke."""
    turn = np.sort(random.uniform(0.0, 2.0 * np.pi, spokes))
    rim = np.stack([np.cos(turn), np.sin(turn), random.normal(0.0, 0.7, spokes)], axis=1)
    place = np.concatenate([np.zeros((1, 3)), 0.02 * rim])
    ring = np.arange(1, spokes + 1)
    return place, np.stack([np.zeros(spokes, np.int64), ring, np.roll(ring, -1)], axis=1)


@given(SEEDS, st.integers(3, 7))
@settings(max_examples=12)
def test_no_motion_beats_the_bounds_of_an_edge_or_a_vertex(seed: int, spokes: int) -> None:
    random = np.random.default_rng(seed)
    mesh, _ = mesh_features(*fan(random, spokes), closed=False)
    cones = random_cones(random, 8, 0.02)
    for i in range(8):
        for e in range(len(mesh.edge)):
            start, along, extent = mesh.edge[e, :3], mesh.edge[e, 3:6], float(mesh.edge[e, 6])
            wing = mesh.wing[mesh.wing_start[e] : mesh.wing_start[e + 1]]
            bound = edge_bound(mesh, e, cones.kernel(i), 0.0, np.inf)

            def touched(
                x: FloatArray, start: FloatArray = start, along: FloatArray = along, extent: float = extent
            ) -> Any:
                foot = (x - start) @ along
                return x - start - foot[:, None] * along, (foot >= 0.0) & (foot <= extent)

            check_cone(random, cones, i, touched, wing, bound, start + 0.5 * extent * along)
        for v in range(len(mesh.vertex)):
            spoke = mesh.spoke[mesh.spoke_start[v] : mesh.spoke_start[v + 1]]
            bound = vertex_bound(mesh, v, cones.kernel(i), 0.0)

            def reached(x: FloatArray, at: FloatArray = mesh.vertex[v]) -> Any:
                return x - at, np.ones(len(x), dtype=bool)

            check_cone(random, cones, i, reached, spoke, bound, mesh.vertex[v])


def check_cone(
    random: np.random.Generator,
    cones: Cones,
    i: int,
    witness: Any,
    directions: FloatArray,
    bound: float,
    at: FloatArray,
) -> None:
    """No sphere of the moved body is in the feature's normal cone and nearer than the bound less the motion."""
    towards = unit(at - 0.5 * (cones.a[i] + cones.b[i]))
    still = Cones(*(values[i : i + 1] for values in cones))
    for moved, m in [(still, 0.0), *motions(random, cones, i, towards, max(bound, 1e-3))]:
        if m > bound:
            continue
        x, radius = on_axis(moved)
        if moved.kernel(0).length == 0.0:
            x, radius = x[:1], radius[:1]
        off, on = witness(x)
        counts = on & (off @ directions.T <= 0.0).all(axis=1)
        assert (np.linalg.norm(off, axis=1) - radius)[counts].min(initial=np.inf) >= bound - m - EXACT


@given(SEEDS, st.integers(1, 40), st.booleans())
@settings(max_examples=20)
def test_lists_field_by_field_give_each_feature_its_own_distance(seed: int, count: int, spheres: bool) -> None:
    random = np.random.default_rng(seed)
    mesh, _ = mesh_features(
        random_triangles(random, count).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), closed=False
    )
    cone = random_cones(random, 1, 0.02).kernel(0)
    if spheres:
        cone = sphere_cone(cone.x, cone.y, cone.z, cone.radius)
    face, edge, vertex = (np.ascontiguousarray(values.T).T for values in (mesh.face, mesh.edge, mesh.vertex))
    faces, edges, vertices = len(face), len(edge), len(vertex)
    distance, parameter, end = (np.full(max(faces, edges, vertices), np.nan) for _ in range(3))
    face_distances(face, 1, faces, cone, distance)
    assert np.isnan(distance[0])
    of_faces = [face_distance(mesh.face, i, cone) for i in range(1, faces)]
    np.testing.assert_allclose(distance[1:faces], of_faces, rtol=1e-12, atol=EXACT)
    edge_distances(edge, 0, edges, cone, distance, parameter, end)
    of_edges = [(*edge_distance(mesh.edge, i, cone), edge_end_distance(mesh.edge, i, cone)) for i in range(edges)]
    found = np.stack([distance, parameter, end], axis=1)[:edges]
    np.testing.assert_allclose(found, of_edges, rtol=1e-12, atol=EXACT)
    vertex_distances(vertex, 0, vertices, cone, distance, parameter)
    of_vertices = [vertex_distance(mesh.vertex, i, cone) for i in range(vertices)]
    np.testing.assert_allclose(np.stack([distance, parameter], axis=1)[:vertices], of_vertices, rtol=1e-12, atol=EXACT)


def test_an_end_over_an_edge_is_as_far_as_its_ball() -> None:
    edge = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.05]])
    # The larger end over the edge, 30 mm up; the smaller one beyond its end; and both beyond it.
    for x, y, expected in ((0.01, 0.0, 0.02), (0.01, 0.04, 0.04), (0.2, 0.0, ELSEWHERE)):
        cone = RoundCone(x, y, 0.03, 1.0, 0.0, 0.0, 0.06, 0.0, 1.0 / 0.06, 0.01, 0.0)
        assert edge_end_distance(edge, 0, cone) == pytest.approx(expected, abs=EXACT)
