"""`hhsim bench speed-error`."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click

from .. import options
from ..console import announce_compilation, print_json, print_notes, print_table, progress
from ..name_list import counts, names


@click.command()
@names("--object", "objects", "Objects. Default: bunny,teapot,cube.")
@names("--motion", "motions", "Motions. Default: grasp,pinch,whole-hand,slide.")
@names("--method", "methods", "Methods. Default: all.")
@counts("--level", "levels", "Levels of the sphere tree. Default: 2,3,4,5.")
@counts(
    "--linearisations",
    "linearisations",
    "Most linearisations in a tick. Default: 1,2,3,12; of method paper 1,2,3; of penalty 12.",
)
@names(
    "--qp",
    "backends",
    "QP solvers beside ours, on a stretch of each object's first motion. Default: all that are installed.",
)
@click.option("--quick", is_flag=True, help="About a minute: the bunny, grasp and slide, levels 3 to 5, our QP solver.")
@click.option(
    "--repetitions", type=click.IntRange(1), default=3, show_default=True, metavar="N", help="Repetitions of every run."
)
@options.rate
@options.picture
@options.seed
@options.out
@options.json
@options.quiet
def command(
    objects: tuple[str, ...] | None,
    motions: tuple[str, ...] | None,
    methods: tuple[str, ...] | None,
    levels: tuple[int, ...] | None,
    linearisations: tuple[int, ...] | None,
    backends: tuple[str, ...] | None,
    quick: bool,
    repetitions: int,
    rate: float,
    plot: Path | None,
    seed: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
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
    from hhsim.bench.speed_error import SpeedErrorOptions, measure
    from hhsim.bench.speed_error_table import ALL, COLUMNS, chosen, remarks, table_rows
    from hhsim.bench.table import check_table_path, csv_path, write_table
    from hhsim.render.speed_error_figure import draw_speed_error
    from hhsim.solver.qp import ACTIVE_SET
    from hhsim.system.output_path import dated_output_path
    from hhsim.system.picture_path import picture_beside

    others = None if backends is None else tuple(name for name in backends if name != ACTIVE_SET)
    named = {
        "objects": objects,
        "motions": motions,
        "methods": methods,
        "levels": levels,
        "linearisations": linearisations,
        "backends": others,
    }
    usual = SpeedErrorOptions.quick() if quick else SpeedErrorOptions()
    run = replace(
        usual,
        repetitions=repetitions,
        rate=rate,
        seed=seed,
        **{name: values for name, values in named.items() if values is not None},  # type: ignore[arg-type]
    )
    output_path = out or dated_output_path("bench-speed-error")
    check_table_path(output_path)
    picture = picture_beside(output_path, plot)
    announce_compilation(quiet=quiet)
    with progress(quiet=quiet) as report:
        runs = measure(run, report)
    rows = table_rows(runs)
    notes = remarks(runs)
    write_table(output_path, "speed-error", COLUMNS, rows, asdict(run))
    draw_speed_error(picture, rows)
    summed, solvers = chosen(rows, object=ALL, motion=ALL), chosen(rows, object=ALL, motion=ALL, stretch=True)
    if as_json:
        print_json(
            {
                "table": str(output_path),
                "csv": str(csv_path(output_path)),
                "plot": str(picture),
                "options": asdict(run),
                "units": {column.name: column.unit for column in COLUMNS},
                "configurations": summed,
                "by_object": [row for row in chosen(rows, motion=ALL) if row["object"] != ALL],
                "qp_solvers": solvers,
                "notes": notes,
            }
        )
    elif not quiet:
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
            _number(row["tick_cpu_p50"], 1e6, 1),
            _number(row["tick_cpu_p99"], 1e6, 1),
            _number(row["penetration_max"], 1e6, 2),
            _number(row["mesh_depth_max"], 1e3, 3),
            _number(row["contact_error_max"], 1e3, 3),
            _number(row["off_finest_mean"], 1e3, 3),
            _number(row["force_variation_tremor"], 1.0, 3),
            _number(row["force_step"], 1.0, 0),
            _number(row["posture_jump_max"], 1e3, 2),
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
            _number(row["tick_cpu_p50"], 1e6, 1),
            _number(row["tick_cpu_p99"], 1e6, 1),
            _number(row["tick_wall_p50"], 1e6, 1),
            _number(row["penetration_max"], 1e6, 2),
            _number(row["off_finest_mean"], 1e3, 3),
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


def _number(value: float, scale: float, digits: int) -> str:
    # Rounded first: what rounds to nothing has no sign.
    return "—" if value != value else f"{round(scale * value, digits) + 0.0:,.{digits}f}"
