"""`hhsim gate`."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hhsim.errors import InputError

from .arguments import options
from .arguments.option_group import OptionGroup, option
from .arguments.options import FILE
from .console import announce_compilation, print_json, print_notes, print_table, progress
from .run_again import names_a_result

if TYPE_CHECKING:
    from hhsim.gate.baseline import Baseline
    from hhsim.gate.gate import GateReport
    from hhsim.result.reader import Result

STEP_SUMMARY = "GITHUB_STEP_SUMMARY"


class Comparison(OptionGroup):
    """What a suite is compared with, and how it is timed."""

    baseline: Path | None = option(
        type=FILE,
        metavar="FILE",
        help="What to compare with: a file of --write-baseline; for a RESULT also another result. Default: the file "
        "that the suite names.",
    )
    base_python: Path | None = option(
        type=FILE,
        metavar="PYTHON",
        help="A python that has the base's hhsim, run in turn with this one: the only fair comparison of times.",
    )
    base_folder: Path | None = option(
        type=FILE,
        metavar="DIR",
        help="Folder of the base that stands for the suite's: its scenes find their methods, recordings, submissions "
        "and sessions there. Without --base-python, this python runs it too.",
    )
    suite: Path | None = option(
        type=FILE,
        metavar="SUITE",
        help="Whose [limits] a RESULT is held to. Default: the limits that hhsim replay shows; no file of the current "
        "folder is read.",
    )
    write_baseline: Path | None = option(type=FILE, metavar="FILE", help="Record the suite's run in this file.")
    time: bool = option("--time/--no-time", default=True, help="Judge and record times, or leave them out.")
    processes: int | None = option(
        type=click.IntRange(3, 100),
        metavar="N",
        help="Timed processes of each side and scene. Default: as the suite says, else 5.",
    )


@click.command()
@click.argument("target", metavar="[RESULT|SUITE]", required=False, type=FILE)
@Comparison.argument("comparison")
@click.option("--markdown", type=FILE, metavar="FILE", help="Write a summary in Markdown.")
@click.option("--step-summary", is_flag=True, help=f"Append the summary to the file that ${STEP_SUMMARY} names.")
@click.option("--junit", type=FILE, metavar="FILE", help="Write JUnit XML.")
@options.json
@options.quiet
def command(
    target: Path | None,
    comparison: Comparison,
    markdown: Path | None,
    step_summary: bool,
    junit: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Judge a change for CI: errors, work and time, yes or no.

    SUITE is a TOML file of scenes and limits; without it, hhsim-gate.toml of the current folder, else the one that
    ships. A scene is a replay, of a method from outside too, a submission or a recorded session. Errors have absolute
    limits. Work counters are compared with the base exactly, but for a stated slack. Times are medians over processes
    of the CPU p50: of base and head run in turn with --base-python, or divided by a fixed reference workload where the
    baseline was recorded elsewhere. A RESULT is judged as it is, by its file alone; of its times, only those that
    --suite limits.

    Exit codes: 0 ok, 1 a limit was missed, 2 bad input, 3 the two sides were fed with different inputs.

    \b
    Examples:
      hhsim gate
      hhsim gate --base-python ../base/.venv/bin/python --step-summary
      hhsim gate my-gate.toml --write-baseline gate-baseline.json
      hhsim gate my-gate.toml --baseline gate-baseline.json --junit gate.xml
      hhsim gate --base-folder ../base
      hhsim gate results/after.h5 --baseline results/before.h5
      hhsim gate session.h5 --suite hhsim-gate.toml
    """
    from hhsim.gate.report import markdown as as_markdown
    from hhsim.system.atomic_write import write_atomically
    from hhsim.system.output_path import check_output_path

    summary = _step_summary() if step_summary else None
    for path in (comparison.write_baseline, markdown, junit):
        if path is not None:
            check_output_path(path)
    announce_compilation(quiet=quiet)
    if target is not None and names_a_result(target):
        if any((comparison.base_python, comparison.base_folder, comparison.write_baseline)):
            raise click.UsageError(
                "--base-python, --base-folder and --write-baseline run a suite: a RESULT is judged as it is"
            )
        report = _judge_result(target, comparison, timed=comparison.time)
    else:
        if comparison.suite is not None:
            raise click.UsageError("--suite is for a RESULT: a suite is run by its name, hhsim gate SUITE")
        report = _judge_suite(target, comparison, quiet=quiet)
    # The name of a file need be no UTF-8.
    text = as_markdown(report).encode(errors="replace")
    if markdown is not None:
        write_atomically(markdown, text)
    if summary is not None:
        with summary.open("ab") as file:
            file.write(text)
    if junit is not None:
        from hhsim.gate.report import junit as as_junit

        write_atomically(junit, as_junit(report))
    if comparison.write_baseline is not None and not report.recorded:
        print_notes([f"not every scene ran, so {comparison.write_baseline} is not written"], prefix="gate")
    _print(report, comparison.write_baseline if report.recorded else None, as_json=as_json, quiet=quiet)
    return report.exit_code


