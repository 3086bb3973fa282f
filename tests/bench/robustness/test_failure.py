"""Shrinking: what is left fails, and the file shows the same failure."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from kept_failure import rerun_failure
from sphere_scenes import bumpy_ball

from hhsim.bench.robustness.failure import Trace, failure_of, keep_failure, make_trial, recorded_penetration, shrink
from hhsim.bench.robustness.local_optimality import pieces_of
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_STUCK, WORK_TOUCHING
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

HAND = HandModel.default()
BALL = bumpy_ball(300)
JUMPS = StressOptions(hold=1, bound="none")
PENETRATES = failure_of("penetration", HAND, pieces_of("spheres", None, BALL), SolverOptions())


class SlippingSolver(HandSolver):
    """A planted fault: 5 mm into the object, where the hand touches it with the middle finger curled to the right."""

    def run(self, *haptic: Any) -> TickRecord:
        record = super().run(*haptic)
        position, _, flexion, _ = haptic
        bad = (record.work[:, WORK_TOUCHING] > 0) & (position[:, 0] > 0.02) & (flexion[:, 2, 0] > 0.8)
        record.joints[bad] -= 0.005 * record.position[bad, None, None] / 0.06
        return record


def test_the_start_is_brought_up_to_the_failure() -> None:
    # Without the graphic hand shown before it, all of the way there would be needed.
    def walk(motion: HandConfiguration) -> Trace:
        graphic = motion.copy()
        for tick in range(1, motion.ticks):
            step = motion.position[tick] - graphic.position[tick - 1]
            graphic.position[tick] = graphic.position[tick - 1] + 1e-3 * step / max(1e-3, float(np.linalg.norm(step)))
        return Trace(graphic.position[:, 0] > 0.2, graphic)

    motion = RandomTargets(HAND, 4, JUMPS).take(900)
    motion.position[:, 0] = 0.25
    motion.position[0] = [0.0, 0.0, 0.25]
    failed, graphic = walk(motion)
    end = int(np.argmax(failed)) + 1
    assert end > 200
    shrunk = shrink(motion.part(0, end), graphic.part(0, end), walk)
    assert shrunk is not None and shrunk.motion.ticks == 2


def test_a_stretch_that_needs_its_past_is_started_at_the_hand_shown() -> None:
    solver = SlippingSolver(HAND, BALL.arrays(), SolverOptions())
    motion = RandomTargets(HAND, 1).take(3000)
    record = solver.run(*motion)
    trial = make_trial(HAND, lambda: SlippingSolver(HAND, BALL.arrays(), SolverOptions()), PENETRATES)
    # The stretch begins inside the object, from where a fresh start retreats to another side of it.
    failing = int(np.argmax(trial(motion).failed))
    shown = HandConfiguration.of(record)
    shrunk = shrink(motion.part(failing - 40, failing + 1), shown.part(failing - 40, failing + 1), trial)
    assert shrunk is not None and shrunk.motion.ticks <= 3


def test_a_motion_that_does_not_fail_is_not_shrunk() -> None:
    motion = RandomTargets(HAND, 6, JUMPS).take(200)
    assert shrink(motion, motion, lambda motion: Trace(np.zeros(motion.ticks, bool), motion)) is None


def test_a_planted_fault_shrinks_to_a_file_that_replays_to_the_same_failure(
    tmp_path: Path, run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hhsim.mesh.catalogue import load_object
    from hhsim.trees.cache import cached_sphere_tree
    from hhsim.trees.options import TreeOptions

    cube = load_object("cube")
    tree = cached_sphere_tree(cube.mesh, TreeOptions(level=cube.level))
    options = SolverOptions(method="progressive", margin=1.5e-3, linearisations=9)

    def faulty() -> HandSolver:
        return SlippingSolver(HAND, tree.arrays(), options)

    trial = make_trial(HAND, faulty, PENETRATES)
    motion = RandomTargets(HAND, 3).take(2500)
    failed, graphic = trial(motion)
    end = int(np.argmax(failed)) + 1
    shrunk = shrink(motion.part(0, end), graphic.part(0, end), trial)
    assert shrunk is not None and shrunk.motion.ticks <= 9
    path = tmp_path / "failing.h5"
    command = keep_failure(path, shrunk, "cube", "", options, kind="penetration")
    assert command == (f"hhsim replay cube {path} --method progressive --samples hold --linearisations 9 --margin 1.5")
    again = rerun_failure(path, HAND, tree, faulty)
    np.testing.assert_array_equal(again.failed, shrunk.trace.failed)
    for one, other in zip(again.graphic, shrunk.trace.graphic):
        assert one.tobytes() == other.tobytes()
    assert not rerun_failure(path, HAND, tree).failed.any(), "without the fault there is no failure"
    # The command itself, with the fault and without.
    words = [*command.split()[1:], "--json", "--out"]
    sound = run(*words, "sound.h5")
    assert sound.code == 0
    monkeypatch.setattr("hhsim.solver.scene_solver.HandSolver", SlippingSolver)
    assert run(*words, "faulty.h5").code == 0
    with h5py.File(tmp_path / "sound.h5") as good, h5py.File(tmp_path / "faulty.h5") as bad:
        assert max(good["hands/right/tick/penetration_depth"]) <= 1e-6
        assert bad["hands/right/tick/penetration_depth"][shrunk.tick] > 1e-4
        np.testing.assert_array_equal(bad["hands/right/tick/graphic/position"], shrunk.trace.graphic.position)


def test_every_kind_of_failure_is_seen() -> None:
    motion = RandomTargets(HAND, 0).take(3)
    options = SolverOptions()
    record = HandSolver(HAND, BALL.arrays(), options).run(*motion)
    trial = {
        kind: failure_of(kind, HAND, pieces_of("spheres", None, BALL), options)
        for kind in ("penetration", "not finite", "stuck")
    }
    sound = make_trial(HAND, lambda: HandSolver(HAND, BALL.arrays(), options), trial["penetration"])(motion)
    assert not sound.failed.any()
    depth = recorded_penetration(HAND, BALL.arrays(), record)
    assert not any(fails(motion, record, depth).any() for fails in trial.values())
    depth.depth[:] = [0.0, 2e-6, np.nan]
    np.testing.assert_array_equal(trial["penetration"](motion, record, depth), [False, True, True])
    record.total[1, 2] = np.nan
    np.testing.assert_array_equal(trial["not finite"](motion, record, depth), [False, True, False])
    # Stuck in free space, while the user's hand is elsewhere.
    record.status[2] = STATUS_STUCK
    assert not trial["stuck"](motion, record, depth).any(), "it is where the user has it"
    motion.position[2, 0] += 0.01
    np.testing.assert_array_equal(trial["stuck"](motion, record, depth), [False, False, True])
