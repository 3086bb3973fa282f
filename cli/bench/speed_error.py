"""`hhsim bench speed-error`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from hhsim.table.table import Column, Table, number, words

from ..arguments import options
from ..arguments.comma_list import counts, names
from ..arguments.option_group import GroupedCommand, OptionGroup, option, shared
from ..arguments.options import COUNT
from ..console import print_notes, print_table, progress
from .suite import SuiteTable, suite_options

Row = Mapping[str, Any]


class Configurations(OptionGroup, heading="Configurations"):
    """Configurations and scenes, each with each."""

    objects: tuple[str, ...] | None = names("--object", "Objects. With --full: bunny,teapot,cube. Default: bunny.")
    motions: tuple[str, ...] | None = names(
        "--motion", "Motions. With --full: grasp,pinch,whole-hand,slide. Default: grasp,slide."
    )
    methods: tuple[str, ...] | None = names("--method", "Methods. Default: all.")
    surfaces: tuple[str, ...] | None = names(
        "--surface", "What of the object the hand touches; paper and penalty take spheres alone. Default: spheres,mesh."
    )
    levels: tuple[int, ...] | None = counts(
        "--level", "Levels of the sphere tree. With --full: 2,3,4,5. Default: 2,3,4.", 5
    )
    linearisations: tuple[int, ...] | None = counts(
        "--linearisations",
        "Most linearisations in a tick. With --full: 1,2,3,12; of method paper 1,2,3; of penalty 12. Default: the "
        "method's own.",
        1_000_000,
    )
    backends: tuple[str, ...] | None = names(
        "--qp", "QP solvers beside ours, on a stretch of each object's first motion. With --full: all installed ones."
    )
    full: bool = option(is_flag=True, help="Three objects, four motions, all linearisations and QP solvers.")
    repetitions: int = option(type=COUNT, default=3, metavar="N", help="Repetitions of every run.")
    rate: float = shared(options.rate)
    seed: int = shared(options.seed)


@click.command(cls=GroupedCommand)
@Configurations.argument("configurations")
@options.picture
@click.option(
    "--peers",
    type=options.FILE,
    metavar="FILE",
    help="Draw the engines of this table of hhsim bench peers into the picture, in grey.",
)
@options.Output.argument("output")
def command(configurations: Configurations, plot: Path | None, peers: Path | None, output: options.Output) -> None:
    """Measure what a tick costs against how far off it is, for every way to solve the hand.

    Methods, surfaces, tree levels, linearisations and QP solvers take turns on the same motions. Errors are measured
    against the true mesh, by code apart from the solver, and against the converged optimum on it. A configuration is on
    the frontier if no other is both faster and better. The table goes to an HDF5 and a CSV file, with a picture beside
    them.

    \b
    Examples:
      hhsim bench speed-error
      hhsim bench speed-error --full
      hhsim bench speed-error --object cup --motion grasp --level 4,5 --qp daqp
      hhsim bench speed-error --surface mesh --method coupled --linearisations 12
      hhsim bench speed-error --out tradeoff.h5 --plot tradeoff.png
    """
    from hhsim.bench.speed_error import FULL, SpeedErrorOptions, measure
    from hhsim.bench.speed_error_table import ALL, COLUMNS, chosen, remarks, table_rows, touched
    from hhsim.bench.table import rows_of
    from hhsim.report.bench_trade_off import draw_trade_off
    from hhsim.system.output_path import picture_beside

    run = suite_options(SpeedErrorOptions, "full", FULL, configurations)
    table = SuiteTable(output, "speed-error", COLUMNS, run)
    picture = table.picture = picture_beside(table.path, plot)
    others = [] if peers is None else rows_of(peers, "peers")
    with progress(quiet=output.quiet) as report:
        runs = measure(run, report)
    rows = table_rows(runs)
    notes = remarks(runs)
    table.write(rows)
    draw_trade_off(picture, "speed-error", rows, others)
    summed, solvers = chosen(rows, object=ALL, motion=ALL), chosen(rows, object=ALL, motion=ALL, stretch=True)
    by_object = [row for row in chosen(rows, motion=ALL) if row["object"] != ALL]
    if table.is_for_people(configurations=summed, by_object=by_object, qp_solvers=solvers, notes=notes):
        where = f"{', '.join(run.objects)}: {', '.join(run.motions)}"
        if run.every_linearisation:
            _print(f"Nothing is both faster and better ({where})", [r for r in summed if _frontier(r)], SHOWN)
            _print("Methods as they come, and on the mesh", [row for row in summed if _as_it_comes(row)], SHOWN)
        else:
            _print(f"Methods and what they touch ({where})", summed, SHOWN)
        if solvers:
            how = f"{solvers[0]['method']}, {touched(solvers[0]['surface'], solvers[0]['level'])}"
            title = f"QP solvers, {how}, on a stretch; all but ours are driven from Python"
            _print(title, solvers, SOLVERS_SHOWN)
        print_notes(notes)
        table.print_paths()


def _as_it_comes(row: Row) -> bool:
    """True for a method's defaults, or its defaults on the mesh."""
    from hhsim.bench.speed_error import usual_linearisations

    on_mesh = row["surface"] == "mesh" and row["linearisations"] == usual_linearisations(row["method"])
    return bool(row["is_default"] or on_mesh)


def _print(title: str, rows: Sequence[Row], columns: Sequence[Column]) -> None:
    if rows:
        by_time = sorted(rows, key=lambda row: row["tick_cpu_p50"])
        print_table(Table(columns, by_time, title))
        print()


def _frontier(row: Row) -> str:
    """Names of the frontiers that a row is on."""
    names = {"mesh_frontier": "mesh", "tracking_frontier": "pose"}
    return ", ".join(name for flag, name in names.items() if row[flag])


SHOWN = (
    words("method"),
    words("touched", lambda row: row["surface"] if row["surface"] == "mesh" else f"{row['surface']} {row['level']}"),
    number("lin.", "linearisations"),
    number("CPU p50", "tick_cpu_p50", "µs", 1),
    number("p99", "tick_cpu_p99", "µs", 1),
    number("in surface", "penetration_max", "µm", 2),
    number("in mesh", "mesh_depth_max", "µm", 1),
    number("contacts off", "contact_error_max", "µm", 1),
    number("pose off", "off_optimum_mean", "mm", 3),
    number("trembling force", "force_variation_tremor", "%", 3),
    number("force step", "force_contact_step_share", "%", 1),
    number("jump", "posture_jump_max", "mm", 2),
    number("lag", "lag_ticks"),
    number("stuck", "stuck_ticks"),
    words("frontier", _frontier),
)
SOLVERS_SHOWN = (
    words("QP solver", "qp"),
    number("CPU p50", "tick_cpu_p50", "µs", 1),
    number("p99", "tick_cpu_p99", "µs", 1),
    number("wall p50", "tick_wall_p50", "µs", 1),
    number("in surface", "penetration_max", "µm", 2),
    number("off best pose", "off_optimum_mean", "mm", 3),
    number("ticks"),
)
