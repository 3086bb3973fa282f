"""Clearances of stored hands by brute force and search; round cones against meshes by closed forms."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import Cones, along_axes, box_distance
from scipy.spatial.transform import Rotation
from sphere_scenes import sphere_tree

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.contact_points import clearances
from hhsim.kernels.contact.mesh_distance import (
    DEEPEST_INTERVAL,
    AxisSearch,
    hand_mesh_distances,
    hand_tip_distances,
    round_cone_mesh_distance,
)
from hhsim.kernels.hand.hand_shape import HandShape, StoredHands
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import build_mesh_bvh

FREE = 1.0
"""A limit [m] that no distance in these scenes reaches."""


def brute_force(hands: StoredHands, leaves: FloatArray, leaf_radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least signed distances of the palm (T,) and of each finger (T, 5)."""
    shape = hands.shape
    joints, ticks, count = hands.joints, len(hands.joints), len(leaf_radius)
    palm = shape.palm_center @ hands.rotation.transpose(0, 2, 1)
    away = np.linalg.norm(palm[:, :, None] + hands.position[:, None, None] - leaves, axis=3)
    ends = (joints[:, :, :3].reshape(-1, 3), joints[:, :, 1:].reshape(-1, 3))
    radii = (np.tile(shape.phalanx_radius[:, k : k + 3].ravel(), ticks) for k in range(2))
    cones = Cones(*(np.repeat(values, count, axis=0) for values in (*ends, *radii)))
    targets = np.tile(leaves, (15 * ticks, 1))
    finger = along_axes(cones, lambda x: np.asarray(np.linalg.norm(x - targets, axis=-1))) - np.tile(
        leaf_radius, 15 * ticks
    )
    least = (away - shape.palm_radius[:, None] - leaf_radius).min(axis=(1, 2), initial=np.inf)
    return least, finger.reshape(ticks, 5, 3 * count).min(axis=2)


Scene = tuple[StoredHands, FloatArray, FloatArray]


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Crowded scenes, about half penetrating, with phalanges of length 0, radius 0 and spheres inside each other."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    ticks, leaves, palms = draw(st.integers(0, 4)), draw(st.integers(1, 60)), draw(st.integers(0, 8))
    spread = draw(st.sampled_from([0.02, 0.1, 0.4]))
    step = rng.choice([0.0, 0.003, 0.03], size=(ticks, 5, 4, 1)) * rng.normal(size=(ticks, 5, 4, 3))
    joints = spread * rng.normal(size=(ticks, 5, 1, 3)) + np.cumsum(step, axis=2)
    phalanx_radius = np.sort(rng.choice([0.0, 0.005, 0.01, 0.02], size=(5, 4)), axis=1)[:, ::-1].copy()
    rotation = np.ascontiguousarray(Rotation.random(ticks, rng=rng).as_matrix()) if ticks else np.zeros((0, 3, 3))
    shape = HandShape(phalanx_radius, 0.03 * rng.normal(size=(palms, 3)), rng.uniform(0.0, 0.015, size=palms))
    center, radius = 0.03 * rng.normal(size=(leaves, 3)), rng.uniform(0.0, 0.01, size=leaves)
    return StoredHands(shape, joints, spread * rng.normal(size=(ticks, 3)), rotation), center, radius


@settings(max_examples=25)
@given(scenes(), st.sampled_from([0.0, 0.01, FREE]))
def test_clearances_equal_brute_force(scene: Scene, limit: float) -> None:
    hands, center, radius = scene
    palm, finger = np.full(len(hands.joints), np.nan), np.full((len(hands.joints), 5), np.nan)
    clearances(sphere_tree(center, radius).arrays(), hands, limit, palm, finger)
    for values, expected in zip((palm, finger), brute_force(hands, center, radius)):
        np.testing.assert_allclose(values, np.minimum(expected, limit), atol=1e-12)


RESOLUTION = 1e-4
HALF = 0.05
CUBE = trimesh.creation.box((2 * HALF,) * 3)


CUBE_BVH = build_mesh_bvh(np.array(CUBE.vertices, np.float64), np.array(CUBE.faces, np.int64))


@pytest.mark.parametrize(
    ("a", "b", "radius_a", "radius_b", "expected"),
    [
        # Along a face it is as deep as its thick end.
        *(((0.0, 0.0, HALF + 0.01 - d), (0.03, 0.0, HALF + 0.01 - d), 0.01, 0.008, -d) for d in (-0.003, 0.0, 0.002)),
        # The axis begins inside.
        ((0.0, 0.0, 0.03), (0.0, 0.0, 0.08), 0.01, 0.005, -0.03),
        # One end holds the other.
        ((0.0, 0.0, 0.06), (0.0, 0.0, 0.06), 0.012, 0.001, -0.002),
        ((0.0, 0.0, 0.06), (0.0, 0.0, 0.061), 0.012, 0.001, -0.002),
        # As a damaged file states it: to where no square of a distance is a number.
        *(((0.0, 0.0, HALF + 0.02), (far, 0.0, far), 0.01, 0.01, 0.01) for far in (1e160, 1e300, np.inf)),
    ],
)
def test_known_distances(
    a: tuple[float, ...], b: tuple[float, ...], radius_a: float, radius_b: float, expected: float
) -> None:
    work = AxisSearch(np.empty(STACK, np.int64), np.empty(STACK), np.empty((2, DEEPEST_INTERVAL)))
    cone = np.array(a), np.array(b), radius_a, radius_b
    assert round_cone_mesh_distance(CUBE_BVH, *cone, np.inf, RESOLUTION, work) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("height", [0.06, 0.072, 0.0])
def test_the_hand_is_as_near_as_its_nearest_part(height: float) -> None:
    # An open hand over the origin.
    hand, position, found, tips = HandModel.default(), np.array([[0.0, -0.05, height]]), np.empty(1), np.empty((1, 5))
    joints = hand.joints(position[0], [1.0, 0.0, 0.0, 0.0], np.full((5, 3), 0.1), np.zeros(5))[None]
    stored = StoredHands(hand_shape(hand), joints, position, np.eye(3)[None])
    radius, center, palm_radius = stored.shape
    hand_mesh_distances(stored, CUBE_BVH, np.inf, RESOLUTION, found)
    hand_tip_distances(stored, CUBE_BVH, 0.004, RESOLUTION, tips)
    parts = [box_distance(center + position[0], HALF) - palm_radius]
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    for f in range(5):
        for k in range(3):
            axis = joints[0, f, k] + share * (joints[0, f, k + 1] - joints[0, f, k])
            parts.append(box_distance(axis, HALF) - radius[f, k] - share[:, 0] * (radius[f, k + 1] - radius[f, k]))
        # Inside it is the ball of the end.
        expected = parts[-1].min() if parts[-1][-1] >= 0.0 else parts[-1][-1]
        assert tips[0, f] == pytest.approx(min(expected, 0.004), abs=2e-5)
    assert found[0] == pytest.approx(float(np.concatenate(parts).min()), abs=2e-5)
