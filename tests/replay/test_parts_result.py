"""Result of a thing of several parts: what its file holds, its second run, and what all that reads it makes of it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cut_scene import cut
from driven_scenes import carried, swing
from rerun_files import Recording
from scipy.spatial.transform import Rotation
from sealed_change import changed as opened
from short_grasp import result_of

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.gate.gate import gate_result
from hhsim.kernels.tick.state import STATUS_NO_PLACE
from hhsim.replay.repeat import run_again
from hhsim.report.run import posed_result
from hhsim.result.csv_export import export_ticks
from hhsim.result.motion import load_result_motion
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import Scene, open_scene
from hhsim.solver.scene_solver import seen_scene
from hhsim.verify.claim import HOLDS
from hhsim.verify.file_checks import file_claims
from hhsim.view.film import video_frames
from hhsim.view.sink import parse_target
from hhsim.view.viewer import view_result

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


def box_distance(result: Result, part: str, tick: int, points: FloatArray) -> FloatArray:
    turn = Rotation.from_quat(np.roll(result.bodies[part]["orientation"][tick], -1))
    corners = result.bodies[part].vertices
    half = 0.5 * np.ptp(corners, axis=0)
    beyond = np.abs(turn.inv().apply(points - result.bodies[part]["position"][tick])) - half
    return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0))


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


def test_a_tick_may_say_that_parts_that_move_left_the_hand_no_place(result: Result, tmp_path: Path) -> None:
    said = changed(result, tmp_path, "hands/right/tick/status", 5, STATUS_NO_PLACE)
    assert [claim.verdict for claim in file_claims(said) if claim.name == "status"] == [HOLDS]


def test_a_thing_that_is_carried_runs_again_to_the_bit(tmp_path: Path) -> None:
    still = open_scene("laptop", "close", solid=False, level=2)
    scene = open_scene(
        "laptop", carried(still.hands[0].trajectory, swing(still.hands[0].trajectory.time)), solid=False, level=2
    )
    short = scene.first(60)
    moving, standing = seen_scene(short).parts, seen_scene(still).parts
    assert moving is not None and standing is not None
    np.testing.assert_allclose(moving.path[:, 0], np.tile(standing.path[0, 0], (60, 1)), atol=1e-12)
    assert np.ptp(moving.world[:, 0], axis=0).max() > 1e-4
    assert len(np.unique(moving.path[:, 0], axis=0)) == 1
    result = result_of(short, tmp_path / "carried.h5", surface="mesh")
    assert run_again(result).identical
    seen = result.seen_from_object.meshes_moved()
    np.testing.assert_allclose(seen[1].shift, moving.path[:, 1, :3], atol=1e-12)


def test_the_viewer_moves_each_part_and_finds_the_contacts_on_it(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "parts.rrd"
    view_result(result, parse_target(str(path)))
    recording = Recording(path)
    for name in result.bodies:
        entity = f"/world/object/{name}"
        places = recording.array(entity, "Transform3D:translation")[:, 0]
        np.testing.assert_allclose(places, result.bodies[name]["position"], atol=1e-6)
    points = recording.rows("/world/contacts/points", "Points3D:positions")
    # On a mesh the viewer marks the features of each triangle, the solver shared ones once.
    assert all(len(row or []) >= count for row, count in zip(points, result["contacts/touching"], strict=True))
    for tick in np.flatnonzero(result["contacts/touching"])[::20]:
        off = [box_distance(result, part, tick, np.array(points[tick])) for part in result.bodies]
        assert np.abs(off).min(axis=0).max() < 1.1e-5
        assert (np.abs(off[1]) < 1.1e-5).any(), "the lid has come down onto the hand"


def test_a_film_shows_the_lid_where_it_is(result: Result) -> None:
    first, last = video_frames(result, np.array([0, TICKS - 1]), 160)
    assert (np.abs(first.astype(int) - last).max(axis=2) > 30).mean() > 0.02


def test_gate_report_and_table_measure_in_the_parts(result: Result, tmp_path: Path) -> None:
    report = gate_result(result, base=result)
    assert {row.verdict for row in report.rows} <= {"same", "limit only"} and len(report.rows) > 5
    posed = posed_result(result)
    assert posed.contradiction() == "" and posed.deepest == 0.0
    export_ticks(result, tmp_path / "ticks.csv", ["time", f"{LID}/joint", f"{LID}/position"])
    table = np.loadtxt(tmp_path / "ticks.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 2], result[f"{LID}/joint"])
    with pytest.raises(InputError, match="beside several bodies, which a motion does not carry"):
        load_result_motion(result.path)
    assert json.loads(json.dumps(run_again(result).to_json()))["identical"]
