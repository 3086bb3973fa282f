"""Results of several bodies, parts and two hands: files, second runs, each as it is alone, and the referee."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from body_tables import body, body_file, joint
from file_faults import bare_datasets
from file_faults import changed as opened
from joint_samples import joint_sample
from leap_document import document
from short_grasp import cut, result_of, shortened

from hhsim.errors import InputError, TrajectoryError
from hhsim.gate.gate import gate_result
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import STATUS_NO_PLACE
from hhsim.metrics.metrics import distance_of_hands
from hhsim.motion.trajectory import ObjectMotion
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import Replay, replay_scene
from hhsim.result.labelled import export_ticks
from hhsim.result.motion import load_result_motion
from hhsim.result.reader import Result, load_hand, load_result
from hhsim.result.schema import BETWEEN_COLUMNS, SCHEMA_VERSION
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.described_scene import SceneWords, described_scene, two_handed_motions
from hhsim.scene.engine_scene import engine_scene
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, open_scene, require_one_object, tree_maker
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import SceneSolver
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


def played(name: str, motion: str, path: Path, ticks: int | None = None) -> Result:
    scene = open_scene(name, motion, solid=False, level=2)
    return result_of(scene if ticks is None else scene.first(ticks), path, surface="mesh")


def failed(result: Result) -> set[str]:
    """The names of the claims on free bodies that are false."""
    return {claim.name for claim in free_claims(result) if claim.failed}


def column(result: Result, body: str, name: str) -> Any:
    return np.asarray(result.bodies[body][name])


def test_the_door_opens_and_stays_where_the_hand_leaves_it(tmp_path: Path) -> None:
    door = played("door", "swing", tmp_path / "door.h5")
    turn, place = (column(door, "leaf", name) for name in ("orientation", "position"))
    angle = -2.0 * np.degrees(np.arctan2(turn[:, 3], turn[:, 0]))
    assert angle[-1] > 30.0 and np.abs(np.diff(angle[-500:])).max() < 1e-9
    assert np.abs(turn[:, 1:3]).max() < 1e-12, "about the hinge alone"
    hinge = np.array([-0.13, 0.0, 0.0])
    cosine, sine = np.cos(np.radians(angle)), -np.sin(np.radians(angle))
    turned = np.stack([cosine * hinge[0], sine * hinge[0], 0.0 * angle], axis=1)
    np.testing.assert_allclose(turned + place - (place[0] + hinge), 0.0, atol=1e-9)


def test_each_body_has_its_poses_and_forces(tmp_path: Path) -> None:
    result = played("blocks", "stack", tmp_path / "blocks.h5", TICKS)
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
    parts = engine_scene(scene).parts
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


HANDS = HandModel.default("right"), HandModel.default("left")
SCRIPT = shortened(load_script("grasp"), 0.7)


@pytest.fixture(scope="module")
def block_scene() -> Scene:
    words = SceneWords(object="cylinder", trajectory=SCRIPT.name)
    return described_scene(words, load_object("cylinder").with_trees(tree_maker(2)), HANDS, (SCRIPT, SCRIPT)).scene


@pytest.fixture(scope="module")
def both(block_scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Replay:
    run = Replay(SceneSolver(block_scene, SolverOptions()))
    run.into(tmp_path_factory.mktemp("both") / "both.h5", ("hhsim",))
    return run


@pytest.fixture(scope="module")
def stored(both: Replay) -> Path:
    return both.hands[0].path


def test_one_file_holds_both_and_nothing_is_left_beside_it(stored: Path) -> None:
    assert [path.name for path in stored.parent.iterdir()] == ["both.h5"]
    with h5py.File(stored) as file:
        assert file.attrs["complete"] == 1 and file.attrs["schema_version"] == SCHEMA_VERSION
        assert json.loads(file.attrs["command"]) == ["hhsim"]
        assert set(file["hands"]) == {"right", "left"} and len(file["bodies"]) == 1
    assert bare_datasets(stored) == []
    found = load_result(stored)
    assert (found.name, list(found.hands), found.hands["left"].other) == ("", ["right", "left"], found.hands["right"])
    with pytest.raises(InputError, match=r"both\.h5 holds two hands: force/total is that of \.hands"):
        found["force/total"]
    with pytest.raises(InputError, match=r"both\.h5 holds two hands: --hand right or --hand left names one"):
        load_hand(stored)


def test_how_near_the_hands_come_is_that_of_the_stored_poses(both: Replay, stored: Path) -> None:
    results: list[Result] = list(load_result(stored).hands.values())
    names = ("graphic/joints", "graphic/position", "graphic/orientation")
    placed = [PlacedHand(*(one[name] for name in names)) for one in results]
    apart = distance_of_hands(HANDS, placed)
    with h5py.File(stored) as file:
        np.testing.assert_array_equal(file["tick/between/graphic"], apart)
        assert {f"between/{name}" for name in file["tick/between"]} == {column.name for column in BETWEEN_COLUMNS}
    assert both.of_both["graphic_distance"] == apart.min() > 0.0 and both.of_both["haptic_distance"] > 0.0
    assert "µs" in both.note and "come within" in both.note


@pytest.mark.soak
def test_both_hands_are_an_axis_of_a_data_set(stored: Path) -> None:
    pytest.importorskip("xarray")
    found = load_result(stored)
    made = found.to_xarray()
    for name, hand in found.hands.items():
        np.testing.assert_array_equal(made["force/total"].sel(hand=name), hand["force/total"])
    assert made["between/graphic"].dims == ("time",)


def test_a_stopped_run_has_the_phases_that_it_came_to(stored: Path, tmp_path: Path) -> None:
    path = shutil.copy(stored, tmp_path / "stopped.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["complete"] = 0
        file["tick/time"].resize(5, axis=0)
    whole = load_result(path)
    assert whole.ticks == 5 and [phase.first_tick for phase in whole.phases] == [0]
    assert all(hand.phases == whole.phases for hand in whole.hands.values())


def test_a_recording_of_two_hands_gives_both_over_the_time_that_both_have(tmp_path: Path) -> None:
    whole, other = document("right"), document("left")
    for k, (frame, seen) in enumerate(zip(whole["frames"], other["frames"])):
        seen["hands"][0]["id"] = 8
        for pointable in seen["pointables"]:
            pointable["handId"] = 8
        if k >= 5:
            frame["hands"] += seen["hands"]
            frame["pointables"] += seen["pointables"]
    path = tmp_path / "two.json"
    path.write_text(json.dumps(whole))
    right, left = two_handed_motions(str(path))
    assert (right.hand, left.hand) == ("right", "left")
    for motion in (right, left):
        assert motion.sample_count == 25
        np.testing.assert_allclose(motion.position, right.position, atol=1e-9)
    path.write_text(json.dumps(document("right")))
    with pytest.raises(TrajectoryError, match="no left hand"):
        two_handed_motions(str(path))


@pytest.mark.parametrize("origin", [0.0, 150.0])
def test_two_hands_without_a_world_keep_their_distance(origin: float, tmp_path: Path) -> None:
    hands = {"right": joint_sample().named() + origin, "left": joint_sample("left").named() + origin + [0.3, 0.0, 0.0]}
    frames = [
        {"t": t, **{side: {"landmarks": points[k].tolist()} for side, points in hands.items()}}
        for k, t in enumerate(joint_sample().motion.time.tolist())
    ]
    path = tmp_path / "two.json"
    path.write_text(json.dumps(frames))
    for reading in (None, {"world_up": "y"}):
        right, left = two_handed_motions(str(path), reading)
        apart = np.median(left.position - right.position, axis=0)
        np.testing.assert_allclose(apart, [0.3, 0.0, 0.0], atol=0.03)
    assert np.linalg.norm(right.position, axis=1).max() < 2.0


def test_a_result_of_two_hands_is_a_motion_of_both(stored: Path) -> None:
    motions = two_handed_motions(str(stored))
    for motion, found in zip(motions, load_result(stored).hands.values()):
        np.testing.assert_array_equal(motion.position, found["haptic/position"])
    with pytest.raises(TrajectoryError, match="is of one hand"):
        two_handed_motions("finger-tap")


def test_hands_that_do_not_belong_together_are_refused(block_scene: Scene) -> None:
    right, left = block_scene.hands
    shorter = replace(left, ticks=left.ticks.first(10))
    for given, said in (
        ((left, right), "hands left and right: expected one, or right and left"),
        ((right, shorter), "the same number of ticks"),
    ):
        with pytest.raises(InputError, match=said):
            replace(block_scene, hands=given)
    elsewhere = left.trajectory.placed([0.1, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="the same object"):
        require_one_object([right.trajectory, elsewhere])
    count = left.trajectory.sample_count
    ways = (np.linspace(0.0, [x, 0.0, 0.0], count) for x in (1e-3, 1e-3, 2e-3))
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    carried = [replace(left.trajectory, object_motion=ObjectMotion(way, turn)) for way in ways]
    require_one_object(carried[:2])
    for others in ([left.trajectory, carried[0]], carried[1:]):
        with pytest.raises(InputError, match="the same motion of the object"):
            require_one_object(others)
