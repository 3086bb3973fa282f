"""Programs of ticks as a test set of qpbenchmark (github.com/qpsolvers/qpbenchmark), which compares QP solvers.

    minimise ½ xᵀ P x + qᵀ x   subject to   G x <= h

A Parquet file has the programs, and `hand_ticks.py` beside it is the test set. It adds our own solver, as `hhsim`, to
those of qpsolvers.
"""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.bench.qp.recorded_problems import MOVED_BACK, TickProgram
from hhsim.errors import OutputError
from hhsim.solver.qp import QpProblem, QpStatus, solve_active_set
from hhsim.system.atomic_write import partial_file, write_atomically
from hhsim.system.output_path import begins_with, check_output_path, holds

BATCH = 1000
"""Programs that are written together."""
TEST_SET_NAME = "hand_ticks.py"
TEST_SET = '''"""Test set of qpbenchmark: {count:,} programs of hand-rendering ticks, in {programs}."""

from pathlib import Path

from hhsim.bench.qp.qpbenchmark_export import test_set

HandTicks = test_set(Path(__file__).with_name({programs!r}))
'''
MADE_BY = b"hhsim bench qp"
"""Bytes that a file of programs holds; a file without them is not replaced."""
OUR_NAME = "hhsim"
"""Name of our active set among qpbenchmark's solvers."""
RUNTIME = 1.0
"""Time limit of a solve [s]."""


def check_program_file(path: Path) -> None:
    """Check before the work that programs and their test set can be written.

    Raises OutputError as `hhsim.system.output_path.check_output_path`; for a name that does not end in .parquet; or for
    an existing file that is no Parquet file, or no test set of ours.
    """
    if path.suffix != ".parquet":
        raise OutputError(f"{path} must end in .parquet: the programs go there")
    test_set_path = path.with_name(TEST_SET_NAME)
    check_output_path(path, "Parquet file of programs", holds(MADE_BY))
    check_output_path(test_set_path, "test set of ours", begins_with(TEST_SET.partition("{")[0].encode()))


def export_programs(programs: Iterable[TickProgram], path: Path) -> Iterator[TickProgram]:
    """Yield the programs, and write them with their test set.

    A row is a conditioned program, see `QpProblem.conditioned`: `P` (the identity), `q`, `G`, `h` (matrices row by
    row), `A`, `b`, `lb` and `ub`, which are empty, and `name`: kind, number and scene. The rows are in the order in
    which a run solves them, so that warm starts can be judged. Further columns, which qpbenchmark ignores: `scene`,
    `kind`, `tick` and `step` (linearisation of the tick, from 0). Raises OutputError where it cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    numbers = pyarrow.list_(pyarrow.float64())
    fields = [(name, numbers) for name in ("P", "q", "G", "h", "A", "b", "lb", "ub")]
    fields += [(name, pyarrow.string()) for name in ("name", "kind", "scene")]
    fields += [(name, pyarrow.int64()) for name in ("tick", "step")]
    schema = pyarrow.schema(fields, metadata={"made_by": MADE_BY})
    source, written = iter(programs), 0
    try:
        with partial_file(path) as partial, parquet.ParquetWriter(partial, schema) as file:
            while batch := list(islice(source, BATCH)):
                rows = [_row(program, written + i) for i, program in enumerate(batch)]
                file.write_table(pyarrow.Table.from_pylist(rows, schema=schema))
                written += len(batch)
                yield from batch
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error}") from error
    text_of_set = TEST_SET.format(count=written, programs=path.name)
    write_atomically(path.with_name(TEST_SET_NAME), text_of_set.encode())


def _row(program: TickProgram, number: int) -> dict[str, Any]:
    root, matrix, norm = program.problem.conditioned()
    return {
        "P": np.eye(root.size).ravel(),
        "q": -root * program.problem.target,
        "G": -matrix.ravel(),
        "h": -program.problem.rhs / norm,
        "name": f"{program.kind} {number} {program.source}",
        "kind": program.kind,
        "scene": program.source,
        "tick": program.tick,
        "step": program.step,
    }


def qpbenchmark_commands(path: Path) -> list[str]:
    """Return the command lines that install qpbenchmark and run it on the programs of a file."""
    test_set_path, results = path.with_name(TEST_SET_NAME), path.with_name("hand_ticks.csv")
    return [
        "pip install qpbenchmark 'hhsim[solvers]'",
        f"qpbenchmark --results-path {results} {test_set_path} run --author me",
    ]


def test_set(path: Path) -> type:
    """Return the test set of a file of programs, a class of qpbenchmark, with our solver among those that it runs.

    Raises ImportError without qpbenchmark.
    """
    import qpsolvers
    from qpbenchmark.parquet_test_set import ParquetTestSet
    from qpbenchmark.solver_settings import SolverSettings

    qpsolvers.solvers.solve_function[OUR_NAME] = solve_as_qpsolvers
    for names in (qpsolvers.available_solvers, qpsolvers.dense_solvers):
        if OUR_NAME not in names:
            names.append(OUR_NAME)
    SolverSettings.IMPLEMENTED_SOLVERS.add(OUR_NAME)

    class HandTicks(ParquetTestSet):  # type: ignore[misc]
        title = description = "Programs of hand-rendering ticks"
        sparse_only = False

        def __init__(self) -> None:
            super().__init__(path)

        def define_tolerances(self, runtime: float = RUNTIME) -> None:
            super().define_tolerances(runtime)

    return HandTicks


def solve_as_qpsolvers(problem: Any, **options: Any) -> Any:
    """Solve a `qpsolvers.Problem` with a diagonal P and G x <= h by our active set; return a `qpsolvers.Solution`."""
    import qpsolvers

    stiffness = np.diag(problem.P)
    rows = QpProblem(stiffness, -problem.G, -problem.h, -problem.q / stiffness)
    found = solve_active_set(rows, MOVED_BACK)
    solution = qpsolvers.Solution(problem)
    solution.found = found.status is QpStatus.OPTIMAL
    if solution.found:
        solution.x, solution.y, solution.z, solution.z_box = found.x, np.zeros(0), found.multiplier, np.zeros(0)
    return solution
