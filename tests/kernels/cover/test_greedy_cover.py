"""Greedy cover, assignment, radii and certificate, each against brute force or dense sampling."""

from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.cover.certify import certify_cover
from hhsim.kernels.cover.greedy_cover import (
    assign,
    covering_radius,
    greedy_cover,
    longest_edges,
    owner_cost,
    spare_spheres,
)
from hhsim.kernels.cover.micro_triangle import cut_mesh, edges_for
from hhsim.kernels.cover.sampled_error import exposed, union_distance
from hhsim.kernels.cover.sphere_descent import move_spheres
from hhsim.kernels.kd_tree import subtrees
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals, mesh_signed_distance
from hhsim.trees.error import sample_mesh

SHAPES = {
    "icosphere": trimesh.creation.icosphere(2, 0.05),
    "box": trimesh.creation.box((0.1, 0.06, 0.02)),
    "torus": trimesh.creation.torus(0.04, 0.012, major_sections=24, minor_sections=12),
}
SPHERES = 40


def far_corner(corner: FloatArray, center: FloatArray) -> FloatArray:
    """Distances of the farthest corners, shape (micro-triangles, spheres)."""
    points = corner.reshape(-1, 3, 1, 3)
    return np.asarray(np.linalg.norm(points - center, axis=3).max(axis=1))


class Case:
    """A greedy cover and all that it was made from."""

    def __init__(self, shape: trimesh.Trimesh, spheres: int = SPHERES, pieces: int = 24 * SPHERES) -> None:
        self.vertices, self.faces = np.array(shape.vertices, float), np.array(shape.faces, np.int64)
        self.corner = self.vertices[self.faces].reshape(-1, 9)
        self.bvh = build_mesh_bvh(self.vertices, self.faces)
        edge = edges_for(self.corner, np.ones(len(self.corner)), pieces)
        self.micro = cut_mesh(self.corner, face_normals(self.vertices, self.faces), edge)
        self.center, self.depth = np.empty((spheres, 3)), np.empty(spheres)
        self.owner, self.cost = np.empty(len(self.micro.corner), np.int64), np.empty(len(self.micro.corner))
        count = self.place(0, spheres)
        self.center, self.depth = self.center[:count], self.depth[:count]
        self.radius = np.empty(count)
        covering_radius(self.micro, self.center, self.owner, self.radius)

    def place(self, begin: int, end: int) -> int:
        return greedy_cover(
            self.bvh, self.micro, 0.05, 0.3, 12, begin, self.center[:end], self.depth[:end], self.owner, self.cost
        )


class Assignment(NamedTuple):
    owner: IntArray
    cost: FloatArray
    second: IntArray
    second_cost: FloatArray


def assigned(case: Case, center: FloatArray, depth: FloatArray, roots: Iterable[int] = (0,)) -> Assignment:
    count = len(case.cost)
    found = Assignment(np.empty(count, np.int64), np.empty(count), np.empty(count, np.int64), np.empty(count))
    for root in roots:
        assign(case.micro, root, center, depth, *found)
    return found


def check_assignment(case: Case, found: Assignment, center: FloatArray, depth: FloatArray) -> None:
    cost = far_corner(case.micro.corner, center) - depth
    rows = np.arange(len(cost))
    assert found.cost == pytest.approx(cost.min(axis=1), abs=1e-15)
    assert cost[rows, found.owner] == pytest.approx(found.cost, abs=1e-15)
    assert found.second_cost == pytest.approx(np.sort(cost, axis=1)[:, 1], abs=1e-15)
    assert cost[rows, found.second] == pytest.approx(found.second_cost, abs=1e-15)
    assert (found.second != found.owner).all()


@pytest.fixture(params=SHAPES, scope="module")
def case(request: pytest.FixtureRequest) -> Case:
    return Case(SHAPES[request.param])


def test_depths_are_those_of_the_mesh(case: Case) -> None:
    assert len(case.depth) > 10
    assert case.depth == pytest.approx(-mesh_signed_distance(case.bvh, case.center), abs=1e-15)
    assert (case.depth > 0.0).all()


def test_costs_and_owners_are_the_brute_force_best(case: Case) -> None:
    cost = far_corner(case.micro.corner, case.center) - case.depth
    assert case.cost == pytest.approx(cost.min(axis=1), abs=1e-15)
    assert cost[np.arange(len(cost)), case.owner] == pytest.approx(case.cost, abs=1e-15)
    whole = assigned(case, case.center, case.depth)
    check_assignment(case, whole, case.center, case.depth)
    parts = assigned(case, case.center, case.depth, subtrees(case.micro.right, 3))
    assert np.array_equal(parts.cost, whole.cost) and np.array_equal(parts.second_cost, whole.second_cost)


@pytest.mark.parametrize("spread", [0.0, 1e-4, 1e-2])
def test_assignment_among_balls_close_together(case: Case, spread: float) -> None:
    center = spread * np.random.default_rng(8).normal(size=(60, 3)) + case.center[0]
    depth = np.ascontiguousarray(-mesh_signed_distance(case.bvh, center))
    check_assignment(case, assigned(case, center, depth), center, depth)


def test_costs_under_given_owners_are_those_of_brute_force(case: Case) -> None:
    rng = np.random.default_rng(9)
    owner = rng.integers(-1, len(case.depth), size=len(case.cost))
    cost = np.empty_like(case.cost)
    owner_cost(case.micro, case.center, case.depth, owner, cost)
    expected = (far_corner(case.micro.corner, case.center) - case.depth)[np.arange(len(owner)), owner]
    assert cost[owner >= 0] == pytest.approx(expected[owner >= 0], abs=1e-15)
    assert np.isinf(cost[owner < 0]).all() and (owner < 0).any()


