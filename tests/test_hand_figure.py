"""The picture of the hand: its surfaces are the bodies that collide, the nearest one is seen, and it can be written."""

from pathlib import Path

import numpy as np
import pytest

from hhsim.errors import OutputError
from hhsim.hand import HandModel
from hhsim.hand_figure import (
    CURLED_POSE,
    NAIL,
    OPEN_POSE,
    SKIN,
    SPHERE,
    draw_hand,
    hand_surface,
    mesh_surface,
    rasterise,
    render,
    round_cone_surface,
    view,
)
from hhsim.kernels.distance import sphere_round_cone_distance


@pytest.mark.parametrize("tip", [0.01, 0.006])
@pytest.mark.parametrize("end", [(0.03, 0.01, -0.02), (0.0, 0.0, 0.0)])
def test_surface_is_the_round_cones(tip: float, end: tuple[float, float, float]) -> None:
    a, b = np.zeros(3), np.array(end)
    tip = 0.01 if not b.any() else tip
    surface = round_cone_surface(a, b, 0.01, tip, SKIN)
    for point, normal in zip(surface.points, surface.normals):
        distance, _ = sphere_round_cone_distance(point, 0.0, a, b, 0.01, tip)
        outside, _ = sphere_round_cone_distance(point + 0.001 * normal, 0.0, a, b, 0.01, tip)
        assert abs(distance) < 1e-16 + 1e-15
        assert outside == pytest.approx(0.001, abs=1e-15)


def test_mesh_normals_point_outwards() -> None:
    surface = mesh_surface(HandModel.default().palm_mesh, SKIN)
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, rtol=1e-12)
    assert (np.einsum("vi,vi->v", surface.normals, surface.points) > 0.0).all()


def test_nearest_triangle_is_seen() -> None:
    corners = np.array([[1.0, 1.0], [9.0, 1.0], [1.0, 9.0]])
    screen, towards = np.concatenate([corners, corners]), np.array([1.0, 1.0, 1.0, 2.0, 2.0, 0.0])
    depth, weight, face = rasterise(screen, towards, np.array([[0, 1, 2], [3, 4, 5]]), (10, 10))
    assert face[2, 2] == 1
    assert face[7, 2] == 0
    assert face[9, 9] == -1
    np.testing.assert_allclose(weight[face >= 0].sum(axis=1), 1.0, rtol=1e-12)
    assert depth[2, 2] == pytest.approx(2.0 - 2.0 / 8.0)
    assert depth[7, 2] == 1.0


@pytest.mark.parametrize(("turn", "tilt"), [(0.0, 0.0), (62.0, -10.0), (180.0, 30.0)])
def test_views_are_rotations(turn: float, tilt: float) -> None:
    rotation = view(turn, tilt)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_a_right_hand_seen_from_the_palm_has_its_thumb_on_the_right() -> None:
    hand = HandModel.default()
    thumb = hand.joints(np.zeros(3), (1.0, 0.0, 0.0, 0.0), np.zeros((5, 3)), np.zeros(5))[0, 3]
    assert (view(0.0, 0.0) @ thumb)[0] > 0.0


@pytest.mark.parametrize("pose", [OPEN_POSE, CURLED_POSE], ids=["open", "curled"])
def test_poses_lie_within_the_limits(pose: tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]) -> None:
    hand = HandModel.default()
    flexion, abduction = np.radians(pose[0]), np.radians(pose[1])
    assert ((hand.flexion_min <= flexion) & (flexion <= hand.flexion_max)).all()
    assert ((hand.abduction_min <= abduction) & (abduction <= hand.abduction_max)).all()


def test_hybrid_shows_spheres_and_the_back_shows_nails() -> None:
    hand = HandModel.default()
    for hybrid in (False, True):
        surface = hand_surface(hand, OPEN_POSE, hybrid)
        assert bool((surface.colors == SPHERE).all(axis=1).any()) is hybrid
        nails = surface.points[(surface.colors == NAIL).all(axis=1)]
        assert len(nails) > 100
        assert (nails[nails[:, 0] > -0.05][:, 2] > -0.03).all()
    picture = render(hand_surface(hand, OPEN_POSE, False), view(0.0, 0.0), 0.21)
    assert picture.min() >= 0.0
    assert picture.max() <= 1.0
    assert 0.1 < (picture < 1.0).all(axis=2).mean() < 0.6


def test_writes_the_picture_or_says_why_not(tmp_path: Path) -> None:
    import matplotlib.image

    draw_hand(tmp_path / "hand.png")
    assert matplotlib.image.imread(tmp_path / "hand.png").shape[1] == 1400
    with pytest.raises(OutputError, match="there is no folder"):
        draw_hand(tmp_path / "nowhere" / "hand.png")
