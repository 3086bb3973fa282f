"""The referee's claims of files, free objects and hands out of themselves: honest ones hold, planted faults do not."""

import importlib
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import trimesh
from fault_table import of_contact
from file_faults import Fault, at, forge_scene
from free_scenes import free_result
from live_scripted import write_session
from planted_faults import failing, planted, verdict
from short_grasp import result_of, short_grasp, short_result, short_scene, with_motion

from hhsim.errors import InputError, MeshError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.mesh.mesh import LARGEST_NUMBER
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import result_ticks
from hhsim.motion.analytic_motion import still
from hhsim.motion.trajectory import Trajectory
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.verify.claim import FAILS, HOLDS, Claim
from hhsim.verify.file_checks import file_claims
from hhsim.verify.free_motion import FreeMotion
from hhsim.verify.free_object_checks import free_claims, free_hand_claims
from hhsim.verify.kinematics import rotations
from hhsim.verify.tick_data import JudgedTicks
from hhsim.verify.tree_checks import outside_spheres
from hhsim.verify.verify import verify

pytestmark = pytest.mark.slow

TICK = 200
BOTH = "bodies/hexagonal-prism/tick", "hands/right/tick/graphic"


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return free_result(tmp_path_factory.mktemp("free") / "free.h5", "hexagonal-prism")


def claims(result: Result) -> dict[str, Claim]:
    return {claim.name: claim for claim in free_claims(result)}


def complementarity(result: Result, *asked: int) -> Claim:
    """The claim, of these ticks where some are asked for."""
    judge = JudgedTicks(result, np.array(asked) if asked else None)
    return next(claim for claim in free_hand_claims(judge) if claim.name == "complementarity")


def test_an_honest_result_passes(honest: Result) -> None:
    assert honest.body.is_free and len(honest["contact/tick"]) > 1000
    found = {**claims(honest), "complementarity": complementarity(honest)}
    assert not [claim for claim in found.values() if claim.failed or claim.checked == 0]


def test_the_figures_are_those_of_the_contacts_one_by_one(honest: Result) -> None:
    motion, ways = FreeMotion(honest), np.zeros((16, honest.ticks))
    for tick, body, way in zip(motion.tick, motion.touching, motion.slip):
        if body >= 0:
            ways[body, tick] = max(ways[body, tick], way)
    wrench = honest.body["hand_wrench"] + honest.body["table_wrench"]
    expected = {
        "object_raised": (motion.center[1:, 2] - motion.center[1, 2]).max(),
        "object_slip": ways.sum(axis=1).max(),
        "object_momentum": motion.unbalanced(wrench[:, :3]).max(),
        "friction_residual_max": honest.body["friction_residual"][np.unique(motion.tick)].max(),
        **dict.fromkeys(("table_depth_max", "cone_outside"), 0.0),
    }
    assert {name: honest.summary[name] for name in expected} == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert "tracking_excess" not in honest.summary


def test_energy_that_nobody_gave_is_in_its_figure(honest: Result, tmp_path: Path) -> None:
    thrown = at("thrown", "bodies/hexagonal-prism/tick/velocity", TICK, lambda x: (0.0, 0.1, 0.0))
    faster = planted(honest.path, tmp_path, thrown)
    assert run_figure("energy_gained", result_ticks(faster)) == pytest.approx(0.5 * 50.0 * 0.1**2, rel=0.1)


def test_the_weight_counts_among_the_forces(tmp_path: Path) -> None:
    """Of what is heavy and falls freely nothing is borne, and its velocity is rounded all the same."""
    path = tmp_path / "falls.h5"
    words = [
        *("cube", "lift", "--free", "--surface", "mesh", "--mass", "1e9"),
        *("--table", "none", "--ticks", "20", "--quiet", "--out"),
    ]
    assert importlib.import_module("hhsim.cli.replay").command.main([*words, str(path)], standalone_mode=False) == 0
    newton = claims(load_result(path))["Newton"]
    assert newton.verdict == HOLDS and 1e-6 < newton.worst < 1e-6 * 9.81e9
    faster = at("faster", "bodies/cube/tick/velocity", 10, lambda x: x + (0.0, 0.0, 1e-6))
    assert claims(planted(path, tmp_path, faster))["Newton"].failed


@pytest.mark.parametrize(("column", "change"), [("a", lambda x: 18), ("tick", lambda x: x - 1)])
def test_a_contact_of_no_body_or_out_of_order_is_damage(
    honest: Result, tmp_path: Path, column: str, change: Callable[[Any], Any]
) -> None:
    with pytest.raises(InputError, match="a contact of no tick, or of no body"):
        free_claims(planted(honest.path, tmp_path, of_contact("damaged", column, change)))


TURN = 0.017


def test_what_turns_together_stands_off_by_straight_steps(honest: Result, tmp_path: Path) -> None:
    """Hand and object turn about points of their own and the hand goes straight: a finger comes off the object."""
    path, motion = tmp_path / "together.h5", FreeMotion(honest)
    shutil.copy(honest.path, path)
    center, normal = motion.center[TICK + 1], motion.normal[(motion.tick == TICK) & motion.own][0]
    with h5py.File(path, "r+") as file:
        of_object, of_hand = (file[f"{of}/position"] for of in BOTH)
        arm = of_hand[TICK] - center
        # About the axis for which that finger goes farthest off.
        axis = normal - arm / np.linalg.norm(arm)
        turn = TURN * axis / np.linalg.norm(axis)
        of_object[TICK] = center + rotations(quaternion(turn[None]))[0].apply(of_object[TICK] - center)[0]
        of_hand[TICK] += np.cross(turn, arm)
        for turned in (file[f"{of}/orientation"] for of in BOTH):
            turned[TICK] = quaternion_product(quaternion(turn[None]), turned[TICK : TICK + 1])[0]
    bend = 0.5 * TURN**2 * float(np.linalg.norm(arm))
    stands = complementarity(load_result(path), TICK)
    assert (stands.verdict, stands.tick) == (HOLDS, TICK)
    assert 4e-6 < stands.worst < bend < stands.tolerance < bend + 2e-6
    with h5py.File(path, "r+") as file:
        file["hands/right/tick/graphic/position"][TICK] += 1.5 * (stands.tolerance - stands.worst) * normal
    assert complementarity(load_result(path), TICK).failed


