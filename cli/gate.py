"""`hhsim gate`."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from hhsim.errors import HhsimError, InputError
from hhsim.table.table import Table

from .arguments.command import OptionGroup, argument, make_command, option
from .arguments.options import OutPath, Printing
from .arguments.scene_options import names_a_result
from .console import print_notes, progress

if TYPE_CHECKING:
    from hhsim.gate.gate import Baseline, GateReport
    from hhsim.result.reader import Result


class Comparison(OptionGroup):
    """Base of the comparison, and timing."""

    baseline: Path | None = option(
        "File of --write-baseline, or another result, to compare with. Default: the suite's file.", "FILE"
    )
    base_python: Path | None = option(
        "Python of the base's hhsim, run in turn with this one: the only fair comparison of times.", "PYTHON"
    )
    base_folder: Path | None = option(
        "Folder of the base that stands for the suite's, with its methods and recordings.", "DIR"
    )
    suite: Path | None = option(
        "Suite whose [limits] a RESULT is held to. Default: the limits that hhsim replay shows.", "SUITE"
    )
    write_baseline: OutPath | None = option("Record the suite's run in this file.", "FILE")
    time: bool = option("Judge times, or leave them out.", None, "--time/--no-time", default=True)
    processes: Annotated[int, click.IntRange(3, 100)] | None = option(
        "Timed processes of each side and scene. Default: as the suite says, else 5.", "N"
    )


class GateOutput(Printing):
    """Files for CI systems, and amount of output."""

    markdown: OutPath | None = option("Write a summary in Markdown.", "FILE")
    whole: bool = option("Print every figure; without it what changed or was missed.", None, "--all")


@make_command
def command(
    *, target: Path | None = argument("[RESULT|SUITE]", required=False), comparison: Comparison, output: GateOutput
) -> int:
    """Judge a change for CI: errors, work and time, yes or no.

    SUITE is a TOML file of scenes and limits; without it, hhsim-gate.toml of the current folder, else the one that
    ships. A scene is a replay. Errors have absolute limits. Work counters are compared with the base exactly, but for
    a stated slack. Times are medians over processes of the CPU p50, of base and head run in turn with --base-python. A
    RESULT, a session's too, is judged by its file alone; of its times, only those that --suite limits.

    Exit codes: 0 ok, 1 a limit was missed, 2 bad input, 3 the two sides had different inputs. The files are written
    with each of them.

    \b
    Examples:
      hhsim gate
      hhsim gate --base-python ../base/.venv/bin/python
      hhsim gate my-gate.toml --write-baseline gate-baseline.json
      hhsim gate my-gate.toml --baseline gate-baseline.json --markdown gate.md
      hhsim gate --base-folder ../base
      hhsim gate results/after.h5 --baseline results/before.h5
      hhsim gate session.h5 --suite hhsim-gate.toml
    """
    from hhsim.gate.gate import FORMAT, GateReport
    from hhsim.gate.verdict import failed_run
    from hhsim.system.output_path import check_output_path, holds

    for path, kind, words in (
        (comparison.write_baseline, "baseline", FORMAT.encode()),
        (output.markdown, "summary of hhsim gate", b" hhsim gate\n\n"),
    ):
        if path is not None:
            check_output_path(path, kind, holds(words))
    if target is not None and names_a_result(target):
        if any((comparison.base_python, comparison.base_folder, comparison.write_baseline)):
            raise click.UsageError(
                "--base-python, --base-folder and --write-baseline run a suite: a RESULT is judged as it is"
            )
        judge = partial(_judge_result, target, comparison)
    else:
        if comparison.suite is not None:
            raise click.UsageError("--suite is for a RESULT: a suite is run by its name, hhsim gate SUITE")
        judge = partial(_judge_suite, target, comparison, quiet=output.quiet)
    try:
        report = judge()
    except HhsimError as error:
        source = "hhsim gate" if target is None else str(target)
        _write(GateReport(source, "", (failed_run(source, str(error), refused=True),)), output.markdown)
        raise
    _write(report, output.markdown)
    written = comparison.write_baseline
    if written is not None and report.recorded:
        from hhsim.gate.gate import write_baseline

        write_baseline(written, report.recorded)
    elif written is not None:
        print_notes([f"not every scene ran, so {written} is not written"], prefix="gate")
    _print(report, written if report.recorded else None, output)
    return report.exit_code


def _judge_result(path: Path, comparison: Comparison) -> "GateReport":
    from hhsim.gate.gate import GateReport, gate_result, load_baseline
    from hhsim.gate.suite import load_suite
    from hhsim.result.reader import load_result

    suite = None if comparison.suite is None else load_suite(comparison.suite)
    heads, named = list(load_result(path).hands.values()), comparison.baseline
    bases: list[Result | Baseline | None] = [None] * len(heads)
    if named is not None and names_a_result(named):
        found = list(load_result(named).hands.values())
        if len(found) != len(heads):
            raise InputError(f"{path} and {named} are not of as many hands")
        bases = list(found)
    elif named is not None:
        bases = [load_baseline(named)] * len(heads)
    reports = [gate_result(one, suite, base, timed=comparison.time) for one, base in zip(heads, bases)]
    rows, notes = (tuple(one for report in reports for one in getattr(report, name)) for name in ("rows", "notes"))
    return GateReport(str(path), str(named or ""), rows, notes) if len(reports) > 1 else reports[0]


def _judge_suite(target: Path | None, comparison: Comparison, *, quiet: bool) -> "GateReport":
    from msgspec.structs import replace

    from hhsim.gate.gate import gate_suite, load_baseline
    from hhsim.gate.run import find_side
    from hhsim.gate.suite import SUITE_FILE, default_suite, load_suite

    usual = Path(SUITE_FILE)
    suite = load_suite(target or usual) if target is not None or usual.is_file() else default_suite()
    if target is None and not usual.is_file():
        print_notes([f"no {SUITE_FILE} in {Path.cwd()}: hhsim's own default suite is run"])
    if comparison.processes is not None:
        suite = replace(suite, time=replace(suite.time, processes=comparison.processes))
    named = comparison.baseline
    # Who names a base's folder compares with that base, not with the suite's own baseline.
    if named is None and comparison.write_baseline is None and comparison.base_folder is None:
        named = suite.folder / suite.baseline if suite.baseline else None
    baseline = None if named is None else load_baseline(named)
    own = Path(sys.executable)
    head, base = find_side("head", own), None
    if comparison.base_folder is not None and not comparison.base_folder.is_dir():
        raise InputError(f"--base-folder {comparison.base_folder}: no such folder; expected a checkout of the base")
    if comparison.base_python is not None or comparison.base_folder is not None:
        python = own if comparison.base_python is None else comparison.base_python.absolute()
        base = find_side("base", python, comparison.base_folder)
    with progress(quiet=quiet) as report:
        return gate_suite(suite, head, base=base, baseline=baseline, timed=comparison.time, progress=report)


def _write(report: "GateReport", path: Path | None) -> None:
    """Write what CI systems read."""
    from hhsim.gate.report import markdown
    from hhsim.system.atomic_write import write_atomically

    if path is not None:
        # The name of a file may be no UTF-8.
        write_atomically(path, markdown(report).encode(errors="replace"))


def _print(report: "GateReport", written: Path | None, output: GateOutput) -> None:
    from hhsim.gate.report import COLUMNS, headline, left_out, not_judged, reasons, worth_showing
    from hhsim.gate.verdict import REFUSED
    from hhsim.table.verdict import NOT_COMPARABLE

    print_notes(report.refused, prefix="error")
    if output.quiet and not output.as_json:
        failing = [row for row in report.rows if not row.passed or row.verdict == NOT_COMPARABLE]
        print_notes(reasons(failing), prefix="gate")
    shown = list(report.rows) if output.whole else worth_showing(report)
    told = [row for row in shown if row.verdict != REFUSED]
    rest = "" if output.whole else left_out(report)
    output.show(
        {**report.to_json(), "baseline_written": str(written) if written else None},
        *([Table(COLUMNS, shown, report.source)] if shown else []),
        *(f"note: {line}" for line in (*reasons(told), *not_judged(report), *report.notes)),
        *([f"{report.source}: {rest} (--all shows them)"] if rest else []),
        headline(report),
        *([f"the baseline is in {written}"] if written else []),
    )
