"""Random scenes: short ones are clean, their judge agrees with other code, and it finds what is planted."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hhsim.result.reader import load_result
from tools.random_scenes import draw, played
from tools.scene_judge import Moved, Recorded, judge

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


def changed(kind: str, change: Callable[[Recorded, Moved], None]) -> list[str]:
    """Find what is wrong in a scene of which a copy of the motion of the free body that hands push most was changed."""
    scene = clean(kind)
    pushed = [np.abs(one.wrench[0]).sum() if one.free else 0.0 for one in scene.bodies]
    place = int(np.argmax(pushed))
    body = scene.bodies[place]
    values = {name: getattr(body, name).copy() for name in ("turn", "shift", "velocity", "spin", "wrench")}
    bodies = [*scene.bodies[:place], replace(body, **values), *scene.bodies[place + 1 :]]
    scene = replace(scene, bodies=tuple(bodies), status=scene.status.copy())
    change(scene, scene.bodies[place])
    return [finding.what for finding in judge(scene, EVERY).findings]


def faults() -> dict[str, Callable[[Recorded, Moved], None]]:
    def scaled(part: int, columns: slice, by: float) -> Callable[[Recorded, Moved], None]:
        def change(scene: Recorded, body: Moved) -> None:
            body.wrench[part, :, columns] *= by

        return change

    def faster(scene: Recorded, body: Moved) -> None:
        body.velocity[150] += 1e-6

    def spinning(scene: Recorded, body: Moved) -> None:
        body.spin[150:] += [0.0, 0.0, 1e-3]

    def lower(scene: Recorded, body: Moved) -> None:
        body.shift[:, 2] -= 1e-3

    def pushed(scene: Recorded, body: Moved) -> None:
        body.wrench[2, 150:, 0] += 1e-3

    return {
        "Newton's equation": scaled(1, slice(3), 1.0001),
        "Euler's equation": scaled(0, slice(3, 6), 2.0),
        "force on the hands": scaled(0, slice(3), 1.0001),
        "velocity off its poses": faster,
        "Euler": spinning,
        "body in table": lower,
        "forces of bodies on each other": pushed,
    }


@pytest.mark.parametrize("what", faults())
def test_what_is_planted_in_a_bodys_motion_is_found(what: str) -> None:
    assert any(found.startswith(what) for found in changed("several", faults()[what]))


def test_a_shown_hand_that_is_off_by_a_millimetre_is_found() -> None:
    scene = clean("fixed")
    shown, *others = scene.shown
    found: list[str] = []
    for way in 1e-3 * np.concatenate([np.eye(3), -np.eye(3)]):
        moved = replace(scene, shown=(shown._replace(position=shown.position + way), *others))
        found += [finding.what for finding in judge(moved, EVERY).findings]
    assert "hand in body, depth [m]" in found
