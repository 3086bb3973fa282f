"""`hhsim bench mesh-size`."""

import click

from hhsim.table.table import Table, number, words

from ..arguments.comma_list import counts
from ..arguments.option_group import OptionGroup, option
from ..arguments.options import Command, Output
from ..console import print_notes, print_table, progress
from .suite import SuiteTable


class MeshSizeSettings(OptionGroup):
    """Object and subdivisions."""

    object_name: str = option("--object", metavar="NAME", default="bunny", help="Object of the catalogue.")
    subdivisions: tuple[int, ...] | None = counts(
        "--subdivisions", "How often each triangle becomes four. Default: 2,4.", 6
    )


@click.command(cls=Command)
@MeshSizeSettings.argument("settings")
@Output.argument("output")
def command(settings: MeshSizeSettings, output: Output) -> None:
    """Measure how contact with triangles grows with their number.

    The object as it is, and finer, rounded and a little rough, under the same grasp, in turns. Getting ready (reading
    the file, the tree, the hierarchy) is measured in a fresh process, first without what the cache keeps, then with it.

    \b
    Examples:
      hhsim bench mesh-size
      hhsim bench mesh-size --object teapot --subdivisions 1,2,3 --out sizes.h5
    """
    from hhsim.bench.mesh_size import COLUMNS, MeshSizeOptions, measure

    run = MeshSizeOptions(**settings.given())
    table = SuiteTable(output, "mesh-size", COLUMNS, run)
    with progress(quiet=output.quiet) as report:
        rows = measure(run, report)
    table.write(rows)
    if table.is_for_people(rows=rows):
        print_table(Table(SHOWN, rows, f"{run.object_name}, CPU time of a tick in contact"))
        print_notes(
            [f"{row['triangles']:,} triangles, {row['method']}: {row['failure']}" for row in rows if row["failure"]]
        )
        table.print_paths()


SHOWN = (
    number("triangles"),
    words("method"),
    number("ready", "ready", "s", 1),
    number("again", "ready_again", "s", 1),
    number("memory", "memory", "MB"),
    number("p50", "tick_p50", "µs", 1, missing=""),
    number("p99", "tick_p99", "µs", missing=""),
    number("×", "tick_ratio", digits=2, missing=""),
    number("candidates", missing=""),
    number("distances", "pair_tests", missing=""),
)
