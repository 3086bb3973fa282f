"""Programs as a file that qpbenchmark reads, as its `ParquetTestSet`.

    minimise ½ xᵀ P x + qᵀ x   subject to   G x <= h

A row is a program: `P` (the identity, in the variables of `hhsim.bench.qp.program`), `q`, `G`, `h` (matrices row by
row), `A`, `b`, `lb` and `ub`, which are empty, and `name`: kind, number and scene. The rows are in the order in which a
run solves them, so that warm starts can be judged. Further columns, which qpbenchmark ignores: `scene`, `kind`, `tick`,
`step` (linearisation of the tick, from 0) and `guess` (rows of G expected to be active).
"""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from hhsim.bench.qp.program import Program
from hhsim.errors import OutputError
from hhsim.system.input_file import read_input
from hhsim.system.output_path import check_output_path

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
    """Yield the programs, and write them to a file that replaces one of that name.

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
