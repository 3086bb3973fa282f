"""The parts of a report that are tables: what was run, figures, differences, phases, session, machine, origin."""

import math
import shlex
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hhsim.gate.time_comparison import BETTER, SAME, WORSE
from hhsim.live.session.session_log import session_log
from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.session_faults import recorded_faults
from hhsim.replay.summary_table import SummaryRow
from hhsim.report.compare import Comparison, compared
from hhsim.report.html import Html, commands, element, joined, listed, paragraph, table
from hhsim.report.key_table import key_table
from hhsim.report.provenance import NONE, option_facts, origin_facts, run_facts
from hhsim.report.run import ReportRun
from hhsim.result.reader import Result
from hhsim.system.shown_number import number

MOST_PHASES = 100
"""Phases that are shown of a result."""
MOST_EVENTS = 60
"""Lines of a session's log that are shown."""
EVENT_LEVELS = ("information", "warning", "fault")
PHASE_HEADINGS = (
    "phase",
    "ticks",
    "time [s]",
    "CPU p50 [µs]",
    "CPU p99 [µs]",
    "deepest [µm]",
    "force, mean [N]",
    "force change, mean [%]",
    "pairs, most",
    "stuck",
    "lagging",
)
FINGER_HEADINGS = ("finger", "ticks with a force", "mean [N]", "largest [N]", "largest step [N]", "ripple [N]")
FINGER_FORCES = (
    "Sizes of the force on all phalanges of a finger together, in the ticks in which it bears one; a step is the "
    "change of that force, as a vector, from one tick to the next; the ripple is its RMS between 50 and 400 Hz, where "
    "skin feels vibration, in the worst quarter of a second, steps included."
)
PHASE_TIMES = "CPU time is that of ticks in contact."


BRIEF_FACTS = (
    "object",
    "object, extent",
    "sphere tree",
    "motion",
    "ticks",
    "hand",
    "method",
    "coupling",
    "not modelled",
)
"""Of `run_facts` those that stand beside the picture."""


def run_section(runs: Sequence[ReportRun], overview: Html) -> Html:
    """The hands, and of a single result what was run."""
    if len(runs) > 1:
        return overview
    facts = run_facts(runs[0].result)
    brief = [(name, facts[name]) for name in BRIEF_FACTS]
    return element(
        "div",
        element("div", overview),
        element("div", table("In short", ("what", "value"), brief)),
        class_="beside",
    )


def settings_section(runs: Sequence[ReportRun]) -> Html:
    """What was run, and the commands that do so again."""
    typed = [shlex.join(run.result.command) for run in runs if run.result.command]
    made = [
        paragraph("Made by" if len(typed) == len(runs) else "Made, as far as a command made it, by", ":"),
        commands(typed),
    ]
    again = [line for run in runs for line in looking_again(run.result)]
    return joined(
        [
            facts_table("What was run", runs, run_facts),
            *(made if typed else [paragraph("It was made by a program that calls the library: there is no command.")]),
            paragraph("To look at every tick, to check every claim, to run the same ticks again:"),
            commands(again),
        ]
    )


def looking_again(result: Result) -> list[str]:
    """Commands that show a result, check it, and run it again."""
    name = shlex.quote(result.path.name)
    return [f"hhsim view {name}", f"hhsim verify {name}", f"hhsim replay {name}"]


def facts_table(caption: str, runs: Sequence[ReportRun], facts: Callable[[Result], Mapping[str, str]]) -> Html:
    """Facts of each result in a column of its own; those that are not the same are marked."""
    columns = [facts(run.result) for run in runs]
    names = list(dict.fromkeys(name for column in columns for name in column))
    rows = []
    for name in names:
        cells = [column.get(name, NONE) for column in columns]
        mark = "≠ " if len(set(cells)) > 1 else ""
        rows.append((mark + name, *cells))
    several = len(runs) > 1
    headings = ("what", *(run.label for run in runs)) if several else ("what", "value")
    return table(f"{caption}; ≠ marks what is not the same" if several else caption, headings, rows, cards=several)


