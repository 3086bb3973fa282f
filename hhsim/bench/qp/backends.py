"""Our QP solver and every other installed one on the same programs; preparation is not timed.

All others get the same conditioned program: minimise ½ |y|² subject to a_i · y >= r_i, rows of length 1, y = (x - x₀) /
L, L the largest violation at x₀ (the program's size without one). The Hessian is the identity, the solution of the
order of 1, and a tolerance means the same to each. The fast solvers are called by their native interface, the others
and their times by qpsolvers.
"""

import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.bench.qp.program import Program
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, new_work
from hhsim.kernels.qp.standalone import PROGRAM, solve_repeatedly
from hhsim.solver.qp import BACKEND_OPTIONS

Solve = Callable[[], tuple[Any, Any, float | None]]
"""Solves a program once: y, None if it claims no solution; multipliers of the rows; the solver's own time [s]."""

WARM, WARM_DAQP = "active-set, warm", "daqp, warm"
DUAL_ACTIVE_SET_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Answer:
    """Answer of a solver.

    Attributes:
        x: Shape (n,) [√J]; None if it claims no solution.
        multiplier: Of each row as given, shape (m,).
        call: Time of the call from Python [ns].
        native: Time of the call without Python's share [ns].
        iterations: Rows added and dropped (ours only).
        certificate: Farkas' y >= 0 for the normalised rows, shape (m,), if ours proves them infeasible.
    """

    x: FloatArray | None
    multiplier: FloatArray
    call: int
    native: float
    iterations: int = 0
    certificate: FloatArray | None = None


class ProgramSolver:
    """Solves programs one after the other by the active set, in one workspace."""

    def __init__(self) -> None:
        self._program: Any = np.zeros(1, PROGRAM).view(np.recarray)[0]
        self._work = new_work(21, 1)

    def solve(self, program: Program, repeats: int = 1) -> Answer:
        """Solve a program from its guess, `repeats` times in one compiled loop, whose median time counts."""
        self._load(program)
        work, duration = self._work, np.zeros(repeats, dtype=np.int64)
        began = time.perf_counter_ns()
        status = int(solve_repeatedly(self._program, duration, work))
        call = time.perf_counter_ns() - began
        count, iterations, blocked = (int(number) for number in work.counts[:3])
        active = np.array(work.active[:count])
        x, values = np.array(work.x[: program.variables]) if status == OPTIMAL else None, np.zeros(program.rows)
        if status == OPTIMAL:
            values[active] = work.multiplier[:count]
        elif status == INFEASIBLE:
            values[active] = np.maximum(-work.dual_step[:count], 0.0)
            values[blocked] = 1.0
        certificate = values if status == INFEASIBLE else None
        return Answer(x, values, call, float(np.median(duration)), iterations, certificate)

    def _load(self, program: Program) -> None:
        record, m, groups = self._program, program.rows, program.groups.shape[1]
        record.common[: len(program.common), :m] = program.common
        record.block[:, :m] = program.block
        record.rhs[:m] = program.rhs
        record.target[: program.variables] = program.target
        for name, values in zip(("group_start", "group_stop", "group_block"), program.groups):
            record[name][:groups] = values
        record.guess[: program.guess.size] = program.guess
        record.guess_count, record.groups = program.guess.size, groups
        record.variables, record.common_columns = program.variables, len(program.common)
        record.tolerance, record.relaxation = program.tolerance, program.relaxation


def prepare(backend: str, program: Program, python_share: float = 0.0) -> Callable[[], Answer]:
    """Return a timed call that solves a program, shifted, normalised and scaled, by a backend.

    Args:
        backend: Its name; `daqp, warm` also gets the guess.
        python_share: Python's share of a call of a backend that reports no time of its own [ns], see `overhead`.
    """
    matrix, norm = program.unit_rows()
    least = program.rhs / norm - matrix @ program.target
    violation = float(least.max(initial=0.0))
    # A violation by rounding would be no unit.
    length = violation if violation > 1e-9 * program.size else program.size
    if backend in ("daqp", WARM_DAQP):
        solve = _daqp(matrix, least / length, program.guess if backend == WARM_DAQP else program.guess[:0])
    elif backend in _NATIVE:
        solve = _NATIVE[backend](matrix, least / length)
    else:
        solve = _by_qpsolvers(backend, matrix, least / length)

    def timed() -> Answer:
        y, z, seconds = None, None, None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            began = time.perf_counter_ns()
            with suppress(Exception):  # any exception of another solver is its answer
                y, z, seconds = solve()
            call = time.perf_counter_ns() - began
        native = max(call - python_share, 0.0) if seconds is None else 1e9 * seconds
        if y is None or z is None:
            return Answer(None, np.zeros(program.rows), call, native)
        multiplier = np.maximum(np.asarray(z, dtype=np.float64), 0.0) * length / norm
        return Answer(program.target + length * np.asarray(y, dtype=np.float64), multiplier, call, native)

    return timed


