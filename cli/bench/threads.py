"""`hhsim bench threads`."""

from typing import Any

import click

from ..comma_list import counts, names
from ..console import announce_compilation, print_json, print_notes, print_table, progress
from ..option_group import OptionGroup, option, shared
from ..options import COUNT, Output
from .table_document import table_document


class ThreadsSettings(OptionGroup):
    """What is replayed, by how many threads, and how often."""

    objects: tuple[str, ...] | None = shared(names("--object", "objects", "Objects. Default: cup,bunny."))
    threads: tuple[int, ...] | None = shared(counts("--threads", "threads", "Numbers of threads. Default: 1,2."))
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
    from hhsim.bench.table import csv_path, write_table
    from hhsim.bench.threads import COLUMNS, ThreadsOptions, measure, remarks, when_threads_pay

    run = ThreadsOptions(**settings.given())
    output_path = output.table_path("threads")
    announce_compilation(quiet=output.quiet)
    with progress(quiet=output.quiet) as report:
        rows = measure(run, report)
    write_table(output_path, "threads", COLUMNS, rows, run.to_json())
    sentences, notes = when_threads_pay(rows), remarks(rows)
    if output.as_json:
        print_json(
            {
                **table_document(output_path, COLUMNS, run.to_json()),
                "rows": rows,
                "when": sentences,
                "notes": notes,
            }
        )
    elif not output.quiet:
        _print_rows(rows)
        for sentence in sentences:
            print(sentence)
        print_notes(notes)
        print(f"the table is in {output_path} and {csv_path(output_path)}")


def _print_rows(rows: list[dict[str, Any]]) -> None:
    numbers = ("contacts", "threads", "detection [µs]", "response [µs]", "total [µs]", "all threads' CPU [µs]", "gain")
    cells = [
        (
            row["object"],
            row["case"],
            row["method"],
            f"{row['contacts']:,.0f}",
            str(row["threads"]),
            *(f"{1e6 * row[name]:.1f}" for name in ("detection", "response", "total", "total_cpu")),
            "" if row["threads"] == 1 else f"{row['speedup']:.2f}",
        )
        for row in rows
    ]
    title = f"wall time of a tick, mean of {rows[0]['instances']} instances in contact"
    print_table(("object", "case", "method", *numbers), cells, title=title, numbers=numbers)
    print()