def key_section(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Html:
    """The key figures of all results, and with which of them the first one can be compared."""
    said: dict[str, list[str]] = {}
    for run, comparison in zip(runs[1:], comparisons):
        said.setdefault(comparison.sentence(), []).append(run.letter)
    lines = [joined([element("b", ", ".join(letters)), f": {text}"]) for text, letters in said.items()]
    return joined([key_table(runs, comparisons), listed(lines, class_="tight") if lines else Html("")])


def verdict_section(runs: Sequence[ReportRun]) -> Html:
    """The verdict of each result in full."""
    return listed(
        joined([element("b", f"{run.label}: {run.verdict.word}. "), " ".join(run.verdict.sentences)]) for run in runs
    )


def figures_section(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Html:
    """The table that replay prints, beside the paper's figures; with others, beside the first result's."""
    first = runs[0]
    if len(runs) == 1:
        of_paper = any(row.paper for row in first.rows)
        rows = [(row.label, row.shown, row.unit, *([row.paper] if of_paper else [])) for row in first.rows]
        whole = first.result.complete and first.result.live is None
        source = "as its replay found them, depths by its poses" if whole else "computed from the ticks in the file"
        caption = f"Figures, {source}"
        if of_paper:
            caption += "; the paper's are of its own machine (an Intel Core i7-8700) and scenes"
        return table(caption, ("figure", "hhsim", "unit", *(["paper"] if of_paper else [])), rows, numbers=(1, 3))
    return _side_by_side(runs, comparisons)


def difference_section(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Html:
    """What differs between each result and the first one, and which figures that makes better or worse."""
    parts: list[str] = []
    for run, comparison in zip(runs[1:], comparisons):
        pairs = ((row, _row(runs[0], row.name)) for row in run.rows)
        words = {row.label: compared(base, row, comparison).word for row, base in pairs if base is not None}
        items = [comparison.sentence()]
        items += [f"Run otherwise: {text}." for text in comparison.how] or ["Run in the same way."]
        items += [f"Around it: {text}." for text in comparison.around]
        for word in (BETTER, WORSE):
            names = [label for label, found in words.items() if found == word]
            if names:
                items.append(f"{word.capitalize()} than {runs[0].letter}: {'; '.join(names)}.")
        parts += [element("h3", f"{run.label} against {runs[0].label}"), listed(items)]
    return joined(parts)


def phase_section(runs: Sequence[ReportRun]) -> Html:
    """A table of phases for each result."""
    parts = [paragraph(PHASE_TIMES)]
    for run in runs:
        rows = [
            (
                phase.name,
                f"{phase.first:,} to {phase.last:,}",
                f"{phase.seconds:,.3f}",
                *(number(value, 1) for value in (phase.cpu_p50, phase.cpu_p99)),
                *(number(value, 3) for value in (phase.depth, phase.force, phase.variation)),
                *(f"{value:,}" for value in (phase.candidates, phase.stuck, phase.lagging)),
            )
            for phase in run.phases[:MOST_PHASES]
        ]
        more = len(run.phases) - len(rows)
        caption = "Phases of the motion" if len(runs) == 1 else f"{run.label}: phases of the motion"
        caption += f"; {more:,} more are in the file" if more else ""
        numbers = range(1, len(PHASE_HEADINGS))
        parts.append(table(caption, PHASE_HEADINGS, rows, numbers=numbers) if rows else paragraph("No tick."))
    return joined(parts)


def finger_section(runs: Sequence[ReportRun]) -> Html:
    """A table of the fingers' forces for each result."""
    parts = [paragraph(FINGER_FORCES)]
    for run in runs:
        rows = [(name, f"{ticks:,}", *(number(value, 3) for value in forces)) for name, ticks, *forces in run.fingers]
        caption = "Forces on each finger" if len(runs) == 1 else f"{run.label}: forces on each finger"
        numbers = range(1, len(FINGER_HEADINGS))
        parts.append(table(caption, FINGER_HEADINGS, rows, numbers=numbers) if rows else paragraph("No tick."))
    return joined(parts)


def session_section(runs: Sequence[ReportRun]) -> Html:
    """Figures and log of each live session."""
    parts: list[str] = []
    for run in runs:
        if run.result.live is None:
            continue
        if len(runs) > 1:
            parts.append(element("h3", run.label))
        if run.session:
            rows = [(row.label, row.shown, row.unit) for row in run.session]
            parts.append(table("Figures of the session", ("figure", "hhsim", "unit"), rows, numbers=(1,)))
        else:
            parts.append(paragraph("The recording was cut short: it has no table of the session."))
        parts += [paragraph(f"{recorded_faults(run.result).line}."), _log(run.result)]
    return joined(parts)


def origin_section(runs: Sequence[ReportRun]) -> Html:
    """Files, checksums, and every option of the solver."""
    return joined(
        [
            facts_table("Files and checksums", runs, origin_facts),
            facts_table("Every option of the solver, SI units", runs, option_facts),
        ]
    )


def _side_by_side(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Html:
    names = [name for name in run_metrics() if any(_row(run, name) is not None for run in runs)]
    of_paper = any(row.paper for run in runs for row in run.rows)
    rows = []
    for name in names:
        found = [_row(run, name) for run in runs]
        first = next(row for row in found if row is not None)
        cells = [first.label, first.unit, found[0].shown if found[0] else NONE]
        for row, comparison in zip(found[1:], comparisons):
            against = _against(found[0], row, comparison)
            shown = row.shown if row else NONE
            cells.append(joined([shown, " ", element("small", against)]) if against else shown)
        rows.append((*cells, *([first.paper] if of_paper else [])))
    caption = (
        f"Figures side by side; with each its ratio to that of {runs[0].letter} and, where both were fed with the "
        "same, the word for it. A median time within 10 % says nothing: identical code differs by as much"
    )
    headings = ("figure", "unit", *(run.label for run in runs), *(["paper"] if of_paper else []))
    return table(caption, headings, rows, numbers=range(2, len(headings)), cards=True)


def _row(run: ReportRun, name: str) -> SummaryRow | None:
    return next((row for row in run.rows if row.name == name), None)


def _against(base: SummaryRow | None, head: SummaryRow | None, comparison: Comparison) -> str:
    if base is None or head is None:
        return ""
    found = compared(base, head, comparison)
    ratio = "" if math.isnan(found.ratio) or found.word == SAME else f"{found.ratio:.3g} ×"
    return " ".join(part for part in (ratio, found.word) if part)


def _log(result: Result) -> Html:
    log = session_log(result)
    if not log.text:
        return Html("")
    chosen = np.flatnonzero(log.level > 0)[:MOST_EVENTS]
    if not len(chosen):
        return paragraph("Its log holds no warning and no fault.")
    rows = [(f"{log.time[i]:,.3f}", EVENT_LEVELS[min(int(log.level[i]), 2)], log.text[i]) for i in chosen]
    more = int((log.level > 0).sum()) - len(chosen)
    caption = "Warnings and faults of its log" + (f"; {more:,} more are in the file" if more else "")
    return table(caption, ("time [s]", "level", "what happened"), rows, numbers=(0,))
