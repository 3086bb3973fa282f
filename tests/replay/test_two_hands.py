"""Two hands on one object: each as it is alone, or both by one program, and one file of both."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from cut_scene import moved_hand, of_hand
from described_datasets import bare_datasets
from joint_samples import joint_sample
from leap_document import document
from short_grasp import result_of, short_grasp, shortened

from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.metrics.metrics import distance_of_hands
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import TwoHandedReplay, replay_two_hands
from hhsim.result.reader import Result, load_hand, load_result
from hhsim.result.schema import BETWEEN_COLUMNS, SCHEMA_VERSION
from hhsim.scene.body import CLEARANCE
from hhsim.scene.declared_bodies import DeclaredBodies, load_object
from hhsim.scene.described_scene import SceneWords, described_scene, two_handed_motions
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, make_scene, open_scene, require_one_object, tree_maker
from hhsim.scene.synthesis import planned
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.verify.verify import verify

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
def both(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> TwoHandedReplay:
    return replay_two_hands(scene, SolverOptions(), tmp_path_factory.mktemp("both") / "both.h5", command=("hhsim",))


def test_each_hand_is_as_it_is_alone(both: TwoHandedReplay, scene: Scene, tmp_path: Path) -> None:
    hands = load_result(both.path).hands
    assert list(hands) == ["right", "left"]
    for hand, (name, found) in enumerate(hands.items()):
        alone = result_of(of_hand(scene, hand), tmp_path / f"{name}.h5")
        assert found.side == name == HANDS[hand].side and found.complete
        for name in sorted(alone.keys()):
            if not name.startswith("duration/"):
                assert found[name].tobytes() == alone[name].tobytes(), name
        assert found.summary.keys() == alone.summary.keys()
        assert found["contacts/touching"].max() > 0


def test_one_file_holds_both_and_nothing_is_left_beside_it(both: TwoHandedReplay) -> None:
    assert [path.name for path in both.path.parent.iterdir()] == ["both.h5"]
    with h5py.File(both.path) as file:
        assert file.attrs["complete"] == 1 and file.attrs["schema_version"] == SCHEMA_VERSION
        assert json.loads(file.attrs["command"]) == ["hhsim"]
        assert set(file["hands"]) == {"right", "left"} and len(file["bodies"]) == 1
    assert bare_datasets(both.path) == []
    found = load_result(both.path)
    assert (found.name, list(found.hands), found.hands["left"].other) == ("", ["right", "left"], found.hands["right"])
    with pytest.raises(InputError, match=r"both\.h5 holds two hands: force/total is that of \.hands"):
        found["force/total"]
    with pytest.raises(InputError, match=r"both\.h5 holds two hands: --hand right or --hand left names one"):
        load_hand(both.path)


def test_how_near_the_hands_come_is_that_of_the_stored_poses(both: TwoHandedReplay) -> None:
    results: list[Result] = list(load_result(both.path).hands.values())
    names = ("graphic/joints", "graphic/position", "graphic/orientation")
    placed = [PlacedHand(*(one[name] for name in names)) for one in results]
    apart = distance_of_hands(HANDS, placed)
    with h5py.File(both.path) as file:
        np.testing.assert_array_equal(file["tick/between/graphic"], apart)
        assert {f"between/{name}" for name in file["tick/between"]} == {column.name for column in BETWEEN_COLUMNS}
    assert both.graphic_distance == apart.min() > 0.0 and both.haptic_distance > 0.0
    assert "µs" in both.note and "come within" in both.note


def test_a_stopped_run_has_the_phases_that_it_came_to(both: TwoHandedReplay, tmp_path: Path) -> None:
    path = shutil.copy(both.path, tmp_path / "stopped.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["complete"] = 0
        file["tick/time"].resize(5, axis=0)
    whole = load_result(path)
    assert whole.ticks == 5 and [phase.first_tick for phase in whole.phases] == [0]
    assert all(hand.phases == whole.phases for hand in whole.hands.values())


@pytest.mark.soak
def test_the_left_hand_finds_its_place_beside_the_right_one(scene: Scene) -> None:
    body = scene.solids[0]
    alone = make_scene(body.mesh, body.tree, HANDS[1], SCRIPT)
    assert not np.allclose(alone.hands[0].ticks.position, scene.hands[1].ticks.position)
    tiny = load_object("sphere").mesh.transformed(0.1 * np.eye(3), np.zeros(3))
    bodies = DeclaredBodies.of_mesh(tiny).with_trees(tree_maker(2))
    words = SceneWords(object="sphere", trajectory="grasp")
    with pytest.raises(TrajectoryError, match=r"no room for both hands|cannot reach"):
        described_scene(words, bodies, HANDS, (SCRIPT, SCRIPT))


def test_mirrored_hands_on_a_mirrored_object_feel_mirrored_forces() -> None:
    scene = make_scene(*_cube(), HANDS[0], short_grasp())
    flip = np.diag([-1.0, 1.0, 1.0])
    mirrored = scene.solids[0].placed_tree.transformed(flip, np.zeros(3))
    given = HandConfiguration.of(scene.hands[0].ticks)
    turned = given.orientation * [1.0, 1.0, -1.0, -1.0]
    other = HandConfiguration(given.position @ flip, turned, given.flexion, given.abduction)
    one = HandSolver(HANDS[0], scene.solids[0].placed_tree.arrays(), SolverOptions()).run(*given)
    two = HandSolver(HANDS[1], mirrored.arrays(), SolverOptions()).run(*other)
    assert np.abs(one.total).max() > 0.5
    np.testing.assert_allclose(two.total @ flip, one.total, atol=1e-9)
    np.testing.assert_allclose(two.joints @ flip, one.joints, atol=1e-12)


def _cube() -> tuple[Any, Any]:
    mesh = load_object("cube").mesh
    return mesh, cached_sphere_tree(mesh, TreeOptions(level=2))


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
    right, left = two_handed_motions(str(path))
    apart = np.median(left.position - right.position, axis=0)  # type: ignore[union-attr]
    np.testing.assert_allclose(apart, [0.3, 0.0, 0.0], atol=0.03)
    right, left = two_handed_motions(str(path), {"world_up": "y"})
    apart = np.median(left.position - right.position, axis=0)  # type: ignore[union-attr]
    np.testing.assert_allclose(apart, [0.3, 0.0, 0.0], atol=0.03)
    assert np.linalg.norm(right.position, axis=1).max() < 2.0  # type: ignore[union-attr]


def test_a_result_of_two_hands_is_a_motion_of_both(both: TwoHandedReplay) -> None:
    motions = two_handed_motions(str(both.path))
    for motion, found in zip(motions, load_result(both.path).hands.values()):
        np.testing.assert_array_equal(motion.position, found["haptic/position"])  # type: ignore[union-attr]
    with pytest.raises(TrajectoryError, match="is of one hand"):
        two_handed_motions("finger-tap")


def test_hands_that_do_not_belong_together_are_refused(scene: Scene, tmp_path: Path) -> None:
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
    with pytest.raises(InputError, match="expected right and left hand"):
        replay_two_hands(of_hand(scene, 0), SolverOptions(), tmp_path / "out.h5")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module", params=["fixed", "free"])
def meeting(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> TwoHandedReplay:
    """Both hands at the cylinder, the left one's motion shifted into the right hand."""
    scene = scene_of_both(script=replace(SCRIPT, name="short"))
    right, left = (hand.ticks.position for hand in scene.hands)
    meeting = moved_hand(scene, 1, position=left + 0.4 * (right.mean(axis=0) - left.mean(axis=0)))
    path = tmp_path_factory.mktemp("meeting") / "both.h5"
    if request.param == "free":
        meeting = on_table(meeting, 0.5)
    return replay_two_hands(meeting, SolverOptions(surface="mesh"), path)


