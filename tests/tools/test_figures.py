"""Pictures of the docs: each can be written, and shows what it is of."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from short_grasp import short_result

from hhsim.errors import OutputError
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result
from hhsim.scene.script import parse_script
from tools.concepts_figure import draw_concepts, show
from tools.cost_figure import CostOptions, TickCosts, binned, draw_costs, measure
from tools.cross_section import cut_spheres
from tools.hand_figure import draw_hand

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


@pytest.mark.soak
def test_the_picture_of_the_concepts(result: Result, tmp_path: Path) -> None:
    draw_concepts(result, tmp_path / "concepts.png")
    picture = imread(tmp_path / "concepts.png")[:, :, :3]
    assert picture.shape[:2] == (890, 1400)
    # Skin, ghost, spheres and the red of forces, each where it belongs.
    left, middle, right = picture[60:420, :460], picture[60:420, 470:920], picture[60:420, 930:]
    blue = (left[:, :, 2] - left[:, :, 0] > 0.3).mean()
    assert blue > 0.02 > (right[:, :, 2] - right[:, :, 0] > 0.5).mean()
    assert (middle[:, :, 0] - middle[:, :, 2] > 0.15).mean() > 0.01
    section = picture[540:, 640:]
    assert ((section[:, :, 0] > 0.7) & (section[:, :, 1] < 0.25)).sum() > 50


@pytest.mark.soak
def test_the_picture_of_the_hand(tmp_path: Path) -> None:
    draw_hand(tmp_path / "hand.png")
    picture = imread(tmp_path / "hand.png")
    assert picture.shape[1] == 1400
    assert 0.1 < (picture[:, :, :3] < 0.95).all(axis=2).mean() < 0.6
    with pytest.raises(OutputError, match="there is no folder"):
        draw_hand(tmp_path / "nowhere" / "hand.png")


def test_bins_of_a_cost_hold_their_lower_edge_and_not_their_upper_one() -> None:
    pairs = np.array([1, 2, 3, 3, 4, 5, 9, 10])
    low, high = binned(TickCosts(pairs, 1e-6 * pairs), [1, 3, 10], least=1)
    assert (low.first, low.last, low.ticks) == (1, 2, 2)
    assert (high.first, high.last, high.ticks) == (3, 9, 5)
    assert low.pairs == 1.5
    assert high.pairs == pytest.approx(24 / 5)
    assert high.median == pytest.approx(4e-6)


@pytest.mark.soak
def test_the_picture_of_the_costs(tmp_path: Path) -> None:
    costs = measure(CostOptions("cube", (1,), ("touch",), margins=(1e-3, 4e-3), rounds=2), lambda report: None)
    assert sorted(costs) == ["coupled", "progressive"]
    bins = {method: binned(ticks, least=1) for method, ticks in costs.items()}
    assert all(sum(row.ticks for row in rows) == len(costs[method].pairs) for method, rows in bins.items())
    draw_costs(tmp_path / "cost.png", bins)
    assert imread(tmp_path / "cost.png").shape[:2] == (600, 1400)
