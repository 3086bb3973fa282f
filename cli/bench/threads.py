"""`hhsim bench threads`."""

import click

from hhsim.table.table import Table, number, words

from ..arguments.comma_list import counts, names
from ..arguments.option_group import OptionGroup, option
from ..arguments.options import COUNT, Command, Output
from ..console import print_notes, print_table, progress
from .suite import SuiteTable


class ThreadsSettings(OptionGroup):
    """Objects, numbers of threads, and repetitions."""

    objects: tuple[str, ...] | None = names("--object", "Objects of Fig. 15. Default: cup,bunny.")
    threads: tuple[int, ...] | None = counts("--threads", "Numbers of threads. Default: 1,2.", 5)
    instances: int = option(type=COUNT, default=100, metavar="N", help="Instances of each case.")
    rounds: int = option(type=COUNT, default=9, metavar="N", help="Plays of each row.")


@click.command(cls=Command)
@ThreadsSettings.argument("settings")
@Output.argument("output")
def command(settings: ThreadsSettings, output: Output) -> None:
    """Measure when threads pay: the paper's Fig. 15.

    Single finger (SF), two fingers (TF), five fingers (FF) and whole hand (WH), with one thread and with several, in
    turns. Times are wall times, which is what threads are to save; the processor time beside them is that of all
    threads, with what they spend on waiting for work.

    \b
    Examples:
      hhsim bench threads
      hhsim bench threads --object bunny --threads 1,2,3
      hhsim bench threads --out threads.h5 --json
    """
    from hhsim.bench.paper.threads import COLUMNS, ThreadsOptions, best_speedup, measure, remarks

    run = ThreadsOptions(**settings.given())
    table = SuiteTable(output, "threads", COLUMNS, run)
    with progress(quiet=output.quiet) as report:
        rows = measure(run, report)
    table.write(rows)
    notes = remarks(rows)
    if table.is_for_people(rows=rows, notes=notes):
        title = f"wall time of a tick in contact, mean of {rows[0]['instances']} instances"
        print_table(Table(SHOWN, rows, title))
        print()
        print(best_speedup(rows))
        print_notes(notes)
        table.print_paths()


SHOWN = (
    *map(words, ("object", "case", "method")),
    *map(number, ("contacts", "threads")),
    number("detection", "detection", "µs", 1),
    number("response", "response", "µs", 1),
    number("total", "total", "µs", 1),
    number("all threads' CPU", "total_cpu", "µs", 1),
    number("gain", lambda row: "" if row["threads"] == 1 else row["speedup"], digits=2),
)
