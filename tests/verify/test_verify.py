"""The referee: honest results pass, a second run finds what is another, and its own geometry has oracles."""

import importlib
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from file_faults import at, attribute, of_scene
from hypothesis import given
from hypothesis import strategies as st
from planted_faults import HOLD, UNMARKED, described_grasp, failing, planted, verdict

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.callee import Kernel
from hhsim.kernels.hand.pose import LARGEST
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.motion.resample import STAMP_TOLERANCE
from hhsim.replay.verdict import verdict as report_verdict
from hhsim.result.reader import Result, load_result
from hhsim.system.progress import silent
from hhsim.verify import file_checks
from hhsim.verify import verify as referee
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim, judged
from hhsim.verify.contacts import RoundCones
from hhsim.verify.depth_checks import has_coal
from hhsim.verify.kinematics import own_hand, pose
from hhsim.verify.second_run import second_run_claim
from hhsim.verify.verify import chosen_ticks, physics, verify
from tools.import_graph import imports_of, library

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return described_grasp(tmp_path_factory.mktemp("honest"))


def test_an_honest_result_holds_in_every_claim(honest: Result) -> None:
    found = verify(honest)
    assert (found.every, found.looked_at, found.looked) == (1, honest.ticks, f"{honest.ticks:,} ticks looked at")
    beyond = set() if has_coal() else {"distance by coal"}
    assert {claim.name for claim in found.claims if claim.verdict != HOLDS} == beyond
    claims = {claim.name: claim for claim in found.claims}
    assert claims["depth"].worst <= 1e-9
    assert claims["kinematics"].checked == honest.ticks
    assert claims["force balance"].checked == honest.ticks and claims["mesh"].checked > 100
    assert claims["distance by coal"].checked > 100 or not has_coal()
    assert all(claim.why for claim in found.claims if claim.verdict == HOLDS and claim.name != "complete")
    assert [claim.group for claim in found.worst] == [*("seal", "second run", "depth", "forces", "joints", "trees")]


