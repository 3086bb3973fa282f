"""Grouping, moving and sparing of spheres against brute force."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.kernels.cover.greedy_cover import assign, greedy_cover
from hhsim.kernels.cover.micro_triangle import cut_mesh, edges_for
from hhsim.kernels.cover.refine import group_by_owner, move_spheres, removal_cost, spare_spheres
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals, mesh_signed_distance


@settings(max_examples=60)
@given(st.integers(1, 20), st.integers(0, 100), st.integers(0, 2**31))
def test_groups(spheres: int, count: int, seed: int) -> None:
    owner = np.random.default_rng(seed).integers(spheres, size=count)
    first, order = np.empty(spheres + 1, np.int64), np.empty(count, np.int64)
    group_by_owner(owner, first, order)
    assert (first[0], first[-1]) == (0, count)
    for sphere in range(spheres):
        assert np.array_equal(order[first[sphere] : first[sphere + 1]], np.flatnonzero(owner == sphere))


def test_moved_balls_cost_less() -> None:
    shape = trimesh.creation.torus(0.04, 0.012, major_sections=24, minor_sections=12)
    vertices, faces = np.array(shape.vertices, float), np.array(shape.faces, np.int64)
    corner = vertices[faces].reshape(-1, 9)
    bvh = build_mesh_bvh(vertices, faces)
    micro = cut_mesh(corner, face_normals(vertices, faces), edges_for(corner, np.ones(len(corner)), 3000))
    spheres = 30
    center, depth, step = np.empty((spheres, 3)), np.empty(spheres), np.zeros(spheres)
    owner, second = np.empty((2, len(micro.corner)), np.int64)
    cost, second_cost = np.empty((2, len(micro.corner)))
    assert greedy_cover(bvh, micro, 0.05, 0.3, 12, 0, center, depth, owner, cost) == spheres
    worst = [cost.max()]
    first, order = np.empty(spheres + 1, np.int64), np.empty(len(owner), np.int64)
    for _ in range(10):
        group_by_owner(owner, first, order)
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
    first, order, spared = np.empty(spheres + 1, np.int64), np.empty(count, np.int64), np.empty(spheres, np.bool_)
    group_by_owner(owner, first, order)
    candidates = rng.permutation(spheres)[: rng.integers(spheres + 1)]
    chosen = spare_spheres(candidates, first, order, second, most, spared)
    assert spared.sum() == chosen <= most
    assert set(np.flatnonzero(spared)) <= set(candidates.tolist())
    lost = spared[owner]
    assert not spared[second[lost]].any()
    assert (chosen > 0) == (len(candidates) > 0)
    assert len(candidates) == 0 or spared[candidates[0]]


def test_removal_cost() -> None:
    cost = np.empty(4)
    removal_cost(np.array([0, 0, 2]), np.array([0.1, 0.2, 0.3]), cost)
    assert cost.tolist() == [0.2, -np.inf, 0.3, -np.inf]
