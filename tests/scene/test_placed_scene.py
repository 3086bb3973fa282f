"""A recording's object goes where the hand touches it, or where the recorded hand closes."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sampled import sampled
from sphere_scenes import brute_pairs, object_tree

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.mesh.catalogue import load_object
from hhsim.motion.trajectory import Trajectory
from hhsim.scene.contact_goals import TOUCHING
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.described_scene import Place, PlacedScene, SceneWords, described_scene, least_distance
from hhsim.scene.motion_catalogue import load_recorded
from hhsim.scene.recorded_grasp_pose import GraspPlacement, find_grasp, place_at_grasp
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

HAND = HandModel.default()
MESH = load_object("sphere").mesh
TREE = cached_sphere_tree(MESH, TreeOptions(level=2))


def fist(at: float = 0.4) -> Trajectory:
    """Fingers that close, so high over the origin [m], without a way."""
    time = np.arange(0.0, 1.0, 0.05)
    flexion = np.interp(time, [0.0, 0.8], [0.1, 1.0])[:, None, None] * np.ones((1, 5, 3))
    return Trajectory(
        time=time,
        position=np.tile([0.0, 0.0, at], (len(time), 1)),
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1)),
        flexion=flexion,
        abduction=np.zeros((len(time), 5)),
        name="fist",
        source="a made-up glove",
    )


def touches(found: PlacedScene) -> bool:
    return least_distance(found.scene, found.scene.solids[0].placed_tree) < TOUCHING


def imported(at: float) -> Trajectory:
    """The same as `hhsim import` would make it, with flags."""
    return replace(fist(at), flags=np.zeros(20, dtype=np.uint32))


def placed(motion: Trajectory, place: Place | None = None) -> PlacedScene:
    words = SceneWords(object="sphere", trajectory="fist", place_object=place, rate=100.0)
    return described_scene(words, DeclaredBodies.of_mesh(MESH, TREE), [HAND], [motion])


def test_it_is_placed_by_itself_where_nothing_touches() -> None:
    found = placed(fist())
    assert found.by_itself and found.placement is not None
    assert found.note.startswith("as the recording has it, the hand touches nothing, so object placed where ")
    assert touches(found)
    assert found.scene.hands[0].trajectory.source == "a made-up glove"
    document = found.to_json()
    assert document is not None and document["by_itself"] and document["text"] in found.note


@pytest.mark.soak
def test_it_stays_where_it_was_recorded_if_that_was_asked_or_if_the_hand_touches_it() -> None:
    there = placed(fist(), "recorded")
    assert (there.placement, there.note, touches(there)) == (None, "", False)
    touched = placed(fist(0.04))
    assert (touched.placement, touched.note, touches(touched)) == (None, "", True)
    asked = placed(fist(), "auto")
    assert asked.placement is not None and not asked.by_itself


@pytest.mark.soak
def test_it_is_placed_by_itself_where_the_hand_would_begin_inside() -> None:
    found = placed(imported(0.0))
    assert found.by_itself and found.placement is not None and found.placement.start_gap > 0.0
    assert found.note.startswith("as the recording has it, the hand begins inside the object, so object placed where ")
    inside = placed(fist(0.0), "recorded").scene
    assert least_distance(inside, inside.solids[0].placed_tree, limit=0.0, ticks=1) < -0.01
    assert least_distance(found.scene, found.scene.solids[0].placed_tree, limit=0.0, ticks=1) == 0.0
    of_a_session = imported(0.0).placed(np.array([0.0, 0.0, 0.001]), np.array([1.0, 0.0, 0.0, 0.0]))
    assert placed(of_a_session).placement is placed(fist(0.0)).placement is None


def test_where_it_begins_inside_anyway_it_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.scene.described_scene.place_at_grasp", lambda *_: SimpleNamespace(start_gap=-0.001))
    found = placed(imported(0.0))
    assert found.placement is None
    assert "begins inside the object, and no other place was found: the hand would begin inside" in found.note


def test_where_no_place_is_found_it_says_so_and_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise TrajectoryError("no finger meets it")

    monkeypatch.setattr("hhsim.scene.described_scene.place_at_grasp", refuse)
    found = placed(fist())
    assert found.placement is None
    assert found.note.endswith("no other place was found: no finger meets it")
    with pytest.raises(TrajectoryError):
        placed(fist(), "auto")


CLOSED_AT = 1.5


def reach_and_close(bend: float = 1.0, fingers: slice = slice(0, 5), still: bool = False) -> Trajectory:
    """A hand comes 0.3 m in a second, closes for half a second, holds, opens and leaves; 50 samples a second."""
    time = np.arange(0.0, 3.0, 0.02)
    away = 0.0 * time if still else np.interp(time, [0.0, 1.0, 2.0, 3.0], [0.3, 0.0, 0.0, 0.3])
    close = np.interp(time, [1.0, CLOSED_AT, 1.7, 2.0], [0.0, 1.0, 1.0, 0.0])
    flexion = np.zeros((len(time), 5, 3))
    flexion[:, fingers] = 0.1 + bend * close[:, None, None] * np.array([0.7, 1.0, 0.6])
    flexion[:, 0] *= 0.4
    turn = quaternion(np.array([0.3, -0.5, 0.9]))
    return Trajectory(
        time=time + 12.0,
        position=np.array([0.4, -0.2, 1.1]) + away[:, None] * np.array([0.6, 0.0, 0.8]),
        orientation=np.tile(turn, (len(time), 1)),
        flexion=flexion,
        abduction=np.zeros((len(time), 5)),
        name="reach",
        source="made up",
    )


def finger_distances(motion: Trajectory, tree: SphereTree, sample: int) -> FloatArray:
    """Least distance of each finger to all leaves, one by one [m], shape (5,)."""
    there = tree.transformed(rotation_matrix(motion.object_orientation), motion.object_position)
    pairs = brute_pairs(HAND, there.leaf_center, there.leaf_radius, HandConfiguration.of(motion), sample)
    return np.asarray(pairs[:15].reshape(5, -1).min(axis=1))


def check_by_brute_force(placed: GraspPlacement, tree: SphereTree) -> FloatArray:
    """What the placement says of itself holds leaf by leaf; the fingers' distances at the grasp."""
    begin, grasp = (finger_distances(placed.motion, tree, sample) for sample in (0, placed.grasp.sample))
    assert -grasp.min() == pytest.approx(placed.depth, abs=1e-9)
    named = [finger in placed.fingers for finger in ("thumb", "index", "middle", "ring", "little")]
    assert named == (grasp < -0.0005).tolist()
    assert begin.min() >= placed.start_gap - 1e-9
    return grasp


