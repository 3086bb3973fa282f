"""What a file says of itself: times, meshes that stick out, figures that differ, and hands that are nowhere."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh
from file_faults import Fault, at, forge_scene
from live_session import write_session
from planted_faults import planted
from short_grasp import short_result

from hhsim.errors import MeshError
from hhsim.mesh.mesh import LARGEST_NUMBER
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.verify.claim import FAILS, HOLDS
from hhsim.verify.file_checks import file_claims
from hhsim.verify.kinematics import rotations
from hhsim.verify.tree_checks import outside_spheres
from hhsim.verify.verify import verify

BOX = trimesh.creation.box((0.2, 0.2, 0.2))


def test_the_corners_of_a_box_stick_out_of_the_ball_within() -> None:
    gap = outside_spheres(np.array(BOX.vertices), np.array(BOX.faces), np.zeros((1, 3)), np.array([0.1]))
    assert gap.max() == pytest.approx(0.1 * (np.sqrt(3.0) - 1.0), abs=1e-12)
    assert gap.min() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("far", [1e300, 2.0 * LARGEST_NUMBER])
def test_a_vertex_that_no_number_reaches_sticks_out(far: float) -> None:
    vertices = np.array(BOX.vertices)
    vertices[3, 1] = far
    gap = outside_spheres(vertices, np.array(BOX.faces), np.zeros((1, 3)), np.array([0.1]))
    assert gap.max() == np.inf


def test_triangles_of_vertices_that_are_not_there_are_no_mesh() -> None:
    with pytest.raises(MeshError, match="name a vertex that does not exist"):
        outside_spheres(np.array(BOX.vertices), np.array([[0, 1, 2**46]]), np.zeros((1, 3)), np.array([0.1]))


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("replay") / "short.h5")


def time_verdict(result: Result) -> str:
    return next(claim.verdict for claim in file_claims(result) if claim.name == "time")


@pytest.mark.parametrize(
    ("name", "of_frames", "shift", "verdict"),
    [
        ("as_a_run", False, 3e-3, FAILS),
        ("lost_frames", True, 3e-3, HOLDS),
        ("frame_before", True, -2e-3, FAILS),
        ("frame_twice", True, -1e-3, FAILS),
    ],
)
def test_frames_of_a_recording_follow_each_other_with_the_gaps_that_it_has(
    result: Result, tmp_path: Path, name: str, of_frames: bool, shift: float, verdict: str
) -> None:
    def fault(file: h5py.File) -> None:
        if of_frames:
            forge_scene(file, lambda scene: scene.update(recording="hand.csv"))
        file["tick/time"][100:] += shift

    fault.__name__ = name
    assert time_verdict(planted(result.path, tmp_path, fault)) == verdict


def test_frames_have_the_rate_that_the_file_says(result: Result, tmp_path: Path) -> None:
    def stretched(file: h5py.File) -> None:
        forge_scene(file, lambda scene: scene.update(recording="hand.csv"))
        file["tick/time"][...] *= 1.0001

    assert time_verdict(planted(result.path, tmp_path, stretched)) == FAILS


def test_a_finger_that_is_held_though_a_reason_frees_it_is_a_false_claim(tmp_path: Path) -> None:
    write_session(tmp_path / "session.h5")
    session = load_result(tmp_path / "session.h5")
    held = int(np.flatnonzero((session["live/tick/command_stiffness"] > 0.0).any(axis=1))[0])
    said = at("said", "hands/right/live/tick/safety", held, lambda _: int(Safety.STALE_INPUT))
    for result, fails in ((session, False), (planted(session.path, tmp_path, said), True)):
        (commands,) = (claim for claim in file_claims(result) if claim.name == "commands")
        assert (commands.failed, commands.tick) == (fails, held if fails else None)


HOLD = 180
"""A tick of the hold."""


@pytest.mark.parametrize(
    "plant",
    [
        at("no_orientation", "hands/right/tick/graphic/orientation", HOLD, lambda x: 0.0),
        at("no_number", "hands/right/tick/graphic/orientation", HOLD, lambda x: np.nan),
        at("no_angle", "hands/right/tick/graphic/flexion", (HOLD, 1, 1), lambda x: np.nan),
    ],
    ids=lambda plant: plant.__name__,
)
@pytest.mark.quick("no_number")
def test_a_hand_that_is_nowhere_is_a_false_claim(result: Result, plant: Fault, tmp_path: Path) -> None:
    found = verify(planted(result.path, tmp_path, plant), every=20)
    false = {claim.name: claim.tick for claim in found.claims if claim.failed}
    assert false.get("kinematics") == HOLD
    assert "second run" in false


def test_a_quaternion_whose_length_is_no_number_is_no_rotation() -> None:
    quaternions = np.array([[0.0] * 4, [1e200, 0, 0, 0], [np.inf, 0, 0, 0], [np.nan] * 4, [1e-300] * 4, [2.0, 0, 0, 0]])
    found, none = rotations(quaternions)
    assert none.tolist() == [True] * 5 + [False]
    assert np.array_equal((found * found.inv()).as_quat(), np.tile([0.0, 0.0, 0.0, 1.0], (6, 1)))
