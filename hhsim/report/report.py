"""`hhsim report`: one page of HTML that says all of one result, or sets several side by side, and its pictures.

The page holds its pictures and its style, asks no server for anything, and needs no script. The same files give the
same bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hhsim import __version__
from hhsim.bench import table as bench_file
from hhsim.errors import InputError, OutputError
from hhsim.report.bench_section import bench_section
from hhsim.report.compare import Comparison, compare
from hhsim.report.figure import Album, PageFigure
from hhsim.report.histogram import histogram_figure
from hhsim.report.pictures import CUT, held_picture, overview_picture, overview_view
from hhsim.report.run import ReportRun, report_runs
from hhsim.report.sections import result_tables
from hhsim.report.speed_error import speed_error_figure
from hhsim.report.time_series import series_figure
from hhsim.report.title import subtitle_of, title_of
from hhsim.report.worst_ticks_section import worst_cards
from hhsim.result.reader import load_result
from hhsim.system.atomic_write import write_together
from hhsim.system.input_file import open_input
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent
from hhsim.table.html import render

GENERATOR = "hhsim report"
"""What the page says it was made by; files that do not are not replaced."""
PAGE = "report.html"
"""Name of the page in a folder of its own."""
HEAD_BYTES = 2048
"""Of a page that is there already: its head is in them."""
FIGURES = (
    ("time", "Over time", series_figure),
    ("ticks", "How long a tick takes", histogram_figure),
    ("speed-error", "Speed against error", speed_error_figure),
)
"""Anchor, heading and maker of the figures that show all results together."""
HANDS = "Skin: graphic hand. Blue: haptic hand. Dots: contacts. Red: forces; the object is see-through."
"""Below the hands of several results."""
CUT_OBJECT = "An object that is much larger than the hand is cut at a clean edge near it."
"""And that of those of which one is cut."""


@dataclass(frozen=True)
class Report:
    """A report that is not written yet.

    Attributes:
        pictures: PNGs by the name that each file gets.
        runs: What was computed of each result.
        comparisons: Of each but the first one with the first one.
    """

    title: str
    html: str
    pictures: dict[str, bytes]
    runs: tuple[ReportRun, ...]
    comparisons: tuple[Comparison, ...]

    def verdict_lines(self) -> list[str]:
        """The verdicts, a line each."""
        lines = [f"{run.label}: {run.ended}" for run in self.runs if run.ended]
        lines += [f"{run.label}: {run.verdict.word}. {' '.join(run.verdict.sentences)}" for run in self.runs]
        for run in self.runs:
            lines += [f"{run.label}: {text}" for text in (run.result.contradiction(), run.misstated) if text]
        compared = zip(self.runs[1:], self.comparisons)
        return lines + [f"{run.label} beside {self.runs[0].label}: {found.sentence()}" for run, found in compared]

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
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
                    "scene": list(found.scene),
                    "how": list(found.how),
                    "around": list(found.around),
                }
                for run, found in zip(self.runs[1:], self.comparisons)
            ],
        }


@dataclass(frozen=True)
class ReportFiles:
    """Where a report is."""

    page: Path
    pictures: tuple[Path, ...]

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {"report": str(self.page), "pictures": [str(path) for path in self.pictures]}


def make_report(paths: Sequence[Path], *, progress: Progress = silent) -> Report:
    """Read results and tables of `hhsim bench`, and make the page of them.

    Args:
        paths: Files, in the order of the page; results are compared with the first of them.

    Raises:
        InputError: No file, or one that is neither a result nor a table of hhsim bench.
    """
    if not paths:
        raise InputError("a report needs at least one result")
    tables = {path: bench_file.load_table(path) for path in paths if bench_file.is_table(path)}
    results = [load_result(path) for path in paths if path not in tables]
    steps = _Steps(progress, 3 + len(FIGURES))
    steps("reading")
    runs = report_runs(results)
    comparisons = [compare(results[0], other) for other in results[1:]]
    album = Album()
    parts = _result_parts(runs, comparisons, album, steps) if runs else {}
    benches = {
        f"bench-{i}": bench_section(found, path.name, album, f"bench-{i}-" if len(tables) > 1 else "")
        for i, (path, found) in enumerate(tables.items(), 1)
    }
    title = title_of(runs, [found.suite for found in tables.values()])
    html = render(
        "report/report.html", title=title, generator=GENERATOR, version=__version__,
        runs=runs, several=len(runs) > 1, benches=benches, **parts,
    )  # fmt: skip
    return Report(title, html, album.pictures, tuple(runs), tuple(comparisons))


def check_report_path(output_path: Path) -> Path:
    """Look, before the work, for what would keep a report from being written.

    Args:
        output_path: A page, NAME.html, or a folder, which is made where it is missing.

    Returns:
        Where the page goes.

    Raises:
        OutputError: As `hhsim.system.output_path.check_output_path`; or a file is there that hhsim report did not
        write.
    """
    if output_path.suffix.lower() in (".html", ".htm"):
        page = output_path
        check_output_path(page)
    elif output_path.is_dir():
        page = output_path / PAGE
        check_output_path(page)
    else:
        page = output_path / PAGE
        check_output_path(output_path)
        if output_path.exists():
            raise OutputError(f"{output_path} is a file: name a folder, or a page such as {output_path}.html")
    if page.exists() and f'content="{GENERATOR} ' not in _head(page):
        raise OutputError(
            f"{page} exists and is no page of hhsim report, so it is not replaced: name another with --out"
        )
    return page


def write_report(report: Report, output_path: Path) -> ReportFiles:
    """Write the page and its pictures, all of them or nothing, the page last.

    Args:
        output_path: As for `check_report_path`. Of NAME.html the pictures are NAME-….png beside it.

    Raises:
        OutputError: As `check_report_path`; or a picture's name is taken, and no page of a report is there that
            it could belong to; or a full disk.
    """
    page = check_report_path(output_path)
    stem = "" if page.name == PAGE else f"{page.stem}-"
    files = {page.with_name(f"{stem}{name}.png"): png for name, png in report.pictures.items()}
    taken = [path for path in files if path.exists()]
    if taken and not page.exists():
        raise OutputError(f"{taken[0]} exists, and no report that it belongs to: name another place with --out")
    made = _make_folder(page.parent)
    try:
        write_together({**files, page: report.html.encode()})
    except OutputError:
        if made:
            page.parent.rmdir()
        raise
    return ReportFiles(page, tuple(files))


def _result_parts(
    runs: Sequence[ReportRun], comparisons: Sequence[Comparison], album: Album, steps: "_Steps"
) -> dict[str, Any]:
    """Return all that the page shows of results, by the names of its template."""
    several = len(runs) > 1
    results = {run.label: run.result for run in runs}
    steps("the hand")
    hands = _hands(runs, album)
    cut = any(isinstance(hand, PageFigure) and CUT in hand.figure.caption for hand in hands)
    # The one beside the curves says most of several results, the other of one.
    beside, below = ("speed-error", "ticks") if several else ("ticks", "speed-error")
    figures, headings = {}, {}
    for name, heading, make in FIGURES:
        steps(heading.lower())
        figures[name], headings[name] = album.shown(make(results), aside=name == beside), heading
    steps("worst ticks")
    return {
        "subtitle": subtitle_of(runs),
        "figures": figures,
        "beside": beside,
        "below": below,
        "below_heading": headings[below],
        "hands": hands,
        "hands_note": f"{HANDS} {CUT_OBJECT}" if cut else HANDS,
        "worst": [(run, worst_cards(run, album)) for run in runs],
        **result_tables(runs, comparisons),
    }


def _hands(runs: Sequence[ReportRun], album: Album) -> list[PageFigure | str]:
    """Return the hand of one result in two halves; of several the half that says more, all from the same side.

    A sentence stands for a picture that cannot be made.
    """
    several, view = len(runs) > 1, None
    found: list[PageFigure | str] = []
    for run in runs:
        try:
            if several:
                view = view or overview_view(run.result)
                made = held_picture(run.result, view)
            else:
                made = overview_picture(run.result)
        except InputError as error:
            found.append(
                f"{run.label}: No picture of the hand: {error}" if several else f"No picture of the hand: {error}"
            )
        else:
            title = f"{run.label}, {made.title[0].lower()}{made.title[1:]}" if several else ""
            found.append(album.shown(made, run.prefix, title))
    return found


def _head(page: Path) -> str:
    try:
        with open_input(page) as file:
            return file.read(HEAD_BYTES).decode("utf-8", "replace")
    except OSError as error:
        raise OutputError(f"cannot replace {page}: {error.strerror or error}; name another with --out") from error


def _make_folder(folder: Path) -> bool:
    """Make the folder where it is missing, and say whether it was."""
    try:
        missing = not folder.exists()
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot make the folder {folder}: {error.strerror or error}; name another with --out"
        ) from error
    return missing


class _Steps:
    """Tells how far the work is."""

    def __init__(self, progress: Progress, count: int) -> None:
        self._progress, self._count, self._done = progress, count, 0

    def __call__(self, what: str) -> None:
        self._progress(what, min(self._done, self._count), self._count)
        self._done += 1
