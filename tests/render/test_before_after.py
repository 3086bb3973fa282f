"""Pictures before and after: the deepest frames are shown, and red is what stands inside the object, nothing else."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from hhsim.errors import InputError, OutputError
from hhsim.render.before_after import FRAMES, JUST_INSIDE, SIDE, TITLE, deepest_frames, draw_before_after
from tools.shapes.generators import sphere

BALL = sphere(0.08, subdivisions=3)
FINGER = sphere(0.04, subdivisions=2)
DEPTH = np.array([-0.005, 0.002, 0.006, 0.001])
"""Depth of the finger in the ball at each frame [m]."""


def fingers(depth: np.ndarray) -> np.ndarray:
    """Skins of the finger, so deep in the ball, at its side, shape (T, V, 3)."""
    return np.asarray(FINGER.vertices + np.array([[[0.06 - d, 0.0, 0.0]] for d in depth]))


def red_pixels(path: Path) -> np.ndarray:
    """Number of red pixels of each picture, shape (rows, 4)."""
    with Image.open(path) as picture:
        pixels = np.asarray(picture, dtype=np.float64)
    rows = round(pixels.shape[0] / (SIDE + TITLE))
    red = pixels[:, :, 0] - pixels[:, :, 1] > 65.0
    return np.array([[part.sum() for part in np.array_split(line, 4, 1)] for line in np.array_split(red, rows, 0)])


@given(st.lists(st.floats(-0.01, 0.03), min_size=1, max_size=200))
def test_drawn_frames_are_the_deepest_ones_apart_from_each_other(depth: list[float]) -> None:
    found = deepest_frames(np.array(depth))
    assert 1 <= len(found) <= FRAMES and depth[found[0]] == max(depth)
    assert all(depth[one] >= depth[other] > JUST_INSIDE for one, other in pairwise(found))
    gap = max(1, round(0.05 * len(depth)))
    assert all(abs(one - other) > gap for i, one in enumerate(found) for other in found[:i])
    near = {frame for one in found for frame in range(one - gap, one + gap + 1)}
    left = [value for frame, value in enumerate(depth) if frame not in near]
    if len(found) < FRAMES:
        assert all(value <= JUST_INSIDE for value in left)
    else:
        assert all(value <= depth[found[-1]] for value in left)


def test_what_stands_inside_is_red_and_only_that(tmp_path: Path) -> None:
    path = tmp_path / "worst.png"
    draw_before_after(BALL, fingers(DEPTH), fingers(np.full(4, -1e-3)), FINGER.faces, path)
    red = red_pixels(path)
    # One frame is drawn: the others are beside it, or outside.
    assert red.shape == (1, 4)
    assert (red[0, [0, 2]] > 30).all() and (red[0, [1, 3]] == 0).all()
    assert red[0, 2] > red[0, 0]


@pytest.mark.soak
def test_chosen_frames_are_drawn_in_their_order(tmp_path: Path) -> None:
    path = tmp_path / "worst.png"
    before = fingers(DEPTH)
    draw_before_after(BALL, before, before, FINGER.faces, path, frames=(0, 2), time=np.arange(4.0))
    red = red_pixels(path)
    assert (red[0] == 0).all() and (red[1] > 0).all()
    np.testing.assert_array_equal(red[:, 0], red[:, 1])


def test_hands_that_do_not_fit_and_a_folder_that_is_missing_are_refused(tmp_path: Path) -> None:
    hands = fingers(DEPTH)
    with pytest.raises(InputError, match="expected the same"):
        draw_before_after(BALL, hands, hands[1:], FINGER.faces, tmp_path / "worst.png")
    with pytest.raises(OutputError, match="there is no folder"):
        draw_before_after(BALL, hands, hands, FINGER.faces, tmp_path / "none" / "worst.png")
