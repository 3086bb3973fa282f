"""Other QP solvers behind the same tick: the same graphic hand."""

import numpy as np
import pytest
from sphere_scenes import CURL, bumpy_ball, record_clearance

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID
from hhsim.motion.analytic_motion import still
from hhsim.solver import qp
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

HAND = HandModel.default("right")
BALL = bumpy_ball(150)
BACKENDS = ("quadprog", "clarabel")
SAME = 1e-6
"""Points of two graphic hands closer than this [m] are the same."""


def grasp(ticks: int = 90) -> HandConfiguration:
    """Fingers close around the ball, then hold."""
    opened = still([0.0, -0.045, 0.056], flexion=0.4 * CURL)
    closed = still([0.0, -0.045, 0.054], flexion=CURL)
    return opened.line(closed, ticks - 1).hold(30)


def run(motion: HandConfiguration, qp: str) -> TickRecord:
    return HandSolver(HAND, BALL.arrays(), SolverOptions(qp=qp)).run(*motion)


@pytest.mark.parametrize("backend", BACKENDS)
def test_another_solver_gives_the_same_graphic_hand_over_a_grasp(backend: str) -> None:
    motion = grasp()
    ours, theirs = run(motion, "active-set"), run(motion, backend)
    assert record_clearance(HAND, BALL, theirs).min() >= 0.0
    size = float(np.linalg.norm(ours.total[-1]))
    assert size > 1.0
    apart = np.linalg.norm(ours.joints - theirs.joints, axis=3).max(axis=(1, 2))
    # In the hold, where both have converged; on the way a tick may end one linearisation sooner or later.
    assert apart[-10:].max() < SAME
    assert apart.max() < 20.0 * SAME
    np.testing.assert_allclose(theirs.total[-1], ours.total[-1], atol=2e-3 * size)
    np.testing.assert_allclose(theirs.phalanx[-1], ours.phalanx[-1], atol=2e-2 * size)


def test_bad_input_is_held_here_too() -> None:
    motion = still([0.0, 0.0, 0.3], ticks=4)
    motion.position[2] = np.nan
    record = run(motion, "quadprog")
    np.testing.assert_array_equal(record.status & STATUS_INPUT_INVALID > 0, [False, False, True, False])
    np.testing.assert_array_equal(record.position[2], record.position[1])


def test_what_a_solver_raises_reaches_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise MemoryError("no room for the program")

    monkeypatch.setattr(qp, "solve", fails)
    with pytest.raises(MemoryError, match="no room"):
        run(grasp(), "quadprog")
