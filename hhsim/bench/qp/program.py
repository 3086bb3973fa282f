"""Programs in the kernels' layout, checks of an answer computed from the program alone, and calls of the solvers.

    minimise ½ |x - x₀|²   subject to   a_i · x >= b_i

in the conditioned variables x = √G δ [√J], see `hhsim.kernels.qp.active_set`. Residuals are of rows of length 1 over
the program's `size`: 1e-9 is a billionth of the numbers in the program.

All other solvers get the same conditioned program: minimise ½ |y|² subject to a_i · y >= r_i, rows of length 1,
y = (x - x₀) / L, L the largest violation at x₀ (the program's size without one). The Hessian is the identity, the
solution of the order of 1, and a tolerance means the same to each; preparation is not timed. qpsolvers calls them;
daqp is called by itself, to take a guess and to tell its own time.
"""

import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, new_work
from hhsim.kernels.qp.standalone import PROGRAM, solve_repeatedly
from hhsim.solver.qp import QpProblem, qpsolvers_call

CERTIFIED_RADIUS = 1e3
"""Least radius without a feasible point, in sizes of the program, that proves infeasibility: rounding limits it to
about a million for rows that contradict each other by 1e-9."""


@dataclass(frozen=True)
class Program:
    """One program.

    Attributes:
        kind: `coupled`, `palm`, `palm+fingers` or `finger`; or the name of a size or of a degenerate set.
        common: Columns that all rows share, shape (0 or 6, m).
        block: Three more columns, shape (3, m), of the variables of the row's group.
        rhs: b, shape (m,).
        groups: First row of each group, the row after its last, and the first variable of its block (-1 for none);
            shape (3, groups).
        target: x₀, shape (n,) [√J].
        tolerance: Violation that counts as satisfied [√J].
        relaxation: Largest distance by which contradicting rows are moved back [√J].
        guess: Rows expected to be active.
        source: Scene that it is from.
        tick: Tick of the scene's motion; -1 without one.
        step: Linearisation of that tick, from 0.
    """

    kind: str
    common: FloatArray
    block: FloatArray
    rhs: FloatArray
    groups: IntArray
    target: FloatArray
    tolerance: float
    relaxation: float
    guess: IntArray
    source: str = ""
    tick: int = -1
    step: int = -1

    @property
    def variables(self) -> int:
        """Number of variables n."""
        return self.target.size

    @property
    def rows(self) -> int:
        """Number of rows m."""
        return self.rhs.size

    @property
    def matrix(self) -> FloatArray:
        """Rows a_i, shape (m, n)."""
        dense = np.zeros((self.rows, self.variables))
        dense[:, : len(self.common)] = self.common.T
        for start, stop, first in self.groups.T:
            if first >= 0:
                dense[start:stop, first : first + 3] = self.block[:, start:stop].T
        return dense

    @property
    def size(self) -> float:
        """Larger of |x₀| and the largest |b_i| / |a_i| [√J]; 1 if all are zero."""
        norm = np.linalg.norm(self.matrix, axis=1)
        apart = np.abs(self.rhs) / np.where(norm > 0.0, norm, np.inf)
        size = max(float(np.linalg.norm(self.target)), float(apart.max(initial=0.0)))
        return size if size > 0.0 else 1.0

    @property
    def problem(self) -> QpProblem:
        """Program as plain matrices, with a stiffness of 1."""
        return QpProblem(np.ones(self.variables), self.matrix, self.rhs, self.target)

    def unit_rows(self) -> tuple[FloatArray, FloatArray]:
        """Return rows of length 1, shape (m, n), zero rows as they are, and the lengths they had, shape (m,)."""
        return self.problem.conditioned()[1:]

    def unguessed(self) -> "Program":
        """Return the program without its guess."""
        return replace(self, guess=self.guess[:0])


