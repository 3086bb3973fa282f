"""Program of consecutive frames against quadprog, and against each frame by itself."""

import numpy as np
import pytest

from hhsim.arrays import FloatArray
from hhsim.repair.projection import FrameProgram, steady_step
from hhsim.repair.written_hand import NUMBERS

FRAMES, TOTAL = [2, 3, 4, 7], 9


def programs(random: np.random.Generator, slacks: int) -> list[FrameProgram]:
    found = []
    for _ in FRAMES:
        n = NUMBERS + slacks
        root = random.normal(size=(n, n))
        feasible = 0.1 * random.normal(size=n)
        rows = 30.0 * random.normal(size=(6, n))
        bounds = rows @ feasible - 30.0 * random.uniform(0.0, 1.0, 6)
        found.append(FrameProgram(root.T @ root + np.eye(n), random.normal(size=n), rows, bounds))
    return found


def by_quadprog(own: list[FrameProgram], change: FloatArray, steadiness: float) -> FloatArray:
    from quadprog import solve_qp

    n = len(own[0].pull)
    hessian, pull = np.zeros((len(own) * n,) * 2), np.concatenate([program.pull for program in own])
    second = np.diff(np.eye(TOTAL), 2, axis=0)
    metric = steadiness * np.mean([np.diag(program.hessian)[:NUMBERS] for program in own], axis=0)
    rows, bounds = [], []
    for k, program in enumerate(own):
        hessian[k * n : (k + 1) * n, k * n : (k + 1) * n] = program.hessian
        for row, bound in zip(program.rows, program.bounds):
            rows.append(np.concatenate([row if j == k else np.zeros(n) for j in range(len(own))]))
            bounds.append(bound)
    # The second differences of change + x, one number of the hand at a time.
    for number in range(NUMBERS):
        of = np.zeros((TOTAL, len(pull)))
        for k, frame in enumerate(FRAMES):
            of[frame, k * n + number] = 1.0
        hessian += metric[number] * (second @ of).T @ (second @ of)
        pull -= metric[number] * (second @ of).T @ (second @ change[:, number])
    return np.asarray(solve_qp(hessian, pull, np.array(rows).T, np.array(bounds))[0]).reshape(len(own), n)[:, :NUMBERS]


@pytest.mark.parametrize(("slacks", "steadiness"), [(0, 3.0), (2, 30.0), (1, 0.0)])
def test_the_steps_are_those_of_quadprog(slacks: int, steadiness: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.repair.projection.TOLERANCE", 1e-10)
    random = np.random.default_rng(slacks)
    own, change = programs(random, slacks), random.normal(size=(TOTAL, NUMBERS))
    step = steady_step(own, change, FRAMES, steadiness)
    assert step is not None
    np.testing.assert_allclose(step, by_quadprog(own, change, steadiness), atol=1e-6)


def test_rows_that_contradict_each_other_give_way_by_the_same() -> None:
    program = FrameProgram(np.eye(NUMBERS), np.zeros(NUMBERS), np.eye(NUMBERS)[[0, 0]] * [[1.0], [-1.0]], np.ones(2))
    step = steady_step([program], np.zeros((1, NUMBERS)), [0], 1.0)
    assert step is not None
    np.testing.assert_allclose(step, 0.0, atol=1e-5)
