"""Our QP solver and every other installed one on the same programs; preparation is not timed.

All others get the same conditioned program: minimise ½ |y|² subject to a_i · y >= r_i, rows of length 1, y = (x - x₀) /
L, L the largest violation at x₀ (the program's size without one). The Hessian is the identity, the solution of the
order of 1, and a tolerance means the same to each. qpsolvers calls them; daqp is called by itself to take a guess.
"""

import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.bench.qp.program import Program
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, new_work
from hhsim.kernels.qp.standalone import PROGRAM, solve_repeatedly
from hhsim.solver.qp import qpsolvers_call

WARM, WARM_DAQP = "active-set, warm", "daqp, warm"
DAQP_TOLERANCE = 1e-9
QUICK = ("daqp", WARM_DAQP, "pyqpmad", "quadprog")
"""Solvers of microseconds: their native time is that of the call less that of a program of one row, see `overhead`."""


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
        python_share: Python's share of a call of a backend among `QUICK` [ns].
    """
    matrix, norm = program.unit_rows()
    least = program.rhs / norm - matrix @ program.target
    violation = float(least.max(initial=0.0))
    # A violation by rounding would be no unit.
    length = violation if violation > 1e-9 * program.size else program.size
    rows, most = -matrix, -least / length
    if backend == WARM_DAQP:
        solve = _guessed_daqp(rows, most, program.guess)
    else:
        options = {"primal_tol": DAQP_TOLERANCE} if backend == "daqp" else {}
        solve = qpsolvers_call(backend, rows, most, **options)

    def timed() -> Answer:
        found = None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            began = time.perf_counter_ns()
            with suppress(Exception):  # any exception of another solver is its answer
                found = solve()
            call = time.perf_counter_ns() - began
        seconds = None if found is None or backend in QUICK else found.solve_time
        native = max(call - python_share, 0.0) if seconds is None else 1e9 * seconds
        if found is None or not found.found or found.x is None or found.z is None:
            return Answer(None, np.zeros(program.rows), call, native)
        multiplier = np.maximum(np.asarray(found.z, dtype=np.float64), 0.0) * length / norm
        return Answer(program.target + length * np.asarray(found.x, dtype=np.float64), multiplier, call, native)

    return timed


def overhead(backend: str, repeats: int = 200) -> float:
    """Return the median time [ns] of a call with one row in one variable: hardly more than Python's share."""
    none = np.zeros((3, 0), dtype=np.int64)
    trivial = Program("", np.ones((1, 1)), np.zeros((3, 1)), -np.ones(1), none, np.zeros(1), 0.0, 0.0, none[0])
    solve = prepare(backend, trivial)
    return float(np.median([solve().call for _ in range(repeats)]))


def _guessed_daqp(rows: FloatArray, most: FloatArray, guess: IntArray) -> Callable[[], Any]:
    import daqp

    m, n = rows.shape
    start = np.zeros(m, dtype=np.int32)
    start[guess] = 1

    def solve() -> SimpleNamespace:
        # It leaves its active set in the last array.
        arrays = (np.eye(n), np.zeros(n), rows, most, np.full(m, -1e30), start.copy())
        y, _, flag, found = daqp.solve(*arrays, primal_tol=DAQP_TOLERANCE)
        return SimpleNamespace(found=flag > 0, x=y, z=found["lam"])

    return solve
