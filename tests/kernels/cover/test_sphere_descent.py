"""Descent of a sphere against scipy, and against the optimum that symmetry gives."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.optimize import minimize

from hhsim.arrays import FloatArray
from hhsim.kernels.cover.micro_triangle import cut_mesh
from hhsim.kernels.cover.sphere_descent import WORK, descend_sphere
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals, mesh_signed_distance

SHAPE = trimesh.creation.box((0.1, 0.08, 0.04))
VERTICES, FACES = np.array(SHAPE.vertices, float), np.array(SHAPE.faces, np.int64)
BVH = build_mesh_bvh(VERTICES, FACES)
MICRO = cut_mesh(VERTICES[FACES].reshape(-1, 9), face_normals(VERTICES, FACES), np.full(12, 0.008))


def descend(order: NDArray[np.int64], center: FloatArray, trials: int = 12) -> tuple[float, float, int]:
    work, stack, distance2 = np.empty((WORK, 8)), np.empty(STACK, np.int64), np.empty(STACK)
    cost, depth, step, good = descend_sphere(BVH, MICRO, order, trials, 0.0, center, work, stack, distance2)
    assert step > 0.0
    return cost, depth, good


def cost_at(order: NDArray[np.int64], center: FloatArray) -> float:
    points = MICRO.corner[order].reshape(-1, 3)
    return float(np.linalg.norm(points - center, axis=1).max() + mesh_signed_distance(BVH, center[None])[0])


def cost_of(order: NDArray[np.int64]) -> Callable[..., float]:
    return lambda center, *_: cost_at(order, center)


def test_a_ball_for_the_whole_box_ends_in_the_middle() -> None:
    center = np.array([0.01, -0.008, 0.003])
    cost, depth, good = descend(np.arange(len(MICRO.corner)), center, 300)
    assert good > 0
    assert depth == pytest.approx(0.02, abs=1e-4)
    assert cost == pytest.approx(np.linalg.norm([0.05, 0.04, 0.02]) - 0.02, rel=1e-3)


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


def test_no_trials_no_move() -> None:
    center = np.array([0.01, 0.0, 0.0])
    cost, _, good = descend(np.arange(4), center, 0)
    assert good == 0
    assert center.tolist() == [0.01, 0.0, 0.0]
    assert cost == pytest.approx(cost_at(np.arange(4), center))