def overhead(backend: str, repeats: int = 200) -> float:
    """Return the median time [ns] of a call with one row in one variable: hardly more than Python's share."""
    none = np.zeros((3, 0), dtype=np.int64)
    trivial = Program("", np.ones((1, 1)), np.zeros((3, 1)), -np.ones(1), none, np.zeros(1), 0.0, 0.0, none[0])
    solve = prepare(backend, trivial)
    return float(np.median([solve().call for _ in range(repeats)]))


def _daqp(matrix: FloatArray, least: FloatArray, guess: IntArray) -> Solve:
    import daqp

    m, n = matrix.shape
    eye, zero = np.eye(n), np.zeros(n)
    rows, most, lowest = -matrix, -least, np.full(m, -1e30)
    start = np.zeros(m, dtype=np.int32)
    start[guess] = 1

    def solve() -> tuple[Any, Any, float | None]:
        # It leaves its active set in the last array.
        arrays = (eye, zero, rows, most, lowest, start.copy())
        y, _, flag, found = daqp.solve(*arrays, primal_tol=DUAL_ACTIVE_SET_TOLERANCE)
        return (y if flag > 0 else None), found["lam"], found["solve_time"] + found["setup_time"]

    return solve


def _quadprog(matrix: FloatArray, least: FloatArray) -> Solve:
    import quadprog

    eye, zero, columns = np.eye(matrix.shape[1]), np.zeros(matrix.shape[1]), matrix.T.copy()

    def solve() -> tuple[Any, Any, float | None]:
        found = quadprog.solve_qp(eye, zero, columns, least, 0, True)
        return found[0], found[4], None

    return solve


def _pyqpmad(matrix: FloatArray, least: FloatArray) -> Solve:
    import pyqpmad

    m, n = matrix.shape
    eye, zero = np.asfortranarray(np.eye(n)), np.zeros(n)
    rows, most = np.asfortranarray(matrix), np.full(m, np.inf)
    settings = pyqpmad.SolverParameters()
    settings.tolerance = 1e-12
    settings.hessian_type = pyqpmad.HessianType.HESSIAN_INVERTED_CHOLESKY_FACTOR
    solver = pyqpmad.Solver()
    solver.reserve(n, 0, m)

    def solve() -> tuple[Any, Any, float | None]:
        # It works in the Hessian that it is given.
        y, z = np.zeros(n), np.zeros(m)
        status = solver.solve(y, eye.copy(order="F"), zero, None, None, rows, least, most, settings)
        dual = solver.get_inequality_dual()
        z[np.asarray(dual.indices)] = dual.dual
        return (y if status == pyqpmad.ReturnStatus.OK else None), z, None

    return solve


def _by_qpsolvers(backend: str, matrix: FloatArray, least: FloatArray) -> Solve:
    import qpsolvers
    from scipy.sparse import csc_matrix

    identity: Any = np.eye(matrix.shape[1])
    rows: Any = -matrix
    if backend not in qpsolvers.dense_solvers:
        identity, rows = csc_matrix(identity), csc_matrix(rows)
    problem = qpsolvers.Problem(identity, np.zeros(matrix.shape[1]), rows, -least)
    options = BACKEND_OPTIONS.get(backend, {})

    def solve() -> tuple[Any, Any, float | None]:
        found = qpsolvers.solve_problem(problem, backend, **options)
        return (found.x if found.found else None), found.z, found.solve_time

    return solve


_NATIVE: dict[str, Callable[[FloatArray, FloatArray], Solve]] = {"pyqpmad": _pyqpmad, "quadprog": _quadprog}
