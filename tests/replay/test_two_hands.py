"""Two hands on one object: each as it is alone, or both by one program, and one file of both."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from cut_scene import of_hand
from described_datasets import bare_datasets
from joint_samples import joint_sample
from leap_document import document
from short_grasp import result_of, shortened

from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.metrics.metrics import distance_of_hands
from hhsim.replay.replay import Replay
from hhsim.result.reader import Result, load_hand, load_result
from hhsim.result.schema import BETWEEN_COLUMNS, SCHEMA_VERSION
from hhsim.scene.declared_bodies import DeclaredBodies, load_object
from hhsim.scene.described_scene import SceneWords, described_scene, two_handed_motions
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, require_one_object, tree_maker
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import SceneSolver

HANDS = HandModel.default("right"), HandModel.default("left")
SCRIPT = shortened(load_script("grasp"), 0.7)


def scene_of_both(name: str = "cylinder", script: Any = SCRIPT, level: int = 2) -> Scene:
    bodies = load_bodies_of(name, level)
    return described_scene(SceneWords(object=name, trajectory=script.name), bodies, HANDS, (script, script)).scene


def load_bodies_of(name: str, level: int) -> DeclaredBodies:
    return load_object(name).with_trees(tree_maker(level))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_of_both()


@pytest.fixture(scope="module")
def both(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Replay:
    run = Replay(SceneSolver(scene, SolverOptions()))
    run.into(tmp_path_factory.mktemp("both") / "both.h5", ("hhsim",))
    return run


@pytest.fixture(scope="module")
def stored(both: Replay) -> Path:
    path = both.hands[0].path
    assert path is not None
    return path


@pytest.mark.soak
def test_each_hand_is_as_it_is_alone(stored: Path, scene: Scene, tmp_path: Path) -> None:
    hands = load_result(stored).hands
    assert list(hands) == ["right", "left"]
    for hand, (name, found) in enumerate(hands.items()):
        alone = result_of(of_hand(scene, hand), tmp_path / f"{name}.h5")
        assert found.side == name == HANDS[hand].side and found.complete
        for name in sorted(alone.keys()):
            if not name.startswith("duration/"):
                assert found[name].tobytes() == alone[name].tobytes(), name
        assert found.summary.keys() == alone.summary.keys()
        assert found["contacts/touching"].max() > 0


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
    assert (right.hand, left.hand) == ("right", "left")  # type: ignore[union-attr]
    for motion in (right, left):
        assert motion.sample_count == 25  # type: ignore[union-attr]
        np.testing.assert_allclose(motion.position, right.position, atol=1e-9)  # type: ignore[union-attr]
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
        apart = np.median(left.position - right.position, axis=0)  # type: ignore[union-attr]
        np.testing.assert_allclose(apart, [0.3, 0.0, 0.0], atol=0.03)
    assert np.linalg.norm(right.position, axis=1).max() < 2.0  # type: ignore[union-attr]


def test_a_result_of_two_hands_is_a_motion_of_both(stored: Path) -> None:
    motions = two_handed_motions(str(stored))
    for motion, found in zip(motions, load_result(stored).hands.values()):
        np.testing.assert_array_equal(motion.position, found["haptic/position"])  # type: ignore[union-attr]
    with pytest.raises(TrajectoryError, match="is of one hand"):
        two_handed_motions("finger-tap")


def test_hands_that_do_not_belong_together_are_refused(scene: Scene) -> None:
    right, left = scene.hands
    shorter = replace(left, ticks=left.ticks.first(10))
    for given, said in (
        ((left, right), "hands left and right: expected one, or right and left"),
        ((right, shorter), "the same number of ticks"),
    ):
        with pytest.raises(InputError, match=said):
            replace(scene, hands=given)
    elsewhere = left.trajectory.placed([0.1, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="the same object"):
        require_one_object([right.trajectory, elsewhere])
