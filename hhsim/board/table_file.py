"""The board as a file: each run a row (CSV, Parquet), or as people read it (Markdown, LaTeX)."""

import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from hhsim.board.collect import Board
from hhsim.board.entry import Entry
from hhsim.board.page import board_page
from hhsim.board.shown import document_table, machine_line
from hhsim.board.standings import Standing
from hhsim.errors import InputError, OutputError
from hhsim.metrics.run.registry import run_metrics
from hhsim.system.output_path import check_output_path
from hhsim.table.table import BARE, Column, Table, words

KINDS = (".html", ".csv", ".parquet", ".md", ".tex")


def run_table(board: Board) -> Table:
    """Return each run, failed ones too, with every figure: for programs."""
    metrics = run_metrics().items()
    columns = [
        *(words(name) for name in ("object", "motion", "method", "surface", "option_set", "options")),
        words("machine", lambda entry: board.machines.get(entry.machine, "")),
        words("processor", lambda entry: machine_line(json.loads(entry.machine or "{}"))),
        *(words(name) for name in ("hhsim", "created", "verdict")),
        Column("times_comparable", of="own_core"),
        Column("runs"),
        *(Column(name, unit=metric.stored_unit, of=_taken("figures", name)) for name, metric in metrics),
        *(
            Column(f"{name}_std", unit=metric.stored_unit, of=_taken("deviations", name))
            for name, metric in metrics
            if metric.noise
        ),
        *(words(name) for name in ("reason", "source")),
    ]
    return Table(columns, (*board.entries, *board.failed))


def _taken(attribute: str, name: str) -> Callable[[Entry], float | None]:
    return lambda entry: getattr(entry, attribute).get(name)


def parquet_bytes(board: Board) -> bytes:
    """As Parquet; the unit of a column is in its metadata.

    Raises:
        InputError: No pyarrow.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise InputError("a Parquet file: pip install pyarrow") from None
    table = run_table(board)
    fields = []
    for column in table.columns:
        kind = pyarrow.string() if not column.is_number else pyarrow.float64()
        kind = pyarrow.bool_() if column.name == "times_comparable" else kind
        fields.append(pyarrow.field(column.name, kind, metadata=None if column.unit in BARE else {"unit": column.unit}))
    stream = io.BytesIO()
    parquet.write_table(pyarrow.Table.from_pylist(table.records, schema=pyarrow.schema(fields)), stream)
    return stream.getvalue()


def check_board_path(path: Path) -> None:
    """Look, before the work, for what would keep a board from being written.

    Raises:
        OutputError: As `hhsim.system.output_path.check_output_path`; or a name that ends otherwise.
    """
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{path}: a board ends in {', '.join(KINDS)}")
    check_output_path(path)


def content_of(path: Path, board: Board, standings: Sequence[Standing]) -> bytes:
    """What a file of this name holds.

    Raises:
        InputError: No pyarrow.
    """
    kind = path.suffix.lower()
    if kind == ".csv":
        return run_table(board).csv().encode()
    if kind == ".parquet":
        return parquet_bytes(board)
    if kind == ".md":
        document = document_table(board, standings)
        return "\n".join([document.markdown(), "", *(f"- {note}" for note in document.notes), ""]).encode()
    if kind == ".tex":
        return document_table(board, standings).latex().encode()
    return board_page(board, standings).encode()
