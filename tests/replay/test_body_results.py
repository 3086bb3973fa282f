"""Results of bodies on joints, driven, free, or parts of one thing: files, second runs, and what the referee finds."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from body_tables import body, body_file, joint
from cut_scene import cut
from sealed_change import changed as opened
from short_grasp import result_of

from hhsim.errors import InputError
from hhsim.gate.gate import gate_result
from hhsim.kernels.tick.state import STATUS_NO_PLACE
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.result.labelled import export_ticks
from hhsim.result.motion import load_result_motion
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import Scene, open_scene
from hhsim.scene.script import Script
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import seen_scene
from hhsim.verify.free_object_checks import free_claims

MESH = SolverOptions(surface="mesh")
TICKS = 60
"""Number of ticks of blocks that stand."""
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


FIRST, PARTS_TICKS = 1600, 400
LID = "bodies/lid/tick"


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return a scene in which the hand comes down onto the base while the lid closes; it begins outside of both."""
    scene = open_scene("laptop", "close", solid=False, level=2)
    return cut(scene, slice(FIRST, FIRST + PARTS_TICKS))


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
    assert parts is not None and result.ticks == PARTS_TICKS
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
