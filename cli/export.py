"""`hhsim export`."""

from pathlib import Path

from hhsim.system.counted import counted

from .arguments.command import argument, make_command, option
from .arguments.options import OutPath, Printing, Side, read_names
from .console import progress


@make_command
def command(
    *,
    result: Path = argument(),
    out: OutPath = argument("FILE"),
    columns: tuple[str, ...] | None = option(
        "Datasets of /tick, such as time,force/total, and of a session live/tick/latency; all for every one. Default: "
        "the usual.",
        "NAMES",
        multiple=True,
        callback=read_names,
    ),
    side: Side | None = option("Which hand, of a result of two.", None, "--hand"),
    printing: Printing,
) -> None:
    """Write the ticks of a result as a table.

    RESULT is a file that hhsim replay, live or repair wrote. In a CSV table each tick is a line, each heading has its
    unit, and an array is a column an element; fingers are counted from the thumb, joints from the palm, both from 0.
    Numbers have every digit, so that they are read back as they were (docs/files.md).

    \b
    Examples:
      hhsim export results/grasp.h5 ticks.csv
      hhsim export grasp.h5 force.csv --columns time,force/total,penetration_depth
      hhsim export session.h5 told.csv --columns live/tick/latency,live/tick/command_stiffness
      hhsim export grasp.h5 everything.csv --columns all
    """
    from hhsim.result.labelled import export_ticks
    from hhsim.result.reader import load_hand

    loaded = load_hand(result, side or "")
    with progress(quiet=printing.quiet) as report:
        written = export_ticks(loaded, out, columns, report)
    printing.show(
        {"result": str(result), "csv": str(out), "ticks": loaded.ticks, "columns": list(written)},
        f"{counted(loaded.ticks, 'tick')}, {counted(len(written), 'column')}: {out}",
    )
