"""`hhsim report`: one HTML page of results, which needs no server and no script; the same files give the same bytes."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from hhsim import __version__
from hhsim.errors import InputError, OutputError
from hhsim.metrics.session_faults import how_it_ended
from hhsim.replay.compare import Comparison, compare
from hhsim.report.figure import ReportFigure
from hhsim.report.pictures import HANDS, overview_picture, overview_view
from hhsim.report.run import ReportRun, of_one_run, report_runs
from hhsim.report.sections import result_tables
from hhsim.report.time_series import histogram_figure, series_figure
from hhsim.result.reader import load_result
from hhsim.result.wording import motion_name, object_name
from hhsim.system.atomic_write import write_together
from hhsim.system.counted import counted
from hhsim.system.output_path import check_output_path, holds
from hhsim.system.progress import Progress, silent
from hhsim.table.html import render

GENERATOR = "hhsim report"
"""Program that the page names."""
GENERATED = f'content="{GENERATOR} '.encode()
"""Bytes of every page; a file without them is not replaced."""
PAGE = "report.html"
CHARTS = {"time": series_figure, "ticks": histogram_figure}
"""Figures of all results together."""
CUT_OBJECT = "An object that is much larger than the hand is cut at a clean edge near it."


@dataclass(frozen=True)
class Report:
    """A report that is not written yet: PNGs by file name, and comparisons with the first result.

    A hand of the first one's run has no comparison.
    """

    title: str
    html: str
    pictures: dict[str, bytes]
    runs: tuple[ReportRun, ...]
    comparisons: tuple[Comparison | None, ...]

    def verdict_lines(self) -> list[str]:
        """Return the verdicts, a line each."""
        lines = [f"{run.label}: {run.ended}" for run in self.runs if run.ended]
        lines += [f"{run.label}: {run.verdict.word}. {' '.join(run.verdict.sentences)}" for run in self.runs]
        for run in self.runs:
            lines += [f"{run.label}: {text}" for text in (run.result.contradiction(), run.misstated) if text]
        compared = zip(self.runs[1:], self.comparisons)
        beside = self.runs[0].label
        return lines + [f"{run.label} beside {beside}: {found.sentence()}" for run, found in compared if found]

    def to_json(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        return {
            "title": self.title,
            "results": [
                {
                    "result": str(run.result.path),
                    "label": run.label,
                    "verdict": run.verdict.word,
                    "missed": list(run.verdict.missed),
                    "figures": {row.name: row.value for row in run.rows},
                }
                for run in self.runs
            ],
            "comparisons": [
                {
                    "result": str(run.result.path),
                    "comparable": found.comparable,
                    **{name: list(getattr(found, name)) for name in ("scene", "how", "around")},
                }
                for run, found in zip(self.runs[1:], self.comparisons)
                if found
            ],
        }


class ReportFiles(NamedTuple):
    """Paths of a written report."""

    page: Path
    pictures: tuple[Path, ...]


def make_report(paths: Sequence[Path], *, progress: Progress = silent) -> Report:
    """Make the page of results, in the order of the files; InputError for another file."""
    results = [hand for path in paths for hand in load_result(path).hands.values()]
    steps = itertools.count()

    def report_step(what: str) -> None:
        progress(what, next(steps), 2 + len(CHARTS))

    report_step("reading")
    runs = report_runs(results)
    comparisons = [None if of_one_run(results[0], other) else compare(results[0], other) for other in results[1:]]
    report_step("the hand")
    hands, figures = _hands(runs), {}
    for name, make in CHARTS.items():
        report_step(f"chart of {name}")
        figures[name] = make({run.label: run.result for run in runs})
    shown = (*hands, *figures.values())
    pictures = {figure.name: figure.png for figure in shown if isinstance(figure, ReportFigure)}
    title, subtitle = title_of(runs), subtitle_of(runs, one=not any(comparisons))
    html = render(
        "report/report.html", title=title, subtitle=subtitle, generator=GENERATOR, version=__version__,
        runs=runs, several=len(runs) > 1, hands=hands, hands_note=f"{HANDS} {CUT_OBJECT}", figures=figures,
        **result_tables(runs, comparisons),
    )  # fmt: skip
    return Report(title, html, pictures, tuple(runs), tuple(comparisons))


def check_report_path(output_path: Path) -> Path:
    """Return the path of the page NAME.html, or in a folder, which is made where it is missing.

    Raises OutputError as `hhsim.system.output_path.check_output_path`, or for a file that is no report.
    """
    is_page = output_path.suffix.lower() in (".html", ".htm")
    page = output_path if is_page else output_path / PAGE
    if not is_page and output_path.exists() and not output_path.is_dir():
        raise OutputError(f"{output_path} is a file: name a folder, or a page such as {output_path}.html")
    made = page if is_page or output_path.is_dir() else output_path
    check_output_path(made, "page of hhsim report", holds(GENERATED))
    return page


def write_report(report: Report, output_path: Path) -> ReportFiles:
    """Write the page and its pictures, NAME-….png beside NAME.html, all or none of them, the page last.

    Raises OutputError as `check_report_path`; for a full disk, or a picture's name that is taken where no report is.
    """
    page = check_report_path(output_path)
    stem = "" if page.name == PAGE else f"{page.stem}-"
    files = {page.with_name(f"{stem}{name}.png"): png for name, png in report.pictures.items()}
    taken = [path for path in files if path.exists()]
    if taken and not page.exists():
        raise OutputError(f"{taken[0]} exists, and no report that it belongs to: name another place with --out")
    folder = page.parent
    try:
        missing = not folder.exists()
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot make the folder {folder}: {error.strerror or error}; name another with --out"
        ) from error
    try:
        write_together({**files, page: report.html.encode()})
    except OutputError:
        if missing:
            folder.rmdir()
        raise
    return ReportFiles(page, tuple(files))


def _hands(runs: Sequence[ReportRun]) -> list[ReportFigure | str]:
    """Return the hand of each result, all seen from one side.

    Where a picture cannot be made, its place has a sentence.
    """
    several, view = len(runs) > 1, None
    found: list[ReportFigure | str] = []
    for run in runs:
        try:
            view = view or overview_view(run.result)
            made = overview_picture(run.result, view)
        except InputError as error:
            found.append(f"{f'{run.label}: ' if several else ''}No picture of the hand: {error}")
        else:
            title = f"{run.label}, {made.title[0].lower()}{made.title[1:]}"
            named = replace(made, name=f"{run.prefix}{made.name}", title=title, caption="")
            found.append(named if several else made)
    return found


MOST_NAMED = 4


def title_of(runs: Sequence[ReportRun]) -> str:
    """Return what a report is of, in a line."""
    if all(of_one_run(runs[0].result, run.result) for run in runs[1:]):
        whole = replace(runs[0].result, hands={}) if len(runs) > 1 else runs[0].result
        return replace(runs[0], result=whole).name
    scenes = list(dict.fromkeys(f"{object_name(run.result)}, {motion_name(run.result)}" for run in runs))
    # Of several scenes the labels repeat object and motion: they are told below, and the scenes here.
    named = [run.label for run in runs] if len(scenes) == 1 else scenes
    shown = "; ".join([*named[:MOST_NAMED], *(["…"] if len(named) > MOST_NAMED else [])])
    return f"{scenes[0]}: {shown}" if len(scenes) == 1 else f"{len(runs)} results: {shown}"


def subtitle_of(runs: Sequence[ReportRun], *, one: bool) -> str:
    """Return what the results are, or the one run, in a line below the title."""
    if not one:
        return f"{len(runs)} results, each beside {runs[0].letter}"
    result = runs[0].result
    kind = "a recorded session" if result.live is not None else "a replay"
    ended = how_it_ended(result)
    text = f"{result.path.name}, {kind} of {counted(result.ticks, 'tick')}, written {result.created_utc}"
    return f"{text}, ended: {ended}" if ended else text
