"""The picture of the concepts: what it shows is what the result holds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from short_grasp import short_result

from hhsim.errors import InputError
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result
from hhsim.scene.script import parse_script
from tools.concepts_figure import coil, draw_concepts, show
from tools.cross_section import cut_spheres

MOTION = """
title = "short"
depth = 0.015
[[phase]]
name = "approach"
duration = 0.05
[[phase]]
name = "touch"
duration = 0.1
[[phase]]
name = "hold"
duration = 0.05
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    path = tmp_path_factory.mktemp("replay") / "short.h5"
    return short_result(path, parse_script(MOTION, name="short", where="short"))


def test_the_section_is_of_the_finger_that_presses_in_its_plane(result: Result) -> None:
    shown = show(result)
    assert shown.tick == 199
    assert shown.finger == 1
    force = result["force/phalanx"][shown.tick, shown.finger, 2]
    assert shown.plane.axes[1] @ force == pytest.approx(np.linalg.norm(shown.plane.axes[:2] @ force))
    joints = stored_hand(result).joints(*shown.pose("graphic"))[shown.finger]
    np.testing.assert_allclose(shown.plane.height(joints), 0.0, atol=1e-9)


def test_in_the_section_the_graphic_finger_is_outside_and_the_haptic_one_inside(result: Result) -> None:
    shown = show(result)
    center, radius, _ = cut_spheres(shown.plane, *shown.leaves())
    thickness = result.static["hand/phalanx_radius"][shown.finger]
    gap = {}
    for whose in ("graphic", "haptic"):
        tip = shown.plane.flat(stored_hand(result).joints(*shown.pose(whose))[shown.finger])[3]
        gap[whose] = float((np.linalg.norm(center - tip, axis=1) - radius).min() - thickness[3])
    assert gap["graphic"] > -1e-9
    assert gap["haptic"] < -1e-3


def test_a_result_without_a_pressing_fingertip_is_told(result: Result) -> None:
    free = replace(result, ticks=20, phases=())
    with pytest.raises(InputError, match="no finger presses with its last phalanx at tick 19"):
        show(free)


def test_a_spring_goes_from_end_to_end() -> None:
    start, end = np.array([0.0, 0.01]), np.array([0.02, 0.03])
    corners = coil(start, end)
    np.testing.assert_array_equal(corners[[0, -1]], [start, end])
    along = (corners - start) @ (end - start)
    assert (np.diff(along) > 0.0).all()
    np.testing.assert_allclose(corners.mean(axis=0), 0.5 * (start + end), atol=2e-4)


@pytest.mark.soak
def test_writes_the_picture(result: Result, tmp_path: Path) -> None:
    import matplotlib.image

    draw_concepts(result, tmp_path / "concepts.png")
    picture = matplotlib.image.imread(tmp_path / "concepts.png")[:, :, :3]
    assert picture.shape[:2] == (890, 1400)
    # Skin, ghost, spheres and the red of forces, each where it belongs.
    left, middle, right = picture[60:420, :460], picture[60:420, 470:920], picture[60:420, 930:]
    blue = (left[:, :, 2] - left[:, :, 0] > 0.3).mean()
    assert blue > 0.02 > (right[:, :, 2] - right[:, :, 0] > 0.5).mean()
    assert (middle[:, :, 0] - middle[:, :, 2] > 0.15).mean() > 0.01
    section = picture[540:, 640:]
    assert ((section[:, :, 0] > 0.7) & (section[:, :, 1] < 0.25)).sum() > 50
