"""`hhsim bench threads`."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click

from .. import options
from ..console import announce_compilation, print_json, print_notes, print_table, progress
from ..name_list import counts, names


@click.command()
@names("--object", "objects", "Objects. Default: cup,bunny.")
@counts("--threads", "threads", "Numbers of threads. Default: 1,2.")
@click.option(
    "--instances",
    type=click.IntRange(1),
    default=100,
    show_default=True,
    metavar="N",
    help="Ticks in contact of each row.",
)
@click.option(
    "--rounds", type=click.IntRange(1), default=9, show_default=True, metavar="N", help="Replays of each row."
)
@options.out
@options.json
@options.quiet
def command(
    objects: tuple[str, ...] | None,
    threads: tuple[int, ...] | None,
    instances: int,
    rounds: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
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
    from hhsim.bench.table import check_table_path, csv_path, write_table
    from hhsim.bench.threads import COLUMNS, ThreadsOptions, measure, remarks, when_threads_pay
    from hhsim.system.output_path import dated_output_path

    named = {"objects": objects, "threads": threads}
    run = replace(
        ThreadsOptions(instances=instances, rounds=rounds),
        **{name: values for name, values in named.items() if values is not None},  # type: ignore[arg-type]
    )
    output_path = out or dated_output_path("bench-threads")
    check_table_path(output_path)
    announce_compilation(quiet=quiet)
    with progress(quiet=quiet) as report:
        rows = measure(run, report)
    write_table(output_path, "threads", COLUMNS, rows, asdict(run))
    sentences, notes = when_threads_pay(rows), remarks(rows)
    if as_json:
        print_json(
            {
                "table": str(output_path),
                "csv": str(csv_path(output_path)),
                "options": asdict(run),
                "units": {column.name: column.unit for column in COLUMNS},
                "rows": rows,
                "when": sentences,
                "notes": notes,
            }
        )
    elif not quiet:
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
