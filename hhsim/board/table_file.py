"""Tables of the board as people read them, and its files: each run a row (CSV), or HTML, Markdown, LaTeX."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hhsim import __version__
from hhsim.board.entry import Board, Entry, shown_options
from hhsim.board.standings import Standing
from hhsim.errors import OutputError
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary import digits_with
from hhsim.system.counted import counted
from hhsim.system.output_path import check_output_path, holds
from hhsim.table.html import render
from hhsim.table.table import Column, Table, markdown_text, number, shown, words

MARK = "●"
LEGEND = (
    f"{MARK}: none that did the same scenes on the same machine is faster (p50, the median over scenes) and as "
    "good in depth and contacts off the mesh, each in its worst scene, and in energy over the optimum. Errors "
    "compare across machines, times within one; ~ before a time: some of its runs had no core of their own, and "
    "it is on no frontier."
)

KINDS = {
    ".html": b'content="hhsim board ',
    ".csv": b",option_set,",
    **dict.fromkeys((".md", ".tex"), LEGEND.partition("(")[0].encode()),
}
"""Bytes that each file of a board holds, by its ending; a file without them is not replaced."""


def standing_table(board: Board, standings: Sequence[Standing]) -> Table:
    """Return the standings as a table with its notes."""
    columns = (
        words("", lambda row: MARK if row.first else ""),
        *map(words, ("method", "surface", "options")),
        words("machine", lambda row: board.machines[row.machine]),
        *map(number, ("scenes", "touched")),
        number("limits missed", "missed"),
        number("failed"),
        number("depth", "depth", "µm", 3),
        number("off the mesh", "off_mesh", "mm", 3),
        number("over optimum", "tracking", "%", 2),
        number("stuck"),
        number("p50", lambda row: _time(row.p50, row.p50_std, row.comparable), "µs"),
        number("p99", lambda row: _time(row.p99, row.p99_std, row.comparable), "µs"),
    )
    machines = [f"{label}: {machine_line(json.loads(machine))}" for machine, label in board.machines.items()]
    return Table(columns, standings, notes=(LEGEND, *machines, *(f"note: {note}" for note in board.notes)))


def entry_table(board: Board) -> Table:
    """Return each run, failed ones too, as a table."""

    def time(name: str) -> Callable[[Entry], str]:
        return lambda row: _time(row.figures.get(name, math.nan), row.deviations.get(name, math.nan), row.own_core)

    columns = (
        *map(words, ("object", "motion", "method", "surface")),
        words("options", lambda row: shown_options(row.option_set, row.options)),
        words("machine", lambda row: board.machines.get(row.machine, "")),
        words("verdict", lambda row: f"{row.verdict}: {row.reason}" if row.reason else row.verdict),
        number("depth", lambda row: row.figures.get("penetration_max"), "µm", 3),
        number("off the mesh", lambda row: row.figures.get("contact_error_max"), "mm", 3),
        number("over optimum", lambda row: row.figures.get("tracking_excess"), "%", 2),
        number("force", lambda row: row.figures.get("force_contact_mean"), "N", 2),
        number("stuck", lambda row: row.figures.get("stuck_ticks")),
        number("p50", time("tick_cpu_p50"), "µs"),
        number("p99", time("tick_cpu_p99"), "µs"),
    )
    return Table(columns, (*board.entries, *board.failed))


def document_table(board: Board, standings: Sequence[Standing]) -> Table:
    """Return the standings as a document has them.

    A column that is the same in all of several rows becomes a note, but for the name of a method.
    """
    whole = standing_table(board, standings)
    cells = {column: {column.shown(row) for row in standings} for column in whole.columns}
    alike = [column for column in cells if column.name != "method" and len(standings) > 1 == len(cells[column])]
    same = "; ".join(filter(None, (f"{column.heading} {cells[column].pop()}".strip() for column in alike)))
    told = [f"the same in every row: {same}"] if same else []
    return replace(whole, columns=[each for each in cells if each not in alike], notes=[*told, *whole.notes])


def machine_line(machine: Mapping[str, Any]) -> str:
    """Return a machine in a line."""
    cores = machine.get("cores")
    parts = [machine.get("cpu"), f"{cores} cores" if cores else "", machine.get("system")]
    return ", ".join([*(str(part) for part in parts if part), f"Python {machine.get('python', '?')}"])


def _time(seconds: float, deviation: float, comparable: bool) -> str:
    """Return a time in µs, with ± standard deviation where there is one."""
    digits = digits_with(1e6 * deviation, 1)
    text = shown(1e6 * seconds, digits)
    text += f" ± {shown(1e6 * deviation, digits)}" if deviation == deviation else ""
    return text if comparable or seconds != seconds else f"~{text}"


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


def check_board_path(path: Path) -> None:
    """Raise OutputError, before the work, if a board cannot be written there or the name ends otherwise."""
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{path}: a board ends in {', '.join(KINDS)}")
    check_output_path(path, "board", holds(KINDS[path.suffix.lower()]))


def content_of(path: Path, board: Board, standings: Sequence[Standing]) -> bytes:
    """Return what a file of this name holds."""
    kind = path.suffix.lower()
    if kind == ".csv":
        return run_table(board).csv().encode()
    if kind == ".md":
        document = document_table(board, standings)
        return "\n".join(
            [document.markdown(), "", *(f"- {markdown_text(note)}" for note in document.notes), ""]
        ).encode()
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
