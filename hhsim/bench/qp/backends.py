"""Every installed QP solver on the same programs; what can be built once is built beforehand and not timed.

All get the same conditioned program, which is exact to undo: minimise ½ |y|² subject to a_i · y >= r_i with rows of
length 1, y = (x - x₀) / L, L the largest violation at x₀ (the program's size where nothing is violated there). The
Hessian is the identity, the solution of the order of 1, and a tolerance means the same to each. Solvers that take the
Hessian's factor get it. The fast ones, whose solve takes no longer than a call from Python, are called by their native
interface; the others as qpsolvers does, and timed by the time that it measures around their own call.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.bench.qp.program import Program
from hhsim.solver.qp import ACTIVE_SET, BACKEND_OPTIONS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

DUAL_ACTIVE_SET_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Answer:
    """What a backend answered.

    Attributes:
        found: Whether it claims a solution.
        x: Shape (n,) [√J]; NaN where it claims none.
        multiplier: Of each row as given, shape (m,); NaN where it claims none.
        call: Time of the native call as Python sees it [ns].
        own: Time that the solver itself reports [ns]; None where it reports none.
    """

    found: bool
    x: FloatArray
    multiplier: FloatArray
    call: int
    own: float | None


@dataclass(frozen=True)
class Conditioned:
    """The program that backends get.

    Attributes:
        matrix: Rows of length 1, shape (m, n); zero rows stay.
        least: r, shape (m,).
        length: L [√J].
        norm: Lengths of the rows as given; 1 for a zero row.
        target: x₀ [√J].
        guess: Rows expected to be active.
    """

    matrix: FloatArray
    least: FloatArray
    length: float
    norm: FloatArray
    target: FloatArray
    guess: IntArray

    @property
    def variables(self) -> int:
        """N."""
        return self.target.size

    @property
    def rows(self) -> int:
        """M."""
        return self.least.size


def condition(program: Program) -> Conditioned:
    """Shift, normalise and scale a program."""
    matrix = program.matrix
    norm = np.linalg.norm(matrix, axis=1)
    norm[norm == 0.0] = 1.0
    matrix = matrix / norm[:, None]
    least = program.rhs / norm - matrix @ program.target
    length = float(least.max(initial=0.0))
    # Where nothing is violated but by rounding, that would be no unit.
    length = length if length > 1e-9 * program.size else program.size
    return Conditioned(matrix, least / length, length, norm, program.target, program.guess)


class PreparedCall:
    """One program, ready for one backend.

    `run` does what a solve needs and returns what the solver gave back; `reset`, which is not timed, undoes what the
    last run left behind; `read` gives (y, multipliers of the normalised rows, the solver's own seconds), y None
    where it claims no solution.
    """

    def __init__(
        self,
        run: Callable[[], Any],
        read: Callable[[Any], tuple[FloatArray | None, FloatArray | None, float | None]],
        reset: Callable[[], None] = lambda: None,
    ) -> None:
        """Keep the three."""
        self.run, self.read, self.reset = run, read, reset

    def solve(self, problem: Conditioned) -> Answer:
        """Solve once, timed."""
        nothing = np.full(problem.variables, np.nan), np.full(problem.rows, np.nan)
        self.reset()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            began = time.perf_counter_ns()
            try:
                raw = self.run()
                call = time.perf_counter_ns() - began
                y, z, seconds = self.read(raw)
            except Exception:  # whatever a foreign solver raises is its answer
                return Answer(False, *nothing, time.perf_counter_ns() - began, None)
        own = None if seconds is None else 1e9 * seconds
        if y is None or z is None:
            return Answer(False, *nothing, call, own)
        x = problem.target + problem.length * np.asarray(y, dtype=np.float64)
        multiplier = np.maximum(np.asarray(z, dtype=np.float64), 0.0) * problem.length / problem.norm
        return Answer(True, x, multiplier, call, own)


def prepare(backend: str, problem: Conditioned, *, warm: bool = False) -> PreparedCall:
    """Build what a backend needs for a program; `warm`: hand over the guess, where the backend takes one (daqp)."""
    if backend == "daqp":
        return _daqp(problem, warm)
    native = _NATIVE.get(backend)
    return _by_qpsolvers(backend, problem) if native is None else native(problem)


def overhead(backend: str, repeats: int = 200) -> float:
    """Median time [ns] of the same call for one row in one variable that nothing violates: hardly more than the call.

    Taken off the call of a backend that reports no time of its own: it counts what little it solves there in the
    backend's favour.
    """
    trivial = Conditioned(np.ones((1, 1)), -np.ones(1), 1.0, np.ones(1), np.zeros(1), np.zeros(0, dtype=np.int64))
    call = prepare(backend, trivial)
    return float(np.median([call.solve(trivial).call for _ in range(repeats)]))


def other_backends() -> list[str]:
    """Installed ones besides our own."""
    from hhsim.solver.qp import available_backends

    return [name for name in available_backends() if name != ACTIVE_SET]


def _daqp(problem: Conditioned, warm: bool) -> PreparedCall:
    import daqp

    eye, zero = np.eye(problem.variables), np.zeros(problem.variables)
    rows, most, least = -problem.matrix, -problem.least, np.full(problem.rows, -1e30)
    start = np.zeros(problem.rows, dtype=np.int32)
    if warm:
        start[problem.guess] = 1
    sense = start.copy()

    def read(raw: Any) -> tuple[FloatArray | None, FloatArray | None, float | None]:
        y, _, flag, information = raw
        seconds = information["solve_time"] + information["setup_time"]
        return (y if flag > 0 else None), information["lam"], seconds

    def reset() -> None:
        sense[:] = start

    return PreparedCall(
        lambda: daqp.solve(eye, zero, rows, most, least, sense, primal_tol=DUAL_ACTIVE_SET_TOLERANCE), read, reset
    )


def _quadprog(problem: Conditioned) -> PreparedCall:
    import quadprog

    eye, zero, columns = np.eye(problem.variables), np.zeros(problem.variables), problem.matrix.T.copy()
    return PreparedCall(
        lambda: quadprog.solve_qp(eye, zero, columns, problem.least, 0, True), lambda raw: (raw[0], raw[4], None)
    )


def _pyqpmad(problem: Conditioned) -> PreparedCall:
    import pyqpmad

    n, m = problem.variables, problem.rows
    eye, zero = np.asfortranarray(np.eye(n)), np.zeros(n)
    rows, most = np.asfortranarray(problem.matrix), np.full(m, np.inf)
    factor, y = eye.copy(order="F"), np.zeros(n)
    settings = pyqpmad.SolverParameters()
    settings.tolerance = 1e-12
    settings.hessian_type = pyqpmad.HessianType.HESSIAN_INVERTED_CHOLESKY_FACTOR
    solver = pyqpmad.Solver()
    solver.reserve(n, 0, m)

    def reset() -> None:
        factor[:] = eye
        y[:] = 0.0

    def read(raw: Any) -> tuple[FloatArray | None, FloatArray | None, float | None]:
        dual = solver.get_inequality_dual()
        z = np.zeros(m)
        z[np.asarray(dual.indices)] = dual.dual
        return (y.copy() if raw == pyqpmad.ReturnStatus.OK else None), z, None

    return PreparedCall(
        lambda: solver.solve(y, factor, zero, None, None, rows, problem.least, most, settings), read, reset
    )


def _by_qpsolvers(backend: str, problem: Conditioned) -> PreparedCall:
    import qpsolvers
    from scipy.sparse import csc_matrix

    identity: Any = np.eye(problem.variables)
    rows: Any = -problem.matrix
    if backend not in qpsolvers.dense_solvers:
        identity, rows = csc_matrix(identity), csc_matrix(rows)
    built = qpsolvers.Problem(identity, np.zeros(problem.variables), rows, -problem.least)
    options = BACKEND_OPTIONS.get(backend, {})

    def read(raw: Any) -> tuple[FloatArray | None, FloatArray | None, float | None]:
        return (raw.x if raw.found else None), raw.z, raw.solve_time

    return PreparedCall(lambda: qpsolvers.solve_problem(built, backend, **options), read)


_NATIVE: dict[str, Callable[[Conditioned], PreparedCall]] = {"pyqpmad": _pyqpmad, "quadprog": _quadprog}
