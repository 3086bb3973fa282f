"""The claims of how hand and object move: by a motion's samples, by the script that the scene names, by figures."""

import importlib
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from cut_scene import cut
from driven_scenes import carried, swing
from file_faults import Fault, at, forge_scene, of_scene
from planted_faults import planted
from recording_samples import smooth_recording
from sampled import first_of_each, sampled
from short_grasp import result_of, short_result, with_motion

from hhsim.motion.trajectory import Trajectory
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import open_scene
from hhsim.verify.again import again_claims
from hhsim.verify.body_checks import body_claims
from hhsim.verify.claim import FAILS, HOLDS, NOT_JUDGED, Claim
from hhsim.verify.file_checks import file_claims
from hhsim.verify.metric_checks import CORRECTION, DEPTH, JUMPS, input_hand_claims, motion_claim
from hhsim.verify.tick_data import JudgedTicks

AIR = 155
"""A tick in which nothing touches, in the middle of a sample of the recording."""


def claims(result: Result) -> dict[str, Claim]:
    found = (*file_claims(result), *body_claims(result), motion_claim(result))
    return {claim.name: claim for claim in found}


def failing(result: Result) -> set[str]:
    return {name for name, claim in claims(result).items() if claim.verdict == FAILS}


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The first two seconds of an object that a script of the catalogue carries."""
    path = tmp_path_factory.mktemp("script") / "carry.h5"
    scene = open_scene("cylinder", "carry", level=2)
    return result_of(scene.first(2000), path, {**scene.description, "hand_file": None, "ticks": 2000})


@pytest.fixture(scope="module", params=sampled(["interpolate", "hold"], lambda _, mode: mode == "interpolate"))
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A recording at 100 Hz, hand and object swung about, far from each other."""
    path, sample = tmp_path_factory.mktemp("recorded") / "swung.h5", smooth_recording(40)
    parts = {name: getattr(sample, name) for name in ("time", "position", "orientation", "flexion", "abduction")}
    motion = Trajectory(**{**parts, "position": parts["position"] + [0.0, 0.0, 1.0]})
    moving = carried(motion, swing(motion.time, 0.5, 2.0))
    scene = with_motion(open_scene("cylinder", "touch", level=2), moving, mode=request.param)
    return result_of(scene, path, {**scene.description, "samples": request.param})


def test_honest_motions_hold(script: Result, recorded: Result) -> None:
    assert script.frame and recorded.frame
    assert failing(script) == failing(recorded) == set()
    assert claims(recorded)["motion"].verdict == HOLDS
    assert claims(recorded)["motion"].checked > 100
    # A script has a sample for every tick: what its hand does is found by a second run alone.
    assert claims(script)["motion"].verdict == NOT_JUDGED


def moved_phases(file: h5py.File) -> None:
    """The grasp begins 40 ticks early, in which nothing is measured by phase."""
    file["phase/first_tick"][1] -= 40
    file["phase/last_tick"][0] -= 40


OF_A_SCRIPT: dict[Fault, str] = {
    of_scene("fixed_object", lambda scene: scene.update(object_pose="fixed")): "carried",
    at("nudged_object", "bodies/cylinder/tick/position", (1800, 1), lambda x: x + 1e-6): "carried",
    at("turned_object", "bodies/cylinder/tick/orientation", 1800, lambda x: x * -1.0): "body poses",
    moved_phases: "phases",
    at("renamed_phase", "phase/name", 1, lambda x: "pinch"): "phases",
    at("shorter_phase", "phase/last_tick", 0, lambda x: x - 1): "phases",
    at("shifted_samples", "hands/right/tick/input_seq", slice(100, None), lambda x: x + 1): "input",
    at("repeated_sample", "hands/right/tick/input_seq", AIR, lambda x: x - 1): "input",
}


@pytest.mark.parametrize("fault", first_of_each(OF_A_SCRIPT), ids=lambda fault: fault.__name__)
def test_what_is_planted_in_a_script_is_found(script: Result, tmp_path: Path, fault: Fault) -> None:
    assert OF_A_SCRIPT[fault] in failing(planted(script.path, tmp_path, fault))


def nudged_together(file: h5py.File) -> None:
    """Both hands by a micrometre, where nothing touches."""
    for name in ("graphic/position", "graphic/joints", "haptic/position"):
        file[f"hands/right/tick/{name}"][AIR] += 1e-6


def turned_user(file: h5py.File) -> None:
    w, x, y, z = file["hands/right/tick/haptic/orientation"][AIR]
    file["hands/right/tick/haptic/orientation"][AIR] = np.array(
        [w - 5e-7 * x, x + 5e-7 * w, y + 5e-7 * z, z - 5e-7 * y]
    )


def stale_user(file: h5py.File) -> None:
    """A tick has the hand of the tick before."""
    for name in ("position", "orientation", "flexion", "abduction"):
        file[f"hands/right/tick/haptic/{name}"][AIR] = file[f"hands/right/tick/haptic/{name}"][AIR - 12]


def another_number(file: h5py.File) -> None:
    """Samples begin three ticks late."""
    numbers = file["hands/right/tick/input_seq"][...]
    file["hands/right/tick/input_seq"][3:] = numbers[:-3]


