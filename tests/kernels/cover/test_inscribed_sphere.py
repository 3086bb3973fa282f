"""Inner spheres and depths against closed forms in a box."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.kernels.cover.inscribed_sphere import depth_at, far_corner2, inscribed_sphere, place_sphere
from hhsim.kernels.cover.micro_triangle import cut_mesh
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals

HALF = np.array([0.05, 0.03, 0.01])
SHAPE = trimesh.creation.box(2.0 * HALF)
VERTICES, FACES = np.array(SHAPE.vertices, float), np.array(SHAPE.faces, np.int64)
BVH = build_mesh_bvh(VERTICES, FACES)
CORNER = VERTICES[FACES].reshape(-1, 9)
MICRO = cut_mesh(CORNER, face_normals(VERTICES, FACES), np.full(12, 0.005))
WORK = np.empty(STACK, np.int64), np.empty(STACK)
share = st.floats(-0.999, 0.999)


@settings(max_examples=100)
@given(share, share, share)
def test_depth(u: float, v: float, w: float) -> None:
    x, y, z = HALF * [u, v, w]
    depth, qx, qy, qz = depth_at(BVH, x, y, z, np.inf, *WORK)
    assert depth == pytest.approx((HALF - np.abs([x, y, z])).min(), abs=1e-15)
    assert np.linalg.norm([x - qx, y - qy, z - qz]) == pytest.approx(depth, abs=1e-15)
    outside, *_ = depth_at(BVH, x, y, 2.0 * HALF[2], np.inf, *WORK)
    assert outside == pytest.approx(-HALF[2])
    assert depth_at(BVH, x, y, z, 0.5 * depth * depth, *WORK)[0] == -np.inf


@settings(max_examples=100)
@given(share, share)
def test_largest_ball_under_a_face(u: float, v: float) -> None:
    p = np.array([HALF[0] * u, HALF[1] * v, HALF[2]])
    stack, distance2 = WORK
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
        depth = place_sphere(BVH, MICRO, i, 1.0, allowed, *WORK, center)
        assert depth == pytest.approx((HALF - np.abs(center)).min(), abs=1e-15)
        touching = MICRO.corner[i].reshape(3, 3).mean(axis=0)
        room = np.sort(HALF - np.abs(touching))
        # No less deep than the largest sphere that touches there.
        assert depth >= min(room[1], HALF[2]) * (1.0 - 1e-6)
        far = np.sqrt(far_corner2(MICRO.corner, i, *center))
        assert far == pytest.approx(np.linalg.norm(MICRO.corner[i].reshape(3, 3) - center, axis=1).max())
        plain = place_sphere(BVH, MICRO, i, 1.0, 0.0, *WORK, np.empty(3))
        assert depth >= plain
        if depth > plain:
            assert far - depth <= allowed
