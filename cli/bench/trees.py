"""`hhsim bench trees`."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click

from .. import options
from ..console import announce_compilation, print_json, print_notes, print_table, progress
from ..name_list import counts, names


@click.command()
@names("--object", "objects", "Objects. Default: bunny,teapot,cube,hexagonal-prism,cylinder,cup.")
@counts("--spheres", "spheres", "Most leaves of the trees. Default: 64,512,4096.")
@click.option(
    "--size",
    type=click.FloatRange(1.0, 10_000.0),
    default=100.0,
    show_default=True,
    metavar="MM",
    help="Scale every object to this longest extent [mm].",
)
@click.option("--time-limits", is_flag=True, help="A missed limit of the CPU time is a miss too.")
@options.picture
@options.seed
@options.out
@options.json
@options.quiet
def command(
    objects: tuple[str, ...] | None,
    spheres: tuple[int, ...] | None,
    size: float,
    time_limits: bool,
    plot: Path | None,
    seed: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Build sphere trees and hold them against those of other programs: error, spheres, CPU time.

    All objects get one longest extent; cube, prism, cylinder and cup are the shapes that other programs were measured
    on, which stand in the same table. Errors are measured by coal, apart from the builders, and come out the same in
    every run. The exit code is 1 where a tree protrudes farther than its limit, has a gap or no proof.

    \b
    Examples:
      hhsim bench trees
      hhsim bench trees --object bunny --spheres 64,128,256,512
      hhsim bench trees --out trees.h5 --plot trees.png --time-limits
    """
    from hhsim.bench.table import check_table_path, csv_path, write_table
    from hhsim.bench.trees import COLUMNS, TreesOptions, measure, missed_bars
    from hhsim.render.tree_comparison_figure import draw_trees
    from hhsim.system.output_path import dated_output_path
    from hhsim.system.picture_path import picture_beside

    named = {"objects": objects, "spheres": spheres}
    run = replace(
        TreesOptions(size=1e-3 * size, seed=seed),
        **{name: values for name, values in named.items() if values is not None},  # type: ignore[arg-type]
    )
    output_path = out or dated_output_path("bench-trees")
    check_table_path(output_path)
    picture = picture_beside(output_path, plot)
    announce_compilation(quiet=quiet)
    with progress(quiet=quiet) as report:
        rows = measure(run, report)
    write_table(output_path, "trees", COLUMNS, rows, asdict(run))
    draw_trees(picture, rows, run.size)
    missed = missed_bars(rows, with_times=time_limits)
    if as_json:
        print_json(
            {
                "table": str(output_path),
                "csv": str(csv_path(output_path)),
                "plot": str(picture),
                "options": asdict(run),
                "units": {column.name: column.unit for column in COLUMNS},
                "rows": rows,
                "missed": missed,
            }
        )
    elif not quiet:
        for name in run.objects:
            _print_object(name, [row for row in rows if row["object"] == name])
        if any(row["measured_by"] == "hhsim" and not row["is_reference"] for row in rows):
            print_notes(["coal is not installed: the errors are those that every tree is measured with"])
        if any(row["is_reference"] for row in rows):
            print("in brackets: other programs, as measured in November 2026 on one core of a 2-core machine")
        print(f"the table is in {output_path} and {csv_path(output_path)}, the picture in {picture}")
    print_notes(missed, prefix="missed")
    return 1 if missed else 0


def _print_object(name: str, rows: Sequence[Mapping[str, Any]]) -> None:
    numbers = (
        *("spheres", "protrusion max [mm]", "limit [mm]", "mean [mm]", "proved bound [mm]", "gap max [mm]"),
        *("CPU [s]", "limit [s]", "leaves only [s]"),
    )
    cells = [
        (
            f"({row['method']})" if row["is_reference"] else row["method"],
            _number(row["spheres"], 1.0, 0),
            _number(row["protrusion_max"], 1e3, 3),
            _number(row["protrusion_limit"], 1e3, 2, missing=""),
            _number(row["protrusion_mean"], 1e3, 3),
            _number(row["bound"] if row["is_proved"] else None, 1e3, 3),
            _number(row["gap_max"], 1e3, 3),
            _number(row["cpu"], 1.0, 2),
            _number(row["cpu_limit"], 1.0, 0, missing=""),
            _number(row["cpu_leaves"], 1.0, 2, missing=""),
        )
        for row in rows
    ]
    print_table(("builder", *numbers), cells, title=name, numbers=numbers)
    print()


def _number(value: float | None, scale: float, digits: int, missing: str = "—") -> str:
    return missing if value is None or value != value else f"{scale * value:,.{digits}f}"
