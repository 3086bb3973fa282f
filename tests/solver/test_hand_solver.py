"""What the solver promises whatever input, budget and threads: no penetration, the same bytes, no jump in a snap."""

import math
import signal
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from conftest import sampled
from file_faults import at
from hypothesis import given
from hypothesis import strategies as st
from planted_faults import failing, planted
from sphere_scenes import CURL, UNTIMED, bumpy_ball, engine_of, object_tree, random_targets, record_clearance

import hhsim.solver.workspace
from cli.replay import command as replay
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.parallel.thread_team import NUMBER_SHIFT, TICKET
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.force import ease_forces
from hhsim.kernels.tick.state import (
    STATUS_INPUT_INVALID,
    STATUS_LAG,
    STATUS_SNAP,
    STATUS_START_INSIDE,
    STATUS_STUCK,
    WORK_CANDIDATES,
    tick_state_dtype,
)
from hhsim.kernels.tick.step import snap_step
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import result_ticks
from hhsim.motion.analytic_motion import still
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene, open_scene
from hhsim.solver.options import UNBOUNDED, SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.solver.workspace import tick_options, tick_record
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.verify import verify

pytestmark = pytest.mark.slow

RIGHT = HandModel.default("right")
LEFT = HandModel.default("left")
METHODS = ("coupled", "progressive")
DEEPEST = 1e-6
"""Depth by brute force that is rounding [m]."""
TREES = {leaves: bumpy_ball(leaves) for leaves in (300, 1200, 4000)}


def assert_same_bytes(one: TickRecord, other: TickRecord) -> None:
    for name in UNTIMED:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def joined(blocks: Sequence[TickRecord]) -> TickRecord:
    return TickRecord(*(np.concatenate(values) for values in zip(*blocks)))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("leaves", "seed", "sweep"),
    sampled(
        [(300, 0, False), (300, 1, True), (1200, 2, False), (1200, 3, True), (4000, 4, False), (4000, 5, True)],
        lambda place, case: place == 1,
    ),
)
def test_random_hands_never_penetrate(method: str, leaves: int, seed: int, sweep: bool) -> None:
    hand = LEFT if seed % 3 == 0 else RIGHT
    tree = TREES[leaves]
    solver = HandSolver(hand, tree.arrays(), SolverOptions(method=method))
    record = solver.run(*random_targets(hand, 2400, seed, sweep=sweep))
    for name in UNTIMED:
        assert np.isfinite(getattr(record, name)).all(), name
    np.testing.assert_allclose(np.linalg.norm(record.orientation, axis=1), 1.0, atol=1e-12)
    assert (record.flexion >= hand.flexion_min - 1e-9).all()
    assert (record.flexion <= hand.flexion_max + 1e-9).all()
    shown = HandConfiguration.of(record)
    for tick in range(0, len(record.position), 97):
        np.testing.assert_allclose(record.joints[tick], hand.joints(*shown.at(tick)), atol=1e-12)
    clearance = record_clearance(hand, tree, record)
    assert clearance.min() >= -DEEPEST
    touching = clearance.min(axis=1) < 1e-5
    assert touching.mean() > 0.3, "the scene hardly provokes"
    stuck = record.status & STATUS_STUCK > 0
    assert stuck.mean() < 0.01


@pytest.mark.parametrize(
    ("method", "force"),
    [("coupled", "kkt"), ("progressive", "kkt"), ("paper", "paper"), ("paper", "kkt"), ("penalty", "kkt")],
)
def test_the_same_input_gives_the_same_bytes_in_blocks_of_any_size(method: str, force: str) -> None:
    tree, options = TREES[300].arrays(), SolverOptions(method=method, force=force)
    motion = random_targets(RIGHT, 540, 3, sweep=True)
    whole, again = (HandSolver(RIGHT, tree, options).run(*motion) for _ in range(2))
    assert_same_bytes(whole, again)
    for size in (1, 7, 512):
        solver = HandSolver(RIGHT, tree, options)
        assert_same_bytes(joined([solver.run(*motion.part(k, k + size)) for k in range(0, 540, size)]), whole)
    solver, record = HandSolver(RIGHT, tree, options), tick_record(540)
    assert solver.begin(HapticBlock(*motion)) == 0 and solver.tick(HapticBlock(*motion), record) == whole.status[-1]
    assert_same_bytes(record, whole)


