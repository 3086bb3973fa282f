"""`hhsim bench qp`."""

from pathlib import Path
from typing import Any

import click

from hhsim.table.table import Table, number, words

from ..arguments import options
from ..arguments.comma_list import names
from ..arguments.option_group import OptionGroup, option
from ..console import print_notes, print_table
from .suite import SuiteTable, measuring


class QpSettings(OptionGroup):
    """Programs, where they are from, and solvers."""

    problems: int = option(type=options.COUNT, default=100_000, metavar="N", help="Programs of real ticks to take.")
    objects: tuple[str, ...] | None = names(
        "--object", "Objects of the ticks. Default: sphere,cube,rock,cup,teapot,bunny."
    )
    motions: tuple[str, ...] | None = names(
        "--motion", "Motions of the ticks; random: random targets. Default: grasp,pinch,whole-hand,slide,random."
    )
    backends: tuple[str, ...] | None = names("--qp", "QP solvers beside ours. Default: all that are installed.")


@click.command()
@QpSettings.argument("settings")
@click.option(
    "--programs",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the programs too, in the order of their ticks, as a .parquet file that qpbenchmark reads.",
)
@options.seed
@options.Output.argument("output")
def command(settings: QpSettings, programs: Path | None, seed: int, output: options.Output) -> int:
    """Solve the programs of real ticks by every solver at hand.

    Our solver solves all of them, taken from replays and random targets, from nothing and from the guess that the tick
    had; every answer is checked from the program alone. A sample of each kind is solved by all solvers in turns. More
    solvers: pip install 'hhsim[solvers]'. The exit code is 1 where ours fails a program.

    \b
    Examples:
      hhsim bench qp
      hhsim bench qp --problems 2000 --qp daqp,quadprog --out qp.h5
      hhsim bench qp --problems 2000 --programs ticks.parquet
    """
    from dataclasses import asdict

    from hhsim.bench.qp.bench import COLUMNS, bench_qp, check_problem_file, missed_programs, solver_versions
    from hhsim.bench.qp.recorded_problems import QpBenchOptions

    chosen = QpBenchOptions(**settings.given(), seed=seed)
    if programs is not None:
        check_problem_file(programs)
    table = SuiteTable(output, "qp", COLUMNS, asdict(chosen))
    with measuring(output) as report:
        rows = bench_qp(chosen, programs, report)
    table.write(rows)
    missed, versions = missed_programs(rows), solver_versions(chosen.solvers())
    if output.as_json:
        written = None if programs is None else str(programs)
        table.print_json(programs=written, rows=rows, versions=versions, missed=missed)
    elif not output.quiet:
        for kind in dict.fromkeys(row["program"] for row in rows):
            _print_kind([row for row in rows if row["program"] == kind])
        print(f"solvers: {', '.join(f'{name} {version}'.strip() for name, version in versions.items())}")
        if programs is not None:
            print(f"the programs are in {programs}")
        table.print_paths()
    print_notes(missed, prefix="missed")
    return 1 if missed else 0


def _print_kind(rows: list[dict[str, Any]]) -> None:
    first = rows[0]
    title = f"{first['program']}: {first['variables']} variables, {first['rows']:.0f} rows; KKT in sizes of the program"
    print_table(Table(SHOWN, sorted(rows, key=lambda row: row["native_p50"] or 0.0), title))
    print()


SHOWN = (
    words("solver"),
    number("programs", "problems"),
    number("solved"),
    number("infeasible", "refused"),
    number("missed"),
    number("KKT max", lambda row: "" if row["residual_max"] is None else f"{row['residual_max']:.1e}"),
    number("iterations", digits=1, missing=""),
    number("call p50", "call_p50", "µs", 2, missing=""),
    number("p99", "call_p99", "µs", 2, missing=""),
    number("native p50", "native_p50", "µs", 2, missing=""),
    number("p99", "native_p99", "µs", 2, missing=""),
)
