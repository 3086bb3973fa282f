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


@click.command(cls=options.Command)
@click.argument("results", metavar="RESULT...", nargs=-1, required=True, type=options.FILE)
@click.option(
    "--out",
    type=options.OUTPUT,
    metavar="DIR|FILE.html",
    help="Folder or page of the report. Default: a dated name in results/.",
)
@options.Printing.argument("printing")
def command(results: tuple[Path, ...], out: Path | None, printing: options.Printing) -> None:
    """Make one HTML page of results: figures, curves, worst ticks.

    RESULT is a file that hhsim replay or hhsim live wrote, complete or not, or a table of hhsim bench. Of several
    results, each is set beside the first: what differs in what they were fed with and in how they were run, and which
    figures that makes better or worse. The page holds its pictures and needs neither a network nor a script; the same
    pictures lie beside it as PNG files.

    \b
    Examples:
      hhsim report results/grasp.h5
      hhsim report coupled.h5 progressive.h5 --out methods.html
      hhsim report results/speed-error.json
    """
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