def test_frozen_input_comes_to_rest() -> None:
    # The figure: the force's variation falls below 1e-6 within 20 ticks of a frozen input.
    goal = still([0.0, -0.045, 0.052], flexion=CURL)
    start = still([0.0, -0.045, 0.15])
    for method in METHODS:
        for leaves in (300, 4000):
            solver = HandSolver(RIGHT, TREES[leaves].arrays(), SolverOptions(method=method))
            solver.run(*start.line(goal, 299))
            record = solver.run(*goal.hold(59))
            size = np.linalg.norm(record.total, axis=1)
            assert size[-1] > 1.0
            assert (np.abs(np.diff(size))[20:] / size[-1] < 1e-6).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_forces_never_exceed_what_the_coupling_can_pull(method: str, seed: int) -> None:
    tree = bumpy_ball(1200)
    options = SolverOptions(method=method)
    motion = random_targets(RIGHT, 2400, seed)
    record = HandSolver(RIGHT, tree.arrays(), options).run(*motion)
    assert (record.status & STATUS_LAG > 0).any(), "the scene hardly provokes"
    # Each joint's torque acts on contacts that are at least a sixth of a phalanx away from it, or on several at once.
    palm = np.linalg.norm(record.palm_wrench[:, :3], axis=1) + np.linalg.norm(record.palm_wrench[:, 3:], axis=1) / 0.02
    torque = options.stiffness.flexion * np.abs(motion[2] - record.flexion).sum(axis=(1, 2))
    assert (np.linalg.norm(record.total, axis=1) <= palm + torque / 0.005).all()


@pytest.mark.parametrize("method", METHODS)
def test_lag_is_no_farther_than_the_users_hand(method: str) -> None:
    tree = bumpy_ball(300)
    motion = random_targets(RIGHT, 1200, 4)
    record = HandSolver(RIGHT, tree.arrays(), SolverOptions(method=method)).run(*motion)
    haptic = np.array([RIGHT.joints(*motion.at(t)) for t in range(1200)])
    far = np.linalg.norm(haptic - record.joints, axis=3).max(axis=(1, 2))
    lagging = record.status & (STATUS_LAG | STATUS_STUCK) > 0
    assert lagging.any()
    assert (record.lag[lagging] > 0.0).all()
    assert (record.lag[lagging] <= far[lagging] + 1e-9).all()
    # A hand that snaps has a way left, too.
    snaps = record.status & STATUS_SNAP > 0
    assert (record.lag[~lagging & ~snaps] == 0.0).all()
    assert (record.lag[snaps] <= far[snaps] + 1e-9).all()


@pytest.mark.parametrize("value", [math.nan, 1e7])
def test_a_hand_waits_for_its_first_sound_sample_where_that_is(value: float) -> None:
    tree = bumpy_ball(300)
    motion = still(np.array([0.0, 0.0, 0.3]), ticks=6)
    motion[0][:2] = value
    record = HandSolver(RIGHT, tree.arrays(), SolverOptions()).run(*motion)
    assert (record.status[:2] & STATUS_INPUT_INVALID > 0).all()
    assert not (record.status & STATUS_START_INSIDE).any()
    np.testing.assert_allclose(record.position, np.tile([0.0, 0.0, 0.3], (6, 1)), atol=1e-12)
    assert record_clearance(RIGHT, tree, record).min() > 0.0


@pytest.mark.parametrize(
    ("method", "limits"),
    sampled(
        [
            (method, limits)
            for limits in ({"budget": 5000}, {"budget": 20000}, {"linearisations": 1}, {"linearisations": 3})
            for method in METHODS
        ],
        lambda place, case: case == ("progressive", {"budget": 5000}),
    ),
)
def test_any_budget_gets_there_in_the_end(method: str, limits: dict[str, int]) -> None:
    # Small budgets end a tick in the middle of what it tries; begun anew as it began, the next would end there too.
    tree = bumpy_ball(300)
    hold = 2000
    motion = random_targets(RIGHT, 4 * hold, 4, hold=hold)
    record = HandSolver(RIGHT, tree.arrays(), SolverOptions(method=method, **limits)).run(*motion)  # type: ignore[arg-type]
    assert record_clearance(RIGHT, tree, record).min() >= 0.0
    # Each target is held for longer than the way to it takes.
    arrived = record.status & (STATUS_STUCK | STATUS_LAG) == 0
    nowhere = np.concatenate([[False], (np.diff(record.joints, axis=0) == 0.0).all(axis=(1, 2, 3))]) & ~arrived
    assert not arrived.all(), "the budget is no hindrance"
    longest = max(map(len, "".join("x" if s else " " for s in nowhere).split()), default=0)
    assert longest <= 5
    # What was not given the time to find a step is on its way, and no tick is stuck for it.
    assert "budget" not in limits or not (record.status & STATUS_STUCK).any()
    assert arrived[hold - 1 :: hold].all()