def on_table(scene: Scene, mass: float) -> Scene:
    return scene.freed(mass=mass, table=float(scene.solids[0].placed_mesh.bounds[0, 2]) - CLEARANCE)


@pytest.mark.quick("fixed")
def test_haptic_hands_that_enter_each_other_are_shown_apart(meeting: TwoHandedReplay) -> None:
    assert meeting.haptic_distance < -5e-3 and meeting.graphic_distance >= 0.0 and meeting.keeps_apart
    assert "enter each other by" in meeting.note and "the graphic ones by 0 mm" in meeting.note
    right, left = load_result(meeting.path).hands.values()
    for result in (right, left):
        assert result.summary["penetration_max"] == 0.0 and result.scene["hands_apart"] is True


@pytest.fixture(scope="module")
def lifted(tmp_path_factory: pytest.TempPathFactory) -> TwoHandedReplay:
    """The cube, pressed from both sides and lifted by 100 mm."""
    scene = scene_of_both("cube", replace(shortened(load_script("lift-both"), 1.2), name="short"))
    options, path = SolverOptions(surface="mesh"), tmp_path_factory.mktemp("lifted") / "lifted.h5"
    return replay_two_hands(on_table(scene, 0.2), options, path)


def test_two_hands_lift_what_they_press_from_both_sides(lifted: TwoHandedReplay) -> None:
    right, left = load_result(lifted.path).hands.values()
    assert lifted.together and "in one program" in lifted.note
    assert right.body["position"][:, 2].max() > 0.09 and right.body["position"][-1, 2] < 1e-3
    of_hands = right.contacts["body"] >= 0
    assert set(right.contacts["body"][of_hands] // 16) == {0, 1}
    np.testing.assert_array_equal(right.contacts["body"][of_hands] ^ 16, left.contacts["body"][of_hands])
    np.testing.assert_array_equal(right.contacts["body"][~of_hands], left.contacts["body"][~of_hands])
    for result in (right, left):
        assert result.summary["penetration_max"] == 0.0
        assert result.summary["object_momentum"] < 1e-8
        assert result.summary["energy_gained"] == 0.0
    flip = [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(left["haptic/position"] * flip, right["haptic/position"], atol=1e-6)


def test_fingers_close_behind_both_handles() -> None:
    tree = cached_sphere_tree(load_object("handle-box").mesh, TreeOptions(level=4))
    for hand in HANDS:
        found = planned(load_script("lift-both").of_two(), hand, tree)
        assert set(found.reached) == {"index", "middle", "ring", "little"}
        turn = quaternion_from_matrix(found.rotation)[None]
        closed = forward_kinematics(hand, found.position[None], turn, found.contact[None], found.abduction[None])
        away, height = np.abs(closed.joints[0, 1:, :, 0]), closed.joints[0, 1:, :, 2]
        # The bar is 90 to 102 mm from the middle, its lower side at -6 mm.
        assert (away[:, 3] < 0.09).all() and (away[:, 0] > 0.102).all() and (height.min(axis=1) < -0.006).all()


@pytest.mark.soak
def test_a_box_hangs_by_its_handles(tmp_path: Path) -> None:
    scene, path = scene_of_both("handle-box", load_script("lift-both").of_two(), level=4), tmp_path / "box.h5"
    replay_two_hands(on_table(scene, 1.2), SolverOptions(), path)
    right = load_hand(path, "right")
    time, height = right["time"], right.body["position"][:, 2] - right.body["position"][0, 2]
    assert height[(time > 2.6) & (time < 2.9)].min() > 0.1 and abs(height[-1]) < 1e-3


@pytest.mark.soak
def test_one_hand_gives_the_cup_to_the_other(tmp_path: Path) -> None:
    scene, path = scene_of_both("cup", load_script("hand-over"), level=4), tmp_path / "given.h5"
    done = replay_two_hands(on_table(scene, 0.236), SolverOptions(), path)
    right = load_hand(path, "right")
    time, height = right["time"], right.body["position"][:, 2] - right.body["position"][0, 2]
    given = (time > 4.85) & (time < 5.0)
    assert height[given].min() > 0.08 and done.graphic_distance > 0.0
    of_left = right["contact/tick"][right.contacts["body"] // 16 == 1]
    of_right = right["contact/tick"][right.contacts["body"] // 16 == 0]
    assert np.isin(np.flatnonzero(given), of_left).all() and not np.isin(of_right, np.flatnonzero(given)).any()


@pytest.mark.parametrize("name", ["open", "close"])
def test_two_hands_at_a_lid_are_mirror_images_each_at_its_side(name: str) -> None:
    motions = two_handed_motions(name)
    right, left = (
        open_scene("laptop", motion, solid=False, level=2, hand=hand).hands[0] for motion, hand in zip(motions, HANDS)
    )
    rows = slice(None, None, 50)
    haptic = [HandConfiguration(*(part[rows] for part in HandConfiguration.of(one.ticks))) for one in (right, left)]
    placed = [forward_kinematics(hand, *configuration) for hand, configuration in zip(HANDS, haptic)]
    joints = [each.joints for each in placed]
    np.testing.assert_allclose(right.ticks.position * [-1.0, 1.0, 1.0], left.ticks.position, atol=1e-12)
    assert joints[0][..., 0].min() > 0.0 > joints[1][..., 0].max()
    assert distance_of_hands(HANDS, (placed[0], placed[1])).min() > 0.01
    # One hand has the middle, the left one too.
    for hand in HANDS:
        alone = open_scene("laptop", name, solid=False, level=2, hand=hand)
        assert abs(alone.hands[0].ticks.position[:, 0]).max() < 1e-12


@pytest.mark.soak
def test_hands_that_meet_beside_parts_are_shown_apart(tmp_path: Path) -> None:
    motions, ticks = two_handed_motions("close"), slice(1800)
    right, left = (
        open_scene("laptop", motion, solid=False, level=2, hand=hand) for motion, hand in zip(motions, HANDS)
    )
    scene = replace(right, hands=(right.hands[0], left.hands[0]))
    places = [hand.ticks.position for hand in scene.hands]
    way = 0.8 * (places[0].mean(axis=0) - places[1].mean(axis=0))
    moved = moved_hand(scene, 1, position=places[1] + way).first(ticks.stop)
    done = replay_two_hands(moved, SolverOptions(surface="mesh"), tmp_path / "both.h5")
    assert done.haptic_distance < -5e-3 and done.graphic_distance >= 0.0 and done.keeps_apart
    results = list(load_result(done.path).hands.values())
    assert all(result.summary["penetration_max"] == 0.0 for result in results)
    found = verify(results[0], every=100)
    assert found.passed, [(claim.name, claim.worst, claim.tick) for claim in found.claims if claim.failed]
    assert "hands apart" in {claim.name for claim in found.claims if claim.verdict == "holds"}
    assert run_again(results[1]).identical
