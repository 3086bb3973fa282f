"""`hhsim bench qp` on a small scale: the library, the calls of other solvers, the command."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import qpsolvers
from conftest import Run
from pyarrow import parquet
from qp_problems import contact_programs, degenerate_set

from hhsim.bench.qp import bench, recorded_problems
from hhsim.bench.qp.bench import Tally, bench_qp, missed_programs
from hhsim.bench.qp.program import ProgramSolver, overhead, prepare, residual
from hhsim.bench.qp.recorded_problems import QpBenchOptions, harvest
from hhsim.bench.table import load_table
from hhsim.solver.qp import available_backends

SMALL = QpBenchOptions(
    problems=100, objects=("sphere",), motions=("grasp", "random"), backends=("daqp", "quadprog", "clarabel")
)
ACCURATE = ("clarabel", "daqp", "quadprog")
SAMPLE = 12


@pytest.fixture(scope="module", autouse=True)
def few() -> Iterator[None]:
    """A short random motion, and few programs that every solver solves."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_problems, "RANDOM_TICKS", 600)
        patch.setattr(bench, "SAMPLE", SAMPLE)
        yield


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("qp") / "programs.parquet"


@pytest.fixture(scope="module")
def rows(programs: Path, few: None) -> list[dict[str, Any]]:
    return bench_qp(SMALL, programs)


def test_ours_solves_everything_and_proves_what_it_refuses(rows: list[dict[str, Any]]) -> None:
    assert missed_programs(rows) == []
    own = [row for row in rows if row["solver"] in ("active-set", "active-set, warm")]
    assert sum(row["problems"] for row in own) == 2 * SMALL.problems
    for row in own:
        assert row["solved"] + row["refused"] == row["problems"] > 0
        assert row["residual_max"] <= 1e-9


def test_every_solver_has_a_row_for_every_kind(rows: list[dict[str, Any]]) -> None:
    solvers = ["active-set", "active-set, warm", *(SMALL.backends or ()), "daqp, warm"]
    for kind in {row["program"] for row in rows}:
        mine = [row for row in rows if row["program"] == kind]
        assert [row["solver"] for row in mine] == solvers
        for row in mine:
            # A backend's time is its call's less Python's share: on a busy machine that can be all of it.
            assert 0.0 <= row["native_p50"] <= row["native_p99"]
            assert 0.0 < row["call_p50"] <= row["call_p99"]
            assert row["residual_max"] < 1e-6
            assert row["missed"] == 0
            if row["solver"] != "active-set":
                assert row["problems"] in (mine[0]["problems"], min(SAMPLE, mine[0]["problems"]))
    assert {"coupled", "finger"} <= {row["program"] for row in rows}


def test_the_programs_are_written_as_qpbenchmark_reads_them(rows: list[dict[str, Any]], programs: Path) -> None:
    taken = parquet.read_table(programs).to_pylist()
    order = {"kind", "scene", "tick", "step", "guess"}
    assert set(taken[0]) == {"P", "q", "G", "h", "A", "b", "lb", "ub", "name"} | order
    assert len({one["name"] for one in taken}) == len(taken) == SMALL.problems
    solver = ProgramSolver()
    same = harvest(SMALL)
    for one, program in zip(taken[::10], list(same)[::10], strict=True):
        n = len(one["q"])
        matrices = {key: np.array(one[key]).reshape(-1, n) for key in ("P", "G")}
        problem = qpsolvers.Problem(matrices["P"], np.array(one["q"]), matrices["G"], np.array(one["h"]))
        theirs = qpsolvers.solve_problem(problem, "quadprog")
        ours = solver.solve(program)
        assert theirs.found == (ours.x is not None)
        if theirs.x is not None and ours.x is not None:
            np.testing.assert_allclose(theirs.x, ours.x, atol=1e-7 * program.size)


