"""Recordings of real hands against any objects: penetration, force variation, time, lag, stuck.

Each recording, object and method is a cell of a sweep: a replay. One that cannot be read or placed is a row with the
reason.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from hhsim.bench.suite import Row, Suite
from hhsim.errors import HhsimError, InputError
from hhsim.replay.verdict import MISSED
from hhsim.scene.motion_catalogue import RECORDING_SUFFIXES, imported_suffixes
from hhsim.solver.method import never_penetrates
from hhsim.solver.options import SolverOptions
from hhsim.sweep.cell_table import COLUMNS, FAILED, done_row, failed_row
from hhsim.sweep.folder import read_row
from hhsim.sweep.input_files import source_digest
from hhsim.sweep.plan import Cell, SweptMotion, SweptObject, checked_object
from hhsim.sweep.sweep import CellTask
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Names
from hhsim.table.table import Column

HERE = Path()
"""Folder that names of files are relative to."""


@dataclass(frozen=True, kw_only=True)
class Recorded(Suite):
    """Recordings, objects and methods, each with each."""

    recordings: tuple[str, ...]
    objects: Names
    methods: Names
    surfaces: Names
    rate: float
    samples: Literal["interpolate", "hold"]
    place_object: Literal["auto", "recorded"]
    level: int | None
    unit: Literal["m", "cm", "mm", "inch"] | None
    size: float | None  # [mm]
    is_portable = True

    def check(self) -> None:
        """Raise InputError for no recordings, an unknown name, or a method that does not take a surface."""
        recording_files(self.recordings)
        for method in self.methods:
            for surface in self.surfaces:
                SolverOptions(method=method, surface=surface)

    @classmethod
    def columns(cls) -> Sequence[Column]:
        """Return the columns of a sweep."""
        return COLUMNS

    def cells(self, progress: Progress) -> list[Cell]:
        """Return every recording with every object and method."""
        level = {} if self.level is None else {"level": self.level}
        how = {**level, "rate": self.rate, "samples": self.samples, "place_object": self.place_object}
        named = []
        for name in self.objects:
            is_file = Path(name).suffix != ""
            swept = SweptObject(name, unit=self.unit, size_mm=self.size) if is_file else SweptObject(name)
            named.append(checked_object("--object", HERE, swept))
        return [
            Cell(shape, SweptMotion(str(path), path.stem), method, surface, "usual", how)
            for path in recording_files(self.recordings)
            for shape in named
            for method in self.methods
            for surface in self.surfaces
        ]

    def run(self, cell: Cell, before: None) -> list[Row]:
        """Replay a cell, and return its figures, or the reason why there are none."""
        with TemporaryDirectory() as folder:
            try:
                digest = cell.digest(HERE)
                about: dict[str, Any] = {"plan_folder": str(HERE), "folder": folder, "sources": source_digest()}
                end = CellTask(cell=cell, digest=digest, keeps_result=False, **about).run()
                row = failed_row(cell, end.reason)
                return [row if end.reason else done_row(cell, read_row(Path(folder) / f"{digest}.json"))]
            except HhsimError as error:
                return [failed_row(cell, str(error))]

    def title(self) -> str:
        """Return the title of the table."""
        return f"recorded hands, {self.rate:g} ticks a second"

    def named(self, cell: Cell) -> str:
        """Return the label of the cell."""
        return cell.label

    def key(self, cell: Cell) -> str:
        """Return the digest of the cell."""
        return cell.digest(HERE)

    def missed(self, rows: Sequence[Row]) -> list[str]:
        """Return what was not run, and where a method that never penetrates does not keep what it promises."""
        return [
            ", ".join(filter(None, (row["motion"], row["object"], row["method"], row["verdict"], row["reason"])))
            for row in rows
            if row["verdict"] == FAILED or (row["verdict"] == MISSED and never_penetrates(row["method"]))
        ]

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """Say that all is kept."""
        return [] if self.missed(rows) else ["no limit missed"]


def recording_files(words: Sequence[str]) -> list[Path]:
    """Return the recordings among files and in folders, by their suffix; InputError where there is none."""
    found: list[Path] = []
    suffixes = (*RECORDING_SUFFIXES, *imported_suffixes())
    for path in map(Path, words):
        inside = [path]
        if path.is_dir():
            inside = sorted(entry for entry in path.iterdir() if entry.is_file() and entry.suffix.lower() in suffixes)
        elif not path.is_file():
            raise InputError(f"{path}: no such file or folder; expected recordings, {', '.join(suffixes)}")
        found += inside
    if not found:
        raise InputError(f"no recordings; expected a folder or files that end in {', '.join(suffixes)}")
    return list(dict.fromkeys(found))


SUITE = Recorded
