"""`hhsim bench recorded`."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from .. import options
from ..console import announce_compilation, print_json, print_table, progress
from ..name_list import names
from ..object_argument import complete_object, read_object

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hhsim.bench.robustness.recorded_metrics import RecordedFigures

HEADINGS = (
    "recording",
    "object",
    "method",
    "ticks",
    "tip [mm/tick]",
    "deepest [µm]",
    "in touch",
    "variation, tick [%]",
    "sample [%]",
    "p50 [µs]",
    "p99 [µs]",
    "lag [ticks]",
    "lag [mm]",
    "stuck",
    "no cause",
)


@click.command(
    short_help="Recordings of real hands against any objects: penetration, force variation, time, lag, stuck."
)
@click.argument("recordings", metavar="FOLDER|FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@names(
    "--object",
    "objects",
    "Objects: names (hhsim objects) or mesh files. Default: bunny,cup.",
    shell_complete=complete_object,
)
@names("--method", "methods", "Methods. Default: coupled,progressive.")
@options.rate
@options.samples
@options.place_object("auto")
@options.tree_level
@click.option(
    "--ticks", type=click.IntRange(1), metavar="N", help="Run only the N ticks around the grasp of each recording."
)
@click.option("--limit", type=click.IntRange(1), metavar="N", help="Run only the first N recordings.")
@options.unit
@options.size
@options.seed
@options.out
@options.json
@options.quiet
def command(
    recordings: tuple[Path, ...],
    objects: tuple[str, ...] | None,
    methods: tuple[str, ...] | None,
    rate: float,
    samples: Literal["interpolate", "hold"],
    place_object: Literal["auto", "recorded"],
    level: int | None,
    ticks: int | None,
    limit: int | None,
    unit: str | None,
    size: float | None,
    seed: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run recordings of real hands against objects, by every method, every tick measured.

    A FOLDER stands for all recordings in it: .h5 and .csv trajectories, and .npz, .json, .lz and .bvh files, which are
    imported on the way in. Penetration is recomputed from the hand that each tick shows. The exit code is 1 where
    coupled or progressive penetrates by more than 1 µm, is not finite, or is stuck although there was a way, and where
    a recording could not be run. --unit and --size are for the mesh files; --seed chooses the ticks that are recomputed
    by brute force, and nothing else is random.

    \b
    Examples:
      hhsim bench recorded recordings
      hhsim bench recorded recordings --object bunny,mug.stl --unit mm
      hhsim bench recorded grab.npz --method paper --samples hold --rate 500
    """
    from hhsim.bench.robustness.recorded import BenchObject, RecordedOptions, bench_recorded, recording_files
    from hhsim.bench.robustness.recorded_metrics import COLUMNS, table_row, totals
    from hhsim.bench.table import check_table_path, write_table
    from hhsim.mesh.catalogue import names_a_file
    from hhsim.solver.options import SolverOptions
    from hhsim.system.output_path import dated_output_path
    from hhsim.trees.cache import cached_sphere_tree
    from hhsim.trees.options import TreeOptions

    solvers = [SolverOptions(method=method) for method in methods or ("coupled", "progressive")]
    files = recording_files(recordings)[:limit]
    announce_compilation(quiet=quiet)
    chosen = {
        name: read_object(name, *((unit, size) if names_a_file(name) else (None, None)))
        for name in objects or ("bunny", "cup")
    }
    output_path = out or dated_output_path("bench-recorded")
    check_table_path(output_path)
    asked = RecordedOptions(rate=rate, mode=samples, place=place_object, ticks=ticks, seed=seed)
    with progress(quiet=quiet) as report:
        placed = [
            BenchObject(mesh.name, mesh, cached_sphere_tree(mesh, TreeOptions(level=level or usual), report))
            for mesh, usual in chosen.values()
        ]
        figures = list(bench_recorded(files, placed, solvers, asked, report))
    described = {
        "recordings": [str(path) for path in recordings],
        "objects": list(chosen),
        "unit": unit,
        "size_mm": size,
        "level": [at.tree.depth for at in placed],
        "rate": rate,
        "samples": samples,
        "place_object": place_object,
        "ticks": ticks,
        "limit": limit,
        "seed": seed,
        "solver": [solver.to_json() for solver in solvers],
    }
    rows = [table_row(row) for row in figures]
    write_table(output_path, "recorded", COLUMNS, rows, described)
    missed = any(row.missed for row in figures)
    if as_json:
        whole = [table_row(row) for row in totals(figures)]
        document = {"suite": "recorded", "missed": missed, "rows": rows, "totals": whole, "options": described}
        print_json({**document, "path": str(output_path)})
    elif not quiet:
        _print(figures)
        print(f"every figure is in {output_path}")
    return int(missed)


def _print(figures: "Sequence[RecordedFigures]") -> None:
    from hhsim.bench.robustness.recorded_metrics import totals

    ran = [row for row in figures if not row.reason]
    if ran:
        title = f"recorded hands, {ran[0].rate:g} ticks a second"
        print_table(HEADINGS, [_cells(row) for row in [*ran, *totals(ran)]], title=title, numbers=HEADINGS[3:])
    for row in figures:
        if row.reason:
            print(f"NOT RUN: {', '.join(filter(None, (row.recording, row.object, row.method)))}: {row.reason}")
        elif row.missed:
            print(f"LIMIT MISSED: {row.recording}, {row.object}, {row.method}")
    if not any(row.missed for row in figures):
        print("no limit missed")


def _cells(row: "RecordedFigures") -> tuple[str, ...]:
    return (
        row.recording,
        row.object,
        row.method,
        f"{row.ticks:,}",
        f"{1e3 * row.fastest:.2f}",
        f"{1e6 * row.penetration:,.3f}",
        f"{row.touching:,}",
        _number(row.variation_tick, 3),
        _number(row.variation_sample, 2),
        _number(1e6 * row.cpu_p50, 1),
        _number(1e6 * row.cpu_p99, 1),
        f"{row.lagging:,}",
        f"{1e3 * row.lag:.1f}",
        f"{row.stuck:,}",
        f"{row.unexplained:,}",
    )


def _number(value: float, digits: int) -> str:
    return "—" if value != value else f"{value:,.{digits}f}"
