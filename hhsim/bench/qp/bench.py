"""`hhsim bench qp`: the programs of real ticks, solved by our active set, and written for qpbenchmark.

Every answer is judged from the program alone, by its KKT residual. `hhsim.bench.qp.qpbenchmark_export` has the file
with which qpbenchmark compares solvers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.bench.qp.qpbenchmark_export import export_programs
from hhsim.bench.qp.recorded_problems import MOVED_BACK, QpBenchOptions, TickProgram, harvest
from hhsim.solver.qp import QpStatus, solve_active_set
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column, Table

RESIDUAL_LIMIT = 1e-9
"""Largest KKT residual of a solution, in sizes of the program."""


@dataclass
class SolvedPrograms:
    """Programs of one kind, and our answers to them."""

    kind: str
    variables: int = 0  # number of variables, the largest of all
    rows: list[int] = field(default_factory=list)  # number of rows of each
    residual: list[float] = field(default_factory=list)  # KKT residual of each answer, in sizes of the program
    infeasible: int = 0  # number of programs whose rows contradict each other
    missed: int = 0  # number of programs without an answer, or with a residual above `RESIDUAL_LIMIT`

    def add(self, program: TickProgram) -> None:
        """Solve a program and count the answer."""
        problem = program.problem
        self.variables = max(self.variables, problem.target.size)
        self.rows.append(problem.rhs.size)
        answer = solve_active_set(problem, MOVED_BACK)
        if answer.status is QpStatus.INFEASIBLE:
            self.infeasible += 1
            return
        residual = program.residual(answer)
        self.residual.append(residual)
        self.missed += answer.status is not QpStatus.OPTIMAL or not residual <= RESIDUAL_LIMIT


COLUMNS = (
    Column("program", "kind of program", of="kind"),
    Column("variables", "number of variables, largest"),
    Column("rows", "number of rows, median", of=lambda found: float(np.median(found.rows))),
    Column("problems", "programs of this kind", of=lambda found: len(found.rows)),
    Column("solved", "programs with an answer of ours", of=lambda found: len(found.residual) - found.missed),
    Column("infeasible", "programs whose rows contradict each other, by a certificate of ours"),
    Column("missed", f"programs without an answer, or with a residual above {RESIDUAL_LIMIT:g}"),
    Column(
        "residual_max",
        "KKT residual of our answers in sizes of the program, largest",
        of=lambda found: max(found.residual, default=None),
    ),
)


def bench_qp(
    options: QpBenchOptions, programs: Path | None = None, progress: Progress = silent
) -> list[dict[str, Any]]:
    """Harvest programs and solve them; return a row for each kind, by the names of `COLUMNS`.

    The programs are written to the file `programs`, see `export_programs`; raises OutputError where they cannot be.
    """
    kinds: dict[str, SolvedPrograms] = {}
    harvested = harvest(options, progress)
    for program in harvested if programs is None else export_programs(harvested, programs):
        kinds.setdefault(program.kind, SolvedPrograms(program.kind)).add(program)
    return Table(COLUMNS, list(kinds.values())).records


def missed_programs(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a sentence for each kind of program of which ours missed any."""
    return [
        f"{row['program']}: {row['missed']} of {row['problems']} programs not solved to {RESIDUAL_LIMIT:g} and not "
        "found infeasible"
        for row in rows
        if row["missed"]
    ]
