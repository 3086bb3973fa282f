"""Files of the board: each run a row (CSV, Parquet), or as people read it (HTML, Markdown, LaTeX)."""

import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from hhsim import __version__
from hhsim.board.entry import Board, Entry
from hhsim.board.shown import document_table, entry_table, machine_line, standing_table
from hhsim.board.standings import Standing
from hhsim.errors import InputError, OutputError
from hhsim.metrics.run.registry import run_metrics
from hhsim.system.counted import counted
from hhsim.system.output_path import check_output_path
from hhsim.table.html import render
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
    """Return the runs as Parquet, with units in the columns' metadata; raise InputError without pyarrow."""
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
    """Raise OutputError, before the work, if a board cannot be written there or the name ends otherwise."""
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{path}: a board ends in {', '.join(KINDS)}")
    check_output_path(path)


def content_of(path: Path, board: Board, standings: Sequence[Standing]) -> bytes:
    """Return what a file of this name holds; raise InputError without pyarrow where it is needed."""
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


def board_page(board: Board, standings: Sequence[Standing]) -> str:
    """Return the HTML page: the standings, then each run; its tables sort at a click and filter by words."""
    return render(
        "board/board.html",
        title=f"Board of {counted(len(board.entries), 'run')}",
        generator="hhsim board",
        version=__version__,
        script=Path(__file__).with_name("board.js").read_text(encoding="utf-8"),
        standings=standing_table(board, standings),
        runs=entry_table(board),
    )
