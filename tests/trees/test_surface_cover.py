"""The frame in which a mesh is covered: that of its points, however they are moved."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hhsim.trees.surface_cover import GRID, canonical_frame

POINTS = {
    "box": np.array(trimesh.creation.box((0.1, 0.1, 0.1)).vertices),
    "torus": np.array(trimesh.creation.torus(0.04, 0.012).vertices),
    "cloud": np.random.default_rng(3).normal(size=(50, 3)),
    "two points": np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]),
}


@pytest.mark.parametrize("name", POINTS)
def test_a_motion_leaves_no_trace(name: str) -> None:
    points = POINTS[name]
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