def residual(program: Program, x: FloatArray, multiplier: FloatArray, moved_back: float = 0.0) -> float:
    """Return the KKT residual of a solution x (n,), in sizes of the program; infinite where it is not a number.

    Args:
        multiplier: Of the rows as given, shape (m,).
        moved_back: Distance by which every row is moved back before the check [√J].
    """
    problem = program.problem
    if moved_back:
        problem = replace(problem, rhs=program.rhs - moved_back * program.unit_rows()[1])
    with np.errstate(invalid="ignore", over="ignore"):
        found = problem.kkt_residual(x, multiplier) / program.size
    return found if found == found else np.inf


def violation(program: Program, x: FloatArray) -> float:
    """Return the largest violation of a row by x (n,), in sizes of the program."""
    matrix, norm = program.unit_rows()
    return float(np.max(program.rhs / norm - matrix @ x, initial=0.0)) / program.size


def certified_radius(program: Program, certificate: FloatArray) -> float:
    """Return the radius about the origin in which no x satisfies the rows, in sizes of the program; 0 without proof.

    For y >= 0 and any x of length ρ, yᵀ (A x - b) <= |yᵀ A| ρ - yᵀ b: negative for ρ < yᵀ b / |yᵀ A|. Sums are taken in
    extended precision; y belongs to the normalised rows.
    """
    matrix, norm = program.unit_rows()
    y = np.asarray(certificate, dtype=np.longdouble)
    if not np.isfinite(y).all() or y.min(initial=0.0) < 0.0:
        return 0.0
    gap = float(y @ (program.rhs.astype(np.longdouble) / norm))
    length = float(np.linalg.norm((y @ matrix.astype(np.longdouble)).astype(np.float64)))
    if gap <= 0.0:
        return 0.0
    return gap / length / program.size if length > 0.0 else np.inf


WARM, WARM_DAQP = "active-set, warm", "daqp, warm"
DAQP_TOLERANCE = 1e-9
QUICK = ("pyqpmad", "quadprog")
"""Solvers of microseconds that do not tell their time: that of a program of one row is taken off, see `overhead`."""


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
    if backend in ("daqp", WARM_DAQP):
        solve = _daqp(rows, most, program.guess if backend == WARM_DAQP else program.guess[:0])
    else:
        solve = qpsolvers_call(backend, rows, most)

    def timed() -> Answer:
        found = None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            began = time.perf_counter_ns()
            with suppress(Exception):  # any exception of another solver is its answer
                found = solve()
            call = time.perf_counter_ns() - began
        seconds = None if found is None else found.solve_time
        native = max((call if seconds is None else 1e9 * seconds) - python_share, 0.0)
        if found is None or not found.found or found.x is None or found.z is None:
            return Answer(None, np.zeros(program.rows), call, native)
        multiplier = np.maximum(np.asarray(found.z, dtype=np.float64), 0.0) * length / norm
        return Answer(program.target + length * np.asarray(found.x, dtype=np.float64), multiplier, call, native)

    return timed


def overhead(backend: str, repeats: int = 200) -> float:
    """Return the median native time [ns] of a program with one row in one variable: hardly more than Python's share."""
    none = np.zeros((3, 0), dtype=np.int64)
    trivial = Program("", np.ones((1, 1)), np.zeros((3, 1)), -np.ones(1), none, np.zeros(1), 0.0, 0.0, none[0])
    solve = prepare(backend, trivial)
    return float(np.median([solve().native for _ in range(repeats)]))


def _daqp(rows: FloatArray, most: FloatArray, guess: IntArray) -> Callable[[], Any]:
    import daqp

    m, n = rows.shape
    arrays = np.eye(n), np.zeros(n), rows, most, np.full(m, -1e30)
    start = np.zeros(m, dtype=np.int32)
    start[guess] = 1

    def solve() -> SimpleNamespace:
        # It leaves its active set in the last array.
        y, _, flag, found = daqp.solve(*arrays, start.copy(), primal_tol=DAQP_TOLERANCE)
        own = found["solve_time"] + found["setup_time"]
        return SimpleNamespace(found=flag > 0, x=y, z=found["lam"], solve_time=own)

    return solve
