"""`hhsim bench trees`."""

from pathlib import Path

import click

from hhsim.table.table import Table, number, words

from ..arguments import options
from ..arguments.comma_list import counts, names
from ..arguments.option_group import OptionGroup, shared
from ..console import print_notes, print_table, progress
from .suite import SuiteTable


class TreesSettings(OptionGroup):
    """Objects and sizes of the trees."""

    objects: tuple[str, ...] | None = names(
        "--object", "Objects. Default: bunny,teapot,cube,hexagonal-prism,cylinder,cup."
    )
    spheres: tuple[int, ...] | None = counts("--spheres", "Most leaves of the trees. Default: 64,512,4096.", 32_768)
    seed: int = shared(options.seed)


@click.command(cls=options.Command)
@TreesSettings.argument("settings")
@click.option(
    "--size",
    type=options.Number(1.0, 10_000.0),
    default=100.0,
    metavar="MM",
    help="Scale every object to this longest extent [mm].",
)
@click.option("--time-limits", is_flag=True, help="A missed limit of the CPU time is a miss too.")
@options.picture
@options.Output.argument("output")
def command(settings: TreesSettings, size: float, time_limits: bool, plot: Path | None, output: options.Output) -> int:
    """Build sphere trees and hold them against those of other programs: error, spheres, CPU time.

    All objects get one longest extent; cube, prism, cylinder and cup are the shapes that other programs were measured
    on, which stand in the same table. Errors are measured by code apart from the builders, and come out the same in
    every run. The exit code is 1 where a tree protrudes farther than its limit, has a gap or no proof.

    \b
    Examples:
      hhsim bench trees
      hhsim bench trees --object bunny --spheres 64,128,256,512
      hhsim bench trees --out trees.h5 --plot trees.png --time-limits
    """
    from hhsim.bench.trees import COLUMNS, TreesOptions, measure, missed_bars
    from hhsim.report.bench_trade_off import draw_trade_off
    from hhsim.system.output_path import picture_beside

    run = TreesOptions(size=1e-3 * size, **settings.given())
    table = SuiteTable(output, "trees", COLUMNS, run)
    picture = table.picture = picture_beside(table.path, plot)
    with progress(quiet=output.quiet) as report:
        rows = measure(run, report)
    table.write(rows)
    draw_trade_off(picture, "trees", rows)
    missed = missed_bars(rows, with_times=time_limits)
    if table.is_for_people(rows=rows, missed=missed):
        for name in run.objects:
            print_table(Table(SHOWN, [row for row in rows if row["object"] == name], name))
            print()
        if any(row["is_reference"] for row in rows):
            print("in brackets: other programs, as measured in November 2026 on one core of a 2-core machine")
        table.print_paths()
    print_notes(missed, prefix="missed")
    return 1 if missed else 0


SHOWN = (
    words("builder", lambda row: f"({row['method']})" if row["is_reference"] else row["method"]),
    number("spheres"),
    number("protrusion max", "protrusion_max", "mm", 3),
    number("limit", "protrusion_limit", "mm", 2, missing=""),
    number("mean", "protrusion_mean", "mm", 3),
    number("proved bound", lambda row: row["bound"] if row["is_proved"] else None, "mm", 3),
    number("gap max", "gap_max", "mm", 3),
    number("CPU", "cpu", "s", 2),
    number("limit", "cpu_limit", "s", missing=""),
    number("leaves only", "cpu_leaves", "s", 2, missing=""),
)
