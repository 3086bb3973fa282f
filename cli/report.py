"""`hhsim report`."""

import re
import time
from pathlib import Path

from hhsim.system.counted import counted

from .arguments.command import argument, make_command, option
from .arguments.options import OutPath, Printing
from .console import progress

DATE = re.compile(r"\d{4}-\d\d-\d\d-\d{6}-")
"""Date in the name of a result that hhsim named."""


@make_command
def command(
    *,
    results: tuple[Path, ...] = argument("RESULT...", nargs=-1, required=True),
    out: OutPath | None = option("Folder or page of the report. Default: a dated name in results/.", "DIR|FILE.html"),
    printing: Printing,
) -> None:
    """Make one HTML page of results: figures, curves, worst ticks.

    RESULT is a file that hhsim replay or hhsim live wrote, complete or not. Of several results, each is
    set beside the first: what differs in what they were fed with and in how they were run, and which
    figures that makes better or worse. The page holds its pictures and needs neither a network nor a script; the same
    pictures lie beside it as PNG files.

    \b
    Examples:
      hhsim report results/grasp.h5
      hhsim report coupled.h5 progressive.h5 --out methods.html
    """
    from hhsim.report.report import check_report_path, make_report, write_report
    from hhsim.system.output_path import dated_output_path

    begin, name = time.perf_counter(), DATE.sub("", results[0].stem)
    if out is not None:
        check_report_path(out)
    with progress(quiet=printing.quiet) as bar:
        report = make_report(results, progress=bar)
    files = write_report(report, out or dated_output_path(f"{name}-report", suffix=""))
    printing.show(
        {
            **report.to_json(),
            "report": str(files.page),
            "pictures": list(map(str, files.pictures)),
            "seconds": time.perf_counter() - begin,
        },
        *report.verdict_lines(),
        f"the report is in {files.page}, with {counted(len(files.pictures), 'picture')} beside it",
    )
