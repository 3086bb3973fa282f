"""Scores of scenes of all kinds: what hhsim itself shows comes back as it was, and a wrong body is measured."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sampled import sampled

from hhsim.hand.configuration import HandConfiguration
from hhsim.motion.trajectory import ObjectMotion
from hhsim.replay.replay import Replay
from hhsim.result.reader import load_result
from hhsim.scene.described_scene import FreeWords, SceneWords, load_words
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import SceneSolver
from hhsim.submissions.pose_file import Submission, format_poses, read_submission
from hhsim.submissions.scene_file import free_bodies, scene_digest, worded_scene
from hhsim.submissions.scene_folder import example_submission, write_scene_folder
from hhsim.submissions.score import scene_of, score
from hhsim.submissions.suspicions import BODY_DEPTH, UNEXPLAINED

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
    with SceneSolver(scene, SolverOptions()) as solver:
        # A submission is in the frame of the scene, and bodies are where their meshes were written.
        begun = {body.name: body.position for body in solver.scene.solids}
        run = Replay(solver)
        with run.writer(path, ()):
            run.go(lambda *_: None)
            run.finish()
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
    assert shown is not None
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
def test_the_motion_of_a_free_body_is_held_to_its_mass_and_forces(kind: str, tmp_path: Path) -> None:
    scene = made(kind)
    own = replayed(scene, tmp_path / "own.h5")
    found = score(own, scene, tmp_path / "score.h5")
    result, again = load_result(tmp_path / "own.h5"), load_result(tmp_path / "score.h5")
    for side in result.hands:
        first, second = (one.hands[side]["penetration_depth"] for one in (result, again))
        np.testing.assert_allclose(second, first, rtol=0.0, atol=1e-9)
    assert not found.suspicions and found.bodies[BODY_DEPTH] < 1e-6
    weight = 0.1 * 9.81
    assert found.bodies[UNEXPLAINED] < 0.02 * weight

    weak = score(replace_forces(own, 0.5), scene, tmp_path / "weak.h5")
    assert weak.bodies[UNEXPLAINED] > 0.2 * weight
    ((name, poses),) = own.bodies.items()
    sunk = ObjectMotion(
        poses.position - np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, 5e-2], len(own.time)), poses.orientation
    )
    low = score(replace(own, bodies={name: sunk}), scene, tmp_path / "low.h5")
    assert low.bodies[BODY_DEPTH] > 1e-3
    far = ObjectMotion(1e3 * poses.position + [1.0, 0.0, 0.0], poses.orientation)
    assert any(
        "object begins 1e+03 mm" in text
        for text in score(replace(own, bodies={name: far}), scene, tmp_path / "far.h5").suspicions
    )


def replace_forces(own: Submission, by: float) -> Submission:
    left = None if own.left is None else replace_forces(own.left, by)
    assert own.phalanx_force is not None and own.palm_force is not None
    return replace(own, phalanx_force=by * own.phalanx_force, palm_force=by * own.palm_force, left=left)
