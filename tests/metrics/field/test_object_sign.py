"""Side of a mesh whose triangles cross, in the figures of the field."""

import numpy as np
import trimesh

from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.mesh.features import mesh_features
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import object_bvh

RADIUS, APART = 0.03, 0.035


def test_points_are_inside_where_one_of_two_crossing_balls_holds_them() -> None:
    balls = [trimesh.creation.icosphere(4, RADIUS) for _ in range(2)]
    balls[1].apply_translation([APART, 0.0, 0.0])
    vertices = np.concatenate([np.asarray(ball.vertices, np.float64) for ball in balls])
    faces = np.concatenate([ball.faces + i * len(balls[0].vertices) for i, ball in enumerate(balls)])
    mesh = Mesh(vertices, np.asarray(faces, np.int64))
    assert len(mesh_features(mesh.vertices, mesh.faces, closed=True)[0].pseudonormal) == 0
    points = np.random.default_rng(0).uniform([-0.04] * 3, [0.075, 0.04, 0.04], (2000, 3))
    away = np.stack([np.linalg.norm(points - center, axis=1) for center in ([0.0] * 3, [APART, 0.0, 0.0])])
    # The faces of the balls are up to a third of a millimetre inside of their spheres.
    clear = (np.abs(away - RADIUS) > 3e-4).all(axis=0)
    found = mesh_signed_distance(object_bvh(mesh), np.ascontiguousarray(points[clear]))
    inside = (away[:, clear] < RADIUS).any(axis=0)
    assert inside.any() and not inside.all()
    np.testing.assert_array_equal(found < 0.0, inside)
