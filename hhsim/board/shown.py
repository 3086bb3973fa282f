"""The board's tables as people read them: in a terminal, in Markdown, on a page."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from hhsim.board.collect import Board
from hhsim.board.entry import Entry, shown_options
from hhsim.board.standings import Standing
from hhsim.replay.repeated_times import digits_with
from hhsim.system.shown_number import number

MARK = "●"
"""Of what is on the frontier."""
LEGEND = (
    f"{MARK}: none that did the same scenes on the same machine is faster (p50, the median over scenes) and as "
    "good in depth and contacts off the mesh, each in its worst scene, and in energy over the optimum. Errors "
    "compare across machines, times within one; ~ before a time: some of its runs had no core of their own, and "
    "it is on no frontier."
)


def standing_cells(board: Board) -> dict[str, Callable[[Standing], str]]:
    """Each column of the standings by its heading."""
    cells: dict[str, Callable[[Standing], str]] = {
        "": lambda row: MARK if row.first else "",
        "method": lambda row: row.method,
        "surface": lambda row: row.surface,
        "options": lambda row: row.options,
        "machine": lambda row: board.machines[row.machine],
        "scenes": lambda row: f"{row.scenes:,}",
        "touched": lambda row: f"{row.touched:,}",
        "limits missed": lambda row: f"{row.missed:,}",
        "failed": lambda row: f"{row.failed:,}",
        "depth [µm]": lambda row: number(row.depth, 3, 1e6),
        "off the mesh [mm]": lambda row: number(row.off_mesh, 3, 1e3),
        "over optimum [%]": lambda row: number(row.tracking, 2),
        "stuck": lambda row: f"{row.stuck:,}",
        "p50 [µs]": lambda row: _time(row.p50, row.p50_std, row.comparable),
        "p99 [µs]": lambda row: _time(row.p99, row.p99_std, row.comparable),
    }
    return cells


def entry_cells(board: Board) -> dict[str, Callable[[Entry], str]]:
    """Each column of the single runs by its heading."""

    def figure(name: str, digits: int, scale: float = 1.0) -> Callable[[Entry], str]:
        return lambda row: number(row.figures.get(name, float("nan")), digits, scale)

    def time(name: str) -> Callable[[Entry], str]:
        return lambda row: _time(
            row.figures.get(name, float("nan")), row.deviations.get(name, float("nan")), row.own_core
        )

    return {
        "object": lambda row: row.object,
        "motion": lambda row: row.motion,
        "method": lambda row: row.method,
        "surface": lambda row: row.surface,
        "options": lambda row: shown_options(row.option_set, row.options),
        "machine": lambda row: board.machines.get(row.machine, ""),
        "verdict": lambda row: f"{row.verdict}: {row.reason}" if row.reason else row.verdict,
        "depth [µm]": figure("penetration_max", 3, 1e6),
        "off the mesh [mm]": figure("contact_error_max", 3, 1e3),
        "over optimum [%]": figure("tracking_excess", 2),
        "force [N]": figure("force_contact_mean", 2),
        "stuck": figure("stuck_ticks", 0),
        "p50 [µs]": time("tick_cpu_p50"),
        "p99 [µs]": time("tick_cpu_p99"),
    }


WORDS = ("", "object", "motion", "method", "surface", "options", "machine", "verdict")
"""Columns that hold no numbers."""


def shown_standings(board: Board, standings: Sequence[Standing]) -> tuple[list[str], list[list[str]], list[str]]:
    """Headings and cells of the standings as a document has them, and what there is to say below.

    A column that is the same in several rows, all of them, is said below instead; the name of a method stays.
    """
    shown = {heading: [cell(row) for row in standings] for heading, cell in standing_cells(board).items()}
    alike = [heading for heading, cells in shown.items() if heading != "method" and len(cells) > 1 == len(set(cells))]
    same = [f"{heading} {shown.pop(heading)[0]}".strip() for heading in alike]
    told = [f"the same in every row: {'; '.join(filter(None, same))}"] if any(same) else []
    return list(shown), [list(row) for row in zip(*shown.values())], [*told, LEGEND, *said_of(board)]


def said_of(board: Board) -> list[str]:
    """Return its machines, by their letters, and its notes."""
    machines = [f"{label}: {machine_line(json.loads(machine))}" for machine, label in board.machines.items()]
    return [*machines, *(f"note: {note}" for note in board.notes)]


def machine_line(machine: Mapping[str, Any]) -> str:
    """A machine in a line."""
    cores = machine.get("cores")
    parts = [machine.get("cpu"), f"{cores} cores" if cores else "", machine.get("system")]
    return ", ".join([*(str(part) for part in parts if part), f"Python {machine.get('python', '?')}"])


def _time(seconds: float, deviation: float, comparable: bool) -> str:
    """In µs, with ± standard deviation where there is one."""
    digits = digits_with(1e6 * deviation, 1)
    shown = number(seconds, digits, 1e6)
    shown += f" ± {number(deviation, digits, 1e6)}" if deviation == deviation else ""
    return shown if comparable or seconds != seconds else f"~{shown}"