@cache
def placed_at(name: str) -> GraspPlacement:
    """An object where the fingers of the made-up recording close."""
    return place_at_grasp(reach_and_close(), HAND, object_tree(name, 3))


@pytest.mark.parametrize("name", sampled(["sphere", "cup"], lambda _, name: name == "sphere"))
def test_closing_fingers_meet_the_object(name: str) -> None:
    tree, placed = object_tree(name, 3), placed_at(name)
    check_by_brute_force(placed, tree)
    assert placed.grasp.closes and len(placed.fingers) >= 3
    assert 0.002 < placed.depth < 0.025 and placed.start_gap >= 0.002
    assert CLOSED_AT - 0.05 < placed.time < 1.75
    assert placed.motion.source == "made up", "where it comes from is not where it was put"
    assert placed.to_json()["text"] == placed.text
    assert f"close on it at {placed.time:.2f} s" in placed.text
    assert placed.to_json()["position"] == placed.motion.object_position.tolist()


def test_the_fingers_that_close_are_those_that_count() -> None:
    grasp = find_grasp(reach_and_close(fingers=slice(1, 3)))
    assert grasp.fingers == (1, 2) and grasp.closes
    # A faster bend while the palm flies is no grasp.
    motion = reach_and_close()
    flexion = motion.flexion.copy()
    flexion[10:20, 1:] = 1.1 * motion.flexion.max()
    flying = Trajectory(motion.time, motion.position, motion.orientation, flexion, motion.abduction)
    assert find_grasp(flying).sample >= 70


@pytest.mark.parametrize("bend", sampled([0.0, 0.15], lambda _, bend: bend > 0.0))
def test_fingers_that_never_close_fall_back_to_the_deepest_flexion_and_say_so(bend: float) -> None:
    tree = object_tree("sphere", 3)
    placed = place_at_grasp(reach_and_close(bend), HAND, tree)
    assert not placed.grasp.closes and "since no finger closes" in placed.text
    assert placed.to_json()["how"] == "deepest flexion"
    check_by_brute_force(placed, tree)


def test_a_hand_that_is_always_there_begins_inside_and_says_so() -> None:
    motion = reach_and_close(0.0, still=True)
    tree = object_tree("cube", 3)
    placed = place_at_grasp(motion, HAND, tree)
    assert placed.start_gap < 0.0 and "the hand begins in it" in placed.text
    check_by_brute_force(placed, tree)
    one = Trajectory(motion.time[:1], *HandConfiguration.of(motion).part(0, 1))
    assert place_at_grasp(one, HAND, tree).start_gap < 0.0


@pytest.mark.parametrize(
    ("recording", "closes"),
    sampled([("leap_grab", True), ("dapg_door_17", True), ("leap_wave", False)], lambda place, _: place == 0),
)
def test_real_recordings_find_a_place_at_the_cup(shared_data: Path, recording: str, closes: bool) -> None:
    tree = object_tree("cup", 3)
    placed = place_at_grasp(load_recorded(shared_data / "recordings" / f"{recording}.npz"), HAND, tree)
    check_by_brute_force(placed, tree)
    assert placed.grasp.closes == closes and placed.start_gap > 0.0 and len(placed.fingers) >= (3 if closes else 1)
