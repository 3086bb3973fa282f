"""Result of several things: what its file holds, its second run, and what the referee finds."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from sealed_change import changed as opened

from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import open_scene
from hhsim.solver.options import SolverOptions
from hhsim.verify.free_object_checks import free_claims
from hhsim.verify.verify import verify

TICKS = 60
RED, GREEN, BLUE = (f"bodies/{name}/tick" for name in ("red", "green", "blue"))


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    path = tmp_path_factory.mktemp("things") / "blocks.h5"
    scene = open_scene("blocks", "stack", solid=False, level=2)
    replay_scene(scene.first(TICKS), SolverOptions(surface="mesh"), path)
    return load_result(path)


def test_each_thing_has_its_poses_and_forces(result: Result) -> None:
    assert list(result.bodies) == ["red", "green", "blue"] and result.free
    for part, weight in ((RED, 0.05), (GREEN, 0.1), (BLUE, 0.0)):
        np.testing.assert_allclose(result[f"{part}/table_wrench"][-1, 2], weight * 9.81, atol=1e-9)
        assert np.abs(result[f"{part}/position"]).max() < 3e-6
    np.testing.assert_allclose(result[f"{BLUE}/body_wrench"][-1, 2], 0.05 * 9.81, rtol=1e-9)
    np.testing.assert_array_equal(result.body["position"], result[f"{RED}/position"])


def test_the_ticks_run_again_are_the_same(result: Result) -> None:
    again = run_again(result)
    assert all(array.identical for array in again.arrays)


def test_the_referee_finds_each_claim_true(result: Result) -> None:
    report = verify(result)
    assert not [claim.name for claim in report.claims if claim.failed]
    assert {"Newton", "between bodies", "bodies apart"} <= {claim.name for claim in report.claims}


@pytest.mark.parametrize(
    ("dataset", "add", "name"),
    [
        (f"{BLUE}/velocity", [0.0, 0.0, 1e-3], "Newton"),
        (f"{GREEN}/body_wrench", [0.0, 0.0, 1e-3, 0.0, 0.0, 0.0], "between bodies"),
        (f"{BLUE}/position", [0.0, 0.0, -1e-5], "bodies apart"),
    ],
)
def test_the_referee_finds_a_planted_fault(
    result: Result, tmp_path: Path, dataset: str, add: list[float], name: str
) -> None:
    path = tmp_path / "changed.h5"
    shutil.copy(result.path, path)
    with opened(path) as file:
        file[dataset][TICKS - 1] += add
    assert name in {claim.name for claim in free_claims(load_result(path)) if claim.failed}


ON_ANOTHER = """
[[body]]
name = "upper"
box = [0.04, 0.04, 0.04]
position = [0.0, 0.0, 0.060002]
mass = 0.05

[[body]]
name = "lower"
box = [0.04, 0.04, 0.04]
position = [0.005, 0.0, 0.02]
mass = 0.1
friction = 0.3

[[body]]
name = "far"
box = [0.04, 0.04, 0.04]
position = [-0.3, 0.0, 0.02]
fixed = true

[[body]]
name = "table"
plane = "under"
"""


def test_a_first_thing_on_another_one_is_read_run_again_and_judged(tmp_path: Path) -> None:
    (tmp_path / "two.toml").write_text(ON_ANOTHER)
    scene = open_scene(str(tmp_path / "two.toml"), "stack", solid=False, level=2)
    replay_scene(scene.first(TICKS), SolverOptions(surface="mesh"), tmp_path / "two.h5")
    result = load_result(tmp_path / "two.h5")
    assert set(result.contacts["body"].tolist()) == {-3}, "it touches the second thing alone"
    np.testing.assert_allclose(result.body["body_wrench"][-1, 2], 0.05 * 9.81, rtol=1e-6)
    assert all(array.identical for array in run_again(result).arrays)
    assert not [claim.name for claim in verify(result).claims if claim.failed]
