"""A scene puts object, tree, hand and motion into one frame; a recording's object goes where the hand closes."""

import ast
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from conftest import Run, sampled
from scipy.spatial.transform import Rotation
from short_grasp import short_grasp_text
from sphere_scenes import brute_pairs, bumpy_ball, object_tree

import hhsim
from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.mesh.catalogue import load_object
from hhsim.motion.analytic_motion import still
from hhsim.motion.trajectory import Trajectory
from hhsim.replay.run_inputs import differences, run_inputs
from hhsim.result.schema import TICK_COLUMNS
from hhsim.scene.contact_goals import TOUCHING
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.described_scene import Place, PlacedScene, SceneWords, described_scene, least_distance
from hhsim.scene.motion_catalogue import load_recorded
from hhsim.scene.recorded_grasp_pose import GraspPlacement, find_grasp, place_at_grasp
from hhsim.scene.scene import make_scene
from hhsim.trees.sphere_tree import SphereTree
from tools.shapes.generators import cube, sphere

HAND = HandModel.default("right")
MESH = sphere(0.076, 2)
TREE = bumpy_ball(200)


def recording(position: FloatArray, orientation: FloatArray) -> Trajectory:
    """Five samples at 100 Hz beside an object at this pose."""
    way = still((0.0, 0.0, 0.3)).line(still((0.0, 0.0, 0.26)), 4)
    place = {"object_position": position, "object_orientation": orientation}
    return Trajectory(np.arange(5) / 100.0, *way, **place, name="five samples")


def test_a_recording_says_where_the_object_is() -> None:
    turn = Rotation.from_rotvec([0.3, -0.5, 0.2])
    shift = np.array([0.1, -0.2, 0.05])
    scene = make_scene(MESH, TREE, HAND, recording(shift, turn.as_quat(scalar_first=True)))
    np.testing.assert_allclose(scene.solids[0].placed_mesh.vertices, turn.apply(MESH.vertices) + shift, atol=1e-12)
    np.testing.assert_array_equal(scene.solids[0].placed_mesh.faces, MESH.faces)
    np.testing.assert_allclose(scene.solids[0].placed_tree.center, turn.apply(TREE.center) + shift, atol=1e-12)
    np.testing.assert_array_equal(scene.solids[0].placed_tree.radius, TREE.radius)
    assert scene.hands[0].trajectory.name == "five samples"


