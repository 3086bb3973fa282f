"""One problem, many solvers: all installed backends agree on contact problems, and show the same graphic hand."""

import numpy as np
import pytest
from sphere_scenes import CURL, bumpy_ball, record_clearance

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.motion.analytic_motion import still
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import QpProblem, available_backends, solve
from hhsim.solver.solver import HandSolver

RELIABLE = ("active-set", "clarabel", "daqp", "quadprog")
"""What the project installs; others that happen to be there may give up, but must say so."""
STIFFNESS = np.array([1000.0] * 3 + [5.0] * 3 + [0.5] * 15)
HAND = HandModel.default("right")
BALL = bumpy_ball(150)
SAME = 1e-6
"""Points of two graphic hands closer than this [m] are the same."""


def energy(problem: QpProblem, solution: FloatArray) -> float:
    """The coupling's energy [J] of a step δ, shape (n,)."""
    offset = solution - problem.target
    return 0.5 * float(offset @ (problem.stiffness * offset))


def contact_problem(rng: np.random.Generator, n: int, m: int) -> QpProblem:
    """Contacts of a hand that was commanded a few millimetres deep: unit normals, levers of 5 cm, many rows alike."""
    matrix = rng.normal(size=(m, n))
    patch = rng.integers(0, max(1, m // 4), size=m)
    matrix[:, :3] = matrix[patch, :3] + 0.05 * rng.normal(size=(m, 3))
    matrix[:, :3] /= np.linalg.norm(matrix[:, :3], axis=1)[:, None]
    matrix[:, 3:] *= 0.05
    inside = 1e-3 * rng.normal(size=n)
    rhs = matrix @ inside - rng.exponential(3e-4, size=m)
    command = inside + rng.normal(size=n) * np.where(np.arange(n) < 3, 5e-3, 5e-2)
    return QpProblem(STIFFNESS[:n], matrix, rhs, command)


@pytest.mark.parametrize(("n", "m"), [(3, 20), (6, 60), (21, 100), (21, 250)])
@pytest.mark.parametrize("backend", available_backends())
def test_backends_agree_on_contact_problems(backend: str, n: int, m: int) -> None:
    rng = np.random.default_rng(n + m)
    for _ in range(10):
        problem = contact_problem(rng, n, m)
        ours = solve(problem)
        theirs = solve(problem, backend)
        if theirs.status != "optimal" and backend not in RELIABLE:
            assert theirs.message
            continue
        assert theirs.status == "optimal", theirs.message
        assert theirs.message == ""
        assert problem.kkt_residual(ours.x, ours.multiplier) < 1e-13
        assert problem.kkt_residual(theirs.x, theirs.multiplier) < 1e-6
        assert (problem.matrix @ theirs.x - problem.rhs).min() > -1e-9
        assert theirs.multiplier.min() >= 0.0
        assert energy(problem, theirs.x) == pytest.approx(energy(problem, ours.x), rel=1e-7)
        np.testing.assert_allclose(theirs.x, ours.x, atol=1e-6)
        # Rows of one patch share their load in many ways; the force they sum to is unique.
        np.testing.assert_allclose(
            problem.matrix.T @ theirs.multiplier, problem.stiffness * (theirs.x - problem.target), atol=1e-4
        )


@pytest.mark.parametrize("backend", available_backends())
def test_of_contradicting_rows_there_is_no_solution(backend: str) -> None:
    problem = contact_problem(np.random.default_rng(3), 6, 20)
    problem.matrix[1] = -problem.matrix[0]
    problem.rhs[:2] = 1e-3
    solution = solve(problem, backend)
    assert solution.status == "failed" and solution.message
    np.testing.assert_array_equal(solution.x, problem.target)
    assert not solution.multiplier.any()


@pytest.mark.parametrize("backend", available_backends())
@pytest.mark.parametrize("place", ["matrix", "rhs", "target"])
def test_nan_fails_without_raising(backend: str, place: str) -> None:
    problem = contact_problem(np.random.default_rng(0), 6, 10)
    getattr(problem, place)[2] = np.nan
    solution = solve(problem, backend)
    assert solution.status == "failed"
    assert "NaN" in solution.message


def test_a_backend_that_raises_is_a_failure_with_its_words(monkeypatch: pytest.MonkeyPatch) -> None:
    import qpsolvers

    def explode(*_: object, **__: object) -> None:
        raise RuntimeError("out of cheese")

    monkeypatch.setattr(qpsolvers, "solve_problem", explode)
    solution = solve(contact_problem(np.random.default_rng(0), 6, 10), "clarabel")
    assert solution.status == "failed"
    assert solution.message == "RuntimeError: out of cheese"


def grasp() -> HandConfiguration:
    """Fingers close around the ball, then hold."""
    opened = still([0.0, -0.045, 0.056], flexion=0.4 * CURL)
    closed = still([0.0, -0.045, 0.054], flexion=CURL)
    return opened.line(closed, 89).hold(30)


def run(motion: HandConfiguration, qp: str) -> TickRecord:
    return HandSolver(HAND, BALL.arrays(), SolverOptions(qp=qp)).run(*motion)


@pytest.mark.parametrize("backend", ["quadprog", "clarabel"])
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


def test_what_a_solver_raises_reaches_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise MemoryError("no room for the program")

    monkeypatch.setattr("hhsim.solver.qp.solve", fails)
    with pytest.raises(MemoryError, match="no room"):
        run(grasp(), "quadprog")
