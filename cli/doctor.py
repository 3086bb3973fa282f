"""`hhsim doctor`."""

from typing import Annotated

import click

from hhsim.table.table import Table, number, words

from .arguments.command import Number, make_command, option
from .arguments.options import Printing


@make_command
def command(
    *,
    rate: Annotated[float, Number(10.0, 10_000.0)] = option("Wake-ups a second [Hz].", "HZ", default=1000.0),
    duration: Annotated[float, Number(0.1, 3600.0)] = option("How long to measure [s].", "S", default=10.0),
    cpu: Annotated[int, click.IntRange(-1, 4095)] | None = option(
        "Processor to stay on; -1: any. Default: the last one.", "N"
    ),
    no_realtime: bool = option("Measure without real-time scheduling and without a processor of one's own."),
    printing: Printing,
) -> int:
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
    from hhsim.live.doctor import measure_wakeups
    from hhsim.live.real_time import RealTimeWishes, described

    found = measure_wakeups(rate, duration, RealTimeWishes.none() if no_realtime else RealTimeWishes(cpu=cpu))
    columns = words("measured", "name"), number("hhsim", "value"), number("limit", missing=""), words("unit")
    printing.show(
        found.to_json(),
        Table(columns, found.rows, f"{found.periods:,} periods at {rate:,g} Hz"),
        f"granted: {described(found.mode)}",
        found.verdict,
        *(f"  - {advice}" for advice in found.advice),
    )
    return 0 if found.good else 1
