"""One contact problem as plain matrices, and its solution by our solver or by any that qpsolvers finds.

    minimise ½ (δ - δ*)ᵀ G (δ - δ*)   subject to   A δ >= b,      G diagonal and positive

All backends get the same conditioned form: x = √G δ, which makes the Hessian the identity, and rows of length 1.
Lengths along x [√J] then mean the same for palm and fingers, and a solver's tolerance is a distance.

Programs of a tick are made of the kernels' rows, to inspect, to solve again and to compare. A tick calls an installed
solver by an address, as any other part; a program that a backend fails on counts as infeasible.
"""

import ctypes
import warnings
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Self

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, UnknownNameError
from hhsim.kernels.hand.kinematics import DOF, PHALANX_COUNT
from hhsim.kernels.qp import active_set
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL
from hhsim.kernels.qp.row_scan import STRIP, Rows
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.kernels.world.columns import common_count, variable_count
from hhsim.kernels.world.program import take_hand_steps
from hhsim.kernels.world.rows import contact_groups, end_rows

ACTIVE_SET = "active-set"
"""Our own backend: `hhsim.kernels.qp.active_set`."""

TOLERANCE = 1e-12
"""Row violation [√J] that the active-set backend accepts; 30 fm at a stiffness of 1 kN/m."""
RESIDUAL_LIMIT = 1e-6
"""A backend's answer with a larger `kkt_residual` [√J] is inaccurate; 30 nm at a stiffness of 1 kN/m."""

BACKEND_OPTIONS: dict[str, dict[str, Any]] = {
    "clarabel": {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11},
    "cvxopt": {"abstol": 1e-10, "reltol": 1e-10, "feastol": 1e-10},
    "daqp": {"primal_tol": 1e-11},
    "ecos": {"abstol": 1e-9, "reltol": 1e-9, "feastol": 1e-9},
    "highs": {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 0.0, "max_iter": 100_000},
    "piqp": {"eps_abs": 1e-11, "eps_rel": 0.0},
    "proxqp": {"eps_abs": 1e-9, "eps_rel": 0.0},
    "scs": {"eps_abs": 1e-9, "eps_rel": 0.0, "max_iters": 100_000},
}
"""Accuracy options of backends whose defaults aim at 1e-3 to 1e-8. Others run as they are."""


class QpStatus(StrEnum):
    """Outcome of a solve."""

    OPTIMAL = "optimal"
    INACCURATE = "inaccurate"
    """Error of a backend that claims an optimum, though `QpProblem.kkt_residual` exceeds `RESIDUAL_LIMIT`."""
    FAILED = "failed"
    """No solution, or none found; `QpSolution.message` has the backend's words."""


