"""`hhsim export`."""

from pathlib import Path

import click

from hhsim.system.counted import counted

from .arguments import options
from .arguments.comma_list import read_names
from .console import print_json, print_line, progress


@click.command(cls=options.Command)
@click.argument("result", type=options.FILE)
@click.argument("out", metavar="FILE", type=options.OUTPUT)
@click.option(
    "--as",
    "form",
    type=click.Choice(["csv", "keypoints", "npz"]),
    help="Write the shown hand as a recording of this format instead, for hhsim import and other software.",
)
@click.option(
    "--columns",
    callback=read_names,
    multiple=True,
    metavar="NAMES",
    help="Datasets of /tick, such as time,force/total, and of a session live/tick/latency; all for every one. Default: "
    "the usual.",
)
@options.one_hand
@options.Printing.argument("printing")
def command(
    result: Path,
    out: Path,
    form: str | None,
    columns: tuple[str, ...] | None,
    side: str | None,
    printing: options.Printing,
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
    from hhsim.result.csv_export import export_ticks
    from hhsim.result.reader import load_hand

    loaded = load_hand(result, side or "")
    if form is not None:
        from hhsim.recordings.registry import export_recording

        if columns:
            raise click.UsageError("--columns is for a table of ticks, and --as writes a recording")
        ticks = export_recording(loaded, form, out)
        if printing.as_json:
            print_json({"result": str(result), "recording": str(out), "format": form, "ticks": ticks})
        elif not printing.quiet:
            print_line(f"{counted(ticks, 'tick')} as {form}: {out}")
        return
    with progress(quiet=printing.quiet) as report:
        written = export_ticks(loaded, out, columns, report)
    if printing.as_json:
        print_json({"result": str(result), "csv": str(out), "ticks": loaded.ticks, "columns": list(written)})
    elif not printing.quiet:
        print_line(f"{counted(loaded.ticks, 'tick')}, {counted(len(written), 'column')}: {out}")
