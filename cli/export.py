"""`hhsim export`."""

from pathlib import Path
from typing import Any, Literal

import click

from hhsim.system.counted import counted

from .arguments.command import argument, make_command, option
from .arguments.options import OutPath, Printing, Side, read_names
from .console import progress


@make_command
def command(
    *,
    result: Path = argument(),
    out: OutPath = argument("FILE"),
    form: Literal["csv", "keypoints", "npz"] | None = option(
        "Write the shown hand as a recording of this format instead, for hhsim import and other software.", None, "--as"
    ),
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
    """Write the ticks of a result, or its hand as a recording.

    RESULT is a file that hhsim replay, live or repair wrote. In a CSV table each tick is a line, each heading has its
    unit, and an array is a column an element; fingers are counted from the thumb, joints from the palm, both from 0.
    Numbers have every digit, so that they are read back as they were (docs/files.md).

    \b
    Examples:
      hhsim export results/grasp.h5 ticks.csv
      hhsim export grasp.h5 force.csv --columns time,force/total,penetration_depth
      hhsim export session.h5 told.csv --columns live/tick/latency,live/tick/command_stiffness
      hhsim export grasp.h5 everything.csv --columns all
      hhsim export grasp.h5 grasp.npz --as keypoints
    """
    from hhsim.recordings.registry import export_recording
    from hhsim.result.csv_export import export_ticks
    from hhsim.result.reader import load_hand

    loaded = load_hand(result, side or "")
    document: dict[str, Any] = {"result": str(result)}
    if form is not None:
        if columns:
            raise click.UsageError("--columns is for a table of ticks, and --as writes a recording")
        ticks = export_recording(loaded, form, out)
        document |= {"recording": str(out), "format": form, "ticks": ticks}
        line = f"{counted(ticks, 'tick')} as {form}: {out}"
    else:
        with progress(quiet=printing.quiet) as report:
            written = export_ticks(loaded, out, columns, report)
        document |= {"csv": str(out), "ticks": loaded.ticks, "columns": list(written)}
        line = f"{counted(loaded.ticks, 'tick')}, {counted(len(written), 'column')}: {out}"
    printing.show(document, line)
