"""`hhsim report`."""

import re
import time
from pathlib import Path

import click

from hhsim.system.counted import counted

from .arguments import options
from .console import print_json, print_line, progress

DATE = re.compile(r"\d{4}-\d\d-\d\d-\d{6}-")
"""Date in the name of a result that hhsim named."""
FIGURES = ("series", "ticks", "speed-error", "hand")
"""Figures of `hhsim.report.figure_file`, without its imports."""
WIDTH = "180mm"
"""Default width of a figure: two columns of most journals."""


@click.command(cls=options.Command)
@click.argument("results", metavar="RESULT...", nargs=-1, required=True, type=options.FILE)
@click.option(
    "--out",
    type=options.OUTPUT,
    metavar="DIR|FILE.html",
    help="Folder or page of the report, or file of the --figure. Default: a dated name in results/.",
)
@click.option("--figure", type=click.Choice(FIGURES), help="Write this one figure, for a paper, and no page.")
@click.option("--width", metavar="WIDTH", help=f"Width of the figure, such as 88mm or 3.5in. Default: {WIDTH}.")
@options.Printing.argument("printing")
def command(
    results: tuple[Path, ...], out: Path | None, figure: str | None, width: str | None, printing: options.Printing
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
    if figure is not None:
        _write_figure(results, figure, width or WIDTH, out, printing)
        return
    if width is not None:
        raise click.UsageError("--width is of a figure: name one with --figure, such as --figure series")
    from hhsim.report.report import check_report_path, make_report, write_report
    from hhsim.system.output_path import dated_output_path

    begin = time.perf_counter()
    if out is not None:
        check_report_path(out)
    with progress(quiet=printing.quiet) as bar:
        report = make_report(results, progress=bar)
    files = write_report(report, out or dated_output_path(f"{DATE.sub('', results[0].stem)}-report", suffix=""))
    if printing.as_json:
        paths = {"report": str(files.page), "pictures": list(map(str, files.pictures))}
        print_json({**report.to_json(), **paths, "seconds": time.perf_counter() - begin})
    elif not printing.quiet:
        for line in report.verdict_lines():
            print_line(line)
        print_line(f"the report is in {files.page}, with {counted(len(files.pictures), 'picture')} beside it")


def _write_figure(
    results: tuple[Path, ...], name: str, width: str, out: Path | None, printing: options.Printing
) -> None:
    from hhsim.report.figure_file import check_figure_path, make_figure, parse_width, write_figure
    from hhsim.system.output_path import dated_output_path

    begin = time.perf_counter()
    inches = parse_width(width)
    if out is not None:
        check_figure_path(out)
    figure = make_figure(results, name)
    path = out or dated_output_path(f"{DATE.sub('', results[0].stem)}-{name}", suffix=".pdf")
    write_figure(figure, path, inches)
    if printing.as_json:
        print_json({"figure": str(path), "width": 0.0254 * inches, "seconds": time.perf_counter() - begin})
    elif not printing.quiet:
        print_line(f"{figure.title}, {25.4 * inches:g} mm wide, is in {path}")