def _judge_result(path: Path, comparison: Comparison, *, timed: bool) -> "GateReport":
    from hhsim.gate.baseline import load_baseline
    from hhsim.gate.gate import gate_result
    from hhsim.gate.suite import load_suite
    from hhsim.result.reader import load_result

    suite = None if comparison.suite is None else load_suite(comparison.suite)
    baseline = comparison.baseline
    base: Result | Baseline | None = None
    if baseline is not None:
        base = load_result(baseline) if names_a_result(baseline) else load_baseline(baseline)
    return gate_result(load_result(path), suite, base, timed=timed)


def _judge_suite(target: Path | None, comparison: Comparison, *, quiet: bool) -> "GateReport":
    from dataclasses import replace

    from hhsim.gate.baseline import load_baseline, write_baseline
    from hhsim.gate.gate import find_suite, gate_suite
    from hhsim.gate.run import find_side, this_python
    from hhsim.gate.suite import SUITE_FILE
    from hhsim.kernels.machine_calibration import REFERENCE_VERSION

    suite = find_suite(target, Path(SUITE_FILE))
    if comparison.processes is not None:
        suite = replace(suite, processes=comparison.processes)
    written = comparison.write_baseline
    # Who names a base's folder compares with it: the suite's own baseline is the head's.
    usual = suite.baseline if written is None and comparison.base_folder is None else None
    named = comparison.baseline or usual
    baseline = None if named is None else load_baseline(named)
    head = find_side("head", this_python())
    base = None
    if comparison.base_folder is not None and not comparison.base_folder.is_dir():
        raise InputError(f"--base-folder {comparison.base_folder}: no such folder; expected a checkout of the base")
    if comparison.base_python is not None or comparison.base_folder is not None:
        python = this_python() if comparison.base_python is None else comparison.base_python.absolute()
        base = find_side("base", python, comparison.base_folder)
    with progress(quiet=quiet) as report_progress:
        report = gate_suite(
            suite,
            head,
            base=base,
            baseline=baseline,
            timed=comparison.time,
            record_times=comparison.time and written is not None,
            progress=report_progress,
        )
    if written is not None and report.recorded:
        write_baseline(written, report.recorded, REFERENCE_VERSION)
    return report


def _step_summary() -> Path:
    named = os.environ.get(STEP_SUMMARY)
    if not named:
        raise InputError(f"--step-summary: ${STEP_SUMMARY} is not set; outside of GitHub Actions, use --markdown FILE")
    return Path(named)


def _print(report: "GateReport", written: Path | None, *, as_json: bool, quiet: bool) -> None:
    from hhsim.gate.report import HEADINGS, NUMBERS, cells, headline, reasons

    if as_json:
        print_json({**report.to_json(), "baseline_written": str(written) if written else None})
    elif quiet:
        failing = [row for row in report.rows if not row.passed or row.verdict == "not comparable"]
        print_notes(reasons(failing), prefix="gate")
    else:
        print_table(HEADINGS, [cells(row) for row in report.rows], title=report.source, numbers=NUMBERS)
        for line in (*reasons(report.rows), *report.notes):
            print(f"note: {line}")
        print(headline(report))
        if written is not None:
            print(f"the baseline is in {written}")