@pytest.mark.parametrize("backend", available_backends()[1:])
def test_each_installed_solver_finds_the_same_solution(backend: str) -> None:
    solver = ProgramSolver()
    for n, m in ((3, 20), (6, 60), (21, 80)):
        for program in contact_programs(n, m, 3, seed=1):
            solve = prepare(backend, program)
            for _ in range(2):
                answer = solve()
                assert answer.call > 0
                if answer.x is None and backend not in ACCURATE:
                    continue
                ours = solver.solve(program)
                assert answer.x is not None
                assert ours.x is not None
                atol = (1e-7 if backend in ACCURATE else 1e-3) * program.size
                np.testing.assert_allclose(answer.x, ours.x, atol=atol)
                assert residual(program, answer.x, answer.multiplier) < atol
    assert overhead(backend, 3) > 0.0


def test_daqp_takes_a_guess() -> None:
    solver = ProgramSolver()
    for program in contact_programs(21, 100, 5, seed=2):
        cold = solver.solve(program)
        guessed = replace(program, guess=np.flatnonzero(cold.multiplier))
        for answer in (prepare("daqp, warm", guessed)() for _ in range(2)):
            assert answer.x is not None
            assert cold.x is not None
            np.testing.assert_allclose(answer.x, cold.x, atol=1e-9)


def counted(tally: Tally) -> tuple[int, int, int]:
    return tally.verdicts["solved"], tally.verdicts["refused"], tally.verdicts["missed"]


@pytest.mark.parametrize("backend", ACCURATE)
def test_a_contradiction_is_no_solution(backend: str) -> None:
    tally = Tally()
    for program in degenerate_set("infeasible by 1", 6, 5, seed=0):
        tally.count_answer(program, prepare(backend, program)(), feasible=False)
    assert counted(tally) == (0, 5, 0)


def test_a_tally_tells_right_from_wrong() -> None:
    (program,) = contact_programs(3, 20, 1, seed=0)
    (contradiction,) = degenerate_set("infeasible by 1e-9", 3, 1, seed=0)
    solver = ProgramSolver()
    answer, refused = solver.solve(program), solver.solve(contradiction)
    assert answer.x is not None
    assert refused.certificate is not None

    def counts(*answers: tuple[Any, Any, bool]) -> tuple[int, int, int]:
        tally = Tally()
        for one, given, feasible in answers:
            tally.count_answer(one, given, feasible)
        return counted(tally)

    nothing = replace(answer, x=None)
    assert counts((program, answer, True)) == (1, 0, 0)
    assert counts((contradiction, nothing, False)) == (0, 1, 0)
    far = replace(refused, x=np.full(3, 1e6))
    for wrong in (replace(answer, x=answer.x + 1.0), replace(answer, x=answer.x * np.nan), nothing):
        assert counts((program, wrong, True)) == (0, 0, 1)
    assert counts((contradiction, far, False)) == (0, 0, 1)

    tally = Tally()
    tally.count_own(program, answer)
    tally.count_own(contradiction, refused)
    assert counted(tally) == (1, 1, 0)
    tally.count_own(contradiction, replace(refused, certificate=refused.certificate * 0.0))
    tally.count_own(program, replace(refused, certificate=None))
    tally.count_own(program, replace(answer, x=answer.x + 1e-8 * program.size))
    assert counted(tally) == (1, 1, 3)


def test_a_miss_is_said(rows: list[dict[str, Any]]) -> None:
    own, other = (
        {**next(row for row in rows if row["solver"] == name), "missed": 1} for name in ("active-set", "daqp")
    )
    (sentence,) = missed_programs([own, other])
    assert sentence.startswith(f"{own['program']}, active-set: 1 of {own['problems']} programs")


ARGUMENTS = (
    *("bench", "qp", "--problems", "40", "--object", "sphere", "--motion", "random"),
    *("--qp", "daqp", "--programs", "ticks.parquet", "--out", "qp.h5"),
)


def test_the_command_prints_tables_and_writes_them(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = run(*ARGUMENTS)
    assert answer.code == 0, answer.err
    for words in ("coupled: 21 variables", "active-set, warm", "daqp", "the programs are in ticks.parquet"):
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
    assert document["options"]["backends"] == ["daqp"] and document["versions"]["daqp"]
    assert {"rows", "table", "programs", "units"} <= document.keys()