def test_the_names_of_the_package_are_those_of_its_table_and_its_types() -> None:
    source = ast.parse(Path(hhsim.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in source.body if isinstance(node, ast.If))
    typed = {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    # The package that has the function is called for it.
    assert typed == hhsim._PLACES | {"repair": "hhsim.repair.in_memory.repair"}
    assert hhsim.__all__ == sorted(typed)
    assert set(dir(hhsim)) == {*hhsim.__all__, "__version__"}
    for name in hhsim.__all__:
        value = getattr(hhsim, name)
        found = value.__name__ if isinstance(value, ModuleType) else f"{value.__module__}.{value.__name__}"
        assert found == hhsim._PLACES[name] and callable(value)
        assert value.__doc__
    with pytest.raises(AttributeError, match="module 'hhsim' has no attribute 'replayed'"):
        _ = hhsim.replayed


def test_the_package_imports_nothing_until_it_is_asked() -> None:
    code = (
        "import sys, hhsim; dir(hhsim); print(*sorted(sys.modules)); "
        "from hhsim.system import environment; assert environment.__name__ == 'hhsim.system.environment'"
    )
    answer = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    loaded = set(answer.stdout.split())
    assert {name for name in loaded if name.startswith("hhsim")} == {"hhsim"}
    assert loaded.isdisjoint({"numpy", "numba", "h5py", "click"})


def test_a_scene_from_names_is_that_of_the_command_line(run: Run, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    words = ("--level", "2", "--seed", "3", "--rate", "500", "--method", "progressive", "--out", "told.h5", "--quiet")
    assert run("replay", "cube", "short.toml", *words).code == 0
    scene = hhsim.open_scene("cube", tmp_path / "short.toml", level=2, seed=3, rate=500.0)
    summary = hhsim.replay_scene(scene, hhsim.SolverOptions(method="progressive"), str(tmp_path / "own.h5"))
    by_command, own = hhsim.load_result(tmp_path / "told.h5"), hhsim.load_result(str(tmp_path / "own.h5"))
    assert summary.path == own.path and own.complete
    for column in TICK_COLUMNS:
        if not column.name.startswith("duration/"):
            assert np.array_equal(by_command[column.name], own[column.name], equal_nan=column.dtype == "<f8"), (
                column.name
            )
    assert own["contacts/touching"].max() > 0
    assert differences(run_inputs(by_command), run_inputs(own)) == []
    description = {name: by_command.scene[name] for name in own.scene if name not in ("object", "trajectory")}
    assert {name: own.scene[name] for name in description} == description
    assert (own.scene["object"], own.scene["trajectory"]) == ("cube", str(tmp_path / "short.toml"))
    answer = run("replay", "own.h5")
    assert answer.code == 0 and "identical in every tick" in answer.out


def test_a_scene_of_a_mesh_and_a_motion_that_are_loaded(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    mesh = cube()
    motion = hhsim.open_scene(mesh, tmp_path / "short.toml", level=1).hands[0].trajectory
    scene = hhsim.open_scene(mesh, motion, level=1, mode="hold", rate=250.0)
    assert (scene.ticks.rate, scene.ticks.tick_count) == (250.0, 50)
    assert (scene.description["object"], scene.description["trajectory"]) == (mesh.name, motion.name)
    assert scene.description["samples"] == "hold" and scene.solids[0].placed_tree.depth == 1
    assert scene.hands[0].model.side == "right"


def test_the_hand_is_named_by_its_side() -> None:
    left = hhsim.open_scene("cube", "pinch", level=2, hand="left")
    assert left.hands[0].model.side == "left" and "left hand" in repr(left)
    with pytest.raises(UnknownNameError, match="unknown hand 'lft': did you mean left"):
        hhsim.open_scene("cube", "pinch", level=2, hand="lft")  # type: ignore[arg-type]


BALL = load_object("sphere").mesh


def fist(at: float = 0.4) -> Trajectory:
    """Fingers that close, so high over the origin [m], without a way."""
    time = np.arange(0.0, 1.0, 0.05)
    flexion = np.interp(time, [0.0, 0.8], [0.1, 1.0])[:, None, None] * np.ones((1, 5, 3))
    posture = still((0.0, 0.0, at), ticks=len(time))._replace(flexion=flexion)
    return Trajectory(time, *posture, name="fist", source="a made-up glove")


def touches(found: PlacedScene) -> bool:
    return least_distance(found.scene, found.scene.solids[0].placed_tree) < TOUCHING


def imported(at: float) -> Trajectory:
    """The same as `hhsim import` would make it, with flags."""
    return replace(fist(at), flags=np.zeros(20, dtype=np.uint32))


def placed(motion: Trajectory, place: Place | None = None) -> PlacedScene:
    words = SceneWords(object="sphere", trajectory="fist", place_object=place, rate=100.0)
    return described_scene(words, DeclaredBodies.of_mesh(BALL, object_tree("sphere", 2)), [HAND], [motion])


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


def reach_and_close(bend: float = 1.0, fingers: slice = slice(0, 5), stays: bool = False) -> Trajectory:
    """A hand comes 0.3 m in a second, closes for half a second, holds, opens and leaves; 50 samples a second."""
    time = np.arange(0.0, 3.0, 0.02)
    away = 0.0 * time if stays else np.interp(time, [0.0, 1.0, 2.0, 3.0], [0.3, 0.0, 0.0, 0.3])
    close = np.interp(time, [1.0, CLOSED_AT, 1.7, 2.0], [0.0, 1.0, 1.0, 0.0])
    flexion = np.zeros((len(time), 5, 3))
    flexion[:, fingers] = 0.1 + bend * close[:, None, None] * np.array([0.7, 1.0, 0.6])
    flexion[:, 0] *= 0.4
    posture = still((0.4, -0.2, 1.1), quaternion(np.array([0.3, -0.5, 0.9])), ticks=len(time))
    posture.position[:] += away[:, None] * np.array([0.6, 0.0, 0.8])
    return Trajectory(time + 12.0, *posture._replace(flexion=flexion), name="reach", source="made up")


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
    assert find_grasp(replace(motion, flexion=flexion)).sample >= 70


@pytest.mark.parametrize("bend", sampled([0.0, 0.15], lambda _, bend: bend > 0.0))
def test_fingers_that_never_close_fall_back_to_the_deepest_flexion_and_say_so(bend: float) -> None:
    tree = object_tree("sphere", 3)
    placed = place_at_grasp(reach_and_close(bend), HAND, tree)
    assert not placed.grasp.closes and "since no finger closes" in placed.text
    assert placed.to_json()["how"] == "deepest flexion"
    check_by_brute_force(placed, tree)


def test_a_hand_that_is_always_there_begins_inside_and_says_so() -> None:
    motion = reach_and_close(0.0, stays=True)
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
