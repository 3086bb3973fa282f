"""Distances by coal to triangles that have no area."""

import numpy as np
import pytest
from numpy.typing import NDArray

from hhsim.mesh.mesh import Mesh

pytest.importorskip("coal", reason="the referee measures with coal: pip install 'hhsim[verify]'")

from hhsim.verify.coal_distance import coal_distance, triangle_shapes

THIRD: dict[str, tuple[float, float]] = {
    "a corner twice": (1.0, 0.0),
    "a corner between the others": (0.25, 0.0),
    "a corner beyond the others": (-0.5, 0.0),
    "higher by rounding": (0.5, 1e-17),
    "a needle": (0.5, 1e-9),
}
"""Where the third corner is, along the first side and beside it [m]."""


@pytest.mark.parametrize("name", THIRD)
def test_a_triangle_without_area_is_as_far_as_its_line(name: str) -> None:
    random, (share, beside) = np.random.default_rng(5), THIRD[name]
    for _ in range(20):
        a, b, point = random.uniform(-0.02, 0.02, (3, 3))
        c = a + share * (b - a) + beside * np.cross(b - a, [0.6, 0.0, 0.8]) / np.linalg.norm(b - a)
        mesh = Mesh(np.array([a, b, c]), np.array([[0, 1, 2]]))
        found = coal_distance(point, point, 0.002, 0.002, *triangle_shapes(mesh)(0))
        first, last = (a + bound * (b - a) for bound in (min(share, 0.0), max(share, 1.0)))
        assert found == pytest.approx(_from_segment(point, first, last) - 0.002, abs=3e-9)


def test_a_triangle_that_is_a_point_is_as_far_as_that() -> None:
    mesh = Mesh(np.full((3, 3), 0.01), np.array([[0, 1, 2]]))
    found = coal_distance(np.zeros(3), np.zeros(3), 0.002, 0.002, *triangle_shapes(mesh)(0))
    assert found == pytest.approx(0.01 * np.sqrt(3.0) - 0.002, abs=1e-12)


def _from_segment(point: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    share = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(point - a - share * (b - a)))
