"""`hhsim report`."""

import re
import time
from pathlib import Path

import click

from . import options
from .console import announce_compilation, print_json, progress

DATE = re.compile(r"\d{4}-\d\d-\d\d-\d{6}-")
"""Before the name of a result that hhsim named."""


@click.command()
@click.argument("results", metavar="RESULT...", nargs=-1, required=True, type=options.FILE)
@click.option(
    "--out",
    type=options.FILE,
    metavar="DIR|FILE.html",
    help="A folder, which gets report.html and the pictures, or the page itself, with the pictures beside it. "
    "Default: a dated folder in results/ under the current one.",
)
@options.json
@options.quiet
def command(results: tuple[Path, ...], out: Path | None, as_json: bool, quiet: bool) -> None:
    """Make one HTML page of results: figures, curves, worst ticks.

    RESULT is a file that hhsim replay or hhsim live wrote, complete or not, or a table of hhsim bench. Of several
    results, each is set beside the first: what differs in what they were fed with and in how they were run, and which
    figures that makes better or worse. The page holds its pictures and needs neither a network nor a script; the same
    pictures lie beside it as PNG files.

    \b
    Examples:
      hhsim report results/grasp.h5
      hhsim report coupled.h5 progressive.h5 --out methods.html
      hhsim report session.h5 --out session-report
      hhsim report results/speed-error.h5 --json
    """
    from hhsim.report.report import check_report_path, make_report, write_report
    from hhsim.system.output_path import dated_output_path

    begin = time.perf_counter()
    announce_compilation(quiet=quiet)
    if out is not None:
        check_report_path(out)
    with progress(quiet=quiet) as bar:
        report = make_report(results, progress=bar)
    files = write_report(report, out or dated_output_path(f"{DATE.sub('', results[0].stem)}-report", suffix=""))
    if as_json:
        print_json({**report.to_json(), **files.to_json(), "seconds": time.perf_counter() - begin})
    elif not quiet:
        for line in report.verdict_lines():
            print(line)
        print(f"the report is in {files.page}, with {len(files.pictures)} pictures beside it")