def helpers() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith(hhsim.solver.workspace.HELPER)]


def posted(solver: HandSolver) -> int:
    """How many tasks the thread team of a solver has been given."""
    return int(solver.workspace.states[0].thread_team.word[TICKET]) >> NUMBER_SHIFT


def run(tree: SphereTree, motion: HandConfiguration, threads: int = 1) -> tuple[TickRecord, int]:
    """A motion in two blocks, and how many tasks were posted."""
    solver = HandSolver(RIGHT, tree.arrays(), SolverOptions(method="progressive", threads=threads))
    half = len(motion.position) // 2
    return joined([solver.run(*motion.part(0, half)), solver.run(*motion.part(half))]), posted(solver)


@pytest.mark.parametrize(
    ("name", "script"),
    sampled(
        [(name, script) for name in ("cup", "bunny") for script in ("grasp", "whole-hand", "slide")],
        lambda place, case: case in (("cup", "grasp"), ("bunny", "whole-hand")),
    ),
)
def test_any_number_of_threads_gives_the_same_bytes(name: str, script: str) -> None:
    scene = make_scene(load_object(name).mesh, object_tree(name, 4), RIGHT, load_script(script), rate=500.0)
    motion = HandConfiguration.of(scene.hands[0].ticks)
    alone, _ = run(scene.solids[0].placed_tree, motion)
    assert alone.work[:, WORK_CANDIDATES].max() > 40
    for threads in (2, 3):
        shared, tasks = run(scene.solids[0].placed_tree, motion, threads)
        assert_same_bytes(alone, shared)
        assert tasks > 100
    assert helpers() == []


def test_no_helper_outlives_an_interrupt() -> None:
    solver = HandSolver(RIGHT, bumpy_ball(300).arrays(), SolverOptions(method="progressive", threads=3))
    solver.run(*random_targets(RIGHT, 2, seed=0))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        engine = engine_of(solver)
        with pytest.raises(KeyboardInterrupt), engine.thread_team.at_work(engine.method):
            assert len(helpers()) == 2
            signal.raise_signal(signal.SIGINT)
            time.sleep(60.0)
    finally:
        signal.signal(signal.SIGINT, before)
    assert helpers() == []
    assert solver.workspace.states[0].thread_team.members == 1


SNAP_STEP = 1.5e-4
"""Largest step of a snap in a tick of 1 ms [m]."""


