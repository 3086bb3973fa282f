"""`hhsim bench qp` on a small scale: the library, the calls of other solvers, the command."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Run

from hhsim.bench.qp.backends import KNOWN_BACKENDS, Answer, condition, other_backends, overhead, prepare
from hhsim.bench.qp.bench import QpBench, QpBenchOptions, bench_qp, check_names
from hhsim.bench.qp.degenerate_problems import degenerate_set
from hhsim.bench.qp.kkt_check import residuals
from hhsim.bench.qp.program import ProgramSolver
from hhsim.bench.qp.random_problems import contact_programs
from hhsim.bench.qp.statistics import Tally
from hhsim.bench.table import load_table
from hhsim.errors import UnknownNameError

SMALL = QpBenchOptions(
    problems=120,
    per_set=2,
    per_size=2,
    objects=("sphere",),
    motions=("grasp", "random"),
    backends=("daqp", "quadprog", "clarabel"),
)
ACCURATE = ("clarabel", "daqp", "quadprog")


@pytest.fixture(scope="module")
def bench() -> QpBench:
    return bench_qp(SMALL)


def test_ours_solves_everything_and_proves_what_it_refuses(bench: QpBench) -> None:
    assert bench.failures == []
    assert bench.harvested["problems"] == 120
    assert bench.harvested["linear_program_denies"] == 0
    assert bench.harvested["compared"] > 0
    assert bench.harvested["objective_difference"] < 1e-9
    for row in bench.rows:
        if row["backend"].startswith("active-set"):
            assert row["solved"] + row["refused"] == row["problems"] > 0
            assert row["residual_max"] <= 1e-9
            assert row["wrong"] == row["unproved"] == row["accepted"] == row["gave_up"] == 0


def test_every_solver_has_a_row_for_every_case(bench: QpBench) -> None:
    solvers = {"active-set", *(SMALL.backends or ())}
    degenerate = [row for row in bench.rows if row["part"] == "degenerate"]
    assert len(degenerate) == 12 * 3 * len(solvers)
    timed = [row for row in bench.rows if row["part"] == "time"]
    for case in {row["case"] for row in timed}:
        present = {row["backend"] for row in timed if row["case"] == case}
        warm = {"active-set, warm", "daqp, warm"} if case.startswith("harvested") else set()
        assert present == solvers | warm
    assert {"3×10", "21×500", "harvested coupled"} <= {row["case"] for row in timed}
    for row in timed:
        assert 0.0 < row["native_p50"] <= row["native_p99"]
        assert 0.0 < row["call_p50"] <= row["call_p99"]
        assert row["residual_max"] < 1e-6
    assert {entry["case"] for entry in bench.nearest} == {row["case"] for row in timed}
    for entry in bench.nearest:
        assert entry["ratio"] == pytest.approx(entry["nearest_p50"] / entry["native_p50"])


def test_absent_solvers_are_named(bench: QpBench) -> None:
    assert not set(bench.absent) & set(bench.versions)
    assert set(bench.absent) | set(bench.versions) >= set(KNOWN_BACKENDS)
    assert bench.versions["daqp"]


@pytest.mark.parametrize("backend", other_backends())
def test_each_installed_solver_finds_the_same_solution(backend: str) -> None:
    solver = ProgramSolver()
    for n, m in ((3, 20), (6, 60), (21, 80)):
        for program in contact_programs(n, m, 3, seed=1):
            problem = condition(program)
            call = prepare(backend, problem)
            for _ in range(2):
                answer = call.solve(problem)
                assert answer.call > 0
                if not answer.found and backend not in ACCURATE:
                    continue
                assert answer.found
                ours = solver.solve(program)
                atol = (1e-7 if backend in ACCURATE else 1e-3) * program.size
                np.testing.assert_allclose(answer.x, ours.x, atol=atol)
                assert residuals(program, answer.x, answer.multiplier).largest < atol
    assert overhead(backend, 3) > 0.0


def test_daqp_takes_a_guess() -> None:
    solver = ProgramSolver()
    for program in contact_programs(21, 100, 5, seed=2):
        cold = solver.solve(program)
        problem = condition(program)
        guessed = type(problem)(**{**vars(problem), "guess": cold.active})
        for answer in (prepare("daqp", guessed, warm=True).solve(guessed) for _ in range(2)):
            assert answer.found
            np.testing.assert_allclose(answer.x, cold.x, atol=1e-9)


@pytest.mark.parametrize("backend", ACCURATE)
def test_a_contradiction_is_no_solution(backend: str) -> None:
    tally = Tally()
    for program in degenerate_set("infeasible by 1", 6, 5, seed=0):
        problem = condition(program)
        tally.count_answer(program, prepare(backend, problem).solve(problem), feasible=False)
    assert tally.refused == tally.problems == 5


def test_a_tally_tells_right_from_wrong() -> None:
    (program,) = contact_programs(3, 20, 1, seed=0)
    (contradiction,) = degenerate_set("infeasible by 1e-9", 3, 1, seed=0)
    solver = ProgramSolver()
    outcome = solver.solve(program)
    tally = Tally()
    exact = Answer(True, outcome.x, outcome.multiplier, 1, None)
    tally.count_answer(program, exact, feasible=True)
    assert (tally.solved, tally.exact) == (1, True)
    tally.count_answer(program, Answer(True, outcome.x + 1.0, outcome.multiplier, 1, None), feasible=True)
    tally.count_answer(program, Answer(True, outcome.x * np.nan, outcome.multiplier, 1, None), feasible=True)
    assert tally.wrong == 2
    tally.count_answer(program, Answer(False, outcome.x, outcome.multiplier, 1, None), feasible=True)
    assert tally.gave_up == 1
    assert not tally.exact
    refused = solver.solve(contradiction)
    tally.count_outcome(contradiction, refused)
    assert tally.refused == 1
    assert refused.certificate is not None
    tally.count_outcome(contradiction, type(refused)(**{**vars(refused), "certificate": refused.certificate * 0.0}))
    assert tally.unproved == 1
    tally.count_outcome(program, refused, feasible=True)
    assert tally.gave_up == 2
    tally.count_answer(contradiction, Answer(True, refused.x * 0.0 + 1e6, refused.multiplier, 1, None), feasible=False)
    assert tally.wrong == 3


def test_names_are_checked_before_the_work() -> None:
    for options, name in (
        (QpBenchOptions(objects=("spere",)), "sphere"),
        (QpBenchOptions(motions=("graps",)), "grasp"),
        (QpBenchOptions(backends=("dapq",)), "daqp"),
    ):
        with pytest.raises(UnknownNameError, match=name):
            check_names(options)


def test_a_miss_is_said(bench: QpBench) -> None:
    row = dict(next(row for row in bench.rows if row["backend"] == "active-set"))
    missed = QpBench(rows=[{**row, "solved": row["solved"] - 1, "gave_up": 1}, {**row, "residual_max": 1e-8}])
    assert len(missed.failures) == 2
    assert "1 of" in missed.failures[0]
    assert "1.0e-08" in missed.failures[1]
    assert len(QpBench(harvested={"linear_program_denies": 2}).failures) == 1


ARGUMENTS = (
    *("bench", "qp", "--problems", "40", "--per-set", "1", "--per-size", "1", "--object", "sphere"),
    *("--motion", "random", "--qp", "daqp", "--out", "qp.h5"),
)


def test_the_command_prints_tables_and_writes_them(run: Run, tmp_path: Path) -> None:
    answer = run(*ARGUMENTS)
    assert answer.code == 0, answer.err
    for words in ("programs of real ticks", "degenerate sets", "side by side", "infeasible by 1e-9", "not installed"):
        assert words in answer.out
    table = load_table(tmp_path / "qp.h5")
    assert table.suite == "qp"
    assert {row["part"] for row in table.rows} == {"harvest", "degenerate", "time"}
    assert table.options["problems"] == 40
    assert (tmp_path / "qp.csv").read_text().startswith("part,case,")


def test_json_is_one_document(run: Run) -> None:
    answer = run(*ARGUMENTS, "--json")
    document = json.loads(answer.out)
    assert document["failures"] == []
    assert document["harvest"]["problems"] == 40
    assert document["options"]["backends"] == ["daqp"]
    assert {"rows", "nearest", "versions", "absent", "path"} <= document.keys()


def test_a_miss_gives_exit_code_1(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.bench.qp.bench.QpBench.failures", property(lambda self: ["something"]))
    answer = run(*ARGUMENTS)
    assert answer.code == 1
    assert "missed: something" in answer.err


def test_wrong_words_are_refused_before_the_work(run: Run, tmp_path: Path) -> None:
    for words, told in (
        (("--object", "spere"), "sphere"),
        (("--motion", "graps"), "grasp"),
        (("--qp", "dapq"), "daqp"),
        (("--qp", " , "), "expected names with commas between"),
        (("--out", "qp.csv"), ".h5"),
    ):
        answer = run("bench", "qp", *words)
        assert answer.code == 2
        assert told in answer.err
    assert list(tmp_path.iterdir()) == []
