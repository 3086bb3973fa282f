"""Results of bodies on joints, driven ones and several free ones: files, second runs, and what the referee finds."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from body_tables import TABLE, body, body_file, joint

from hhsim.hand.quaternion import rotation_matrix
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import open_scene
from hhsim.scene.script import Script
from hhsim.solver.options import SolverOptions
from hhsim.verify.free_object_checks import free_claims
from hhsim.verify.tick_data import LAG
from hhsim.verify.verify import verify

MESH = SolverOptions(surface="mesh")
TICKS = 60
"""Number of ticks of blocks that stand."""
MOVES, SHUT = 1900, 3000
"""Ticks in which the drawer is pushed, and in which it is shut."""
HELD = 2800
"""Tick in which the chest is in the air, and the tray on its way."""
LATE = 4
"""Ticks fewer than these may lag while the fingers close on the chest."""
PRESSED = (
    body("block", [0.04, 0.04, 0.04], mass=0.1),
    body("anvil", [0.2, 0.2, 0.02], position=[0.0, 0.0, -0.030001], fixed=True),
    body(
        "press",
        [0.1, 0.1, 0.02],
        position=[0.0, 0.0, 0.031],
        joint=joint("slider", [0.0, 0.0, -1.0], limits=[0.0, 0.01], motion=[[0.0, 0.0], [0.5, 0.004], [1.0, 0.0]]),
    ),
)
ON_ANOTHER = (
    body("upper", [0.04, 0.04, 0.04], position=[0.0, 0.0, 0.060002], mass=0.05),
    body("lower", [0.04, 0.04, 0.04], position=[0.005, 0.0, 0.02], mass=0.1, friction=0.3),
    body("far", [0.04, 0.04, 0.04], position=[-0.3, 0.0, 0.02], fixed=True),
    TABLE,
)


def played(object_: str | Path, motion: str | Script, path: Path, ticks: int | None = None) -> Result:
    scene = open_scene(object_, motion, solid=False, level=2)
    replay_scene(scene if ticks is None else scene.first(ticks), MESH, path)
    return load_result(path)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Result]:
    """Results by the names of their objects, each run once."""
    motions: dict[str, tuple[str, int | None]] = {
        "door": ("swing", None),
        "drawer": ("shut", None),
        "chest": ("lift", None),
        "blocks": ("stack", TICKS),
    }
    folder, made = tmp_path_factory.mktemp("bodies"), dict[str, Result]()

    def result(name: str) -> Result:
        if name not in made:
            motion, ticks = motions[name]
            made[name] = played(name, motion, folder / f"{name}.h5", ticks)
        return made[name]

    return result


def failed(result: Result) -> set[str]:
    """The names of the claims on free bodies that are false."""
    return {claim.name for claim in free_claims(result) if claim.failed}


def column(result: Result, body: str, name: str) -> Any:
    return np.asarray(result.bodies[body][name])


def test_the_door_opens_and_stays_where_the_hand_leaves_it(results: Callable[[str], Result]) -> None:
    turn, place = (column(results("door"), "leaf", name) for name in ("orientation", "position"))
    angle = -2.0 * np.degrees(np.arctan2(turn[:, 3], turn[:, 0]))
    assert angle[-1] > 30.0 and np.abs(np.diff(angle[-500:])).max() < 1e-9
    assert np.abs(turn[:, 1:3]).max() < 1e-12, "about the hinge alone"
    hinge = np.array([-0.13, 0.0, 0.0])
    cosine, sine = np.cos(np.radians(angle)), -np.sin(np.radians(angle))
    turned = np.stack([cosine * hinge[0], sine * hinge[0], 0.0 * angle], axis=1)
    np.testing.assert_allclose(turned + place - (place[0] + hinge), 0.0, atol=1e-9)


@pytest.mark.soak
def test_the_drawer_shuts_and_what_lies_on_it_slides_on_where_it_stops(results: Callable[[str], Result]) -> None:
    result = results("drawer")
    place, box = (column(result, name, "position") for name in ("drawer", "box"))
    np.testing.assert_allclose(place[-1], [0.0, -0.12, 0.0], atol=1e-9)
    assert not place[:, [0, 2]].any() and not column(result, "drawer", "angular_velocity").any()
    assert abs(box[MOVES, 1] - place[MOVES, 1]) < 1e-6, "carried along"
    assert 1e-3 < place[-1, 1] - box[-1, 1] < 5e-3
    assert not np.asarray(result["status"]).any()


@pytest.mark.soak
def test_the_chest_is_lifted_with_its_lid_and_set_down_on_the_tray_that_has_gone_on(
    results: Callable[[str], Result],
) -> None:
    result = results("chest")
    chest, lid, tray = (column(result, name, "position") for name in ("chest", "lid", "tray"))
    status = np.asarray(result["status"])
    assert not (status & ~LAG).any() and np.count_nonzero(status) < LATE
    assert chest[:, 2].max() > 0.09 and abs(chest[-1, 2]) < 1e-5
    np.testing.assert_allclose(tray[-1], [0.0, 0.06, 0.0], atol=1e-9)
    assert np.abs(chest[-1, 1] - chest[0, 1]) < 0.01, "the tray has gone on under it"
    turns = [rotation_matrix(column(result, name, "orientation")) for name in ("chest", "lid")]
    hinge = [turn @ [-0.025, 0.0, 0.031] + place for turn, place in zip(turns, (chest, lid))]
    assert np.abs(hinge[0] - hinge[1]).max() < 2e-6
    (driven,) = (claim for claim in free_claims(result) if claim.name == "driven")
    assert driven.verdict == "holds" and driven.checked > result.ticks - LATE


def test_each_body_has_its_poses_and_forces(results: Callable[[str], Result]) -> None:
    result = results("blocks")
    assert [(name, body.kind) for name, body in result.bodies.items()] == [
        (name, "free") for name in ("red", "green", "blue")
    ]
    for name, weight in (("red", 0.05), ("green", 0.1), ("blue", 0.0)):
        np.testing.assert_allclose(column(result, name, "table_wrench")[-1, 2], weight * 9.81, atol=1e-9)
        assert np.abs(column(result, name, "position")).max() < 3e-6
    np.testing.assert_allclose(column(result, "blue", "body_wrench")[-1, 2], 0.05 * 9.81, rtol=1e-9)


@pytest.mark.soak
def test_what_stops_a_driven_body_is_told(tmp_path: Path) -> None:
    scene = open_scene(body_file(tmp_path, *PRESSED), "never", solid=False, level=2)
    summary = replay_scene(scene, MESH, tmp_path / "press.h5")
    (note,) = (one for one in summary.notes if one.startswith("press"))
    assert "kept from where it is recorded in" in note and "by up to 3 mm" in note
    found = load_result(tmp_path / "press.h5")
    block, press = (column(found, name, "position")[:, 2] for name in ("block", "press"))
    assert (0.021 + press - block - 0.02).min() >= 0.0, "nothing is entered"
    np.testing.assert_allclose(press[1000:], 0.0, atol=1e-9)
    assert not failed(found)


@pytest.mark.soak
def test_a_first_body_on_another_one_is_read_run_again_and_judged(tmp_path: Path) -> None:
    result = played(body_file(tmp_path, *ON_ANOTHER), "stack", tmp_path / "two.h5", TICKS)
    assert set(result.contacts["body"].tolist()) == {-3}, "it touches the second body alone"
    np.testing.assert_allclose(result.body["body_wrench"][-1, 2], 0.05 * 9.81, rtol=1e-6)
    assert run_again(result).identical
    claims = {claim.name: claim for claim in verify(result).claims}
    assert not [claim.name for claim in claims.values() if claim.failed]
    assert {"Newton", "between bodies", "bodies apart"} <= claims.keys()
