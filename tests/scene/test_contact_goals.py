"""Demanded touches: reading them, and their distances against other ways to compute them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sphere_scenes import object_tree

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.metrics.brute_force_distance import round_cone_contact
from hhsim.scene.contact_goals import Touch, holds, object_regions, touch_distances
from hhsim.scene.finger_closure import body_distances, make_work

HAND = HandModel.default()
TREE, COARSE = object_tree("cup", 3), object_tree("cup", 2)


def pose(seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Near the cup: position, rotation, flexion and the distance of each body by the tree."""
    random = np.random.default_rng(seed)
    rotation = np.ascontiguousarray(Rotation.random(rng=random).as_matrix())
    position, flexion = random.uniform(-0.1, 0.1, 3), random.uniform(0.0, 1.0, (5, 3))
    work = make_work(HAND.arrays(), TREE.arrays())
    distance = body_distances(position, rotation, flexion, np.zeros(5), work)
    return position, rotation, work.joints.copy(), distance


@pytest.mark.parametrize("seed", range(3))
def test_a_region_counts_only_leaves_that_would_be_touched_within_it(seed: int) -> None:
    position, rotation, joints, _ = pose(seed)
    touch, coarse = Touch("middle", "inside"), COARSE
    (found,) = touch_distances([touch], "cup", HAND, coarse, joints, position, rotation)
    best = np.inf
    for k in range(3):
        for center, radius in zip(coarse.leaf_center, coarse.leaf_radius):
            distance, places = round_cone_contact(
                center[None], np.array([radius]), joints[2, k], joints[2, k + 1], *HAND.radius[2, k : k + 2]
            )
            if holds(object_regions("cup")["inside"], places)[0]:
                best = min(best, float(distance[0]))
    assert found == pytest.approx(best, abs=1e-12)
    (anywhere,) = touch_distances([Touch("middle")], "cup", HAND, coarse, joints, position, rotation)
    assert anywhere <= found


NAMED = [(name, region) for name in object_names() for region in object_regions(name)]


@pytest.mark.parametrize(("name", "region"), NAMED)
def test_every_shipped_region_holds_some_of_the_surface_and_not_most_of_it(name: str, region: str) -> None:
    triangles = load_object(name).mesh.triangles
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    share = area[holds(object_regions(name)[region], triangles.mean(axis=1))].sum() / area.sum()
    assert 0.005 < share < 0.75
