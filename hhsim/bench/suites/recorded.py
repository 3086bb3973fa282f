"""Recordings of real hands against any objects: penetration, force variation, time, lag, stuck.

Each recording, object and method is a cell of a sweep: a replay. One that cannot be read or placed is a row with the
reason.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from hhsim.bench.suite import Row, Suite, setting
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
from hhsim.system.settings_file import Names, check_fields

HERE = Path()
"""Folder that names of files are relative to."""


@dataclass(frozen=True)
class RecordedOptions:
    """Recordings, objects and methods, each with each."""

    recordings: tuple[str, ...] = setting((), metavar="FOLDER|FILE...", is_argument=True)
    objects: Names = setting(("bunny", "cup"), "Objects: names (hhsim objects) or mesh files.", "--object")
    methods: Names = setting(("coupled", "progressive"), "Methods.", "--method")
    surfaces: Names = setting(
        ("spheres",), "What of the objects the hand touches: spheres (of the tree), mesh, or both.", "--surface"
    )
    rate: float = setting(1000.0)
    samples: Literal["interpolate", "hold"] = setting("interpolate")
    place_object: Literal["auto", "recorded"] = setting("auto")
    level: int | None = setting(None)
    unit: Literal["m", "cm", "mm", "inch"] | None = setting(None)
    size: float | None = setting(None)  # [mm]

    def __post_init__(self) -> None:
        """Raise InputError for no recordings, an unknown name, or a method that does not take a surface."""
        check_fields(self)
        recording_files(self.recordings)
        for method in self.methods:
            for surface in self.surfaces:
                SolverOptions(method=method, surface=surface)


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


def cells(options: RecordedOptions, progress: Progress) -> list[Cell]:
    """Return every recording with every object and method."""
    level = {} if options.level is None else {"level": options.level}
    how = {**level, "rate": options.rate, "samples": options.samples, "place_object": options.place_object}
    named = []
    for name in options.objects:
        is_file = Path(name).suffix != ""
        swept = SweptObject(name, unit=options.unit, size_mm=options.size) if is_file else SweptObject(name)
        named.append(checked_object("--object", HERE, swept))
    return [
        Cell(shape, SweptMotion(str(path), path.stem), method, surface, "usual", how)
        for path in recording_files(options.recordings)
        for shape in named
        for method in options.methods
        for surface in options.surfaces
    ]


def run(cell: Cell, before: None = None) -> list[Row]:
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


def missed(options: RecordedOptions, rows: Sequence[Row]) -> list[str]:
    """Return what was not run, and where a method that never penetrates does not keep what it promises."""
    return [
        ", ".join(filter(None, (row["motion"], row["object"], row["method"], row["verdict"], row["reason"])))
        for row in rows
        if row["verdict"] == FAILED or (row["verdict"] == MISSED and never_penetrates(row["method"]))
    ]


SHOWN = """
    motion=recording object method surface verdict penetration_max=deepest contact_error_max=off_mesh
    force_contact_mean=force force_contact_step=step force_variation_contact=variation tick_cpu_p50=p50 tick_cpu_p99=p99
    lag_ticks=lag stuck_ticks=stuck
"""
SUITE = Suite(
    help="""Replay recordings of real hands against objects, by every method.

    A FOLDER stands for all recordings in it: .h5 and .csv trajectories, and .npz, .json, .lz and .bvh files, which are
    imported on the way in. Each is what hhsim replay makes of the same words. The exit code is 1 where coupled or
    progressive does not keep a limit that it promises to, and where a recording could not be replayed. --unit and
    --size are for the mesh files.

    \b
    Examples:
      hhsim bench recorded recordings
      hhsim bench recorded recordings --object bunny,mug.stl --unit mm
      hhsim bench recorded grab.npz --method paper --samples hold --rate 500
    """,
    settings=RecordedOptions,
    columns=COLUMNS,
    cells=cells,
    run=run,
    shown=SHOWN,
    title=lambda options: f"recorded hands, {options.rate:g} ticks a second",
    missed=missed,
    lines=lambda options, rows: [] if missed(options, rows) else ["no limit missed"],
    is_portable=True,
    key=lambda cell: cell.digest(HERE),
    named=lambda cell: cell.label,
    optional=("variation [%]", "step [N]"),
)
