"""The referee's distances to triangles: against samples along the axis, each by trimesh."""

from typing import Any

import numpy as np
import trimesh

from hhsim.arrays import FloatArray
from hhsim.verify.contacts import away_from_triangles, near_triangle_pairs, ready_triangles, triangle_places
from hhsim.verify.kinematics import OwnHand, Posed


def sampled_distance(a: FloatArray, b: FloatArray, first: float, last: float, triangle: FloatArray) -> float:
    """Signed distance [m] of a round cone to a triangle at 4,001 places of its axis."""
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    places = (1.0 - share) * a + share * b
    closest: Any = trimesh.triangles.closest_point
    # In millimetres: trimesh's tolerance is of lengths like those.
    point = 1e-3 * closest(np.repeat(1e3 * triangle[None], len(places), axis=0), 1e3 * places)
    radius = first + share[:, 0] * (last - first)
    return float((np.linalg.norm(places - point, axis=1) - radius).min())


def test_every_triangle_is_as_far_as_samples_of_the_axis_say() -> None:
    random = np.random.default_rng(11)
    triangles = random.normal(size=(30, 3, 3)) * 0.02 + random.normal(size=(30, 1, 3)) * 0.02
    joints = random.normal(size=(2, 5, 4, 3)) * 0.03
    radius = np.sort(random.uniform(0.004, 0.01, (5, 4)), axis=1)[:, ::-1]
    palm = random.normal(size=(2, 3, 3)) * 0.03
    none = np.zeros((5, 3))
    palm_radius = np.array([0.01, 0.012, 0.008])
    hand = OwnHand(none, none, none, none, radius, none, none, np.zeros((3, 3)), palm_radius, 1.0)
    posed = Posed(joints, np.zeros((2, 5, 3)), palm, palm.mean(axis=1))
    fingers = np.array([True, True, False, True, True])
    ready, places = ready_triangles(triangles), triangle_places(triangles)
    found = near_triangle_pairs(hand, posed, ready, places, fingers, 0.01)
    assert (np.diff(found.tick) >= 0).all() and set(found.body.tolist()) >= {0, 8 + 1, 15}
    checked = 0
    for tick in range(2):
        for body in range(15):
            f, k = divmod(body, 3)
            mine = (found.tick == tick) & (found.body == body)
            if not fingers[f]:
                assert not mine.any()
                continue
            first, last = joints[tick, f, k], joints[tick, f, k + 1]
            for i, triangle in enumerate(triangles):
                expected = sampled_distance(first, last, radius[f, k], radius[f, k + 1], triangle)
                ours = found.distance[mine & (found.leaf == i)]
                if expected > 0.01 + 1e-5:
                    assert len(ours) == 0
                elif -0.003 < expected < 0.01 - 1e-5:
                    # Deeper, where the axis may go through it, samples are off by their spacing.
                    assert ours.min() <= expected + 1e-12 and ours.min() > expected - 2e-6
                    checked += 1
    assert checked > 100


def test_what_has_no_area_is_as_far_as_its_longest_side_or_its_corner() -> None:
    flat = np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.04, 0.0, 0.0]], [[0.02, 0.0, 0.0]] * 3])
    points = np.array([[0.07, 0.03, 0.04], [0.02, 0.0, 0.01]])
    away = away_from_triangles(ready_triangles(flat), points.T).T
    np.testing.assert_allclose(away, [[0.0, 0.03, 0.04], [0.0, 0.0, 0.01]], rtol=0.0, atol=1e-16)
    both = ready_triangles(np.concatenate([flat, flat + 1.0])).at(np.array([1, 0]))
    np.testing.assert_array_equal(away_from_triangles(both, points[::-1].T).T, away[::-1])
