"""Programs taken from real ticks: what they are, and that our solver solves all of them or proves that nothing can."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from qp_problems import solve_program
from sphere_scenes import bumpy_ball, random_targets, record_clearance

from hhsim.arrays import FloatArray
from hhsim.bench.qp import recorded_problems
from hhsim.bench.qp.bench import RESIDUAL_LIMIT
from hhsim.bench.qp.program import Program
from hhsim.bench.qp.recorded_problems import RUNS, QpBenchOptions, harvest, harvest_tick
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL
from hhsim.motion.analytic_motion import still
from hhsim.solver.contact_qp import coupled_problem
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

HAND = HandModel.default("right")
BALL = bumpy_ball(300)


def programs(method: str, motion: HandConfiguration) -> Iterator[Program]:
    solver = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method))
    solver.run(*(values[:1] for values in motion))
    for tick in range(1, len(motion.position)):
        yield from harvest_tick(solver, HandConfiguration(*motion), tick, "test")


def certified_radius(program: Program, certificate: FloatArray) -> float:
    """Radius about the origin in which no x satisfies the rows, in sizes of the program.

    For y >= 0 and any x of length ρ, yᵀ (A x - b) <= |yᵀ A| ρ - yᵀ b: negative for ρ < yᵀ b / |yᵀ A|. Sums are taken in
    extended precision.
    """
    assert certificate.min() >= 0.0
    _, matrix, norm = program.problem.conditioned()
    y = certificate.astype(np.longdouble)
    length = float(np.linalg.norm((y @ matrix.astype(np.longdouble)).astype(np.float64)))
    return float(y @ (program.rhs.astype(np.longdouble) / norm)) / (length + 1e-300) / program.size


def is_solved(program: Program) -> bool:
    """Solved to 1e-9 of its size, from nothing and from the guess; or else both times proved infeasible."""
    problem = program.problem
    norm = problem.conditioned()[2]
    relaxed = replace(problem, rhs=program.rhs - program.relaxation * norm)
    solved = set()
    for guess in ((), program.guess):
        outcome = solve_program(program, guess)
        solved.add(outcome.status == OPTIMAL)
        if outcome.status == OPTIMAL:
            found = [one.kkt_residual(outcome.x, outcome.multiplier) for one in (problem, relaxed)]
            assert min(found) <= RESIDUAL_LIMIT * program.size
        else:
            assert outcome.status == INFEASIBLE
            # Rounding limits it to about a million for rows that contradict each other by 1e-9.
            assert certified_radius(program, np.maximum(outcome.certificate, 0.0)) > 1e3
    assert len(solved) == 1
    return solved.pop()


def least_violation(program: Program) -> float:
    """Least t, to 1e-9, for which some x violates no normalised row by more than t, in sizes of the program."""
    from scipy.optimize import linprog

    _, matrix, norm = program.problem.conditioned()
    n = program.variables
    found = linprog(
        np.concatenate([np.zeros(n), [1.0]]),
        A_ub=np.hstack([-matrix, -np.ones((program.rows, 1))]),
        b_ub=-program.rhs / norm / program.size,
        bounds=[(None, None)] * n + [(-1.0, None)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    return float("nan") if found.status != 0 or found.x is None else float(found.x[-1])


@pytest.mark.soak
@pytest.mark.parametrize(("method", "kinds"), [("coupled", {"coupled"}), ("progressive", {"palm", "finger"})])
def test_every_program_of_a_stress_is_solved_or_proved_infeasible(method: str, kinds: set[str]) -> None:
    found: dict[str, int] = {}
    refused: list[Program] = []
    for program in programs(method, random_targets(HAND, 80, 3, hold=20)):
        found[program.kind] = found.get(program.kind, 0) + 1
        if not is_solved(program):
            refused.append(program)
    assert kinds <= set(found)
    assert sum(found.values()) > 80
    for program in refused[:20]:
        assert least_violation(program) > 0.0
    if method == "progressive":
        assert found["palm+fingers"] > 0
        assert {program.kind for program in refused} == {"finger"}


@pytest.mark.soak
@pytest.mark.parametrize("problems", [2000])
def test_programs_of_a_catalogue_s_scenes(problems: int) -> None:
    kinds: dict[str, int] = {}
    sources: set[str] = set()
    for program in harvest(
        QpBenchOptions(problems=problems, objects=("sphere", "cube"), motions=("grasp", "random"), seed=1)
    ):
        is_solved(program)
        kinds[program.kind] = kinds.get(program.kind, 0) + 1
        sources.add(program.source)
    assert sum(kinds.values()) == problems
    assert set(kinds) >= {"coupled", "palm", "finger"}
    assert len(sources) == 8


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


def test_a_harvested_program_is_the_tick_s() -> None:
    # The same rows as `contact_problem` takes from the state, where both are at hand.
    opened = still([0.0, -0.045, 0.056], flexion=0.2)
    closed = still([0.0, -0.045, 0.050], flexion=0.7)
    motion = opened.line(closed, 39)
    solver = HandSolver(HAND, BALL.arrays(), SolverOptions())
    # A tick that arrives: one that lags leaves the rows of the program that its forces are from.
    solver.run(*(values[:31] for values in motion))
    taken = harvest_tick(solver, HandConfiguration(*motion), 31, "here")
    assert taken
    program = taken[-1]
    problem, _ = coupled_problem(solver.workspace.states[0])
    assert (program.kind, program.source, program.variables) == ("coupled", "here", 21)
    weight = np.sqrt(problem.stiffness)
    # contact_problem also holds the limits of fingers that touch nothing.
    theirs = {tuple(np.round(row, 12)) for row in np.column_stack([problem.matrix / weight, problem.rhs])}
    ours = {tuple(np.round(row, 12)) for row in np.column_stack([program.matrix, program.rhs])}
    assert ours <= theirs
    assert len(ours) > 5


def test_the_harvest_is_the_same_for_the_same_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_problems, "RANDOM_TICKS", 300)

    def first(seed: int) -> list[Program]:
        return list(harvest(QpBenchOptions(problems=10, objects=("sphere",), motions=("random",), seed=seed)))

    one, same, other = first(0), first(0), first(1)
    assert len(one) == len(same) == len(other) == 10
    assert all(np.array_equal(a.rhs, b.rhs) and np.array_equal(a.target, b.target) for a, b in zip(one, same))
    assert not all(np.array_equal(a.rhs, b.rhs) for a, b in zip(one, other))


def test_the_programs_of_a_run_are_in_order_and_none_is_left_out() -> None:
    taken = list(harvest(QpBenchOptions(problems=240, objects=("sphere",), motions=("grasp",), seed=1)))
    for method in ("coupled", "progressive"):
        mine = [program for program in taken if program.source == f"sphere/grasp/{method}"]
        places = [(program.tick, program.step) for program in mine]
        assert places == sorted(places)
        ticks = np.unique([tick for tick, _ in places])
        # What joins two runs is longer; every other step is from a tick to the next, and from a linearisation to it.
        assert np.count_nonzero(np.diff(ticks) > 1) <= RUNS + 1 < len(ticks) - 1
        for tick in ticks[:-1]:
            steps = {step for at, step in places if at == tick}
            assert steps == set(range(max(steps) + 1))
        guessed = [program for program in mine if program.step == 0 and program.tick - 1 in ticks]
        assert np.mean([program.guess.size > 0 for program in guessed]) > 0.5, "the tick before says what to expect"
