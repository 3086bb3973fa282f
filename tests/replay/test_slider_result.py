"""Result of a drawer that a hand pushes shut: what its file holds, its second run, and what the referee finds."""

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

DRAWER = "bodies/drawer/tick"
MOVES, SHUT = 1900, 3000
"""Ticks in which the hand moves it, and in which it is shut."""


def played(motion: str | Script, path: Path) -> Result:
    replay_scene(open_scene("drawer", motion, level=2), SolverOptions(surface="mesh"), path)
    return load_result(path)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return played("shut", tmp_path_factory.mktemp("drawer") / "drawer.h5")


def test_the_drawer_shuts_and_what_lies_on_it_slides_on_where_it_stops(result: Result) -> None:
    place, box = (np.asarray(result[f"bodies/{name}/tick/position"]) for name in ("drawer", "box"))
    np.testing.assert_allclose(place[-1], [0.0, -0.12, 0.0], atol=1e-9)
    assert not place[:, [0, 2]].any() and not np.asarray(result[f"{DRAWER}/angular_velocity"]).any()
    assert abs(box[MOVES, 1] - place[MOVES, 1]) < 1e-6, "carried along"
    assert 1e-3 < place[-1, 1] - box[-1, 1] < 5e-3
    assert not np.asarray(result["status"]).any()


def test_the_ticks_run_again_are_the_same(result: Result) -> None:
    assert all(array.identical for array in run_again(result).arrays)


def test_the_referee_finds_each_claim_true(tmp_path: Path) -> None:
    hasty = played(hurried("shut", 1.2), tmp_path / "hurried.h5")
    report = verify(hasty)
    assert not [claim.name for claim in report.claims if claim.failed]
    (slider,) = (claim for claim in report.claims if claim.name == "slider")
    assert slider.verdict == "holds" and slider.checked == hasty.ticks


def failed_claims(path: Path) -> set[str]:
    """The names of the claims of a free object that are false in a file."""
    return {claim.name for claim in free_claims(load_result(path)) if claim.failed}


@pytest.mark.parametrize(
    ("dataset", "tick", "add"),
    [
        (f"{DRAWER}/position", SHUT, [1e-8, 0.0, 0.0]),
        (f"{DRAWER}/orientation", MOVES, [0.0, 1e-8, 0.0, 0.0]),
        (f"{DRAWER}/velocity", MOVES, [0.0, 1e-3, 0.0]),
        (f"{DRAWER}/hand_wrench", MOVES, [0.0, 1e-2, 0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_the_referee_finds_a_planted_fault(
    result: Result, tmp_path: Path, dataset: str, tick: int, add: list[float]
) -> None:
    path = Path(shutil.copy(result.path, tmp_path / "changed.h5"))
    with opened(path) as file:
        file[dataset][tick] += add
    assert "slider" in failed_claims(path)


@pytest.mark.parametrize("change", [{"friction": 1.4}, {"limits": [-0.11, 0.1]}, {"axis": [1e-6, 1.0, 0.0]}])
def test_the_referee_finds_another_slider_than_that_of_the_run(
    result: Result, tmp_path: Path, change: dict[str, Any]
) -> None:
    path = Path(shutil.copy(result.path, tmp_path / "changed.h5"))
    with opened(path) as file:
        forge_properties(file, lambda free: free["slider"].update(change))
    assert "slider" in failed_claims(path)
