"""`hhsim report`."""

import re
import time
from pathlib import Path
from typing import Annotated, Any

import click

from hhsim.system.counted import counted

from .arguments.command import argument, make_command, option
from .arguments.options import OutPath, Printing
from .console import progress

DATE = re.compile(r"\d{4}-\d\d-\d\d-\d{6}-")
"""Date in the name of a result that hhsim named."""
WIDTH = "180mm"
"""Default width of a figure: two columns of most journals."""
FIGURES = ("series", "ticks", "speed-error", "hand")
"""Figures of `hhsim.report.figure_file`, without its imports."""


@make_command
def command(
    *,
    results: tuple[Path, ...] = argument("RESULT...", nargs=-1, required=True),
    out: OutPath | None = option(
        "Folder or page of the report, or file of the --figure. Default: a dated name in results/.", "DIR|FILE.html"
    ),
    figure: Annotated[str, click.Choice(FIGURES)] | None = option("Write this one figure, for a paper, and no page."),
    width: str | None = option(f"Width of the figure, such as 88mm or 3.5in. Default: {WIDTH}.", "WIDTH"),
    printing: Printing,
) -> None:
    """Make one HTML page of results: figures, curves, worst ticks.

    RESULT is a file that hhsim replay or hhsim live wrote, complete or not, or a table of hhsim bench. Of several
    results, each is set beside the first: what differs in what they were fed with and in how they were run, and which
    figures that makes better or worse. The page holds its pictures and needs neither a network nor a script; the same
    pictures lie beside it as PNG files.

    With --figure one of its figures becomes a file for a paper: curves over time (series), how long a tick takes
    (ticks), speed against error (speed-error), or the hand on the object (hand). Of a table of hhsim bench speed-error
    or peers it is speed-error.

    \b
    Examples:
      hhsim report results/grasp.h5
      hhsim report coupled.h5 progressive.h5 --out methods.html
      hhsim report grasp.h5 --figure series --width 88mm --out fig.pdf
      hhsim report results/speed-error.json --figure speed-error --out fig.svg
    """
    from hhsim.report.figure_file import check_figure_path, make_figure, parse_width, write_figure
    from hhsim.report.report import check_report_path, make_report, write_report
    from hhsim.system.output_path import dated_output_path

    begin, name = time.perf_counter(), DATE.sub("", results[0].stem)
    if width is not None and figure is None:
        raise click.UsageError("--width is of a figure: name one with --figure, such as --figure series")
    inches = parse_width(width or WIDTH)
    if out is not None:
        (check_report_path if figure is None else check_figure_path)(out)
    document: dict[str, Any]
    if figure is None:
        with progress(quiet=printing.quiet) as bar:
            report = make_report(results, progress=bar)
        files = write_report(report, out or dated_output_path(f"{name}-report", suffix=""))
        document = {**report.to_json(), "report": str(files.page), "pictures": list(map(str, files.pictures))}
        where = f"the report is in {files.page}, with {counted(len(files.pictures), 'picture')} beside it"
        lines = [*report.verdict_lines(), where]
    else:
        drawn, path = make_figure(results, figure), out or dated_output_path(f"{name}-{figure}", suffix=".pdf")
        write_figure(drawn, path, inches)
        document = {"figure": str(path), "width": 0.0254 * inches}
        lines = [f"{drawn.title}, {25.4 * inches:g} mm wide, is in {path}"]
    printing.show({**document, "seconds": time.perf_counter() - begin}, *lines)
