"""The picture of the hand: its views are rotations, its poses are possible, and it can be written."""

from pathlib import Path

import numpy as np
import pytest

from hhsim.errors import OutputError
from hhsim.hand.model import HandModel
from tools.hand_figure import CURLED_POSE, OPEN_POSE, draw_hand, view


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


@pytest.mark.soak
def test_writes_the_picture_or_says_why_not(tmp_path: Path) -> None:
    import matplotlib.image

    draw_hand(tmp_path / "hand.png")
    picture = matplotlib.image.imread(tmp_path / "hand.png")
    assert picture.shape[1] == 1400
    assert 0.1 < (picture[:, :, :3] < 0.95).all(axis=2).mean() < 0.6
    with pytest.raises(OutputError, match="there is no folder"):
        draw_hand(tmp_path / "nowhere" / "hand.png")
