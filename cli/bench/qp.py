"""`hhsim bench qp`."""

from pathlib import Path

import click

from hhsim.table.table import Table, number, words

from ..arguments import options
from ..arguments.comma_list import names
from ..arguments.option_group import OptionGroup, option
from ..console import print_notes, print_table, progress
from .suite import SuiteTable


class QpSettings(OptionGroup):
    """Number of programs, and their objects and motions."""

    problems: int = option(type=options.COUNT, default=100_000, metavar="N", help="Programs of real ticks to take.")
    objects: tuple[str, ...] | None = names(
        "--object", "Objects of the ticks. Default: sphere,cube,rock,cup,teapot,bunny."
    )
    motions: tuple[str, ...] | None = names(
        "--motion", "Motions of the ticks; random: random targets. Default: grasp,pinch,whole-hand,slide,random."
    )


@click.command(cls=options.Command)
@QpSettings.argument("settings")
@click.option(
    "--programs",
    type=options.OUTPUT,
    metavar="FILE",
    help="Write the programs too, in the order of their ticks, as a .parquet file and a test set of qpbenchmark.",
)
@options.seed
@options.Output.argument("output")
def command(settings: QpSettings, programs: Path | None, seed: int, output: options.Output) -> int:
    """Take the programs of real ticks, solve them by our solver, and write them for qpbenchmark.

    Programs are taken from replays and random targets. Every answer is judged by its KKT residual, from the program
    alone; the exit code is 1 where ours misses one. With --programs they are written to a Parquet file, with a test set
    of qpbenchmark beside it, hand_ticks.py, which compares our solver with all of qpsolvers.

    \b
    Examples:
      hhsim bench qp
      hhsim bench qp --problems 2000 --object bunny --out qp.h5
      hhsim bench qp --problems 2000 --programs ticks.parquet
    """
    from hhsim.bench.qp.bench import COLUMNS, bench_qp, missed_programs
    from hhsim.bench.qp.qpbenchmark_export import check_program_file, qpbenchmark_commands
    from hhsim.bench.qp.recorded_problems import QpBenchOptions

    chosen = QpBenchOptions(**settings.given(), seed=seed)
    if programs is not None:
        check_program_file(programs)
    table = SuiteTable(output, "qp", COLUMNS, chosen)
    with progress(quiet=output.quiet) as report:
        rows = bench_qp(chosen, programs, report)
    table.write(rows)
    missed, compare = missed_programs(rows), [] if programs is None else qpbenchmark_commands(programs)
    written = None if programs is None else str(programs)
    if table.is_for_people(programs=written, rows=rows, missed=missed, compare=compare):
        print_table(Table(SHOWN, rows, "programs of ticks, and our answers; KKT in sizes of the program"))
        if programs is not None:
            print(f"the programs are in {programs}; to compare solvers on them:")
            for line in compare:
                print(f"  {line}")
        table.print_paths()
    print_notes(missed, prefix="missed")
    return 1 if missed else 0


SHOWN = (
    words("program"),
    *map(number, ("variables", "rows")),
    number("programs", "problems"),
    *map(number, ("solved", "infeasible", "missed")),
    number("KKT max", lambda row: "" if row["residual_max"] is None else f"{row['residual_max']:.1e}"),
)
