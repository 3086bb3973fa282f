"""Hands whose contacts give way: the nearest pose jumps, and the shown hand follows it as fast as it may."""

from pathlib import Path

import numpy as np
import pytest
from file_faults import at
from hypothesis import given
from hypothesis import strategies as st
from planted_faults import failing, planted

from cli.replay import command as replay
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.force import ease_forces
from hhsim.kernels.tick.state import STATUS_SNAP, tick_state_dtype
from hhsim.kernels.tick.step import snap_step
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import result_ticks
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import open_scene
from hhsim.solver.options import UNBOUNDED, SolverOptions
from hhsim.solver.workspace import tick_options
from hhsim.verify.verify import verify

pytestmark = pytest.mark.slow

HAND = HandModel.default()
SNAP_STEP = 1.5e-4
"""Way beyond the user's own in a tick of 1 ms by default [m]."""


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


@pytest.fixture(scope="module")
def lift(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A cup that a trembling hand lifts: fingertips slip off its rim, and unbounded the hand by 14.5 mm in a tick."""
    out = tmp_path_factory.mktemp("lift") / "cup.h5"
    replay(["cup", "lift", "--free", "--tremor", "0.2,0.3", "--out", str(out), "--quiet"], standalone_mode=False)
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
    assert tick_options(SolverOptions().at_rate(200.0), HAND).snap_step == pytest.approx(5.0 * SNAP_STEP)


def test_only_a_method_that_seeks_the_nearest_pose_is_bounded() -> None:
    assert tick_options(SolverOptions(method="progressive"), HAND).snap_step == np.inf


@pytest.mark.parametrize(("ticks", "times"), [(0, 1.0), (16, 1.25), (32, 1.8), (96, 1.8), (128, 2.8), (160, 5.8)])
def test_a_snap_grows_to_less_than_a_jump_and_ends(ticks: int, times: float) -> None:
    progress = np.zeros(1, tick_state_dtype()).view(np.recarray)[0].progress
    progress.snapped = ticks
    assert snap_step(tick_options(SolverOptions(), HAND), progress) == pytest.approx(times * SNAP_STEP)


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