def test_a_long_run_is_sampled_and_says_so(honest: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(referee, "LONG", honest.ticks)
    found = verify(honest)
    claims = {claim.name: claim for claim in found.claims}
    assert found.looked.endswith("distance by coal, mesh: 1 in 50 ticks")
    assert found.every == 50 and found.looked_at < 20
    for name in ("depth", "non-penetration", "complementarity", "force balance"):
        assert (claims[name].verdict, claims[name].checked) == (HOLDS, honest.ticks)
    assert claims["mesh"].checked < 20


def test_a_hand_that_leaps_inside_is_asked_of_the_library_whatever_is_sampled(honest: Result, tmp_path: Path) -> None:
    def leaps(file: h5py.File) -> None:
        for name in ("position", "joints"):
            file[f"hands/right/tick/graphic/{name}"][UNMARKED] += (0.0, 0.0, 0.02)

    ticks = chosen_ticks(planted(honest.path, tmp_path, leaps), 1000)
    assert {UNMARKED, UNMARKED + 1} <= set(ticks.tolist())
    assert UNMARKED not in chosen_ticks(honest, 1000)


def test_no_compiled_code_of_the_solver_judges(honest: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(kernel: Kernel, *arguments: object) -> None:
        raise AssertionError(f"the referee calls {kernel.py_func.__qualname__}")

    monkeypatch.setattr(Kernel, "__call__", refused)
    monkeypatch.setattr(Kernel, "entry", refused)
    with pytest.raises(AssertionError, match="quaternion_to_matrix"):
        quaternion_to_matrix(np.array([1.0, 0.0, 0.0, 0.0]), np.empty((3, 3)))
    assert failing(physics(honest, every=HOLD)) == set()


def test_what_the_referee_takes_from_kernels_and_solver_is_no_geometry() -> None:
    """Constants, and shapes of arguments; a second run is of the solver, and says so."""
    taken = {
        imported.inside
        for name, path in library().items()
        if name.startswith("hhsim.verify.") and name != "hhsim.verify.second_run"
        for imported in imports_of(path)
        if imported.name.startswith(("hhsim.kernels", "hhsim.solver"))
    }
    known = {"hand_shape.HandShape", "method.methods_that", "method.EVERYTHING"}
    of_numbers = {name for name in taken if name.rpartition(".")[2].isupper()}
    assert {".".join(name.split(".")[-2:]) for name in taken - of_numbers} <= known
    assert taken, "nothing is read: the test shows nothing"


def test_the_referee_and_the_solver_mean_the_same_hands() -> None:
    """The referee has numbers of its own, so as to share no code; here they are held against the solver's."""
    assert file_checks.LARGEST == LARGEST
    assert file_checks.STAMP == STAMP_TOLERANCE


# Faults that no cheap claim can know of: what the input gives when it is run again.


less_work = at("less_work", "hands/right/tick/work/units", HOLD, lambda x: x // 2)


@pytest.fixture(scope="module")
def named(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A run whose object and motion are in the catalogue."""
    path = tmp_path_factory.mktemp("named") / "touch.h5"
    words = ("cylinder", "touch", "--level", "2", "--rate", "250", "--out", str(path), "--quiet")
    assert importlib.import_module("hhsim.cli.replay").command.main(words, standalone_mode=False) == 0
    return load_result(path)


def run_anew(result: Result) -> Claim:
    return second_run_claim(result, silent)


def test_an_honest_input_gives_the_same_again(named: Result) -> None:
    claim = run_anew(named)
    assert (claim.verdict, claim.worst, claim.note) == (HOLDS, 0.0, "") and claim.checked > 250


def test_on_another_machine_rounding_is_let_pass_and_no_more(named: Result, tmp_path: Path) -> None:
    def elsewhere(off: float, what: str = "machine", **said: str) -> Claim:
        def fault(file: h5py.File) -> None:
            less_work(file)
            file["hands/right/tick/graphic/joints"][HOLD] += off
            file.attrs[what] = json.dumps({**getattr(named, what), **said})

        return run_anew(planted(named.path, tmp_path, fault))

    near = elsewhere(1e-13, cpu="another processor")
    assert near.verdict == HOLDS and "another processor" in near.note
    far = elsewhere(1e-9, cpu="another processor")
    assert far.failed and "graphic/joints differs in 1 rows, first in tick 200" in far.note
    # With other versions nothing tells whether the run was another.
    assert elsewhere(1e-9, "packages", numpy="1.0").verdict == NOT_JUDGED


def test_where_the_object_is_not_to_be_had_the_run_is_of_the_file(tmp_path: Path) -> None:
    mesh, path = tmp_path / "own.stl", tmp_path / "own.h5"
    shutil.copy(Path("examples/mug.stl").resolve(), mesh)
    words = (str(mesh), "grasp", "--unit", "mm", "--level", "1", "--rate", "25", "--out", str(path), "--quiet")
    assert importlib.import_module("hhsim.cli.replay").command.main(words, standalone_mode=False) == 0
    found = run_anew(load_result(path))
    assert found.verdict == HOLDS and found.note == f"with {mesh} as it is now"
    mesh.unlink()
    found = run_anew(load_result(path))
    assert found.verdict == HOLDS and "which nothing else shows" in found.note


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A run whose ticks may make one step."""
    result = described_grasp(tmp_path_factory.mktemp("lagging"), budget=1)
    assert (result["status"] & 2 > 0).sum() > 10, "nothing lags: the test shows nothing"
    return result


def test_a_lag_that_is_left_out_is_found(lagging: Result, tmp_path: Path) -> None:
    def unflagged(file: h5py.File) -> None:
        status = file["hands/right/tick/status"]
        status[...] = status[...] & ~2
        file["hands/right/tick/lag"][...] = 0.0
        file["summary/right"].attrs.update(lag_ticks=0.0, lag_max=0.0)

    def understated(file: h5py.File) -> None:
        file["hands/right/tick/lag"][...] *= 0.5
        file["summary/right"].attrs["lag_max"] *= 0.5

    assert "force balance" in failing(verify(planted(lagging.path, tmp_path, unflagged), every=40))
    assert run_anew(planted(lagging.path, tmp_path, understated)).failed


def test_an_assumed_solid_is_named_with_what_is_outside_of_it(honest: Result, tmp_path: Path) -> None:
    said = "the guarantee is of the assumed solid: 3 % of the surface, up to 0.4 mm, lies outside it"
    repairs = ["turned 1 triangle to face outward", said]
    assumed = of_scene("assumed", lambda scene: scene.update(object_repairs=repairs))
    result = planted(honest.path, tmp_path, assumed)
    mesh = next(claim for claim in verify(result, every=100).claims if claim.name == "mesh")
    assert (mesh.verdict, mesh.note) == (HOLDS, said)
    assert f"T{said[1:]}." in report_verdict(result, ()).sentences


def test_a_depth_set_to_zero_where_the_hand_penetrates_is_found(tmp_path: Path) -> None:
    """Method paper goes in, and says so: its depth is right, until it is set to zero."""
    deep = described_grasp(tmp_path, level=3, method="paper")
    assert deep["penetration_depth"].max() > 1e-8
    found = verify(deep, every=10)
    assert failing(found) == set()
    assert verdict(found, "depth") == HOLDS
    assert verdict(found, "non-penetration") == NOT_CLAIMED
    assert found.sphere_penetration == pytest.approx(deep["penetration_depth"].max(), rel=1e-6)
    assert "µm" in next(claim.note for claim in found.claims if claim.name == "non-penetration")

    def zeroed(file: h5py.File) -> None:
        for name in ("depth", "palm", "finger"):
            file[f"hands/right/tick/penetration_{name}"][...] = 0.0
        file["summary/right"].attrs["penetration_max"] = 0.0

    assert failing(verify(planted(deep.path, tmp_path, zeroed), every=40)) == {"depth", "second run"}


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"method": "progressive"}, marks=pytest.mark.soak),  # as that of the cup below
        {"force": "paper"},
        {"method": "penalty"},
        {"fingers": ("thumb", "index")},
        {"budget": 1},
        {"side": "left"},
    ],
    ids=str,
)
@pytest.mark.quick("{'method': 'penalty'}", "{'budget': 1}")
def test_other_options_hold_too(tmp_path: Path, options: dict[str, Any]) -> None:
    result = described_grasp(tmp_path, **options)
    found = verify(result, every=20)
    assert failing(found) == set()
    if "budget" in options:
        assert (result["status"] & 2).any(), "nothing lags: the test shows nothing"
    if options.get("method") == "penalty":
        assert verdict(found, "forces") == NOT_JUDGED


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 0.3), st.floats(0.01, 0.4), st.floats(0.01, 0.4))
def test_no_place_on_the_axis_is_nearer(seed: int, length: float, first: float, last: float) -> None:
    """Also where the ball at one end holds that at the other."""
    rng = np.random.default_rng(seed)
    a, way = rng.normal(size=(2, 3))
    axis, count = length * way / np.linalg.norm(way), 20
    points = a + rng.normal(size=(count, 3)) * rng.uniform(0.01, 1.0)
    ends = np.tile(a, (count, 1)), np.tile(a + axis, (count, 1))
    place, radius = RoundCones(*ends, np.full(count, first), np.full(count, last)).nearest_balls(points)
    share = np.linspace(0.0, 1.0, 1001)
    balls = np.linalg.norm(a + share[:, None] * axis - points[:, None], axis=2) - (first + share * (last - first))
    found = np.linalg.norm(place - points, axis=1) - radius
    assert np.all(found <= balls.min(axis=1) + 1e-12) and np.all(found >= balls.min(axis=1) - 1e-3 * (length + 0.4))


