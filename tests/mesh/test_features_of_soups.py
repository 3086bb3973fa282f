"""The distance that a tick goes by is that to every triangle, however the triangles are put together."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import moved
from mesh_oracle import Cones, by_arctangents, least_of_features
from sampled import sampled
from scipy.spatial.transform import Rotation
from sphere_scenes import palm_spheres, set_pose
from triangle_soups import SOUPS, indexed, least_distance, plane_normals, soup, touching_cone, unit

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import COUNT_GATHERS, evaluate
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, PALM_BODY
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.mesh.features import mesh_features
from hhsim.mesh.mesh import Mesh
from hhsim.solver.surface import SURFACES
from hhsim.solver.workspace import tick_state
from hhsim.trees.contact_surface import encloses

SAME = 2e-10
"""Two distances of one body [m]: a triangle lower than a billionth of its length is a line in one of them."""
POSES = 10
HAND = HandModel.default("right")
ARRAYS = HAND.arrays()
MARGIN, SKIN = 1e-3, 3e-3


def features_of(triangles: FloatArray) -> tuple[MeshFeatures, bool]:
    vertices, faces = indexed(triangles)
    closed = encloses(Mesh(vertices, faces))
    return mesh_features(vertices, faces, closed=closed)[0], closed


def goes_around(triangles: FloatArray, point: FloatArray) -> bool:
    return bool(by_arctangents(triangles, point[None])[0] > 0.5)


@pytest.mark.parametrize(
    ("kind", "first"), sampled([(kind, first) for first in range(0, 1680, 40) for kind in SOUPS], lambda i, _: i < 12)
)
def test_the_least_over_features_is_the_least_over_triangles(kind: str, first: int) -> None:
    judged = 0
    for seed in range(first, first + 40):
        triangles, random = soup(kind, seed)
        normals = plane_normals(triangles)
        mesh, closed = features_of(triangles)
        for _ in range(POSES):
            ends, radius = touching_cone(random, triangles, normals)
            if closed and goes_around(triangles, ends[0]):
                continue
            distance = least_distance(ends, radius, triangles, normals)
            if distance > 0.0:
                assert least_of_features(mesh, Cones(*ends[:, None], *radius[:, None]).kernel(0)) == pytest.approx(
                    distance, abs=SAME
                ), seed
                judged += 1
    assert judged > POSES


def bodies(at: HandConfiguration) -> list[tuple[FloatArray, FloatArray]]:
    """Ends and radii of the phalanges, then of the palm's spheres."""
    joints = HAND.joints(*at.at(0))
    palm = palm_spheres(HAND.palm_tree.leaf_center, at.position[:1], at.orientation[:1])[0]
    phalanges = [(joints[f, k : k + 2], HAND.radius[f, k : k + 2]) for f in range(5) for k in range(3)]
    spheres = [(np.stack([p, p]), np.array([r, r])) for p, r in zip(palm, HAND.palm_tree.leaf_radius)]
    return phalanges + spheres


def distances(at: HandConfiguration, triangles: FloatArray, normals: FloatArray) -> FloatArray:
    """Of each phalanx and of the palm [m], shape (16,)."""
    each = [least_distance(ends, radius, triangles, normals) for ends, radius in bodies(at)]
    return np.array([*each[:PALM_BODY], min(each[PALM_BODY:])])


@pytest.mark.parametrize(
    ("kind", "seed"), sampled([(kind, seed) for seed in range(20) for kind in SOUPS], lambda i, _: i < 12)
)
def test_lists_that_last_hold_the_nearest_triangle_of_every_body(kind: str, seed: int) -> None:
    triangles, random = soup(kind, seed)
    normals = plane_normals(triangles)
    mesh, closed = features_of(triangles)
    state: Any = tick_state(np.ones(DOF), surface=SURFACES["mesh"])[0]
    orientation = Rotation.random(1, rng=random).as_quat(scalar_first=True)
    at = HandConfiguration(
        np.zeros((1, 3)),
        orientation,
        random.uniform(HAND.flexion_min, HAND.flexion_max, (1, 5, 3)),
        random.uniform(HAND.abduction_min, HAND.abduction_max, (1, 5)),
    )

    def is_outside(motion: HandConfiguration, clearance: float) -> bool:
        around = closed and goes_around(triangles, motion.position[0])
        return bool(not around and distances(motion, triangles, normals).min() > clearance)

    near = False
    while not near:
        # A body on a triangle; from there away until it is a millimetre off.
        ends, _ = bodies(at)[random.integers(PALM_BODY + 5)]
        start, way = triangles[random.integers(len(triangles))].mean(axis=0) - ends[0], unit(random)
        low, high = 0.0, 0.4
        for _ in range(12):
            middle = 0.5 * (low + high)
            away = is_outside(at._replace(position=(start + middle * way)[None]), 1e-3)
            low, high = (low, middle) if away else (middle, high)
        placed = at._replace(position=(start + high * way)[None])
        near = is_outside(placed, 0.0) and distances(placed, triangles, normals).min() < 2e-3
    at = placed
    judged = taken = 0
    for _ in range(30):
        size = 10.0 ** random.uniform(-5.0, -2.5)
        step = random.normal(size=DOF) * size
        step[3:] *= 4.0
        target = moved(at, step, 4.0 * size * random.normal(size=5))
        expected = distances(target, triangles, normals)
        # Beyond the lists there is nothing to judge.
        if not is_outside(target, 0.0) or expected.min() > MARGIN + SKIN:
            continue
        at = target
        set_pose(HAND, state.pose, at)
        assert evaluate(ARRAYS, state.pose, mesh, MARGIN, MARGIN, SKIN, state.candidates, state.work) == 0
        nearest, slack = np.array(state.candidates.nearest), np.array(state.candidates.slack)
        assert (slack >= MARGIN).all()
        assert (nearest >= expected - SAME).all()
        listed = expected < slack - SAME
        np.testing.assert_allclose(nearest[listed], expected[listed], rtol=0.0, atol=SAME)
        judged += int(listed.any())
        taken += 1
    assert judged > 0
    assert state.work[COUNT_GATHERS] < 0.9 * taken * BODY_COUNT, "the lists never last"
