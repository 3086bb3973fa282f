"""`hhsim bench recorded`."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from hhsim.table.table import Table, number, words

from ..arguments import options, recording_options
from ..arguments.comma_list import names, read_names
from ..arguments.object_argument import MeshSize, complete_object
from ..console import print_table, progress
from .suite import Solvers, SuiteTable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hhsim.bench.robustness.recorded import RecordedFigures

SHOWN = (
    *map(words, ("recording", "object", "method", "surface")),
    number("ticks"),
    number("tip", "fastest", "mm/tick", 2),
    number("deepest", "penetration", "µm", 3),
    number("off mesh", "contact_error_max", "mm", 2),
    number("in touch", "touching"),
    number("force", "force_mean", "N", 2),
    number("step", "force_step", "N", 2),
    number("variation, tick", "variation_tick", "%", 3),
    number("sample", "variation_sample", "%", 2),
    number("p50", "cpu_p50", "µs", 1),
    number("p99", "cpu_p99", "µs", 1),
    number("lag", "lagging", "ticks"),
    number("lag", "lag", "mm", 1),
    number("stuck"),
    number("no cause", "unexplained"),
)

OPTIONAL = ("tip [mm/tick]", "sample [%]", "ticks", "lag [mm]", "no cause")
"""Columns that a narrow terminal leaves out."""


class RecordedMotion(recording_options.Sampling):
    """Sampling of a recording, and the place of its object."""

    place_object: Literal["auto", "recorded"] = recording_options.place_object("auto")


class RecordedSolvers(Solvers):
    """Solvers; the safe ones if none is named."""

    methods: tuple[str, ...] | None = names("--method", "Methods. Default: coupled,progressive.")


@click.command(cls=options.Command)
@click.argument("recordings", metavar="FOLDER|FILE...", nargs=-1, required=True, type=options.FILE)
@click.option(
    "--object",
    "objects",
    callback=read_names,
    multiple=True,
    metavar="NAMES",
    help="Objects: names (hhsim objects) or mesh files. Default: bunny,cup.",
    shell_complete=complete_object,
)
@RecordedSolvers.argument("solvers")
@RecordedMotion.argument("motion")
@options.tree_level
@click.option(
    "--ticks", type=options.COUNT, metavar="N", help="Run only the N ticks around the grasp of each recording."
)
@MeshSize.argument("mesh_size")
@options.Output.argument("output")
def command(
    recordings: tuple[Path, ...],
    objects: tuple[str, ...] | None,
    solvers: Solvers,
    motion: RecordedMotion,
    level: int | None,
    ticks: int | None,
    mesh_size: MeshSize,
    output: options.Output,
) -> int:
    """Run recordings of real hands against objects, by every method, every tick measured.

    A FOLDER stands for all recordings in it: .h5 and .csv trajectories, and .npz, .json, .lz and .bvh files, which are
    imported on the way in. Penetration is recomputed from the hand that each tick shows. The exit code is 1 where
    coupled or progressive penetrates by more than 1 µm, touches farther than 1 mm from the true mesh, is not finite, or
    is stuck although there was a way, and where a recording could not be run. --unit and --size are for the mesh files.

    \b
    Examples:
      hhsim bench recorded recordings
      hhsim bench recorded recordings --object bunny,mug.stl --unit mm
      hhsim bench recorded grab.npz --method paper --samples hold --rate 500
    """
    from hhsim.bench.robustness.recorded import (
        COLUMNS,
        BenchObject,
        RecordedOptions,
        bench_recorded,
        recording_files,
        totals,
    )
    from hhsim.linkage.file import resolve_object
    from hhsim.mesh.catalogue import names_a_file
    from hhsim.trees.cache import cached_sphere_tree
    from hhsim.trees.options import TreeOptions

    named = solvers.options(("coupled", "progressive"))
    files = recording_files(recordings)
    chosen = {
        name: mesh_size.read(name) if names_a_file(name) else resolve_object(name)
        for name in objects or ("bunny", "cup")
    }
    table = SuiteTable(output, "recorded", COLUMNS, {})
    run = RecordedOptions(rate=motion.rate, mode=motion.samples, place=motion.place_object, ticks=ticks)
    with progress(quiet=output.quiet) as report:
        placed = [
            BenchObject(mesh.name, mesh, cached_sphere_tree(mesh, TreeOptions(level=level or usual), report))
            for mesh, usual in chosen.values()
        ]
        figures: list[RecordedFigures] = []
        stopped: KeyboardInterrupt | None = None
        try:
            for row in bench_recorded(files, placed, named, run, report):
                figures.append(row)  # noqa: PERF402 — what is done is kept where the next one is interrupted
        except KeyboardInterrupt as interrupt:
            if not figures:
                raise
            stopped = interrupt
    table.options = {
        "recordings": [str(path) for path in recordings],
        "objects": list(chosen),
        "unit": mesh_size.unit,
        "size_mm": mesh_size.size,
        "level": [at.tree.depth for at in placed],
        "rate": motion.rate,
        "samples": motion.samples,
        "place_object": motion.place_object,
        "ticks": ticks,
        "solver": [solver.to_json() for solver in named],
    }
    rows = Table(COLUMNS, figures).records
    table.write(rows)
    if stopped is not None:
        stopped.add_note(f"what ran so far, {len(rows):,} in all, is in {table.path} and its .csv file")
        raise stopped
    missed = any(row.missed for row in figures)
    if table.is_for_people(missed=missed, rows=rows, totals=Table(COLUMNS, totals(figures)).records):
        _print(figures)
        table.print_paths()
    return int(missed)


def _print(figures: "Sequence[RecordedFigures]") -> None:
    from hhsim.bench.robustness.recorded import totals

    ran = [row for row in figures if not row.reason]
    if ran:
        title = f"recorded hands, {ran[0].rate:g} ticks a second"
        print_table(Table(SHOWN, [*ran, *totals(ran)], title), optional=OPTIONAL)
    for row in figures:
        if row.reason:
            print(f"NOT RUN: {', '.join(filter(None, (row.recording, row.object, row.method)))}: {row.reason}")
        elif row.missed:
            why = f": touches up to {1e3 * row.contact_error_max:.2g} mm off the mesh"
            print(f"LIMIT MISSED: {row.recording}, {row.object}, {row.method}{why if row.floats else ''}")
    if not any(row.missed for row in figures):
        print("no limit missed")
