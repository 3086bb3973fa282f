"""Spheres put into a box: the inner one that touches, how deep it lies, where it goes; closed forms and scipy."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize

from hhsim.arrays import FloatArray
from hhsim.kernels.cover.inscribed_sphere import depth_at, far_corner2, inscribed_sphere, place_sphere
from hhsim.kernels.cover.micro_triangle import cut_mesh
from hhsim.kernels.cover.sphere_descent import WORK, descend_sphere
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals, mesh_signed_distance

HALF = np.array([0.05, 0.04, 0.02])
SHAPE = trimesh.creation.box(2.0 * HALF)
VERTICES, FACES = np.array(SHAPE.vertices, float), np.array(SHAPE.faces, np.int64)
BVH = build_mesh_bvh(VERTICES, FACES)
MICRO = cut_mesh(VERTICES[FACES].reshape(-1, 9), face_normals(VERTICES, FACES), np.full(12, 0.008))
STACKS = np.empty(STACK, np.int64), np.empty(STACK)
share = st.floats(-0.999, 0.999)


@settings(max_examples=100)
@given(share, share, share)
def test_depth(u: float, v: float, w: float) -> None:
    x, y, z = HALF * [u, v, w]
    depth, qx, qy, qz = depth_at(BVH, x, y, z, np.inf, *STACKS)
    assert depth == pytest.approx((HALF - np.abs([x, y, z])).min(), abs=1e-15)
    assert np.linalg.norm([x - qx, y - qy, z - qz]) == pytest.approx(depth, abs=1e-15)
    outside, *_ = depth_at(BVH, x, y, 2.0 * HALF[2], np.inf, *STACKS)
    assert outside == pytest.approx(-HALF[2])
    assert depth_at(BVH, x, y, z, 0.5 * depth * depth, *STACKS)[0] == -np.inf


@settings(max_examples=100)
@given(share, share)
def test_largest_ball_under_a_face(u: float, v: float) -> None:
    p = np.array([HALF[0] * u, HALF[1] * v, HALF[2]])
    stack, distance2 = STACKS
    radius, *stop = inscribed_sphere(BVH, p[0], p[1], p[2], 0.0, 0.0, 1.0, 1.0, stack, distance2)
    room = (HALF - np.abs(p))[:2].min()
    assert radius == pytest.approx(min(HALF[2], room), rel=1e-6)
    center = p - [0.0, 0.0, radius]
    assert np.linalg.norm(center - stop) == pytest.approx(radius, rel=1e-6)
    assert inscribed_sphere(BVH, p[0], p[1], p[2], 0.0, 0.0, 1.0, 1e-4, stack, distance2)[0] <= 1e-4


@pytest.mark.parametrize("allowed", [0.0, 1e-3, 4e-3])
def test_placed_balls_reach_deep_and_keep_the_promise(allowed: float) -> None:
    center = np.empty(3)
    for i in range(0, len(MICRO.corner), 5):
        depth = place_sphere(BVH, MICRO, i, 1.0, allowed, *STACKS, center)
        assert depth == pytest.approx((HALF - np.abs(center)).min(), abs=1e-15)
        touching = MICRO.corner[i].reshape(3, 3).mean(axis=0)
        room = np.sort(HALF - np.abs(touching))
        # No less deep than the largest sphere that touches there.
        assert depth >= min(room[1], HALF[2]) * (1.0 - 1e-6)
        far = np.sqrt(far_corner2(MICRO.corner, i, *center))
        assert far == pytest.approx(np.linalg.norm(MICRO.corner[i].reshape(3, 3) - center, axis=1).max())
        plain = place_sphere(BVH, MICRO, i, 1.0, 0.0, *STACKS, np.empty(3))
        assert depth >= plain
        if depth > plain:
            assert far - depth <= allowed


def descend(order: NDArray[np.int64], center: FloatArray, trials: int = 12) -> tuple[float, float, int]:
    work = np.empty((WORK, 8))
    cost, depth, step, good = descend_sphere(BVH, MICRO, order, trials, 0.0, center, work, *STACKS)
    assert step > 0.0
    return cost, depth, good


def cost_at(order: NDArray[np.int64], center: FloatArray) -> float:
    points = MICRO.corner[order].reshape(-1, 3)
    return float(np.linalg.norm(points - center, axis=1).max() + mesh_signed_distance(BVH, center[None])[0])


def cost_of(order: NDArray[np.int64]) -> Callable[..., float]:
    return lambda center, *_: cost_at(order, center)


def test_is_near_the_local_optimum_and_never_worse_than_the_start() -> None:
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(25):
        middle = MICRO.corner[rng.integers(len(MICRO.corner))].reshape(3, 3).mean(axis=0)
        near = np.linalg.norm(MICRO.corner.reshape(-1, 3, 3).mean(axis=1) - middle, axis=1)
        order = np.flatnonzero(near < 0.012)
        start = 0.6 * middle
        center = start.copy()
        cost, depth, _ = descend(order, center)
        assert cost == pytest.approx(cost_at(order, center), abs=1e-12)
        assert depth == pytest.approx(-mesh_signed_distance(BVH, center[None])[0], abs=1e-12)
        assert depth > 0.0
        assert cost <= cost_at(order, start)
        # A derivative-free search from where the descent ended.
        found = minimize(cost_of(order), center, method="Nelder-Mead", tol=1e-9)
        ratios.append(cost / found.fun)
    assert np.median(ratios) < 1.01
    assert max(ratios) < 1.05
