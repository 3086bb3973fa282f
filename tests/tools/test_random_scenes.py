"""Random scenes: short ones are clean, their judge agrees with other code, and it finds what is planted."""

import tempfile
from functools import cache
from pathlib import Path

import pytest

from hhsim.result.reader import load_result
from tools.random_scenes import draw, played
from tools.scene_judge import Recorded, judge

pytestmark = pytest.mark.soak

TICKS, EVERY = 300, 10
SCENES = {"fixed": 28, "several": 9, "free": 9}
"""A scene of some kinds in which hands touch: one with fingers that meet; of several bodies one of two hands."""


@cache
def clean(kind: str) -> Recorded:
    with tempfile.TemporaryDirectory() as folder:
        case = draw(kind, 0, SCENES[kind], TICKS)
        return case.ticks_of(load_result(played(case, Path(folder))))


@pytest.mark.parametrize("kind", SCENES)
def test_a_short_scene_is_clean_and_its_hands_touch(kind: str) -> None:
    found = judge(clean(kind), EVERY)
    assert found.findings == []
    assert found.touching and max(found.deepest.values()) == 0.0
    assert found.newton < 1e-6 and found.euler < 1e-6
    assert bool(found.equations) == (kind != "fixed")


# Hands that met in tick 530 stood there for ever: each tick ended before a step, and the next tried the same. Jaws that
# squeezed a palm drove it into the fixed one, where it stayed when they opened; on spheres between those of one jaw.
@pytest.mark.parametrize("scene", [("fixed", 4242, 37), ("joint-driven", 1201, 21), ("joint-driven", 1201, 58)])
def test_a_scene_in_which_hands_once_stopped_for_ever_goes_on(scene: tuple[str, int, int], tmp_path: Path) -> None:
    case = draw(*scene, 1200)
    found = judge(case.ticks_of(load_result(played(case, tmp_path))), 100)
    assert found.findings == []
