"""`hhsim bench qp`, small: its rows, the file for qpbenchmark, our solver as one of qpsolvers, the command."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import qpsolvers
from conftest import Run
from pyarrow import parquet
from qp_problems import INFEASIBLE_SETS, VARIABLES, rows_around

from hhsim.bench.qp import recorded_problems
from hhsim.bench.qp.bench import RESIDUAL_LIMIT, SolvedPrograms, bench_qp, missed_programs
from hhsim.bench.qp.qpbenchmark_export import check_program_file, solve_as_qpsolvers
from hhsim.bench.qp.recorded_problems import QpBenchOptions, harvest
from hhsim.bench.table import load_table
from hhsim.errors import OutputError
from hhsim.solver.qp import QpProblem, QpSolution, QpStatus, solve

SMALL = QpBenchOptions(problems=100, objects=("sphere",), motions=("grasp", "random"))


@pytest.fixture(scope="module", autouse=True)
def short() -> Iterator[None]:
    """A short random motion."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_problems, "RANDOM_TICKS", 600)
        yield


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("qp") / "programs.parquet"


@pytest.fixture(scope="module")
def rows(programs: Path, short: None) -> list[dict[str, Any]]:
    return bench_qp(SMALL, programs)


def test_every_program_is_solved_or_found_infeasible(rows: list[dict[str, Any]]) -> None:
    assert missed_programs(rows) == []
    assert {"coupled", "finger"} <= {row["program"] for row in rows}
    assert sum(row["problems"] for row in rows) == SMALL.problems
    for row in rows:
        assert row["solved"] + row["infeasible"] == row["problems"] > 0
        assert row["residual_max"] <= RESIDUAL_LIMIT


def test_a_wrong_answer_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(problem: QpProblem, relaxation: float) -> QpSolution:
        shift = 1e-6 * np.linalg.norm(problem.target)
        right = solve(problem)
        return QpSolution(right.x + shift, right.multiplier, right.status, right.backend)

    monkeypatch.setattr("hhsim.bench.qp.bench.solve_active_set", wrong)
    kind = SolvedPrograms("coupled")
    for program in harvest(QpBenchOptions(problems=3, objects=("sphere",), motions=("grasp",))):
        kind.add(program)
    assert kind.missed == 3
    (sentence,) = missed_programs([{"program": "coupled", "missed": 3, "problems": 3}, {"missed": 0}])
    assert sentence.startswith("coupled: 3 of 3 programs")


def test_the_programs_are_written_as_qpbenchmark_reads_them(rows: list[dict[str, Any]], programs: Path) -> None:
    taken = parquet.read_table(programs).to_pylist()
    order = {"kind", "scene", "tick", "step"}
    assert set(taken[0]) == {"P", "q", "G", "h", "A", "b", "lb", "ub", "name"} | order
    assert len({one["name"] for one in taken}) == len(taken) == SMALL.problems
    for one, program in zip(taken[::10], list(harvest(SMALL))[::10], strict=True):
        n = len(one["q"])
        matrices = {key: np.array(one[key]).reshape(-1, n) for key in ("P", "G")}
        problem = qpsolvers.Problem(matrices["P"], np.array(one["q"]), matrices["G"], np.array(one["h"]))
        theirs, ours = qpsolvers.solve_problem(problem, "quadprog"), solve(program.problem)
        assert theirs.found == (ours.status == QpStatus.OPTIMAL)
        if theirs.x is not None:
            root = np.sqrt(program.problem.stiffness)
            np.testing.assert_allclose(theirs.x, root * ours.x, atol=1e-7 * program.size)


def test_the_test_set_finds_the_programs(
    rows: list[dict[str, Any]], programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = programs.with_name("hand_ticks.py").read_text()
    assert "100 programs" in text.splitlines()[0]
    found: list[Path] = []
    monkeypatch.setattr("hhsim.bench.qp.qpbenchmark_export.test_set", found.append)
    exec(compile(text, "hand_ticks.py", "exec"), {"__file__": str(programs.with_name("hand_ticks.py"))})
    assert found == [programs]


def test_a_file_of_something_else_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "ticks.parquet"
    check_program_file(path)
    for file, name in ((path, "Parquet"), (tmp_path / "hand_ticks.py", "test set")):
        file.write_text("mine")
        with pytest.raises(OutputError, match=name):
            check_program_file(path)
        file.unlink()
    with pytest.raises(OutputError, match="parquet"):
        check_program_file(tmp_path / "ticks.h5")


@pytest.mark.parametrize("n", VARIABLES)
def test_ours_is_a_solver_of_qpsolvers(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(10):
        matrix, rhs, target, _ = rows_around(rng, n, 60)
        stiffness = rng.uniform(0.5, 2.0, n)
        problem = qpsolvers.Problem(np.diag(stiffness), -stiffness * target, -matrix, -rhs)
        ours, theirs = solve_as_qpsolvers(problem, verbose=False), qpsolvers.solve_problem(problem, "quadprog")
        assert ours.is_optimal(1e-9) and theirs.x is not None
        np.testing.assert_allclose(ours.x, theirs.x, atol=1e-9)
    matrix, rhs, target = INFEASIBLE_SETS["infeasible by 1"](rng, n, 60)
    assert not solve_as_qpsolvers(qpsolvers.Problem(np.eye(n), -target, -matrix, -rhs)).found


ARGUMENTS = ("bench", "qp", "--problems", "40", "--object", "sphere", "--motion", "random", "--out", "qp.h5")


def test_the_command_prints_tables_and_writes_them(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = run(*ARGUMENTS, "--programs", "ticks.parquet")
    assert answer.code == 0, answer.err
    for words in ("coupled", "the programs are in ticks.parquet", "qpbenchmark --results-path hand_ticks.csv"):
        assert words in answer.out
    table = load_table(tmp_path / "qp.h5")
    assert table.suite == "qp"
    assert table.options["problems"] == 40
    assert (tmp_path / "qp.csv").read_text().startswith("program,")
    assert parquet.read_table(tmp_path / "ticks.parquet").num_rows == 40
    monkeypatch.setattr("hhsim.bench.qp.bench.missed_programs", lambda rows: ["something"])
    answer = run(*ARGUMENTS, "--json")
    document = json.loads(answer.out)
    assert (answer.code, document["missed"]) == (1, ["something"]) and "missed: something" in answer.err
    assert {"rows", "table", "programs", "units"} <= document.keys()