def test_own_kinematics_are_those_of_the_hand_for_any_angles(honest: Result) -> None:
    rng = np.random.default_rng(3)
    orientation = rng.normal(size=(50, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    at = HandConfiguration(rng.normal(size=(50, 3)), orientation, rng.normal(size=(50, 5, 3)), rng.normal(size=(50, 5)))
    joints = pose(own_hand(honest), at).joints
    hand = HandModel.default()
    expected = np.array([hand.joints(*(values[i] for values in at)) for i in range(50)])
    assert np.abs(joints - expected).max() < 1e-12


def test_a_verdict_counts_what_is_not_a_number_as_wrong() -> None:
    assert judged("a", "b", [0.0, np.nan], 1.0, "m", "w").verdict == FAILS
    assert judged("a", "b", [0.0, 1.0], 1.0, "m", "w").verdict == HOLDS
    found = judged("a", "b", [2.0, 3.0], [1.0, 10.0], "m", "w", ticks=[7, 9])
    assert (found.verdict, found.tick, found.worst) == (FAILS, 7, 2.0)
    assert judged("a", "b", [], 1.0, "m", "w").verdict == NOT_JUDGED


def test_without_coal_all_is_judged_but_its_second_opinion(honest: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "coal", None)
    found = physics(honest, every=HOLD)
    assert found.passed and verdict(found, "mesh") == HOLDS
    (opinion,) = (claim for claim in found.claims if claim.name == "distance by coal")
    assert opinion.verdict == NOT_JUDGED and "pip install 'hhsim[verify]'" in opinion.note


wrong_wrench = at("wrong_wrench", "hands/right/tick/force/palm_wrench", (HOLD, 4), lambda x: x + 1e-3)


def test_the_command_tells_its_verdict_and_exit_code(honest: Result, tmp_path: Path, run: Callable[..., Any]) -> None:
    answer = run("verify", str(honest.path), "--every", "40")
    assert answer.code == 0
    assert "every claim that could be judged holds" in answer.out
    bad = planted(honest.path, tmp_path, wrong_wrench).path
    answer = run("verify", str(bad), "--every", "40", "--json")
    assert answer.code == 1
    document = json.loads(answer.out)
    assert not document["passed"]
    claim = next(claim for claim in document["claims"] if claim["name"] == "palm wrench")
    assert (claim["verdict"], claim["tick"]) == (FAILS, HOLD)
    assert "FALSE: second run, palm wrench" in run("verify", str(bad), "--every", "40").out
    assert run("verify", str(tmp_path / "none.h5")).code == 2
    assert run("verify", str(bad), "--quiet") == (1, "", "")


def test_a_run_that_was_stopped_is_judged_by_its_ticks(honest: Result, tmp_path: Path) -> None:
    stopped = attribute("stopped", "/", "complete", lambda complete: 0)
    assert failing(verify(planted(honest.path, tmp_path, stopped), every=40)) == {"complete"}

    def without_figures(file: h5py.File) -> None:
        stopped(file)
        for group in ("summary", "summary/right"):
            for name in list(file[group].attrs):
                del file[group].attrs[name]

    found = verify(planted(honest.path, tmp_path, without_figures), every=40)
    assert failing(found) == set()
    assert verdict(found, "complete") == NOT_CLAIMED
