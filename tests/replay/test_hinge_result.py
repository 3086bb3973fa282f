"""Result of a door that a hand pushes open: what its file holds, its second run, and what the referee finds."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from file_faults import forge_properties
from sealed_change import changed as opened
from short_grasp import hurried

from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import open_scene
from hhsim.scene.script import Script
from hhsim.solver.options import SolverOptions
from hhsim.verify.free_object_checks import free_claims
from hhsim.verify.verify import verify

LEAF = "bodies/leaf/tick"


def played(motion: str | Script, path: Path) -> Result:
    replay_scene(open_scene("door", motion, level=2), SolverOptions(surface="mesh"), path)
    return load_result(path)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return played("swing", tmp_path_factory.mktemp("door") / "door.h5")


def test_the_door_opens_and_stays_where_the_hand_leaves_it(result: Result) -> None:
    turn = np.asarray(result[f"{LEAF}/orientation"])
    angle = -2.0 * np.degrees(np.arctan2(turn[:, 3], turn[:, 0]))
    assert angle[-1] > 30.0 and np.abs(np.diff(angle[-500:])).max() < 1e-9
    assert np.abs(turn[:, 1:3]).max() < 1e-12, "about the hinge alone"
    hinge = np.array([-0.13, 0.0, 0.0])
    place = np.asarray(result[f"{LEAF}/position"])
    cosine, sine = np.cos(np.radians(angle)), -np.sin(np.radians(angle))
    turned = np.stack([cosine * hinge[0], sine * hinge[0], 0.0 * angle], axis=1)
    np.testing.assert_allclose(turned + place - (place[0] + hinge), 0.0, atol=1e-9)


def test_the_ticks_run_again_are_the_same(result: Result) -> None:
    assert all(array.identical for array in run_again(result).arrays)


def test_the_referee_finds_each_claim_true(tmp_path: Path) -> None:
    hasty = played(hurried("swing", 1.2), tmp_path / "hurried.h5")
    report = verify(hasty)
    assert not [claim.name for claim in report.claims if claim.failed]
    (hinge,) = (claim for claim in report.claims if claim.name == "hinge")
    assert hinge.verdict == "holds" and hinge.checked == hasty.ticks


@pytest.mark.parametrize(
    ("dataset", "add"),
    [
        (f"{LEAF}/position", [0.0, 1e-8, 0.0]),
        (f"{LEAF}/orientation", [0.0, 1e-8, 0.0, 0.0]),
        (f"{LEAF}/angular_velocity", [0.0, 0.0, 1e-3]),
        (f"{LEAF}/hand_wrench", [0.0, 1e-2, 0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_the_referee_finds_a_planted_fault(result: Result, tmp_path: Path, dataset: str, add: list[float]) -> None:
    path = tmp_path / "changed.h5"
    shutil.copy(result.path, path)
    with opened(path) as file:
        file[dataset][2000] += add
    assert "hinge" in {claim.name for claim in free_claims(load_result(path)) if claim.failed}


@pytest.mark.parametrize("change", [{"friction": 0.09}, {"limits": [-0.5, 0.5]}, {"origin": [-0.13, 0.001, 0.0]}])
def test_the_referee_finds_another_hinge_than_that_of_the_run(
    result: Result, tmp_path: Path, change: dict[str, Any]
) -> None:
    path = tmp_path / "changed.h5"
    shutil.copy(result.path, path)
    with opened(path) as file:
        forge_properties(file, lambda free: free["hinge"].update(change))
    assert "hinge" in {claim.name for claim in free_claims(load_result(path)) if claim.failed}