OF_A_RECORDING = (
    nudged_together,
    at("nudged_with_nothing", "bodies/cylinder/tick/position", (AIR, 2), lambda x: x + 1e-6),
    at("bent_user_finger", "hands/right/tick/haptic/flexion", (AIR, 3, 1), lambda x: x + 1e-6),
    *(turned_user, stale_user, another_number),
)


@pytest.mark.parametrize("fault", sampled(OF_A_RECORDING, lambda place, _: place < 2), ids=lambda fault: fault.__name__)
def test_what_is_planted_in_a_recording_is_off_its_curve(recorded: Result, tmp_path: Path, fault: Fault) -> None:
    assert "motion" in failing(planted(recorded.path, tmp_path, fault))


def test_phases_of_a_motion_of_ones_own_are_not_judged_and_said_so(script: Result, tmp_path: Path) -> None:
    def own(file: h5py.File) -> None:
        moved_phases(file)
        forge_scene(file, lambda scene: scene.update(trajectory="mine.toml"))

    found = claims(planted(script.path, tmp_path, own))
    assert found["begin of phases"].verdict == NOT_JUDGED and "--again" in found["begin of phases"].note


def test_a_second_run_finds_phases_that_were_moved(script: Result, tmp_path: Path) -> None:
    def motion(result: Result) -> Claim:
        return next(claim for claim in again_claims(result, lambda what, done, total: None) if "motion" in claim.name)

    assert motion(script).verdict == HOLDS
    assert motion(planted(script.path, tmp_path, moved_phases)).failed


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("replay") / "short.h5")


def verdicts(result: Result, **figures: float) -> dict[str, str]:
    changed = replace(result, summary={**result.summary, **figures})
    judge = JudgedTicks(changed, np.arange(0, result.ticks, 10))
    return {claim.name: claim.verdict for claim in input_hand_claims(judge)}


def test_an_honest_file_holds(result: Result) -> None:
    assert result.summary[DEPTH] > 5e-3
    assert verdicts(result) == {"input depth": HOLDS, "correction": HOLDS, "jumps": HOLDS}


@pytest.mark.parametrize("off", [-1e-5, 1e-5, 1e-3, np.inf, np.nan])
def test_a_depth_that_is_another_is_found(result: Result, off: float) -> None:
    assert verdicts(result, **{DEPTH: float(result.summary[DEPTH]) + off})["input depth"] == FAILS


@pytest.mark.soak
def test_beside_moving_parts_the_deepest_part_counts(tmp_path: Path) -> None:
    scene = open_scene("laptop", "close", level=3)
    result = result_of(cut(scene, slice(2050, 2200)), tmp_path / "parts.h5")
    assert len(result.bodies) == 2 and np.ptp(result.bodies["lid"]["joint"]) > 0.05
    assert result.summary[DEPTH] > 1e-3
    assert verdicts(result) == {"input depth": HOLDS, "correction": HOLDS, "jumps": NOT_JUDGED}
    for name, found in ((DEPTH, "input depth"), (CORRECTION[2], "correction")):
        assert verdicts(result, **{name: float(result.summary[name]) + 1e-5})[found] == FAILS


@pytest.mark.parametrize("name", CORRECTION)
def test_a_correction_that_is_another_is_found(result: Result, name: str) -> None:
    found = verdicts(result, **{name: float(result.summary[name]) + 1e-8})
    assert found == {"input depth": HOLDS, "correction": FAILS, "jumps": HOLDS}


@pytest.mark.parametrize("name", JUMPS)
def test_a_jump_that_is_another_is_found(result: Result, name: str) -> None:
    found = verdicts(result, **{name: float(result.summary[name]) + 1e-8})
    assert found == {"input depth": HOLDS, "correction": HOLDS, "jumps": FAILS}


def test_in_a_mesh_the_referee_has_no_depth_of_its_own(result: Result) -> None:
    scene = {**result.scene, "solver": {**result.scene["solver"], "surface": "mesh"}}
    assert verdicts(replace(result, scene=scene))["input depth"] == NOT_JUDGED


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
    assert claims(planted(result.path, tmp_path, fault))["time"].verdict == verdict


def test_frames_have_the_rate_that_the_file_says(result: Result, tmp_path: Path) -> None:
    def stretched(file: h5py.File) -> None:
        forge_scene(file, lambda scene: scene.update(recording="hand.csv"))
        file["tick/time"][...] *= 1.0001

    assert claims(planted(result.path, tmp_path, stretched))["time"].failed


@pytest.mark.parametrize(
    ("thing", "motion"), [("drawer", "shut"), pytest.param("door", "swing", marks=pytest.mark.soak)]
)
def test_the_motion_of_several_things_is_made_once_more(tmp_path: Path, thing: str, motion: str) -> None:
    """Its script finds the place by the name of the scene, which the first thing's mesh does not have."""
    path = tmp_path / "things.h5"
    few = ("--surface", "mesh", "--level", "1", "--rate", "100", "--ticks", "30")
    words = [thing, motion, *few, "--quiet", "--out", str(path)]
    assert importlib.import_module("hhsim.cli.replay").command.main(words, standalone_mode=False) == 0
    found = {claim.name: claim for claim in again_claims(load_result(path), lambda what, done, total: None)}
    assert found["again: motion"].verdict == HOLDS and found["again: motion"].checked == 30
    assert found["again: ticks"].verdict == HOLDS
