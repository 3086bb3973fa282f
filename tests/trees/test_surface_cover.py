"""The cover of a mesh: complete, within its number of spheres, and better than the greedy start."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from sampled import sampled
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress, silent
from hhsim.trees.error import prove_cover
from hhsim.trees.surface_cover import GRID, canonical_frame, cover_of, in_own_frame


def arrays(shape: trimesh.Trimesh) -> tuple[FloatArray, IntArray]:
    return np.array(shape.vertices, dtype=np.float64), np.array(shape.faces, dtype=np.int64)


def build_cover(
    vertices: FloatArray, faces: IntArray, spheres: int, progress: Progress = silent
) -> tuple[FloatArray, FloatArray]:
    return cover_of(in_own_frame(Mesh(vertices, faces)), spheres, progress)


TETRAHEDRON = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
SHAPES = {
    "tetrahedron": trimesh.Trimesh(TETRAHEDRON, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    "box": trimesh.creation.box((0.1, 0.1, 0.1)),
    "needle": trimesh.creation.cone(0.002, 0.1, sections=12),
    "fine sphere": trimesh.creation.icosphere(4, 0.05),
}


@pytest.mark.parametrize(
    ("name", "spheres"),
    sampled(
        [(name, spheres) for name in SHAPES for spheres in (1, 3, 100)],
        lambda place, case: case not in [("fine sphere", 3), ("fine sphere", 100)],
    ),
)
def test_covers_with_the_balls_it_may_have(name: str, spheres: int) -> None:
    vertices, faces = arrays(SHAPES[name])
    center, radius = build_cover(vertices, faces, spheres)
    assert 1 <= len(radius) <= spheres
    assert (radius > 0.0).all()
    assert prove_cover(Mesh(vertices, faces), center, radius)[0].size == 0


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