def test_longest_edges(case: Case) -> None:
    longest = np.empty(len(case.micro.corner))
    longest_edges(case.micro.corner, longest)
    points = case.micro.corner.reshape(-1, 3, 3)
    edges = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2)
    assert longest == pytest.approx(edges.max(axis=1), rel=1e-12)


def test_each_ball_reaches_its_micro_triangles_and_no_farther(case: Case) -> None:
    far = far_corner(case.micro.corner, case.center)
    for sphere, radius in enumerate(case.radius):
        mine = case.owner == sphere
        assert radius == pytest.approx(far[mine, sphere].max() if mine.any() else -1.0, abs=1e-15)


def certify(case: Case, center: FloatArray, radius: FloatArray, slack: float = 1e-14) -> IntArray:
    unproved, proof = np.empty(len(case.faces), np.int64), np.empty(0, np.int32)
    count, _ = certify_cover(case.corner, center, radius, slack, 1e-6, unproved, proof)
    return unproved[:count]


def distance_to_union(points: FloatArray, center: FloatArray, radius: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(0.0, (np.linalg.norm(points[:, None] - center, axis=2) - radius).min(axis=1)))


def test_certificate_agrees_with_dense_sampling(case: Case) -> None:
    used = case.radius > 0.0
    center, radius = np.ascontiguousarray(case.center[used]), case.radius[used] * (1.0 + 1e-9)
    points = sample_mesh(case.vertices, case.faces, 20_000, np.random.default_rng(0))
    assert certify(case, center, radius).size == 0
    assert distance_to_union(points, center, radius).max() == 0.0

    # Take one sphere away: what sampling finds bare has no proof, and the proof fails nowhere else but there.
    for lost in range(0, len(radius), 7):
        rest = np.arange(len(radius)) != lost
        unproved = certify(case, np.ascontiguousarray(center[rest]), radius[rest])
        bare = distance_to_union(points, center[rest], radius[rest]) > 0.0
        reach = np.linalg.norm(case.vertices[case.faces[unproved]].mean(axis=1) - center[lost], axis=1)
        size = np.linalg.norm(np.ptp(case.vertices[case.faces], axis=1), axis=1).max() if unproved.size else 0.0
        assert (reach <= radius[lost] + size).all()
        assert unproved.size > 0 or not bare.any()


def test_union_distance_is_brute_force() -> None:
    rng = np.random.default_rng(4)
    center, radius, points = rng.normal(size=(300, 3)), 0.3 * rng.random(300), 1.5 * rng.normal(size=(500, 3))
    out = np.empty(500)
    x, y, z = np.ascontiguousarray(center.T)
    union_distance(points, x, y, z, radius, out)
    assert out == pytest.approx(distance_to_union(points, center, radius), abs=1e-12)
    assert (out == 0.0).any() and (out > 0.0).any()


def test_exposed_is_brute_force() -> None:
    rng = np.random.default_rng(5)
    center, radius = rng.normal(size=(60, 3)), 0.2 + 0.5 * rng.random(60)
    owner = rng.integers(60, size=2000)
    direction = rng.normal(size=(2000, 3))
    points = center[owner] + radius[owner, None] * direction / np.linalg.norm(direction, axis=1)[:, None]
    free = np.empty(2000, np.bool_)
    x, y, z = np.ascontiguousarray(center.T)
    exposed(points, owner, x, y, z, radius, free)
    distance = np.linalg.norm(points[:, None] - center, axis=2) - radius
    distance[np.arange(2000), owner] = np.inf
    assert np.array_equal(free, distance.min(axis=1) >= 0.0)
    assert free.any() and not free.all()


def groups(owner: IntArray, spheres: int) -> tuple[IntArray, IntArray]:
    order = np.argsort(owner, kind="stable")
    return np.searchsorted(owner, np.arange(spheres + 1), sorter=order), order


def test_moved_balls_cost_less() -> None:
    spheres = 30
    case = Case(SHAPES["torus"], spheres, 3000)
    bvh, micro, center, depth, owner, cost = case.bvh, case.micro, case.center, case.depth, case.owner, case.cost
    step, second, second_cost = np.zeros(spheres), np.empty_like(owner), np.empty_like(cost)
    worst = [cost.max()]
    for _ in range(10):
        first, order = groups(owner, spheres)
        assert move_spheres(bvh, micro, first, order, 6, center, depth, step) > 0
        assert depth == pytest.approx(-mesh_signed_distance(bvh, center), abs=1e-15)
        assert (depth > 0.0).all() and (step[first[1:] > first[:-1]] > 0.0).all()
        assign(micro, 0, center, depth, owner, cost, second, second_cost)
        worst.append(cost.max())
    assert all(after <= before * (1.0 + 1e-9) for before, after in pairwise(worst))
    assert worst[-1] < 0.75 * worst[0]


@settings(max_examples=80)
@given(st.integers(2, 12), st.integers(1, 60), st.integers(0, 2**31), st.integers(1, 12))
def test_spared_balls_are_not_missed(spheres: int, count: int, seed: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    owner = rng.integers(spheres, size=count)
    second = (owner + rng.integers(1, spheres, size=count)) % spheres
    (first, order), spared = groups(owner, spheres), np.empty(spheres, np.bool_)
    candidates = rng.permutation(spheres)[: rng.integers(spheres + 1)]
    chosen = spare_spheres(candidates, first, order, second, most, spared)
    assert spared.sum() == chosen <= most
    assert set(np.flatnonzero(spared)) <= set(candidates.tolist())
    lost = spared[owner]
    assert not spared[second[lost]].any()
    assert (chosen > 0) == (len(candidates) > 0)
    assert len(candidates) == 0 or spared[candidates[0]]
