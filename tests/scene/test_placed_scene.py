"""A recording's object goes where the hand touches it, where it would touch nothing otherwise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.motion.trajectory import Trajectory
from hhsim.scene.contact_goals import TOUCHING
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.described_scene import Place, PlacedScene, SceneWords, described_scene, least_distance
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

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
