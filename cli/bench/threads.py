"""`hhsim bench threads`."""

from dataclasses import asdict

import click

from hhsim.table.table import Table, number, words

from ..arguments.comma_list import counts, names
from ..arguments.option_group import OptionGroup, option
from ..arguments.options import COUNT, Output
from ..console import print_notes, print_table
from .suite import SuiteTable, measuring


class ThreadsSettings(OptionGroup):
    """Objects, numbers of threads, and repetitions."""

    objects: tuple[str, ...] | None = names("--object", "Objects. Default: cup,bunny.")
    threads: tuple[int, ...] | None = counts("--threads", "Numbers of threads. Default: 1,2.", 5)
    instances: int = option(type=COUNT, default=100, metavar="N", help="Ticks in contact of each row.")
    rounds: int = option(type=COUNT, default=9, metavar="N", help="Replays of each row.")


@click.command()
@ThreadsSettings.argument("settings")
@Output.argument("output")
def command(settings: ThreadsSettings, output: Output) -> None:
    """Measure when threads pay: the paper's Fig. 15.

    Single finger (SF), two fingers (TF), five fingers (FF) and whole hand (WH), with one thread and with several, in
    turns. Times are wall times, which is what threads are to save;
    the processor time beside them is that of all threads, with what they spend on waiting for work.

    \b
    Examples:
      hhsim bench threads
      hhsim bench threads --object bunny --threads 1,2,3
      hhsim bench threads --out threads.h5 --json
    """
    from hhsim.bench.threads import COLUMNS, ThreadsOptions, measure, remarks, when_threads_pay

    run = ThreadsOptions(**settings.given())
    table = SuiteTable(output, "threads", COLUMNS, asdict(run))
    with measuring(output) as report:
        rows = measure(run, report)
    table.write(rows)
    sentences, notes = when_threads_pay(rows), remarks(rows)
    if output.as_json:
        table.print_json(rows=rows, when=sentences, notes=notes)
    elif not output.quiet:
        title = f"wall time of a tick, mean of {rows[0]['instances']} instances in contact"
        print_table(Table(SHOWN, rows, title))
        print()
        for sentence in sentences:
            print(sentence)
        print_notes(notes)
        table.print_paths()


SHOWN = (
    words("object"),
    words("case"),
    words("method"),
    number("contacts"),
    number("threads"),
    number("detection", "detection", "µs", 1),
    number("response", "response", "µs", 1),
    number("total", "total", "µs", 1),
    number("all threads' CPU", "total_cpu", "µs", 1),
    number("gain", lambda row: "" if row["threads"] == 1 else row["speedup"], digits=2),
)
