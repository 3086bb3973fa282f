"""`hhsim bench qp`: the programs of real ticks, solved by every installed solver, and as a file for qpbenchmark.

Ours solves all of them (`hhsim.bench.qp.recorded_problems`), from nothing and from the guess of the tick, and every
answer is checked from the program alone (`hhsim.bench.qp.program`). A fair sample of each kind is solved by every
solver in turns, and timed.
"""

import random
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.bench.qp.program import (
    CERTIFIED_RADIUS,
    QUICK,
    WARM,
    WARM_DAQP,
    Answer,
    Program,
    ProgramSolver,
    certified_radius,
    overhead,
    prepare,
    residual,
    violation,
)
from hhsim.bench.qp.recorded_problems import QpBenchOptions, harvest
from hhsim.errors import OutputError
from hhsim.solver.qp import ACTIVE_SET
from hhsim.system.environment import package_version
from hhsim.system.input_file import read_input
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column

BATCH = 1000
"""Programs that are written together."""


def check_problem_file(path: Path) -> None:
    """Check before the work that programs can be written.

    Raises:
        OutputError: As `hhsim.system.output_path.check_output_path`; a name that does not end in .parquet; or an
            existing file that is no Parquet file.
    """
    if path.suffix != ".parquet":
        raise OutputError(f"{path} must end in .parquet: the programs go there")
    check_output_path(path)
    if path.exists() and read_input(path)[:4] != b"PAR1":
        raise OutputError(f"{path} exists and is no Parquet file, so it is not replaced: name another")


