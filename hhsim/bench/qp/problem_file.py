"""Programs as a file that qpbenchmark reads, as its `ParquetTestSet`.

    minimise ½ xᵀ P x + qᵀ x   subject to   G x <= h

A row is a program: `P`, `q`, `G`, `h` (matrices row by row), `A`, `b`, `lb` and `ub`, which are empty, and `name`: its
kind, a number and where it was found. The variables are those of `hhsim.bench.qp.program`, so that P is the identity.
"""

from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from hhsim.bench.qp.program import Program
from hhsim.errors import OutputError
from hhsim.system.output_path import check_output_path

FLUSH = 1000
"""Programs that wait in memory to be written together."""


def check_problem_file(path: Path) -> None:
    """Look, before the work, for what would keep programs from being written.

    Raises:
        OutputError: As `hhsim.system.output_path.check_output_path`; a name that does not end in .parquet; or a file is
            there that is none, which a slip of the pen must not destroy.
    """
    if path.suffix != ".parquet":
        raise OutputError(f"{path} must end in .parquet: the programs go there")
    check_output_path(path)
    if path.exists() and path.read_bytes()[:4] != b"PAR1":
        raise OutputError(f"{path} exists and is no Parquet file, so it is not replaced: name another")


class ProblemFile:
    """Writes programs one after the other, however many there are; to be used in a `with` statement."""

    def __init__(self, path: Path) -> None:
        """Open the file; one of that name is replaced.

        Raises:
            OutputError: It cannot be written.
        """
        import pyarrow
        from pyarrow import parquet

        numbers = pyarrow.list_(pyarrow.float64())
        fields = [(name, numbers) for name in ("P", "q", "G", "h", "A", "b", "lb", "ub")]
        self._schema = pyarrow.schema([*fields, ("name", pyarrow.string())])
        self._waiting: list[dict[str, Any]] = []
        self._count = 0
        try:
            self._writer = parquet.ParquetWriter(path, self._schema)
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error}") from error

    def append(self, program: Program) -> None:
        """Write a program."""
        self._waiting.append(
            {
                "P": np.eye(program.variables).ravel(),
                "q": -program.target,
                "G": -program.matrix.ravel(),
                "h": -program.rhs,
                "name": f"{program.kind} {self._count} {program.source}",
            }
        )
        self._count += 1
        if len(self._waiting) == FLUSH:
            self._flush()

    def __enter__(self) -> "ProblemFile":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._flush()
        self._writer.close()

    def _flush(self) -> None:
        import pyarrow

        self._writer.write_table(pyarrow.Table.from_pylist(self._waiting, schema=self._schema))
        self._waiting = []
