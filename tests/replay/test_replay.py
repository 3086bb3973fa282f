"""A replay end to end: what is in the file is what the poses in it say."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from short_grasp import shortened
from sphere_scenes import bumpy_ball, result_clearance

from hhsim.hand.model import HandModel
from hhsim.metrics import metrics
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.result.reader import CHUNK_TICKS, Result, load_result
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, make_scene
from hhsim.solver import scene_solver
from hhsim.solver.hand_solver import WarmUp
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import SceneSolver
from tools.shapes.generators import sphere

HAND = HandModel.default("right")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene(sphere(0.076, 3), bumpy_ball(400), HAND, shortened(load_script("grasp"), 1.1))


@pytest.fixture(scope="module", params=["coupled", "progressive"])
def run(request: pytest.FixtureRequest, scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Any]:
    path = tmp_path_factory.mktemp("replay") / f"{request.param}.h5"
    summary = replay_scene(scene, SolverOptions(method=request.param), path, description={"seed": 0})
    return load_result(path), summary


def test_the_file_is_complete_and_says_what_was_done(run: tuple[Result, ReplaySummary], scene: Scene) -> None:
    result, summary = run
    assert result.complete
    assert summary.path == result.path
    assert result.ticks == summary.ticks == scene.ticks.tick_count > 2 * CHUNK_TICKS
    assert result.phases == scene.ticks.phases
    assert result.scene["solver"]["method"] in ("coupled", "progressive")
    assert result.scene["seed"] == 0
    assert result.scene["motion"] == "grasp"
    assert result.scene["object_spheres"] == 400
    assert result.scene["modelled"]["object_spheres"] == scene.solids[0].placed_tree.leaf_count
    for name in ("position", "orientation", "flexion", "abduction"):
        np.testing.assert_array_equal(result[f"haptic/{name}"], getattr(scene.hands[0].ticks, name))
    np.testing.assert_array_equal(result["time"], scene.ticks.time)
    np.testing.assert_array_equal(result["input_seq"], scene.hands[0].ticks.input_seq)


def test_the_penetration_in_the_file_is_that_of_the_poses_in_it(run: tuple[Result, ReplaySummary]) -> None:
    result, _ = run
    clearance = result_clearance(result)
    assert clearance.min() >= -1e-6
    depth = np.maximum(0.0, -clearance)
    np.testing.assert_allclose(result["penetration_palm"], depth[:, 15], atol=1e-12)
    np.testing.assert_allclose(result["penetration_finger"], depth[:, :15].reshape(-1, 5, 3).max(axis=2), atol=1e-12)
    np.testing.assert_allclose(result["penetration_depth"], depth.max(axis=1), atol=1e-12)
    assert (clearance.min(axis=1) < 1e-5).sum() > 200, "the hand hardly touches"


def test_rates_of_force_are_those_of_the_forces(run: tuple[Result, ReplaySummary]) -> None:
    result, _ = run
    np.testing.assert_array_equal(result["force_variation_rate"], metrics.force_variation_rate(result["force/total"]))
    finger = result["force/phalanx"].sum(axis=2)
    np.testing.assert_array_equal(result["force_variation_finger"], metrics.force_variation_rate(finger))


def test_the_coupled_method_is_its_own_reference(run: tuple[Result, ReplaySummary]) -> None:
    result, summary = run
    excess = summary.attributes()["tracking_excess"]
    if result.scene["solver"]["method"] == "coupled":
        assert abs(excess) < 1e-3
    else:
        assert excess > 0.0


def test_kernels_are_prepared_before_the_first_tick(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    prepare, go = scene_solver.warm_up, SceneSolver.run

    def prepared(*words: Any, **given: Any) -> WarmUp:
        done.append("prepared")
        return prepare(*words, **given)

    def run(solver: SceneSolver, ticks: slice) -> Any:
        done.append("ticks")
        return go(solver, ticks)

    monkeypatch.setattr(scene_solver, "warm_up", prepared)
    monkeypatch.setattr(SceneSolver, "run", run)
    with pytest.raises(KeyboardInterrupt):
        replay_scene(scene, SolverOptions(), tmp_path / "a.h5", progress=stop_at(CHUNK_TICKS))
    assert done == ["prepared", "ticks"]


def stop_at(tick: int) -> Callable[[str, int, int], None]:
    def report(what: str, done: int, total: int) -> None:
        if done >= tick:
            raise KeyboardInterrupt

    return report


def test_an_interrupt_in_the_middle_keeps_the_ticks_so_far(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "stopped.h5"
    with pytest.raises(KeyboardInterrupt) as stopped:
        replay_scene(scene, SolverOptions(), path, progress=stop_at(2 * CHUNK_TICKS))
    assert any("complete = 0" in note for note in stopped.value.__notes__)
    result = load_result(path)
    assert not result.complete
    assert result.ticks == 2 * CHUNK_TICKS
    assert np.isfinite(result["graphic/joints"]).all()
    assert result_clearance(result).min() >= -1e-6


def test_an_interrupt_before_the_first_block_leaves_nothing(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        replay_scene(scene, SolverOptions(), tmp_path / "none.h5", progress=stop_at(0))
    assert list(tmp_path.iterdir()) == []
