"""Result of a thing of several parts: what its file holds, its second run, and what all that reads it makes of it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cut_scene import cut
from sealed_change import changed as opened
from short_grasp import result_of

from hhsim.errors import InputError
from hhsim.gate.gate import gate_result
from hhsim.kernels.tick.state import STATUS_NO_PLACE
from hhsim.replay.repeat import run_again
from hhsim.result.labelled import export_ticks
from hhsim.result.motion import load_result_motion
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import Scene, open_scene
from hhsim.solver.scene_solver import seen_scene

FIRST, TICKS = 1600, 400
LID = "bodies/lid/tick"


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return a scene in which the hand comes down onto the base while the lid closes; it begins outside of both."""
    scene = open_scene("laptop", "close", solid=False, level=2)
    return cut(scene, slice(FIRST, FIRST + TICKS))


@pytest.fixture(scope="module")
def result(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Result:
    return result_of(scene, tmp_path_factory.mktemp("parts") / "close.h5", surface="mesh")


def changed(result: Result, folder: Path, dataset: str, row: int, add: float) -> Result:
    path = folder / "changed.h5"
    shutil.copy(result.path, path)
    with opened(path) as file:
        file[dataset][row] += add
    return load_result(path)


def test_a_result_holds_the_parts_and_runs_again_to_the_bit(scene: Scene, result: Result, tmp_path: Path) -> None:
    parts = seen_scene(scene).parts
    assert parts is not None and result.ticks == TICKS
    assert list(result.bodies) == ["base", "lid"]
    assert np.array_equal(result[f"{LID}/joint"], parts.values["lid"])
    assert np.array_equal(result[f"{LID}/position"], parts.path[:, 1, :3])
    assert np.array_equal(result["bodies/base/tick/orientation"], parts.path[:, 0, 3:])
    assert not (np.asarray(result["status"]) & STATUS_NO_PLACE).any()
    assert run_again(result).identical
    with pytest.raises(InputError, match=r"the mesh of lid in the file is another \(checksum\)"):
        run_again(changed(result, tmp_path, "bodies/lid/mesh/vertices", 3, 1e-4))
    otherwise = run_again(changed(result, tmp_path, f"{LID}/position", 200, 2e-3))
    assert not otherwise.same and min(array.first_tick for array in otherwise.arrays if not array.identical) == 200


def test_gate_report_and_table_measure_in_the_parts(result: Result, tmp_path: Path) -> None:
    report = gate_result(result, base=result)
    assert {row.verdict for row in report.rows} <= {"same", "limit only"} and len(report.rows) > 5
    assert result["penetration_depth"].max() == 0.0
    export_ticks(result, tmp_path / "ticks.csv", ["time", f"{LID}/joint", f"{LID}/position"])
    table = np.loadtxt(tmp_path / "ticks.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 2], result[f"{LID}/joint"])
    with pytest.raises(InputError, match="beside several bodies, which a motion does not carry"):
        load_result_motion(result.path)
    assert json.loads(json.dumps(run_again(result).to_json()))["identical"]