@dataclass(frozen=True)
class QpProblem:
    """Min ½ (δ - δ*)ᵀ G (δ - δ*) subject to A δ >= b.

    Args:
        stiffness: Diagonal of G, shape (n,); [N/m] for a displacement, [N·m/rad] for an angle; positive.
        matrix: A, shape (m, n); a contact row gives the rate of the distance by displacement [1] and by angle [m/rad].
        rhs: b, shape (m,) [m] for contact rows.
        target: δ*, shape (n,); [m] and [rad].

    Raises:
        InputError: On shapes that do not fit, or a stiffness that is not positive.
    """

    stiffness: FloatArray
    matrix: FloatArray
    rhs: FloatArray
    target: FloatArray

    def __post_init__(self) -> None:
        for name in ("stiffness", "matrix", "rhs", "target"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        n, m = self.target.size, self.rhs.size
        for name, shape in (("stiffness", (n,)), ("matrix", (m, n)), ("rhs", (m,)), ("target", (n,))):
            found = getattr(self, name).shape
            if found != shape:
                raise InputError(f"QP: {name} has shape {found}, expected {shape} for {n} variables and {m} rows")
        if not np.all(self.stiffness > 0.0):
            raise InputError(f"QP: every stiffness must be positive, the least is {self.stiffness.min()}")

    def kkt_residual(self, solution: FloatArray, multiplier: FloatArray) -> float:
        """Largest violation [√J] of the optimality conditions by δ, shape (n,), with multipliers, shape (m,).

        Of the rows, of the multipliers' sign, of the balance G (δ - δ*) = Aᵀ λ, and of complementarity (the smaller of
        slack and multiplier), all in the conditioned variables, where these are lengths. 0 is an exact optimum.
        """
        root, unit, norm = self.conditioned()
        slack = unit @ (root * solution) - self.rhs / norm
        push = multiplier * norm
        balance = root * (solution - self.target) - unit.T @ push
        return float(np.max(np.concatenate([-slack, -push, np.abs(balance), np.minimum(slack, push)]), initial=0.0))

    def conditioned(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return √G, the rows for x = √G δ at length 1, and their former lengths; a zero row stays, with length 1."""
        root = np.sqrt(self.stiffness)
        scaled = self.matrix / root
        norm: FloatArray = np.linalg.norm(scaled, axis=1)
        norm[norm == 0.0] = 1.0
        return root, scaled / norm[:, None], norm


@dataclass(frozen=True)
class QpSolution:
    """Solution of a backend."""

    x: FloatArray  # δ, shape (n,) [m] and [rad]; the target where there is no solution
    multiplier: FloatArray  # λ >= 0 of each row, shape (m,); [N] for contact rows; zeros where there is no solution
    status: QpStatus = QpStatus.OPTIMAL  # compares equal to its string
    message: str = ""  # reason, empty for an optimum

    @classmethod
    def failed(cls, problem: QpProblem, message: str) -> Self:
        """Return that there is no solution of a problem."""
        return cls(problem.target.copy(), np.zeros(problem.rhs.size), QpStatus.FAILED, message)


def available_backends() -> list[str]:
    """Return `active-set`, then what qpsolvers finds installed."""
    import qpsolvers

    return [ACTIVE_SET, *sorted(qpsolvers.available_solvers)]


def solve(problem: QpProblem, backend: str = ACTIVE_SET) -> QpSolution:
    """Solve `problem` with one of `available_backends()`; a backend's failure is a status, never an exception."""
    if backend != ACTIVE_SET and backend not in available_backends():
        raise UnknownNameError("QP backend", backend, available_backends())
    if not all(np.isfinite(array).all() for array in (problem.matrix, problem.rhs, problem.target)):
        return QpSolution.failed(problem, "the problem holds NaN or infinity")
    if problem.rhs.size == 0:
        return QpSolution(problem.target.copy(), np.zeros(0))
    found = solve_active_set(problem) if backend == ACTIVE_SET else _solve_by_qpsolvers(problem, backend)
    if found.status is not QpStatus.OPTIMAL:
        return found
    residual = problem.kkt_residual(found.x, found.multiplier)
    if residual <= RESIDUAL_LIMIT:
        return found
    return replace(found, status=QpStatus.INACCURATE, message=f"KKT residual {residual:.1e}")


def solve_active_set(problem: QpProblem, relaxation: float = 0.0) -> QpSolution:
    """Solve by our own solver, unchecked; rows that contradict each other may be moved back by `relaxation` [√J]."""
    root, unit, norm = problem.conditioned()
    m, n = unit.shape
    # Columns of zeros fill up the strips that the kernel reads.
    width = -(-n // STRIP) * STRIP
    work = active_set.new_work(width, m)
    rows = Rows(
        n_common=width,
        common=np.pad(unit.T, ((0, width - n), (0, 0))),
        block=np.zeros((3, m)),
        rhs=problem.rhs / norm,
        group_start=np.zeros(1, dtype=np.int64),
        group_stop=np.full(1, m, dtype=np.int64),
        group_block=np.full(1, -1, dtype=np.int64),
    )
    guess = np.zeros(1, dtype=np.int64)
    target = np.pad(root * problem.target, (0, width - n))
    status = active_set.solve(width, rows, target, TOLERANCE, relaxation, guess, 0, work)
    if status != OPTIMAL:
        contradict = "the rows contradict each other"
        return QpSolution.failed(problem, contradict if status == INFEASIBLE else f"kernel status {status}")
    multiplier = np.zeros(m)
    count = work.counts[0]
    multiplier[work.active[:count]] = work.multiplier[:count]
    return QpSolution(work.x[:n] / root, multiplier / norm)


def _solve_by_qpsolvers(problem: QpProblem, backend: str) -> QpSolution:
    import qpsolvers
    from scipy.sparse import csc_matrix

    root, unit, norm = problem.conditioned()
    target, rhs = root * problem.target, problem.rhs / norm
    kind: Any = np.asarray if backend in qpsolvers.dense_solvers else csc_matrix
    identity, rows, zero = kind(np.eye(target.size)), kind(-unit), np.zeros(target.size)
    # The target's largest violation is about how far away the solution is: as the unit, it makes tolerances relative.
    farthest = float(np.max(rhs - unit @ target))
    length = farthest if farthest > 0.0 else 1.0
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scaled = qpsolvers.Problem(identity, zero, rows, (unit @ target - rhs) / length)
            solution = qpsolvers.solve_problem(scaled, backend, **BACKEND_OPTIONS.get(backend, {}))
        message = "; ".join(str(warning.message) for warning in caught)
    except Exception as error:  # whatever a foreign solver raises is its answer
        return QpSolution.failed(problem, f"{type(error).__name__}: {error}")
    if not solution.found or solution.x is None or solution.z is None:
        return QpSolution.failed(problem, message or "no solution found")
    x = (target + length * np.asarray(solution.x, dtype=np.float64)) / root
    multiplier = np.maximum(np.asarray(solution.z, dtype=np.float64), 0.0) * length / norm
    return QpSolution(x, multiplier)


MULTIPLIER_FLOOR = 1e-9
"""Interior-point backends leave smaller multipliers [N] on inactive rows."""
_CALL = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.POINTER(ctypes.c_int64), *[ctypes.c_void_p] * 5)
"""A kernel as numba calls it: where its value goes, where an exception would, and pointers for its arguments."""


def backend_code(method: Any, backend: str) -> tuple[Any, Any]:
    """Return machine code that solves the programs of a hand alone by a QP solver, and what the caller keeps for it."""
    failed: list[BaseException] = []
    world = method.world[0]
    problem, loaded = world.problem, world.loaded

    def called(value: Any, *_: Any) -> int:
        value[0] = INFEASIBLE
        try:
            dense, rows = dense_problem(method)
            solution = solve(dense, backend)
            if solution.status is QpStatus.FAILED:
                return 0
            problem.delta[:DOF] = solution.x
            pushing = np.flatnonzero(solution.multiplier > MULTIPLIER_FLOOR)[:ACTIVE_CAPACITY]
            loaded.count, row, force = len(pushing), rows[pushing], solution.multiplier[pushing]
            loaded.row[: len(pushing)], loaded.multiplier[: len(pushing)] = row, force
            loaded.key[: len(pushing)] = problem.key[row]
            world.hand_pairs.multiplier[:] = 0.0
            of_parts = row >= problem.dense_row
            world.hand_pairs.multiplier[row[of_parts] - problem.dense_row] = force[of_parts]
            take_hand_steps(method.states, problem)
            value[0] = OPTIMAL
        except BaseException as error:
            failed.append(error)
        return 0

    code = _CALL(called)
    return ctypes.cast(code, ctypes.c_void_p).value, (code, failed)


def dense_problem(method: Any) -> tuple[QpProblem, IntArray]:
    """Return the program at hand of a hand alone, and the kernels' row of each of its rows.

    Rows are the palm's contacts, each finger's contacts and joint limits, and those of the hand's own parts.
    """
    world, states = method.world[0], method.states
    problem, state = world.problem, states[0]
    end_rows(states, method.options.offset, contact_groups(states, problem), problem, world.hand_pairs)
    names = "group_start", "group_stop", "group_block"
    groups = zip(*(problem[name][: problem.groups] for name in names))
    common, count = common_count(problem), variable_count(problem)
    rows, parts = [np.zeros(0, np.int64)], [np.zeros((0, count))]
    for start, stop, block in groups:
        part = np.zeros((stop - start, count))
        part[:, :common] = problem.common[:common, start:stop].T
        if block >= 0:
            part[:, block : block + PHALANX_COUNT] = problem.block[:, start:stop].T
        elif start >= problem.dense_row:
            part[:, common:] = problem.dense[: stop - start, : count - common]
        rows.append(np.arange(start, stop))
        parts.append(part)
    index, weight, stiffness = np.concatenate(rows), problem.inverse_root, np.array(state.stiffness)
    target = problem.target[:count] * weight
    return QpProblem(stiffness, np.concatenate(parts) / weight, problem.rhs[index], target), index
