"""The degenerate sets of `qp_problems` are what they are called."""

from collections.abc import Iterator

import numpy as np
import pytest
from qp_problems import FEASIBLE_SETS, VARIABLES, Rows

from hhsim.solver.qp import QpProblem, solve

COUNT = 20


@pytest.mark.parametrize("variables", VARIABLES)
def test_each_set_is_what_its_name_says(variables: int) -> None:
    rng = np.random.default_rng(variables)

    def of(name: str) -> Iterator[Rows]:
        return (FEASIBLE_SETS[name](rng, variables, int(rng.integers(50, 101))) for _ in range(COUNT))

    for matrix, rhs, _ in of("duplicate rows"):
        assert len(np.unique(np.column_stack([matrix, rhs]), axis=0)) <= (len(rhs) + 1) // 2
    for matrix, _, _ in of("all rows of rank 1"):
        assert np.linalg.matrix_rank(matrix) == 1
    for angle in (1e-9, 1e-5):
        for matrix, _, _ in of(f"pairs parallel to {angle:.0e}".replace("e-0", "e-")):
            unit = matrix / np.linalg.norm(matrix, axis=1)[:, None]
            apart = np.array([np.sort(np.linalg.norm(unit - row, axis=1))[1] for row in unit])
            assert np.median(apart) < 10.0 * angle
    for matrix, rhs, _ in of("zero rows, rhs 0"):
        zero = ~matrix.any(axis=1)
        assert zero.any()
        assert not rhs[zero].any()
    for matrix, rhs, target in of("start on the boundary"):
        slack = matrix @ target - rhs
        assert slack.min() > -1e-12
        assert (slack < 1e-12).any()
    for matrix, _, _ in of("rows scaled 1e-6 to 1e6"):
        norm = np.linalg.norm(matrix, axis=1)
        assert norm.max() / norm.min() > 1e8
    for matrix, rhs, target in of("more than n active"):
        x = solve(QpProblem(np.ones(variables), matrix, rhs, target)).x
        assert np.sum(np.abs(matrix @ x - rhs) < 1e-9) > variables
