"""Pictures of the docs: each can be written, and shows what it is of."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from short_grasp import short_result

from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result
from hhsim.scene.script import parse_script
from tools.concepts_figure import draw_concepts, show
from tools.cost_figure import CostOptions, binned, draw_costs, measure
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
def test_the_pictures_are_drawn(result: Result, tmp_path: Path) -> None:
    draw_concepts(result, tmp_path / "concepts.png")
    draw_hand(tmp_path / "hand.png")
    costs = measure(CostOptions("cube", (1,), ("touch",), margins=(1e-3, 4e-3), rounds=2), lambda report: None)
    bins = {method: binned(ticks, least=1) for method, ticks in costs.items()}
    assert all(sum(row.ticks for row in rows) == len(costs[method].pairs) for method, rows in bins.items())
    draw_costs(tmp_path / "cost.png", bins)
    for name in ("concepts", "hand", "cost"):
        picture = imread(tmp_path / f"{name}.png")[:, :, :3]
        assert picture.shape[1] == 1400
        assert 0.01 < (picture < 0.95).all(axis=2).mean() < 0.6, name
