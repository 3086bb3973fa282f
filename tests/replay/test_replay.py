"""A replay end to end: what is in the file, and only what a scene asks for of fingers, work and tree level."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import sampled
from short_grasp import shortened
from sphere_scenes import bumpy_ball, object_tree, random_targets, record_clearance, result_clearance

from hhsim.errors import InputError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.surface import COUNT_PAIR_TESTS
from hhsim.kernels.tick.state import STATUS_LAG, WORK_BODIES, WORK_LINEARISATIONS, WORK_UNITS
from hhsim.mesh.catalogue import load_object
from hhsim.metrics import metrics
from hhsim.metrics.metrics import penetration
from hhsim.motion.analytic_motion import still
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.result.reader import CHUNK_TICKS, Result, load_result
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, make_scene
from hhsim.solver import solver as solvers
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.solver.solver import HandSolver, SceneSolver, WarmUp
from hhsim.trees.triangle_tree import coarsest_sphere_tree
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
    prepare, go = solvers.warm_up, SceneSolver.solve

    def prepared(*words: Any, **given: Any) -> WarmUp:
        done.append("prepared")
        return prepare(*words, **given)

    def run(solver: SceneSolver, ticks: slice) -> Any:
        done.append("ticks")
        return go(solver, ticks)

    monkeypatch.setattr(solvers, "warm_up", prepared)
    monkeypatch.setattr(SceneSolver, "solve", run)
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


BALL = bumpy_ball(1200)
METHODS = ("coupled", "progressive")


@pytest.mark.parametrize(
    ("method", "fingers"),
    sampled(
        [(method, fingers) for fingers in (("index",), ("thumb", "middle"), ()) for method in METHODS],
        lambda place, _: place in (0, 3, 4),
    ),
)
def test_fingers_that_a_scene_does_not_use_follow_the_users_hand(method: str, fingers: tuple[str, ...]) -> None:
    # The hand comes down on the ball with curled fingers, deeper than it can.
    start, end = (still([0.0, -0.06, height], flexion=0.6) for height in (0.16, 0.02))
    motion = start.line(end, 399)
    options = SolverOptions(method=method, fingers=fingers)
    record = HandSolver(HAND, BALL.arrays(), options).run(*motion)
    clearance = record_clearance(HAND, BALL, record)
    used = options.modelled()
    assert used.sum() == 3 * len(fingers) + 1
    assert clearance[:, used].min() >= 0.0
    assert clearance[:, ~used].min() < -1e-3, "the others go through"
    unused = [f for f, finger in enumerate(FINGERS) if finger not in fingers]
    np.testing.assert_allclose(record.flexion[:, unused], motion.flexion[:, unused], atol=1e-12)
    shown = PlacedHand(record.joints, record.position, record.orientation)
    depth = penetration(BALL.arrays(), hand_shape(HAND), shown, [finger in fingers for finger in FINGERS])
    assert depth.depth.max() == 0.0
    assert np.isnan(depth.finger[:, unused]).all()
    assert not np.isnan(depth.finger[:, [f for f in range(5) if f not in unused]]).any()
    whole = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method)).run(*motion)
    assert record.work[:, COUNT_PAIR_TESTS].sum() < whole.work[:, COUNT_PAIR_TESTS].sum()
    assert record.work[:, WORK_BODIES].max() <= 3 * len(fingers) + 1


@pytest.mark.parametrize("method", sampled(METHODS, lambda place, method: method == "coupled"))
def test_a_budget_ends_the_tick_and_leaves_lag_and_nothing_worse(method: str) -> None:
    motion = random_targets(HAND, 700, 4)
    free = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method, budget=UNLIMITED)).run(*motion)
    assert free.work[:, WORK_UNITS].max() > 200_000
    before = np.inf
    for budget in (100_000, 30_000, 1):
        record = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method, budget=budget)).run(*motion)
        again = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method, budget=budget)).run(*motion)
        np.testing.assert_array_equal(record.joints, again.joints)
        assert record_clearance(HAND, BALL, record).min() >= 0.0
        units = record.work[:, WORK_UNITS]
        # A tick overshoots by the linearisation that it is in.
        assert units.max() < free.work[:, WORK_UNITS].max()
        assert units.sum() < before
        before = units.sum()
        if budget == 1:
            assert record.work[:, WORK_LINEARISATIONS].max() == 1
    assert (record.status & STATUS_LAG > 0).sum() > (free.status & STATUS_LAG > 0).sum()


def test_the_coarsest_level_within_the_budget_is_chosen() -> None:
    mesh = load_object("cube").mesh
    for level in (1, 2, 3):
        bound = object_tree("cube", level).errors[-1].bound
        tree = coarsest_sphere_tree(mesh, 1.001 * bound)
        assert (tree.depth, tree.errors[-1].bound) == (level, bound)
    with pytest.raises(InputError, match="it must be positive and finite"):
        coarsest_sphere_tree(mesh, 0.0)
