"""Programs for tests: rows in the kernels' layout, degenerate sets, random contacts; and a referee."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.qp.program import Program
from hhsim.kernels.qp.active_set import new_work
from hhsim.kernels.qp.row_scan import ProgramRows, WideRows

Rows = tuple[FloatArray, FloatArray, FloatArray]
"""Matrix (m, n), right-hand side (m,), target (n,)."""
Maker = Callable[[np.random.Generator, int, int], Rows]

VARIABLES = (3, 6, 21)
LEAST_ROWS, MOST_ROWS = 50, 100
DEGENERATE_TOLERANCE = 1e-12
"""Violation that counts as satisfied; the numbers in these sets are of the order of 1."""


def _hand_rows(rng: np.random.Generator, n: int, m: int) -> FloatArray:
    """Rows of length 1 in the pattern of a hand's: six columns of the palm, three of one finger."""
    matrix: FloatArray = rng.normal(size=(m, n))
    if n > 6:
        owner = rng.integers(0, 1 + (n - 6) // 3, size=m)
        column = np.arange(n - 6) // 3 + 1
        matrix[:, 6:] *= column[None, :] == owner[:, None]
    matrix /= np.linalg.norm(matrix, axis=1)[:, None]
    return matrix


def rows_around(rng: np.random.Generator, n: int, m: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rows that a point inside satisfies with some slack, about half of them violated by the target; and the point."""
    matrix, inside = _hand_rows(rng, n, m), rng.normal(size=n)
    return matrix, matrix @ inside - rng.exponential(0.3, size=m), inside + 2.0 * rng.normal(size=n), inside


def duplicates(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    half = m // 2
    matrix[half : 2 * half], rhs[half : 2 * half] = matrix[:half], rhs[:half]
    return matrix, rhs, target


def _rank_one(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, _, target, inside = rows_around(rng, n, m)
    matrix = np.outer(rng.uniform(0.1, 2.0, size=m), matrix[0])
    return matrix, matrix @ inside - rng.exponential(0.3, size=m), target


def parallel(angle: float) -> Maker:
    def make(rng: np.random.Generator, n: int, m: int) -> Rows:
        matrix, rhs, target, inside = rows_around(rng, n, m)
        half = m // 2
        # Where the first of a pair has none, the second has no finger's column either.
        tilt = angle * rng.normal(size=(half, n)) * (matrix[:half] != 0.0)
        matrix[half : 2 * half] = matrix[:half] + tilt
        apart = rng.choice([0.0, angle, 1e-3], size=half) * rng.random(half)
        rhs[half : 2 * half] = matrix[half : 2 * half] @ inside - (matrix[:half] @ inside - rhs[:half]) - apart
        return matrix, rhs, target

    return make


def zero_rows(rhs_of_zero: float) -> Maker:
    def make(rng: np.random.Generator, n: int, m: int) -> Rows:
        matrix, rhs, target, _ = rows_around(rng, n, m)
        zero = rng.random(m) < 0.2
        zero[0] = True
        matrix[zero], rhs[zero] = 0.0, rhs_of_zero
        return matrix, rhs, target

    return make


def _boundary(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, _, inside = rows_around(rng, n, m)
    # The target is feasible, and several rows hold there with equality: nothing is to be done.
    touching = rng.random(m) < 0.2
    touching[0] = True
    return matrix, np.where(touching, matrix @ inside, rhs), inside


def _scaled(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    factor = 10.0 ** rng.uniform(-6.0, 6.0, size=m)
    return matrix * factor[:, None], rhs * factor, target


def _mixed_units(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    # As if some variables were in metres and others in millimetres or milliradians.
    unit = np.where(np.arange(n) % 3 == 0, 1e3, np.where(np.arange(n) % 3 == 1, 1.0, 1e-1))
    return matrix / unit, rhs, target * unit


def _vertex(rng: np.random.Generator, n: int, m: int) -> Rows:
    # All rows meet in one point and push: more than n are active there.
    matrix, _, _, tip = rows_around(rng, n, m)
    matrix *= np.where(matrix @ matrix[0] < 0.0, -1.0, 1.0)[:, None]
    return matrix, matrix @ tip, tip - matrix.T @ rng.exponential(1.0, size=m)


def _contradiction(gap: float) -> Maker:
    def make(rng: np.random.Generator, n: int, m: int) -> Rows:
        matrix, rhs, target, inside = rows_around(rng, n, m)
        if rng.random() < 0.5:
            # Two opposed walls.
            matrix[1] = -matrix[0]
            rhs[:2] = matrix[:2] @ inside + 0.5 * gap
            return matrix, rhs, target
        # k + 1 rows around a point, in the k columns that the palm (or the finger) has.
        k = min(n, 6)
        matrix[: k + 1, k:] = 0.0
        matrix[:k] /= np.linalg.norm(matrix[:k], axis=1)[:, None]
        opposite = -rng.uniform(0.2, 1.0, size=k) @ matrix[:k]
        matrix[k] = opposite / np.linalg.norm(opposite)
        rhs[: k + 1] = matrix[: k + 1] @ inside + 0.5 * gap
        return matrix, rhs, target

    return make


FEASIBLE_SETS: dict[str, Maker] = {
    "duplicate rows": duplicates,
    "all rows of rank 1": _rank_one,
    "pairs parallel to 1e-9": parallel(1e-9),
    "pairs parallel to 1e-5": parallel(1e-5),
    "zero rows, rhs 0": zero_rows(0.0),
    "zero rows, rhs -1": zero_rows(-1.0),
    "start on the boundary": _boundary,
    "rows scaled 1e-6 to 1e6": _scaled,
    "mm and rad mixed": _mixed_units,
    "more than n active": _vertex,
}

INFEASIBLE_SETS: dict[str, Maker] = {
    "infeasible by 1": _contradiction(1.0),
    "infeasible by 1e-9": _contradiction(1e-9),
}


def degenerate_set(name: str, variables: int, count: int, seed: int) -> Iterator[Program]:
    """`count` programs of one set with so many variables, 50 to 100 rows each."""
    make = {**FEASIBLE_SETS, **INFEASIBLE_SETS}[name]
    rng = np.random.default_rng([seed, variables, *name.encode()])
    for _ in range(count):
        rows = int(rng.integers(LEAST_ROWS, MOST_ROWS + 1))
        yield dense_program(name, *make(rng, variables, rows), tolerance=DEGENERATE_TOLERANCE)


SIZES = ((3, 10), (3, 100), (6, 100), (6, 250), (21, 50), (21, 250), (21, 500))
"""Variables and rows."""

PATCH = 8
"""Contacts of a patch, on average."""
TRANSLATION, ROTATION, FLEXION = 1000.0, 5.0, 0.5
"""Stiffness [N/m], [N·m/rad], [N·m/rad]."""
CONTACT_TOLERANCE = 3e-12
"""Violation that counts as satisfied [√J]: 0.1 pm."""


def contact_programs(variables: int, rows: int, count: int, seed: int) -> Iterator[Program]:
    """`count` programs of one size, of 3, 6 or 21 variables."""
    rng = np.random.default_rng([seed, variables, rows])
    kind = f"{variables}×{rows}"
    for _ in range(count):
        yield _contacts(rng, kind, variables, rows)


def _contacts(rng: np.random.Generator, kind: str, n: int, m: int) -> Program:
    patches = max(1, m // PATCH)
    patch = rng.integers(0, patches, size=m)
    normal = rng.normal(size=(patches, 3))[patch] + 0.05 * rng.normal(size=(m, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    point = 0.05 * rng.normal(size=(patches, 3))[patch] + 0.002 * rng.normal(size=(m, 3))
    lever = 0.03 * rng.normal(size=(patches, 3))[patch] + 0.002 * rng.normal(size=(m, 3))
    root = np.sqrt([TRANSLATION] * 3 + [ROTATION] * 3 + [FLEXION] * 15)
    reach = np.array([5e-3] * 3 + [0.05] * 3 + [0.1] * 15) * root
    matrix = np.zeros((m, 21))
    matrix[:, :3] = normal
    matrix[:, 3:6] = np.cross(point, normal)
    owner = rng.integers(0, 6, size=patches)[patch]
    for finger in range(1, 6):
        own = owner == finger
        matrix[own, 3 + 3 * finger : 6 + 3 * finger] = lever[own]
    if n == 3:
        matrix, root, reach = lever, root[6:9], reach[6:9]
    elif n == 6:
        matrix, root, reach = matrix[:, :6], root[:6], reach[:6]
    matrix = matrix / root
    inside = 0.1 * reach * rng.normal(size=n)
    rhs = matrix @ inside - rng.exponential(3e-4, size=m)
    return dense_program(kind, matrix, rhs, inside + reach * rng.normal(size=n), CONTACT_TOLERANCE)


def dense_program(
    kind: str, matrix: FloatArray, rhs: FloatArray, target: FloatArray, tolerance: float, relaxation: float = 0.0
) -> Program:
    """A program of rows (m, n), n = 3, 6, or 6 and blocks of 3 of which a row uses at most one; rows are reordered."""
    m, n = matrix.shape
    if n == 3:
        owner, first = np.zeros(m, dtype=np.int64), np.zeros(1, dtype=np.int64)
        common = np.zeros((0, m))
    else:
        used = (matrix[:, 6:].reshape(m, -1, 3) != 0.0).any(axis=2)
        owner = np.where(used.any(axis=1), 1 + used.argmax(axis=1) if used.shape[1] else 0, 0)
        first = np.concatenate([[-1], np.arange(6, n, 3)])
        common = matrix[:, :6].T
    order = np.argsort(owner, kind="stable")
    owner, matrix = owner[order], matrix[order]
    block = np.zeros((3, m))
    for g, column in enumerate(first):
        if column >= 0:
            block[:, owner == g] = matrix[owner == g, column : column + 3].T
    groups = np.arange(first.size)
    return Program(
        kind=kind,
        common=np.ascontiguousarray(common[:, order]),
        block=block,
        rhs=np.ascontiguousarray(rhs[order]),
        groups=np.array([np.searchsorted(owner, groups), np.searchsorted(owner, groups, side="right"), first]),
        target=np.ascontiguousarray(target),
        tolerance=tolerance,
        relaxation=relaxation,
        guess=np.zeros(0, dtype=np.int64),
    )


def kernel_rows(program: Program, kind: type[ProgramRows | WideRows] = ProgramRows) -> ProgramRows | WideRows:
    """The rows as the kernels take them."""
    return kind(len(program.common), program.common, program.block, program.rhs, *program.groups)


def rubbish_work(variables: int, rows: int) -> Any:
    """A workspace in which nothing may matter."""
    work = new_work(variables, rows)
    for name in work.dtype.names:
        work[name].fill(-7 if work[name].dtype == np.int64 else np.nan)
    return work


def least_violation(program: Program) -> float:
    """Least t, to 1e-9, for which some x violates no normalised row by more than t, in sizes of the program."""
    from scipy.optimize import linprog

    matrix, norm = program.unit_rows()
    n, size = program.variables, program.size
    found = linprog(
        np.concatenate([np.zeros(n), [1.0]]),
        A_ub=np.hstack([-matrix, -np.ones((program.rows, 1))]),
        b_ub=-program.rhs / norm / size,
        bounds=[(None, None)] * n + [(-1.0, None)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    return float("nan") if found.status != 0 or found.x is None else float(found.x[-1])
