"""Result of a chest with a hinged lid on a driven tray: its file, its second run, and what the referee finds."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from sealed_change import changed as opened

from hhsim.hand.quaternion import rotation_matrix
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import open_scene
from hhsim.solver.options import SolverOptions
from hhsim.verify.free_object_checks import free_claims
from hhsim.verify.tick_data import LAG

CHEST, LID, TRAY = (f"things/chest/{name}" for name in ("chest", "lid", "tray"))
HELD = 2800
"""Tick in which the chest is in the air, and the tray on its way."""
LATE = 4
"""Ticks fewer than these may lag while the fingers close."""

PRESSED = """
[[body]]
name = "block"
box = [0.04, 0.04, 0.04]
mass = 0.1

[[body]]
name = "anvil"
box = [0.2, 0.2, 0.02]
position = [0.0, 0.0, -0.030001]
fixed = true

[[body]]
name = "press"
box = [0.1, 0.1, 0.02]
position = [0.0, 0.0, 0.031]
joint.type = "slider"
joint.axis = [0.0, 0.0, -1.0]
joint.limits = [0.0, 0.01]
joint.motion = [[0.0, 0.0], [0.5, 0.004], [1.0, 0.0]]
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    path = tmp_path_factory.mktemp("chest") / "chest.h5"
    replay_scene(open_scene("chest", "lift", level=2), SolverOptions(surface="mesh"), path)
    return load_result(path)


def test_the_chest_is_lifted_with_its_lid_and_set_down_on_the_tray_that_has_gone_on(result: Result) -> None:
    chest, lid, tray = (np.asarray(result[f"{group}/position"]) for group in (CHEST, LID, TRAY))
    status = np.asarray(result["status"])
    assert not (status & ~LAG).any() and np.count_nonzero(status) < LATE
    assert chest[:, 2].max() > 0.09 and abs(chest[-1, 2]) < 1e-5
    np.testing.assert_allclose(tray[-1], [0.0, 0.06, 0.0], atol=1e-9)
    assert np.abs(chest[-1, 1] - chest[0, 1]) < 0.01, "the tray has gone on under it"
    turns = [rotation_matrix(np.asarray(result[f"{group}/orientation"])) for group in (CHEST, LID)]
    hinge = [turn @ [-0.025, 0.0, 0.031] + place for turn, place in zip(turns, (chest, lid))]
    assert np.abs(hinge[0] - hinge[1]).max() < 2e-6


def test_the_ticks_run_again_are_the_same(result: Result) -> None:
    assert all(array.identical for array in run_again(result).arrays)


def test_the_referee_finds_each_claim_true(result: Result) -> None:
    found = free_claims(result)
    assert not [claim.name for claim in found if claim.failed]
    (driven,) = (claim for claim in found if claim.name == "driven")
    assert driven.verdict == "holds" and driven.checked > result.ticks - LATE


@pytest.mark.parametrize(
    ("dataset", "add", "claim"),
    [
        (f"{TRAY}/position", [0.0, 1e-8, 0.0], "driven"),
        (f"{TRAY}/orientation", [0.0, 1e-8, 0.0, 0.0], "driven"),
        (f"{TRAY}/recorded_position", [0.0, 1e-8, 0.0], "driven"),
        (f"{TRAY}/velocity", [0.0, 1e-3, 0.0], "object velocity"),
        (f"{LID}/position", [0.0, 0.0, 1e-5], "joint"),
    ],
)
def test_the_referee_finds_a_planted_fault(
    result: Result, tmp_path: Path, dataset: str, add: list[float], claim: str
) -> None:
    path = Path(shutil.copy(result.path, tmp_path / "changed.h5"))
    with opened(path) as file:
        file[dataset][HELD] += add
    assert claim in {one.name for one in free_claims(load_result(path)) if one.failed}


def test_what_stops_a_driven_thing_is_told(tmp_path: Path) -> None:
    (tmp_path / "press.toml").write_text(PRESSED)
    scene = open_scene(str(tmp_path / "press.toml"), "never", solid=False, level=2)
    summary = replay_scene(scene, SolverOptions(surface="mesh"), tmp_path / "press.h5")
    (note,) = (one for one in summary.notes if one.startswith("press"))
    assert "kept from where it is recorded in" in note and "by up to 3 mm" in note
    found = load_result(tmp_path / "press.h5")
    block, press = (np.asarray(found[f"things/press/{name}/position"])[:, 2] for name in ("block", "press"))
    assert (0.021 + press - block - 0.02).min() >= 0.0, "nothing is entered"
    np.testing.assert_allclose(press[1000:], 0.0, atol=1e-9)
    assert not [one.name for one in free_claims(found) if one.failed]