LAST = 119
AWAY = np.array([0.0, 0.5, 0.0])


def pinch() -> Trajectory:
    """Thumb and index finger close through each other in the air."""
    flexion = np.zeros((5, 3))
    flexion[0], flexion[1] = (0.1, 0.9, 0.9), (1.2, 1.2, 0.6)
    motion = still(AWAY).line(still(AWAY, flexion=flexion, abduction=[0.5, 0.0, 0.0, 0.0, 0.0]), LAST - 20).hold(20)
    return Trajectory(np.arange(motion.ticks) / 1000.0, *motion, name="pinched air", hand="right")


@pytest.fixture(scope="module")
def pinched(tmp_path_factory: pytest.TempPathFactory) -> Result:
    path = tmp_path_factory.mktemp("honest") / "pinch.h5"
    in_the_air = with_motion(short_scene(short_grasp()), pinch())
    return result_of(in_the_air, path, {"hand_file": None}, self_contact=True, surface="mesh")


def test_a_pinch_in_the_air_holds_in_every_claim(pinched: Result) -> None:
    found = verify(pinched)
    assert failing(found) == set()
    assert verdict(found, "own parts") == verdict(found, "second run") == HOLDS
    # The hand bears on itself, and that is what balances its coupling.
    assert np.linalg.norm(pinched["force/phalanx"][-1], axis=2).max() > 0.1
    assert pinched.summary["self_depth_haptic"] > 5e-3
    assert pinched.summary["self_depth_graphic"] == 0.0


def bent_finger(file: h5py.File) -> None:
    """The index finger of the shown hand bent on into the thumb by 1 mrad, joints and all."""
    flexion = file["hands/right/tick/graphic/flexion"][LAST]
    flexion[1, 0] += 1e-3
    file["hands/right/tick/graphic/flexion"][LAST] = flexion
    shown = HandConfiguration(*(file[f"hands/right/tick/graphic/{name}"][LAST] for name in HandConfiguration._fields))
    file["hands/right/tick/graphic/joints"][LAST] = HandModel.default().joints(*shown)


def pulling_thumb(file: h5py.File) -> None:
    """The thumb is drawn to the finger that it bears on."""
    file["hands/right/tick/force/phalanx"][LAST, 0] *= -1.0


def shallow_user(file: h5py.File) -> None:
    file["summary/right"].attrs["self_depth_haptic"] *= 0.999


FAULTS: dict[Fault, str] = {bent_finger: "own parts", pulling_thumb: "force balance", shallow_user: "second run"}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_planted_fault_is_found(pinched: Result, tmp_path: Path, fault: Fault) -> None:
    assert FAULTS[fault] in failing(verify(planted(pinched.path, tmp_path, fault)))


def test_the_claim_is_of_runs_that_make_it(pinched: Result, tmp_path: Path) -> None:
    in_the_air = with_motion(short_scene(short_grasp()), replace(pinch(), name="through"))
    through = result_of(in_the_air, tmp_path / "through.h5", {"hand_file": None}, surface="mesh")
    assert through.summary["self_depth_graphic"] == through.summary["self_depth_haptic"] > 5e-3
    assert "own parts" not in {claim.name for claim in verify(through).claims}


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


@pytest.mark.parametrize(
    ("name", "of_frames", "shift", "stretch", "verdict"),
    [
        ("as_a_run", False, 3e-3, 1.0, FAILS),
        ("lost_frames", True, 3e-3, 1.0, HOLDS),
        ("frame_before", True, -2e-3, 1.0, FAILS),
        ("frame_twice", True, -1e-3, 1.0, FAILS),
        ("other_rate", True, 0.0, 1.0001, FAILS),
    ],
)
def test_frames_of_a_recording_follow_each_other_at_its_rate_with_the_gaps_that_it_has(
    result: Result, tmp_path: Path, name: str, of_frames: bool, shift: float, stretch: float, verdict: str
) -> None:
    def fault(file: h5py.File) -> None:
        if of_frames:
            forge_scene(file, lambda scene: scene.update(recording="hand.csv"))
        file["tick/time"][100:] += shift
        file["tick/time"][...] *= stretch

    fault.__name__ = name
    claims = {claim.name: claim.verdict for claim in file_claims(planted(result.path, tmp_path, fault))}
    assert claims["time"] == verdict


def test_a_finger_that_is_held_though_a_reason_frees_it_is_a_false_claim(tmp_path: Path) -> None:
    write_session(tmp_path / "session.h5")
    session = load_result(tmp_path / "session.h5")
    held = int(np.flatnonzero((session["live/tick/command_stiffness"] > 0.0).any(axis=1))[0])
    said = at("said", "hands/right/live/tick/safety", held, lambda _: int(Safety.STALE_INPUT))
    for result, fails in ((session, False), (planted(session.path, tmp_path, said), True)):
        (commands,) = (claim for claim in file_claims(result) if claim.name == "commands")
        assert (commands.failed, commands.tick) == (fails, held if fails else None)


HOLD = 180


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
