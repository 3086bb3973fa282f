"""Scores: a method has the same errors as a class and as the file of its poses; scenes are found and held."""

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from conftest import sampled
from short_grasp import moved_hand, short_grasp, short_scene

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import Side
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.motion.trajectory import ObjectMotion
from hhsim.replay.replay import Replay, replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.described_scene import FreeWords, SceneWords, load_words
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import SceneSolver
from hhsim.submissions.pose_file import Submission, format_poses, read_submission
from hhsim.submissions.scene_folder import (
    example_submission,
    free_bodies,
    scene_digest,
    worded_scene,
    write_scene_folder,
)
from hhsim.submissions.score import BODY_DEPTH, MESH_DEPTH, OFF_BEST_MAX, scene_of, score
from hhsim.verify.verify import verify

CLASS = "project_out:ProjectOut"


@pytest.fixture(scope="module")
def scene() -> Scene:
    # The hand's way is long enough for some ticks to be free.
    return short_scene(short_grasp(hold=0.12), "cylinder")


@pytest.fixture(scope="module")
def as_class(scene: Scene, repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Result:
    patch = pytest.MonkeyPatch()
    patch.syspath_prepend(str(repository / "examples"))
    path = tmp_path_factory.mktemp("class") / "class.h5"
    replay_scene(scene, SolverOptions(method=CLASS), path)
    patch.undo()
    return load_result(path)


def poses_of(result: Result, scene: Scene, *, forces: bool = True) -> Submission:
    """What the result's method would have sent."""
    total, phalanx = result["force/total"], result["force/phalanx"]
    return Submission(
        method="project out",
        scene=scene_digest(scene),
        time=scene.ticks.time,
        poses=HandConfiguration(*(np.array(result[f"graphic/{name}"]) for name in HandConfiguration._fields)),
        phalanx_force=np.array(phalanx) if forces else None,
        palm_force=total - phalanx.sum(axis=(1, 2)) if forces else None,
        duration=1e-9 * result["duration/total"] if forces else None,
    )


@pytest.mark.soak
def test_a_class_and_the_file_of_its_poses_have_the_same_errors(scene: Scene, as_class: Result, tmp_path: Path) -> None:
    (tmp_path / "poses.csv").write_text(format_poses(poses_of(as_class, scene)))
    found = score(read_submission(tmp_path / "poses.csv"), scene, tmp_path / "result.h5")
    result = load_result(tmp_path / "result.h5")
    assert found.suspicions == ()
    times = {"tick_cpu_p50", "tick_cpu_p99", "tick_cpu_max", "tick_wall_p50", "tick_wall_over_1ms"}
    # The hold again, by a hand that trembles, is of a method that can be run again, and its work of one that counts it.
    only_a_class = {name for name in as_class.summary if "tremor" in name} | {"work_mean"}
    shared = set(as_class.summary) & set(result.summary)
    assert set(as_class.summary) - shared == only_a_class
    assert set(result.summary) - shared == {"force_variation_hold_std"}
    for name in shared:
        value = result.summary[name]
        if name not in times:
            assert value == pytest.approx(as_class.summary[name], rel=1e-12, abs=1e-12, nan_ok=True), name
    assert result.summary["penetration_max"] > 0.0 and result.summary["force_contact_max"] > 0.0
    columns = ("graphic/joints", "penetration_depth", "contacts/touching", "force/total", "force_variation_rate")
    for name in columns:
        np.testing.assert_allclose(result[name], as_class[name], rtol=0.0, atol=1e-12)
    # Its times are those that it says, to the nanosecond.
    np.testing.assert_array_equal(result["duration/total"], as_class["duration/total"])


def test_what_is_not_given_has_no_row_and_no_claim_is_false(scene: Scene, as_class: Result, tmp_path: Path) -> None:
    found = score(poses_of(as_class, scene, forces=False), scene, tmp_path / "r.h5")
    result = load_result(tmp_path / "r.h5")
    assert not any(name.startswith(("force", "tick_")) for name in result.summary)
    assert not result.gives("forces") and not result.gives("times") and not result.gives("runs")
    assert result.summary["penetration_max"] == as_class.summary["penetration_max"]
    labels = [row.name for row in found.hands["right"].rows]
    assert labels[:3] == ["penetration_max", "mesh_depth_max", "contact_error_max"]
    assert {"off_best_mean", "off_best_max"} < set(labels)
    assert result.scene["submission"]["suspicions"] == []
    assert not [claim.name for claim in verify(result, every=60).claims if claim.failed]


@pytest.mark.soak
def test_the_best_hand_is_off_itself_by_nothing_and_the_users_by_what_it_is_pushed(
    scene: Scene, tmp_path: Path
) -> None:
    """The truth beside the figure: `coupled` on the triangles is near the optimum, the user's own hand is inside."""
    options = SolverOptions(surface="mesh")
    replay_scene(scene, options, tmp_path / "best.h5")
    best = load_result(tmp_path / "best.h5")
    near = score(poses_of(best, scene, forces=False), scene, tmp_path / "near.h5", surface="mesh").hands["right"].errors
    user = score(example_submission(scene), scene, tmp_path / "user.h5").hands["right"].errors
    assert near[MESH_DEPTH] == 0.0 and near[OFF_BEST_MAX] < 1e-4
    deepest = load_result(tmp_path / "user.h5").summary["penetration_max"]
    # The spheres cover the mesh.
    assert 0.0 < user[MESH_DEPTH] <= deepest
    assert user[OFF_BEST_MAX] > user[MESH_DEPTH] > 0.005


def test_a_scene_comes_back_by_its_words_bit_for_bit(tmp_path: Path) -> None:
    words = SceneWords(object="cylinder", trajectory="touch", level=2, place_object="recorded")
    scene = worded_scene(load_words(words))
    digest = write_scene_folder(scene, tmp_path / "s")
    again = scene_of(read_submission(tmp_path / "s" / "example-submission.csv"))
    assert scene_digest(again) == digest == scene_digest(scene)
    assert again.ticks.phases == scene.ticks.phases and again.ticks.rate == scene.ticks.rate
    for name in HandConfiguration._fields:
        np.testing.assert_array_equal(getattr(again.hands[0].ticks, name), getattr(scene.hands[0].ticks, name))
    np.testing.assert_array_equal(again.solids[0].placed_mesh.vertices, scene.solids[0].placed_mesh.vertices)
    np.testing.assert_array_equal(again.solids[0].placed_tree.center, scene.solids[0].placed_tree.center)
    with pytest.raises(HhsimError, match="is not empty"):
        write_scene_folder(scene, tmp_path / "s")


def _turned_and_moved(scene: Scene) -> Scene:
    """The scene with its object away from the world's origin, 1.5 times as large."""
    turn, place = rotation_matrix(np.array([0.8, 0.6, 0.0, 0.0])), np.array([0.3, -0.2, 0.1])
    (body,) = scene.solids
    vertices, center = (1.5 * points @ turn.T + place for points in (body.mesh.vertices, body.tree.center))
    tree = replace(body.tree, center=center, radius=1.5 * body.tree.radius, covers=(), errors=())
    return replace(scene, bodies=(replace(body, mesh=replace(body.mesh, vertices=vertices), tree=tree),))


def test_the_model_of_the_scene_has_the_object_where_it_is(scene: Scene, tmp_path: Path) -> None:
    scene, folder = _turned_and_moved(scene), tmp_path / "s"
    write_scene_folder(scene, folder)
    model = Xml.parse(folder / "scene.xml").getroot()
    names = [element.get("file", "") for element in model.iter() if element.get("file")]
    assert names == ["hand.xml", "object.obj"]
    corners = [line.split()[1:] for line in (folder / names[1]).read_text().splitlines() if line.startswith("v ")]
    np.testing.assert_array_equal(np.array(corners, float), scene.solids[0].placed_mesh.vertices)
    (body,) = model.findall("worldbody/body")
    seen, *spheres = body.findall("geom")
    (mesh,) = model.findall("asset/mesh")
    # In the world's frame and in metres: nothing moves, turns or scales it.
    assert (body.attrib, seen.get("mesh"), mesh.get("name")) == ({"name": "object"}, "object", "object")
    assert {"pos", "quat", "euler", "scale", "refpos", "refquat"}.isdisjoint({*seen.attrib, *mesh.attrib})
    numbers = [[*map(float, f"{sphere.get('pos')} {sphere.get('size')}".split())] for sphere in spheres]
    tree = scene.solids[0].placed_tree
    np.testing.assert_array_equal(numbers, np.column_stack([tree.leaf_center, tree.leaf_radius]))
    # Contact bits: of the object's spheres with the hand's geoms alone, of the mesh that is seen with nothing.
    hand = Xml.parse(folder / "hand.xml").find("default/geom")
    assert (hand.get("contype"), hand.get("conaffinity")) == ("1", "0")
    assert {(sphere.get("contype"), sphere.get("conaffinity")) for sphere in spheres} == {("0", "1")}
    assert (seen.get("contype"), seen.get("conaffinity")) == ("0", "0")


def test_the_digest_is_of_mesh_hand_motion_and_rate_and_not_of_the_tree(scene: Scene) -> None:
    grasp = short_grasp(hold=0.12)
    finer = short_scene(grasp, "cylinder", 3)
    other_tree = replace(scene.solids[0], tree=finer.solids[0].tree)
    assert scene_digest(replace(scene, bodies=(other_tree,))) == scene_digest(scene)
    others = short_scene(grasp, "cube"), short_scene(grasp, "cylinder", 2, "left"), moved_hand(scene, 0, rate=500.0)
    assert len({scene_digest(one) for one in (scene, finer, *others)}) == 5


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_hand_as_numbers_and_the_readmes_words_are_the_hand(side: Side, tmp_path: Path) -> None:
    """Forward kinematics from hand.json by what README.md says, with nothing else."""
    scene = short_scene(short_grasp(), "cylinder", 2, side)
    write_scene_folder(scene, tmp_path / "s")
    fingers = json.loads((tmp_path / "s" / "hand.json").read_text())["fingers"]
    minus = "abduction turns u about minus w" in (tmp_path / "s" / "README.md").read_text()
    random = np.random.default_rng(2)
    flexion, abduction = random.uniform(-0.3, 1.5, (5, 3)), random.uniform(-0.3, 0.3, 5)
    found = []
    for finger, bends, spread in zip(fingers.values(), flexion, abduction):
        place, u, w = (np.array(finger[name]) for name in ("base", "distal", "dorsal"))
        turn = _turned(w, -spread if minus else spread)
        u, axis = turn @ u, turn @ np.cross(w, u)
        row = [place]
        for length, bend in zip(finger["length"], bends):
            u = _turned(axis, bend) @ u
            row.append(row[-1] + length * u)
        found.append(row)
    wanted = scene.hands[0].model.joints(np.zeros(3), [1.0, 0.0, 0.0, 0.0], flexion, abduction)
    assert np.abs(np.array(found) - wanted).max() < 1e-12


def _turned(axis: FloatArray, angle: float) -> FloatArray:
    return rotation_matrix(quaternion(angle * axis / np.linalg.norm(axis)))


def test_a_scene_that_cannot_be_made_again_is_said(scene: Scene, tmp_path: Path) -> None:
    for wrong in ({"object": "cat"}, {"object": "cube", "level": "fine"}, {"object": "gone.stl"}):
        of = replace(example_submission(scene), made_by={"trajectory": "touch", **wrong})
        with pytest.raises(InputError, match="cannot be made again: "):
            scene_of(of)
    with pytest.raises(InputError, match="does not say its scene"):
        scene_of(replace(example_submission(scene), made_by={}))
    with pytest.raises(InputError, match="expected that of hhsim scene"):
        scene_of(example_submission(scene), tmp_path / "nowhere")


KINDS = {
    "free": ("cube", "lift", None, FreeWords(mass=0.1)),
    "free, both": ("cube", "lift-both", "both", FreeWords(mass=0.1)),
    "driven, both": ("cube", "carry", "both", None),
    "several": ("blocks", "stack", None, None),
    "joint, driven": ("laptop", "open", None, None),
}


def made(kind: str) -> Scene:
    name, motion, hand, free = KINDS[kind]
    words = SceneWords(
        object=name, trajectory=motion, hand=hand, free=free, level=2, rate=200.0, place_object="recorded"
    )
    return worded_scene(load_words(words))


def replayed(scene: Scene, path: Path) -> Submission:
    """What `coupled` shows, as other software would send it."""
    solver = SceneSolver(scene, SolverOptions())
    # A submission is in the frame of the scene, and bodies are where their meshes were written.
    begun = {body.name: body.position for body in solver.scene.solids}
    Replay(solver).into(path)
    assert all(np.array_equal(begun[body.name], body.position) for body in scene.solids), "a body was raised"
    result, bodies = load_result(path), {}
    for name, body in free_bodies(scene).items():
        stored = result.bodies[body.name] if len(scene.solids) > 1 else result.body
        moved = stored.poses()
        if len(scene.solids) == 1:
            moved = ObjectMotion(*moved).since(body.position, body.orientation)
            moved = ObjectMotion(moved.shift, moved.turn)
        bodies[name] = moved
    shown = None
    for hand, one in reversed([*zip(scene.hands, result.hands.values(), strict=True)]):
        phalanx, total = np.array(one["force/phalanx"]), np.array(one["force/total"])
        poses = HandConfiguration(*(np.array(one[f"graphic/{name}"]) for name in HandConfiguration._fields))
        example = example_submission(scene)
        about = {"made_by": example.made_by, "hand": hand.model.side, "left": shown, "bodies": bodies}
        palm = total - phalanx.sum(axis=(1, 2))
        shown = Submission("own", example.scene, scene.ticks.time, poses, phalanx, palm, **about)
    return shown


@pytest.mark.parametrize("kind", sampled(list(KINDS), lambda _, kind: kind == "free, both"))
def test_a_scene_is_read_and_made_again_as_it_was(kind: str, tmp_path: Path) -> None:
    scene = made(kind)
    digest = write_scene_folder(scene, tmp_path / "s")
    assert digest == scene_digest(scene) == scene_digest(scene_of(example_submission(scene), tmp_path / "s"))
    (tmp_path / "poses.csv").write_text(format_poses(example_submission(scene)))
    read = read_submission(tmp_path / "poses.csv")
    assert len(read.hands) == len(scene.hands) and set(read.bodies) == set(free_bodies(scene))
    for block, values in example_submission(scene).arrays.items():
        np.testing.assert_allclose(read.arrays[block], values, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("kind", sampled(["free", "free, both"], lambda _, kind: kind == "free"))
@pytest.mark.soak
def test_the_place_of_a_free_body_is_measured_and_doubted(kind: str, tmp_path: Path) -> None:
    scene = made(kind)
    own = replayed(scene, tmp_path / "own.h5")
    found = score(own, scene, tmp_path / "score.h5")
    result, again = load_result(tmp_path / "own.h5"), load_result(tmp_path / "score.h5")
    for side in result.hands:
        first, second = (one.hands[side]["penetration_depth"] for one in (result, again))
        np.testing.assert_allclose(second, first, rtol=0.0, atol=1e-9)
    assert not found.suspicions and found.bodies[BODY_DEPTH] < 1e-6
    ((name, poses),) = own.bodies.items()
    way = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, 5e-2], len(own.time))
    sunk = ObjectMotion(poses.position - way, poses.orientation)
    low = score(replace(own, bodies={name: sunk}), scene, tmp_path / "low.h5")
    assert low.bodies[BODY_DEPTH] > 1e-3
    far = ObjectMotion(1e3 * poses.position + [1.0, 0.0, 0.0], poses.orientation)
    doubts = score(replace(own, bodies={name: far}), scene, tmp_path / "far.h5").suspicions
    assert any("object begins 1e+03 mm" in text for text in doubts)
