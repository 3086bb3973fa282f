"""Distances by coal against closed forms and hhsim's own kernels: hands, inside ones too, triangles without area."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import RESOLUTION, mesh_clearance
from hhsim.verify.coal_distance import HandReferee, coal_distance, triangle_shapes
from hhsim.verify.contacts import PALM

pytest.importorskip("coal", reason="the referee measures with coal: pip install 'hhsim[verify]'")

BOX = trimesh.creation.box((0.1, 0.06, 0.04))
MESH = Mesh(np.asarray(BOX.vertices), np.asarray(BOX.faces), name="box")
HAND = HandModel.default()
FAR = 0.02


def over(height: float) -> PlacedHand:
    """A hand, palm down, over the origin."""
    return forward_kinematics(
        HAND, [[0.0, -0.06, height]], [[1.0, 0.0, 0.0, 0.0]], np.full((1, 5, 3), 0.2), np.zeros((1, 5))
    )


def box_distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    beyond = np.abs(points) - [0.05, 0.03, 0.02]
    return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=1))


def test_a_round_cone_over_a_box_by_brute_force_on_its_axis() -> None:
    referee, rng = HandReferee(MESH), np.random.default_rng(5)
    share = np.linspace(0.0, 1.0, 20_001)
    judged = 0
    for _ in range(60):
        a = rng.normal(size=3)
        a *= rng.uniform(0.06, 0.09) / np.linalg.norm(a)
        b = a + 0.03 * rng.normal(size=3)
        radius_a, radius_b = rng.uniform(0.004, 0.012, 2)
        away = box_distance((1.0 - share)[:, None] * a + share[:, None] * b)
        if away.min() < 1e-4:
            continue
        expected = float((away - (1.0 - share) * radius_a - share * radius_b).min())
        found = referee.round_cone(a, b, radius_a, radius_b, 1.0)
        # The samples miss the minimum by up to half their distance, times the slope there.
        assert expected - 5e-6 <= found <= expected + 1e-8
        assert referee.round_cone(a, b, radius_a, radius_b, expected - 1e-3) == expected - 1e-3
        judged += 1
    assert judged > 30


def test_an_axis_that_is_inside_is_in_by_its_radius() -> None:
    referee = HandReferee(MESH)
    inside = referee.round_cone(np.array([-0.01, 0.0, 0.0]), np.array([0.01, 0.0, 0.0]), 0.004, 0.003, FAR)
    through = referee.round_cone(np.array([-0.01, 0.0, 0.0]), np.array([0.01, 0.0, 0.1]), 0.004, 0.003, FAR)
    assert inside == through == -0.004
    deep = referee.round_cone(np.array([-0.01, 0.0, 0.0]), np.array([0.01, 0.0, 0.0]), 0.004, 0.003, 0.0)
    assert deep == -0.004, "farther from the surface than the limit, and inside"


@pytest.mark.parametrize("name", ["bunny", "cube"])
def test_a_whole_hand_is_where_the_kernels_have_it(name: str) -> None:
    mesh = load_object(name).mesh
    referee, bvh = HandReferee(mesh), build_mesh_bvh(mesh.vertices, mesh.faces)
    top = float(mesh.bounds[1, 2])
    signs = set()
    for height in np.linspace(top + 0.01, top + 0.1, 16):
        placed = over(float(height))
        theirs = referee.clearances(hand_shape(HAND), placed, FAR)
        assert theirs.shape == (1, PALM + 1)
        ours = float(mesh_clearance(bvh, hand_shape(HAND), placed, FAR)[0])
        if theirs.min() > -0.003:
            assert theirs.min() == pytest.approx(ours, abs=1e-6 + 0.01 * RESOLUTION)
        signs.add(np.sign(ours))
    assert signs == {-1.0, 1.0}


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