def written(programs: Iterable[Program], path: Path) -> Iterator[Program]:
    """Yield the programs, and write them to a file that qpbenchmark reads, as its `ParquetTestSet`.

        minimise ½ xᵀ P x + qᵀ x   subject to   G x <= h

    A row is a program: `P` (the identity, in the variables of `hhsim.bench.qp.program`), `q`, `G`, `h` (matrices row
    by row), `A`, `b`, `lb` and `ub`, which are empty, and `name`: kind, number and scene. The rows are in the order in
    which a run solves them, so that warm starts can be judged. Further columns, which qpbenchmark ignores: `scene`,
    `kind`, `tick`, `step` (linearisation of the tick, from 0) and `guess` (rows of G expected to be active).

    Raises:
        OutputError: It cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    numbers = pyarrow.list_(pyarrow.float64())
    fields = [(name, numbers) for name in ("P", "q", "G", "h", "A", "b", "lb", "ub")]
    text, count = pyarrow.string(), pyarrow.int64()
    order = [("kind", text), ("scene", text), ("tick", count), ("step", count), ("guess", pyarrow.list_(count))]
    schema = pyarrow.schema([*fields, ("name", text), *order])
    source = enumerate(programs)
    try:
        with parquet.ParquetWriter(path, schema) as file:
            while batch := list(islice(source, BATCH)):
                rows = [
                    {
                        "P": np.eye(program.variables).ravel(),
                        "q": -program.target,
                        "G": -program.matrix.ravel(),
                        "h": -program.rhs,
                        "name": f"{program.kind} {number} {program.source}",
                        "kind": program.kind,
                        "scene": program.source,
                        "tick": program.tick,
                        "step": program.step,
                        "guess": program.guess,
                    }
                    for number, program in batch
                ]
                file.write_table(pyarrow.Table.from_pylist(rows, schema=schema))
                yield from (program for _, program in batch)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error}") from error


SAMPLE = 100
"""Number of programs of a kind that every solver solves."""
PATIENCE = 5.0
"""Time after which another solver skips the rest of a kind [s]."""
ROUNDS = 3
"""Turns of each solver at each program."""
IN_A_ROW = 5
"""Solves in a turn, whose median counts: the first finds a cold cache."""
SOLVED_LIMIT = 1e-6
"""Largest residual, in sizes of the program, of a solution of another solver."""
OWN_LIMIT = 1e-9
"""Largest residual of a solution of ours."""

COLUMNS = (
    Column("program", "kind of program"),
    Column("variables", "number of variables, largest"),
    Column("rows", "number of rows, median"),
    Column("solver", "solver; warm: from the guess that the tick had"),
    Column("problems", "programs it was given: ours all, another a sample"),
    Column("solved", "answers with residuals of 1e-6 or less, of ours 1e-9 or less"),
    Column("refused", "rightly refused: the rows contradict each other; ours proves it"),
    Column("missed", "no answer although there is one, a wrong one, or a refusal that is not proved"),
    Column("residual_p99", "KKT residual in sizes of the program, 99th percentile"),
    Column("residual_max", "KKT residual in sizes of the program, largest"),
    Column("iterations", "iterations, mean (ours only)"),
    Column("call_p50", "wall time of the call as Python sees it, median", "s"),
    Column("call_p99", "the same, 99th percentile", "s"),
    Column("native_p50", "wall time without Python's share, median", "s"),
    Column("native_p99", "the same, 99th percentile", "s"),
)


@dataclass
class Tally:
    """Answers of one solver to the programs of one kind.

    Attributes:
        verdicts: Numbers of programs solved, refused (rightly: the rows contradict each other) and missed.
        residual: Of each answer to a feasible program, in sizes of the program.
        iterations: Of each solve.
        call: Times of the calls from Python [ns].
        native: Times of the calls without Python's share [ns].
    """

    verdicts: Counter[str] = field(default_factory=Counter)
    residual: list[float] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)
    call: list[float] = field(default_factory=list)
    native: list[float] = field(default_factory=list)

    def count_answer(self, program: Program, answer: Answer, feasible: bool) -> None:
        """Count an answer of another solver."""
        if answer.x is None:
            self.verdicts["missed" if feasible else "refused"] += 1
            return
        # An answer to contradicting rows violates one; its other residuals tell nothing.
        found = residual(program, answer.x, answer.multiplier) if feasible else violation(program, answer.x)
        if feasible:
            self.residual.append(found)
        self.verdicts["solved" if found <= SOLVED_LIMIT else "missed"] += 1

    def count_times(self, call: Sequence[float], native: Sequence[float]) -> None:
        """Count the medians of a turn [ns]."""
        self.call.append(float(np.median(call)))
        self.native.append(float(np.median(native)))

    def count_own(self, program: Program, answer: Answer) -> None:
        """Count an answer of ours, whose certificate must prove a refusal."""
        self.iterations.append(answer.iterations)
        if answer.x is None:
            certificate = answer.certificate
            proved = certificate is not None and certified_radius(program, certificate) >= CERTIFIED_RADIUS
            self.verdicts["refused" if proved else "missed"] += 1
            return
        found = residual(program, answer.x, answer.multiplier)
        if program.relaxation > 0.0 and found > OWN_LIMIT:
            # Rows that contradict each other by rounding are moved back, see `kernels.qp.active_set`.
            found = min(found, residual(program, answer.x, answer.multiplier, program.relaxation))
        self.residual.append(found)
        self.verdicts["solved" if found <= OWN_LIMIT else "missed"] += 1

    def row(self, kind: str, variables: int, rows: Sequence[int], solver: str) -> dict[str, Any]:
        """Return a row of the table."""
        times = {"call": self.call, "native": self.native}
        return {
            "program": kind,
            "variables": variables,
            "rows": float(np.median(rows)),
            "solver": solver,
            "problems": self.verdicts.total(),
            **{verdict: self.verdicts[verdict] for verdict in ("solved", "refused", "missed")},
            "residual_p99": _percentile(self.residual, 99),
            "residual_max": max(self.residual, default=None),
            "iterations": float(np.mean(self.iterations)) if self.iterations else None,
            **{f"{name}_p{share}": _percentile(of, share, 1e-9) for name, of in times.items() for share in (50, 99)},
        }


@dataclass
class _Kind:
    """Harvested programs of one kind: sizes, a sample and the tallies."""

    variables: int = 0
    rows: list[int] = field(default_factory=list)
    sample: list[Program] = field(default_factory=list)
    tallies: dict[str, Tally] = field(default_factory=lambda: {ACTIVE_SET: Tally(), WARM: Tally()})


def bench_qp(
    options: QpBenchOptions, programs: Path | None = None, progress: Progress = silent
) -> list[dict[str, Any]]:
    """Harvest, solve, check and time; return a row for each kind of program and solver, by the names of `COLUMNS`.

    Args:
        programs: File of the harvested programs, see `written`; None for none.

    Raises:
        OutputError: The programs cannot be written.
    """
    solver = ProgramSolver()
    kinds: dict[str, _Kind] = {}
    draw = random.Random(options.seed)
    harvested = harvest(options, progress)
    for program in harvested if programs is None else written(harvested, programs):
        kind = kinds.setdefault(program.kind, _Kind())
        kind.tallies[ACTIVE_SET].count_own(program, solver.solve(program.unguessed()))
        kind.tallies[WARM].count_own(program, solver.solve(program))
        kind.variables = max(kind.variables, program.variables)
        kind.rows.append(program.rows)
        # A fair sample of a stream of unknown length.
        if len(kind.sample) < SAMPLE:
            kind.sample.append(program)
        elif (place := draw.randrange(len(kind.rows))) < SAMPLE:
            kind.sample[place] = program
    others = [*options.solvers(), *([WARM_DAQP] if "daqp" in options.solvers() else [])]
    python_share = {backend: overhead(backend) if backend in QUICK else 0.0 for backend in others}
    for number, kind in enumerate(kinds.values()):
        _time(kind, python_share, solver)
        progress("timing", number + 1, len(kinds))
    return [
        tally.row(name, kind.variables, kind.rows, backend)
        for name, kind in kinds.items()
        for backend, tally in kind.tallies.items()
    ]


def _time(kind: _Kind, python_share: dict[str, float], solver: ProgramSolver) -> None:
    kind.tallies |= {name: Tally() for name in python_share}
    spent = dict.fromkeys(python_share, 0.0)
    for program in kind.sample:
        feasible = solver.solve(program).x is not None
        calls = {name: prepare(name, program, share) for name, share in python_share.items() if spent[name] < PATIENCE}
        for _ in range(ROUNDS):
            for name, given in ((ACTIVE_SET, program.unguessed()), (WARM, program)):
                calls_of_ours = [solver.solve(given).call for _ in range(IN_A_ROW)]
                kind.tallies[name].count_times(calls_of_ours, [solver.solve(given, IN_A_ROW).native])
            for name, solve in calls.items():
                began = time.perf_counter()
                answers = [solve() for _ in range(IN_A_ROW)]
                spent[name] += time.perf_counter() - began
                kind.tallies[name].count_times([a.call for a in answers], [a.native for a in answers])
        for name, solve in calls.items():
            kind.tallies[name].count_answer(program, solve(), feasible)


def missed_programs(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the programs that ours missed, a sentence a kind."""
    return [
        f"{row['program']}, {row['solver']}: {row['missed']} of {row['problems']} programs not solved to "
        f"{OWN_LIMIT:g} and not proved infeasible"
        for row in rows
        if row["solver"] in (ACTIVE_SET, WARM) and row["missed"]
    ]


def solver_versions(backends: Sequence[str]) -> dict[str, str]:
    """Return the installed version of each solver besides ours; empty if it has none."""
    distributions = {"proxqp": "proxsuite", "highs": "highspy", "sip": "sip_python"}
    return {backend: package_version(distributions.get(backend, backend)) or "" for backend in backends}


def _percentile(values: list[float], share: float, unit: float = 1.0) -> float | None:
    return unit * float(np.percentile(values, share)) if values else None
