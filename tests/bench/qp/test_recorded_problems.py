"""Programs taken from real ticks: their order, and that our solver solves all of them or proves that nothing can."""

from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest
from sphere_scenes import bumpy_ball, random_targets, record_clearance

from hhsim.bench.qp import recorded_problems
from hhsim.bench.qp.bench import RESIDUAL_LIMIT
from hhsim.bench.qp.recorded_problems import MOVED_BACK, RUNS, QpBenchOptions, TickProgram, harvest, harvest_tick
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import QpProblem, QpStatus, solve_active_set

HAND = HandModel.default("right")
BALL = bumpy_ball(300)


def programs(method: str, motion: HandConfiguration) -> Iterator[TickProgram]:
    solver = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method))
    solver.run(*(values[:1] for values in motion))
    for tick in range(1, len(motion.position)):
        yield from harvest_tick(solver, HandConfiguration(*motion), tick, "test")


def assert_answered(program: TickProgram) -> None:
    """Solved to 1e-9 of its size, or infeasible by an independent solver's judgement too."""
    answer = solve_active_set(program.problem, MOVED_BACK)
    if answer.status == QpStatus.INFEASIBLE:
        assert least_violation(program.problem) > 0.0
    else:
        assert answer.status == QpStatus.OPTIMAL
        assert program.residual(answer) <= RESIDUAL_LIMIT


def least_violation(problem: QpProblem) -> float:
    """Least t [√J], to 1e-9, for which some x violates no normalised row by more than t."""
    from scipy.optimize import linprog

    _, matrix, norm = problem.conditioned()
    rows, n = matrix.shape
    found = linprog(
        np.concatenate([np.zeros(n), [1.0]]),
        A_ub=np.hstack([-matrix, -np.ones((rows, 1))]),
        b_ub=-problem.rhs / norm,
        bounds=[(None, None)] * n + [(-1.0, None)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    return float("nan") if found.status != 0 or found.x is None else float(found.x[-1])


@pytest.mark.soak
@pytest.mark.parametrize(
    ("method", "kinds"), [("coupled", {"coupled"}), ("progressive", {"palm", "palm+fingers", "finger"})]
)
def test_every_program_of_a_stress_is_answered(method: str, kinds: set[str]) -> None:
    found = list(programs(method, random_targets(HAND, 80, 3, hold=20)))
    for program in found:
        assert_answered(program)
    assert kinds <= {program.kind for program in found}
    assert len(found) > 80


@pytest.mark.soak
def test_every_program_of_a_catalogue_s_scenes_is_answered() -> None:
    options = QpBenchOptions(problems=2000, objects=("sphere", "cube"), motions=("grasp", "random"), seed=1)
    found = list(harvest(options))
    for program in found:
        assert_answered(program)
    kinds = Counter(program.kind for program in found)
    assert kinds.total() == 2000 and set(kinds) >= {"coupled", "finger"}
    assert len({program.source for program in found}) == 8


def test_harvesting_a_tick_does_to_the_hand_what_running_it_does() -> None:
    motion = random_targets(HAND, 60, 5, hold=20)
    for method in ("coupled", "progressive"):
        options = SolverOptions(method=method)
        run = HandSolver(HAND, BALL.arrays(), options)
        record = run.run(*motion)
        driven = HandSolver(HAND, BALL.arrays(), options)
        driven.run(*(values[:1] for values in motion))
        for tick in range(1, 60):
            harvest_tick(driven, HandConfiguration(*motion), tick, "")
            np.testing.assert_allclose(driven.workspace.states[0].pose.position, record.position[tick], atol=1e-7)
        assert record_clearance(HAND, BALL, record).min() >= -1e-6


def test_the_harvest_is_the_same_for_the_same_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_problems, "RANDOM_TICKS", 300)

    def first(seed: int) -> list[QpProblem]:
        options = QpBenchOptions(problems=10, objects=("sphere",), motions=("random",), seed=seed)
        return [program.problem for program in harvest(options)]

    one, same, other = first(0), first(0), first(1)
    assert len(one) == len(same) == len(other) == 10
    assert all(np.array_equal(a.rhs, b.rhs) and np.array_equal(a.target, b.target) for a, b in zip(one, same))
    assert not all(np.array_equal(a.rhs, b.rhs) for a, b in zip(one, other))


def test_the_programs_of_a_run_are_in_order_and_none_is_left_out() -> None:
    taken = list(harvest(QpBenchOptions(problems=240, objects=("sphere",), motions=("grasp",), seed=1)))
    for method in ("coupled", "progressive"):
        places = [(program.tick, program.step) for program in taken if program.source == f"sphere/grasp/{method}"]
        assert places == sorted(places)
        ticks = np.unique([tick for tick, _ in places])
        # What joins two runs is longer; every other step is from a tick to the next, and from a linearisation to it.
        assert np.count_nonzero(np.diff(ticks) > 1) <= RUNS + 1 < len(ticks) - 1
        for tick in ticks[:-1]:
            steps = {step for at, step in places if at == tick}
            assert steps == set(range(max(steps) + 1))