@pytest.fixture(scope="module")
def grasp(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A grasp of the teapot: fingers slip over its edges, and the palm with them by 2 mm."""
    out = tmp_path_factory.mktemp("snap") / "teapot.h5"
    replay_scene(open_scene("teapot", "grasp"), SolverOptions(), out)
    return load_result(out)


def test_a_hand_that_snaps_makes_no_jump(grasp: Result) -> None:
    run = result_ticks(grasp)
    assert run_figure("snap_ticks", run) > 10, "the scene hardly provokes"
    # A step from inside the object may go a little farther.
    assert run_figure("posture_jump_max", run) <= 1.3 * SNAP_STEP
    assert run_figure("force_contact_step_share", run) < 7.0
    assert run_figure("penetration_max", run) == 0.0
    assert run_figure("lag_ticks", run) == run_figure("stuck_ticks", run) == 0


def test_without_a_bound_it_jumps_and_ends_in_the_same_place(grasp: Result, tmp_path: Path) -> None:
    out = tmp_path / "free.h5"
    replay_scene(open_scene("teapot", "grasp"), SolverOptions(snap_speed=UNBOUNDED), out)
    free = load_result(out)
    assert run_figure("posture_jump_max", result_ticks(free)) > 10.0 * SNAP_STEP
    assert run_figure("snap_ticks", result_ticks(free)) == 0
    hold = result_ticks(grasp).holds[0]
    apart = np.asarray(grasp["graphic/joints"])[hold] - np.asarray(free["graphic/joints"])[hold]
    assert np.linalg.norm(apart[-1], axis=-1).max() < 1e-5


def test_forces_of_a_snap_follow_the_coupling(grasp: Result) -> None:
    snaps = np.asarray(grasp["status"]) & STATUS_SNAP > 0
    # In its last tick a snap has arrived.
    on_the_way = snaps & np.append(snaps[1:], False)
    assert on_the_way.sum() > 10
    total, wrench = (np.asarray(grasp[f"force/{name}"]) for name in ("total", "palm_wrench"))
    np.testing.assert_array_equal(total[on_the_way], wrench[on_the_way, :3])


@pytest.mark.soak
def test_the_referee_finds_nothing_in_snaps(grasp: Result, lift: Result) -> None:
    assert verify(grasp).passed
    assert not [claim for claim in verify(lift).claims if claim.failed]


@pytest.mark.soak
def test_a_tick_that_snaps_without_a_reason_is_found(grasp: Result, tmp_path: Path) -> None:
    said = at("said", "hands/right/tick/status", result_ticks(grasp).holds[0].stop - 1, lambda _: STATUS_SNAP)
    assert failing(verify(planted(grasp.path, tmp_path, said))) == {"second run"}


@pytest.fixture(scope="module", params=["0", *(pytest.param(seed, marks=pytest.mark.soak) for seed in "12345")])
def lift(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A cup that a trembling hand lifts: fingertips slip off its rim, and unbounded the hand by 14.5 mm in a tick."""
    out = tmp_path_factory.mktemp("lift") / "cup.h5"
    words = ["cup", "lift", "--free", "--tremor", "0.2,0.3", "--seed", request.param, "--out", str(out), "--quiet"]
    replay(words, standalone_mode=False)
    return load_result(out)


def test_beside_a_free_body_damping_keeps_the_bound(lift: Result) -> None:
    run = result_ticks(lift)
    assert run_figure("snap_ticks", run) > 10, "the scene hardly provokes"
    assert run_figure("posture_jump_max", run) <= 2.0 * SNAP_STEP
    assert run_figure("penetration_max", run) == 0.0


@pytest.mark.soak
def test_a_force_that_no_damping_explains_is_found(lift: Result, tmp_path: Path) -> None:
    tick = int(np.flatnonzero(np.asarray(lift["status"]) == STATUS_SNAP)[0])
    haptic = at("moved", "hands/right/tick/haptic/position", tick, lambda place: place + 1e-3)
    assert "second run" in failing(verify(planted(lift.path, tmp_path, haptic)))


def test_a_slower_loop_lets_the_hand_go_farther_in_a_tick() -> None:
    assert tick_options(SolverOptions().at_rate(200.0)).snap_step == pytest.approx(5.0 * SNAP_STEP)


def test_only_a_method_that_seeks_the_nearest_pose_is_bounded() -> None:
    assert tick_options(SolverOptions(method="progressive")).snap_step == np.inf


@pytest.mark.parametrize(("ticks", "times"), [(0, 1.0), (16, 1.25), (32, 1.8), (96, 1.8), (128, 2.8), (160, 5.8)])
def test_a_snap_grows_to_less_than_a_jump_and_ends(ticks: int, times: float) -> None:
    progress = np.zeros(1, tick_state_dtype()).view(np.recarray)[0].progress
    progress.snapped = ticks
    assert snap_step(tick_options(SolverOptions()), progress) == pytest.approx(times * SNAP_STEP)


@given(st.integers(0, 2**32 - 1))
def test_each_force_goes_towards_its_own_as_far_as_the_hand_may_go(seed: int) -> None:
    random = np.random.default_rng(seed)
    state = np.zeros(1, tick_state_dtype()).view(np.recarray)[0]
    state.stiffness[:] = 1000.0
    state.progress.bound = most = random.exponential(1e-3)
    before, own = random.normal(size=(5, 3, 3)), random.normal(size=(5, 3, 3))
    state.forces.before[:], state.forces.phalanx[:] = before, own
    ease_forces(state)
    # Of each finger.
    way = np.linalg.norm((own - before).sum(axis=1), axis=1)[:, None, None]
    share = np.minimum(1.0, 1000.0 * most / way)
    np.testing.assert_allclose(state.forces.phalanx, before + share * (own - before), atol=1e-12)
    assert state.progress.snaps == (share < 1.0).any()
