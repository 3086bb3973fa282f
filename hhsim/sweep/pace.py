"""Seconds per tick of cells that were run, for the estimate of those left."""

import math
from collections.abc import Iterable
from typing import Any

from hhsim.sweep.folder import SweepFolder
from hhsim.sweep.plan import Cell, PlannedCell
from hhsim.system import environment as info


class Pace:
    """Ticks and seconds of cells that were run, and the number of these cells."""

    def __init__(self) -> None:
        self.cells = 0
        self._spent: dict[tuple[Any, ...], tuple[int, float]] = {}

    def add(self, cell: Cell, ticks: int, seconds: float) -> None:
        """Add a cell that was run."""
        self.cells += 1
        for likeness in _likenesses(cell):
            before = self._spent.get(likeness, (0, 0.0))
            self._spent[likeness] = before[0] + ticks, before[1] + seconds

    def knows(self, cell: Cell) -> bool:
        """Return True if a cell of its method, surface and options was run."""
        return kind(cell) in self._spent

    def left(self, cells: Iterable[PlannedCell]) -> float:
        """Estimate the duration of cells one after the other [s] from the most similar ones; NaN without any."""
        total = 0.0
        for planned in cells:
            known = (self._spent[likeness] for likeness in _likenesses(planned.cell) if likeness in self._spent)
            ticks, seconds = next(known, (0, math.nan))
            total += planned.run_ticks * seconds / max(1, ticks)
        return total


def pace_of(cells: Iterable[PlannedCell], folder: SweepFolder) -> Pace:
    """Return the pace of those cells that ran on this machine."""
    pace, here = Pace(), info.machine()
    for planned in cells:
        row = folder.row(planned)
        if row.get("machine") == here:
            pace.add(planned.cell, planned.ticks * row.get("repeated", {}).get("runs", 1), float(row["seconds"]))
    return pace


def kind(cell: Cell) -> tuple[str, ...]:
    """Return what decides most of a tick's time: method, surface and options."""
    return cell.method, cell.surface, cell.options_name


def _likenesses(cell: Cell) -> tuple[tuple[Any, ...], ...]:
    """Return keys that similar cells share, the most specific first."""
    same, shape, motion = kind(cell), cell.object.name, cell.motion.name
    return (*same, shape, motion), (*same, shape), (*same, None, motion), same, ()


def lasting(seconds: float) -> str:
    """Format a duration for people."""
    if seconds != seconds:
        return "an unknown time"
    if seconds < 120.0:
        return f"{seconds:,.0f} s"
    return f"{seconds / 60.0:,.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:,.1f} h"
