"""The frame of a mesh moves with it, and leaves no trace of where it was."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hhsim.trees.surface_cover import GRID, canonical_frame

SHAPES = {
    "box": np.array(trimesh.creation.box((0.1, 0.1, 0.1)).vertices),
    "torus": np.array(trimesh.creation.torus(0.04, 0.012).vertices),
    "cloud": np.random.default_rng(3).normal(size=(50, 3)),
    "two points": np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]),
}


@pytest.mark.parametrize("name", SHAPES)
def test_is_a_similarity_that_keeps_points_in_the_unit_ball(name: str) -> None:
    points = SHAPES[name]
    frame = canonical_frame(points)
    assert frame.rotation @ frame.rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(frame.rotation) == pytest.approx(1.0)
    inside = frame.into(points)
    assert np.linalg.norm(inside, axis=1).max() == pytest.approx(1.0, abs=GRID)
    moved = np.linalg.norm(frame.out_of(inside) - points, axis=1)
    assert moved.max() <= 0.5 * np.sqrt(3.0) * GRID * frame.size * (1.0 + 1e-5)


@pytest.mark.parametrize("name", SHAPES)
def test_a_motion_leaves_no_trace(name: str) -> None:
    points = SHAPES[name]
    plain = canonical_frame(points).into(points)
    rng = np.random.default_rng(5)
    for seed in range(5):
        rotation = Rotation.random(random_state=seed)
        scale = 10.0 ** rng.uniform(-4.0, 4.0)
        there: NDArray[np.float64] = scale * rotation.apply(points) + scale * rng.normal(size=3)
        if name == "two points":
            # The second axis of a line is nobody's; the first is its own.
            assert canonical_frame(there).into(there)[:, 0] == pytest.approx(plain[:, 0], abs=GRID)
        else:
            assert np.array_equal(canonical_frame(there).into(there), plain)


def test_points_in_one_place_have_a_frame() -> None:
    points = np.full((4, 3), 7.0)
    frame = canonical_frame(points)
    assert frame.out_of(frame.into(points)).tolist() == points.tolist()
