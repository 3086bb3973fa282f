"""Clearances of stored hands against brute force over all pairs, the axis parameter found by search."""

from typing import NamedTuple

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import Cones, along_axes
from scipy.spatial.transform import Rotation
from sphere_scenes import sphere_tree

from hhsim.arrays import FloatArray
from hhsim.kernels.contact.contact_points import clearances
from hhsim.kernels.hand.hand_shape import HandShape, StoredHands
from hhsim.kernels.sphere_tree import TreeArrays

FREE = 1.0
"""A limit [m] that no distance in these scenes reaches."""


class PlacedHands(NamedTuple):
    joints: FloatArray
    position: FloatArray
    rotation: FloatArray


def run(shape: HandShape, tree: TreeArrays, hands: PlacedHands, limit: float) -> tuple[FloatArray, FloatArray]:
    palm, finger = np.full(len(hands.joints), np.nan), np.full((len(hands.joints), 5), np.nan)
    clearances(tree, StoredHands(shape, *hands), limit, palm, finger)
    return palm, finger


def brute_force(
    shape: HandShape, leaves: FloatArray, leaf_radius: FloatArray, hands: PlacedHands
) -> tuple[FloatArray, FloatArray]:
    """Least signed distances of the palm (T,) and of each finger (T, 5)."""
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


Scene = tuple[HandShape, FloatArray, FloatArray, PlacedHands]


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
    return shape, center, radius, PlacedHands(joints, spread * rng.normal(size=(ticks, 3)), rotation)


@settings(max_examples=25)
@given(scenes(), st.sampled_from([0.0, 0.01, FREE]))
def test_clearances_equal_brute_force(scene: Scene, limit: float) -> None:
    shape, center, radius, hands = scene
    found = run(shape, sphere_tree(center, radius).arrays(), hands, limit)
    for values, expected in zip(found, brute_force(shape, center, radius, hands)):
        np.testing.assert_allclose(values, np.minimum(expected, limit), atol=1e-12)
