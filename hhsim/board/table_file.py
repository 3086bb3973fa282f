"""The board as a file: each run a row (CSV, Parquet), or as people read it (Markdown, LaTeX)."""

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hhsim.bench.table import spelled
from hhsim.board.collect import Board
from hhsim.board.latex import latex_text
from hhsim.board.page import board_page
from hhsim.board.shown import machine_line, shown_standings
from hhsim.board.standings import Standing
from hhsim.errors import InputError, OutputError
from hhsim.metrics.run.registry import run_metrics
from hhsim.system.output_path import check_output_path

KINDS = (".html", ".csv", ".parquet", ".md", ".tex")
OF_ENTRY = ("object", "motion", "method", "surface", "option_set", "options")
WORDS = (*OF_ENTRY, "machine", "processor", "hhsim", "created", "verdict")
FLAG = "times_comparable"
DEVIATION = "_std"
"""Ending of the column of a time's standard deviation over several runs."""


def rows_of(board: Board) -> list[dict[str, Any]]:
    """Each run, failed ones too, by the column's name; None for what is not known."""
    found = []
    for entry in (*board.entries, *board.failed):
        machine = json.loads(entry.machine or "{}")
        found.append(
            {
                **{name: getattr(entry, name) for name in WORDS if name not in ("machine", "processor")},
                "machine": board.machines.get(entry.machine, ""),
                "processor": machine_line(machine),
                FLAG: entry.own_core,
                "runs": entry.runs,
                **{name: entry.figures.get(name) for name in run_metrics()},
                **{
                    name + DEVIATION: entry.deviations.get(name)
                    for name, metric in run_metrics().items()
                    if metric.noise
                },
                "reason": entry.reason,
                "source": entry.source,
            }
        )
    return found


def columns() -> dict[str, str]:
    """Unit of each column by its name: SI, % where a figure is defined so, "" for words, counts and truths."""
    figures = {name: "" if metric.stored_unit == "1" else metric.stored_unit for name, metric in run_metrics().items()}
    deviations = {name + DEVIATION: figures[name] for name, metric in run_metrics().items() if metric.noise}
    return {**dict.fromkeys(WORDS, ""), FLAG: "", "runs": "", **figures, **deviations, "reason": "", "source": ""}


def csv_text(board: Board) -> str:
    """As CSV: one line of headings with units, missing figures empty, numbers in full precision."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{name} [{unit}]" if unit else name for name, unit in columns().items()])
    for row in rows_of(board):
        writer.writerow([spelled(row[name]) for name in columns()])
    return text.getvalue()


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
    rows = rows_of(board)
    fields = []
    for name, unit in columns().items():
        words = name in WORDS or name in ("reason", "source")
        kind = pyarrow.string() if words else pyarrow.bool_() if name == FLAG else pyarrow.float64()
        fields.append(pyarrow.field(name, kind, metadata={"unit": unit} if unit else None))
    stream = io.BytesIO()
    parquet.write_table(pyarrow.Table.from_pylist(rows, schema=pyarrow.schema(fields)), stream)
    return stream.getvalue()


def markdown_text(board: Board, standings: Sequence[Standing]) -> str:
    """The standings as a table of Markdown, and what there is to say of them."""
    headings, rows, notes = shown_standings(board, standings)
    lines = [_line(headings), _line(["---"] * len(headings)), *(_line(row) for row in rows)]
    return "\n".join([*lines, "", *(f"- {note}" for note in notes), ""])


def _line(cells: Sequence[str]) -> str:
    safe = [cell.replace("|", r"\|") for cell in cells]
    return f"| {' | '.join(safe)} |"


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
        return csv_text(board).encode()
    if kind == ".parquet":
        return parquet_bytes(board)
    if kind == ".md":
        return markdown_text(board, standings).encode()
    if kind == ".tex":
        return latex_text(board, standings).encode()
    return board_page(board, standings).encode()
