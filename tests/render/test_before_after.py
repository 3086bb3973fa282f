"""Pictures before and after: the deepest frames are shown, and red is what stands inside the object, nothing else."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from hhsim.errors import OutputError
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


def draw(before: np.ndarray, after: np.ndarray, path: Path) -> np.ndarray:
    """Draw the fingers in the ball; number of red pixels of each picture, shape (rows, 4)."""
    count = len(before)
    draw_before_after(
        [BALL] * count, before, after, FINGER.faces, path, np.arange(4.0), range(4), [np.zeros(count)] * 2
    )
    return red_pixels(path)


def test_what_stands_inside_is_red_and_only_that(tmp_path: Path) -> None:
    red = draw(fingers(DEPTH)[2:3], fingers(np.full(1, -1e-3)), tmp_path / "worst.png")
    assert red.shape == (1, 4)
    assert (red[0, [0, 2]] > 30).all() and (red[0, [1, 3]] == 0).all()
    assert red[0, 2] > red[0, 0]


@pytest.mark.soak
def test_frames_are_drawn_in_their_order(tmp_path: Path) -> None:
    before = fingers(DEPTH)[[0, 2]]
    red = draw(before, before, tmp_path / "worst.png")
    assert (red[0] == 0).all() and (red[1] > 0).all()
    np.testing.assert_array_equal(red[:, 0], red[:, 1])


def test_a_folder_that_is_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="there is no folder"):
        draw(fingers(DEPTH), fingers(DEPTH), tmp_path / "none" / "worst.png")
