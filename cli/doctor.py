"""`hhsim doctor`."""

import click

from hhsim.table.table import Table

from .arguments import options
from .console import print_json, print_line, print_table


@click.command(cls=options.Command)
@click.option(
    "--rate", type=options.Number(10.0, 10_000.0), default=1000.0, metavar="HZ", help="Wake-ups a second [Hz]."
)
@click.option(
    "--duration", type=options.Number(0.1, 3600.0), default=10.0, metavar="S", help="How long to measure [s]."
)
@click.option(
    "--cpu", type=click.IntRange(-1, 4095), metavar="N", help="Processor to stay on; -1: any. Default: the last one."
)
@click.option(
    "--no-realtime", is_flag=True, help="Measure without real-time scheduling and without a processor of one's own."
)
@options.Printing.argument("printing")
def command(rate: float, duration: float, cpu: int | None, no_realtime: bool, printing: options.Printing) -> int:
    """Tell whether this machine keeps 1 kHz, and if not, why.

    Waits for deadlines as a session's loop would, in compiled code, asks the system for the same, and counts how late
    it is woken. Exit code 1 where more than 0.1 % of the periods are missed, more than 9 in a row, or where one wake-up
    in a hundred is later than a quarter of a period; then it says what to change. A session looks for 0.3 s by itself.

    \b
    Examples:
      hhsim doctor
      hhsim doctor --rate 2000 --duration 60
      hhsim doctor --no-realtime
    """
    from hhsim.live.doctor import examine
    from hhsim.live.real_time import RealTimeWishes, described

    wishes = RealTimeWishes.none() if no_realtime else RealTimeWishes(cpu=cpu)
    diagnosis = examine(rate, duration, wishes)
    if printing.as_json:
        print_json(diagnosis.to_json())
    elif not printing.quiet:
        title = f"{diagnosis.wakeups.periods:,} periods at {rate:,g} Hz"
        headings, cells = ("measured", "hhsim", "limit", "unit"), [row.cells for row in diagnosis.rows]
        print_table(Table.of_cells(headings, cells, title, numbers=headings[1:3]))
        print_line(f"granted: {described(diagnosis.wakeups.mode)}")
        for line in (diagnosis.verdict, *(f"  - {advice}" for advice in diagnosis.advice)):
            print_line(line)
    return 0 if diagnosis.good else 1
