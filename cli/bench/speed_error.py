"""`hhsim bench speed-error`."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import options
from ..comma_list import counts, names
from ..console import announce_compilation, number, print_json, print_notes, print_table, progress
from ..option_group import OptionGroup, option, shared
from ..options import COUNT
from .table_document import table_document

if TYPE_CHECKING:
    from hhsim.bench.speed_error import SpeedErrorOptions


class Configurations(OptionGroup):
    """What is run, and how: each with each."""

    objects: tuple[str, ...] | None = shared(names("--object", "objects", "Objects. Default: bunny,teapot,cube."))
    motions: tuple[str, ...] | None = shared(
        names("--motion", "motions", "Motions. Default: grasp,pinch,whole-hand,slide.")
    )
    methods: tuple[str, ...] | None = shared(names("--method", "methods", "Methods. Default: all."))
    levels: tuple[int, ...] | None = shared(counts("--level", "levels", "Levels of the sphere tree. Default: 2,3,4,5."))
    linearisations: tuple[int, ...] | None = shared(
        counts(
            "--linearisations",
            "linearisations",
            "Most linearisations in a tick. Default: 1,2,3,12; of method paper 1,2,3; of penalty 12.",
        )
    )
    backends: tuple[str, ...] | None = shared(
        names(
            "--qp",
            "backends",
            "QP solvers beside ours, on a stretch of each object's first motion. Default: all that are installed.",
        )
    )
    quick: bool = option(is_flag=True, help="About a minute: the bunny, grasp and slide, levels 3 to 5, our QP solver.")
    repetitions: int = option(type=COUNT, default=3, metavar="N", help="Repetitions of every run.")
    rate: float = shared(options.rate)
    seed: int = shared(options.seed)

    def options(self) -> "SpeedErrorOptions":
        """The same for the library."""
        from hhsim.bench.speed_error import SpeedErrorOptions
        from hhsim.solver.qp import ACTIVE_SET

        named = self.given()
        if self.backends is not None:
            named["backends"] = tuple(name for name in self.backends if name != ACTIVE_SET)
        return replace(SpeedErrorOptions.quick() if named.pop("quick") else SpeedErrorOptions(), **named)


@click.command()
@Configurations.argument("configurations")
@options.picture
@options.Output.argument("output")
def command(configurations: Configurations, plot: Path | None, output: options.Output) -> None:
    """Measure what a tick costs against how far off it is, for every way to solve the hand.

    Methods, tree levels, linearisations and QP solvers take turns on the same motions. Errors are measured against the
    object's spheres, its true mesh and the converged optimum on the finest spheres. A configuration is on the frontier
    if no other is both faster and better. The table goes to an HDF5 and a CSV file, with a picture beside them.

    \b
    Examples:
      hhsim bench speed-error --quick
      hhsim bench speed-error --object cup --motion grasp --level 4,5 --qp daqp
      hhsim bench speed-error --out tradeoff.h5 --plot tradeoff.png
    """
    from hhsim.bench.speed_error import measure
    from hhsim.bench.speed_error_table import ALL, COLUMNS, chosen, remarks, table_rows
    from hhsim.bench.table import csv_path, write_table
    from hhsim.render.speed_error_figure import draw_speed_error
    from hhsim.system.picture_path import picture_beside

    run = configurations.options()
    output_path = output.table_path("speed-error")
    picture = picture_beside(output_path, plot)
    announce_compilation(quiet=output.quiet)
    with progress(quiet=output.quiet) as report:
        runs = measure(run, report)
    rows = table_rows(runs)
    notes = remarks(runs)
    write_table(output_path, "speed-error", COLUMNS, rows, run.to_json())
    draw_speed_error(picture, rows)
    summed, solvers = chosen(rows, object=ALL, motion=ALL), chosen(rows, object=ALL, motion=ALL, stretch=True)
    if output.as_json:
        print_json(
            {
                **table_document(output_path, COLUMNS, run.to_json(), plot=str(picture)),
                "configurations": summed,
                "by_object": [row for row in chosen(rows, motion=ALL) if row["object"] != ALL],
                "qp_solvers": solvers,
                "notes": notes,
            }
        )
    elif not output.quiet:
        where = f"{', '.join(run.objects)}: {', '.join(run.motions)}"
        _print_rows(f"Nothing is both faster and better ({where})", [r for r in summed if _frontier(r)])
        _print_rows("Methods as they come", [row for row in summed if row["is_default"]])
        if solvers:
            _print_solvers(solvers)
        print_notes(notes)
        print(f"the table is in {output_path} and {csv_path(output_path)}, the picture in {picture}")


def _print_rows(title: str, rows: Sequence[dict[str, Any]]) -> None:
    if not rows:
        return
    numbers = (
        *("level", "lin.", "CPU p50 [µs]", "p99 [µs]", "in spheres [µm]", "in mesh [mm]", "contacts off [mm]"),
        *("pose off [mm]", "trembling force [%]", "force step [%]", "jump [mm]", "lag", "stuck"),
    )
    cells = [
        (
            row["method"],
            str(row["level"]),
            str(row["linearisations"]),
            number(row["tick_cpu_p50"], 1, 1e6),
            number(row["tick_cpu_p99"], 1, 1e6),
            number(row["penetration_max"], 2, 1e6),
            number(row["mesh_depth_max"], 3, 1e3),
            number(row["contact_error_max"], 3, 1e3),
            number(row["off_finest_mean"], 3, 1e3),
            number(row["force_variation_tremor"], 3),
            number(row["force_step"], 0),
            number(row["posture_jump_max"], 2, 1e3),
            f"{row['lag_ticks']:,}",
            f"{row['stuck_ticks']:,}",
            _frontier(row),
        )
        for row in sorted(rows, key=lambda row: row["tick_cpu_p50"])
    ]
    print_table(("method", *numbers, "frontier"), cells, title=title, numbers=numbers)
    print()


def _print_solvers(rows: Sequence[dict[str, Any]]) -> None:
    numbers = ("CPU p50 [µs]", "p99 [µs]", "wall p50 [µs]", "in spheres [µm]", "off best pose [mm]", "ticks")
    cells = [
        (
            row["qp"],
            number(row["tick_cpu_p50"], 1, 1e6),
            number(row["tick_cpu_p99"], 1, 1e6),
            number(row["tick_wall_p50"], 1, 1e6),
            number(row["penetration_max"], 2, 1e6),
            number(row["off_finest_mean"], 3, 1e3),
            f"{row['ticks']:,}",
        )
        for row in sorted(rows, key=lambda row: row["tick_cpu_p50"])
    ]
    first = rows[0]
    title = f"QP solvers, {first['method']}, level {first['level']}, on a stretch; all but ours are driven from Python"
    print_table(("QP solver", *numbers), cells, title=title, numbers=numbers)
    print()


def _frontier(row: dict[str, Any]) -> str:
    """Which frontiers a row is on."""
    names = {"mesh_frontier": "mesh", "tracking_frontier": "pose"}
    return ", ".join(name for flag, name in names.items() if row[flag])
