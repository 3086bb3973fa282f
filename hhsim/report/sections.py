"""Tables of a report: what was run, figures, differences, phases, session, machine, origin."""

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hhsim.gate.compare import Comparison, compared
from hhsim.gate.time_comparison import BETTER, NOT_COMPARABLE, SAME, WITHIN, WORSE
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.session_faults import recorded_faults, session_log
from hhsim.replay.summary_table import SummaryRow, figure_table
from hhsim.report.provenance import NONE, machine_facts, option_facts, origin_facts, run_facts
from hhsim.report.run import ReportRun
from hhsim.result.reader import Result
from hhsim.table.table import MISSING, Marked, Table, number, words

MOST_PHASES = 100
MOST_EVENTS = 60
EVENT_LEVELS = ("information", "warning", "fault")
PHASE_COLUMNS = (
    words("phase", "name"),
    number("ticks", lambda phase: f"{phase['first']:,} to {phase['last']:,}"),
    number("time", "seconds", "s", 3),
    number("CPU p50 [µs]", "cpu_p50", digits=1),
    number("CPU p99 [µs]", "cpu_p99", digits=1),
    number("deepest [µm]", "depth", digits=3),
    number("force, mean", "force", "N", 3),
    number("force change, mean", "variation", "%", 3),
    number("pairs, most", "candidates"),
    number("stuck"),
    number("lagging"),
)
FINGER_COLUMNS = (
    words("finger", "name"),
    number("ticks with a force", "ticks"),
    number("mean", "mean", "N", 3),
    number("largest", "largest", "N", 3),
    number("largest step", "step", "N", 3),
    number("ripple", "ripple", "N", 3),
)
BRIEF_FACTS = (
    *("object", "object, extent", "sphere tree", "motion", "ticks"),
    *("hand", "method", "coupling", "not modelled"),
)
"""Facts of `run_facts` that stand beside the picture."""


def result_tables(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """Return what the page shows of results besides pictures, by the names of its template."""
    facts = run_facts(runs[0].result)
    comparable: dict[str, list[str]] = {}
    for run, comparison in zip(runs[1:], comparisons):
        comparable.setdefault(comparison.sentence(), []).append(run.letter)

    def of_run(title: str, run: ReportRun) -> str:
        return title if len(runs) == 1 else f"{run.label}: {title[0].lower()}{title[1:]}"

    return {
        "key_figures": key_table(runs, comparisons),
        "comparable": comparable,
        "in_short": Table.of_cells(("what", "value"), [(name, facts[name]) for name in BRIEF_FACTS], "In short"),
        "differences": [(run, differences(runs[0], run, found)) for run, found in zip(runs[1:], comparisons)],
        "sessions": [
            (run, recorded_faults(run.result).line, log_table(run.result))
            for run in runs
            if run.result.live is not None
        ],
        "session_table": lambda run: figure_table(run.session, "Figures of the session", name="figure"),
        "all_figures": all_figures(runs, comparisons),
        "settings": facts_table("What was run", runs, run_facts),
        "typed": [shlex.join(run.result.command) for run in runs if run.result.command],
        # Commands that show a result, check it, and run it again.
        "again": [
            f"hhsim {verb} {shlex.quote(run.result.path.name)}" for run in runs for verb in ("view", "verify", "replay")
        ],
        "phase_table": lambda run: phase_table(run, of_run("Phases of the motion", run)),
        "finger_table": lambda run: Table(FINGER_COLUMNS, run.fingers, of_run("Forces on each finger", run)),
        "machine": facts_table("Machine and versions", runs, machine_facts),
        "origin": facts_table("Files and checksums", runs, origin_facts),
        "solver_options": facts_table("Every option of the solver, SI units", runs, option_facts),
    }


def facts_table(caption: str, runs: Sequence[ReportRun], facts: Callable[[Result], Mapping[str, str]]) -> Table:
    """Return facts of each result in its own column; those that differ are marked."""
    columns = [facts(run.result) for run in runs]
    rows = []
    for name in dict.fromkeys(name for column in columns for name in column):
        cells = [column.get(name, NONE) for column in columns]
        rows.append((f"≠ {name}" if len(set(cells)) > 1 else name, *cells))
    if len(runs) == 1:
        return Table.of_cells(("what", "value"), rows, caption)
    return Table.of_cells(("what", *(run.label for run in runs)), rows, f"{caption}; ≠ marks what is not the same")


def all_figures(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Table:
    """Return the table that replay prints beside the paper's figures; of several results, beside the first's."""
    first = runs[0]
    if len(runs) > 1:
        return _side_by_side(runs, comparisons)
    whole = first.result.complete and first.result.live is None
    source = "as its replay found them, depths by its poses" if whole else "computed from the ticks in the file"
    of_paper = any(row.paper for row in first.rows)
    paper = "; the paper's are of its own machine (an Intel Core i7-8700) and scenes" if of_paper else ""
    return figure_table(first.rows, f"Figures, {source}{paper}", name="figure")


def differences(first: ReportRun, run: ReportRun, comparison: Comparison) -> list[str]:
    """Return what differs between a result and the first one, and which figures are better or worse."""
    pairs = ((row, first.row(row.name)) for row in run.rows)
    found = {row.label: compared(base, row, comparison).word for row, base in pairs if base is not None}
    items = [comparison.sentence()]
    items += [f"Run otherwise: {text}." for text in comparison.how] or ["Run in the same way."]
    items += [f"Around it: {text}." for text in comparison.around]
    for word in (BETTER, WORSE):
        names = [label for label, its in found.items() if its == word]
        if names:
            items.append(f"{word.capitalize()} than {first.letter}: {'; '.join(names)}.")
    return items


def phase_table(run: ReportRun, title: str) -> Table:
    """Return the first phases of a result."""
    more = len(run.phases) - MOST_PHASES
    return Table(
        PHASE_COLUMNS, run.phases[:MOST_PHASES], title + (f"; {more:,} more are in the file" if more > 0 else "")
    )


def log_table(result: Result) -> Table | None:
    """Return the first warnings and faults of a session's log; None where there is no log."""
    log = session_log(result)
    if not log.text:
        return None
    told = np.flatnonzero(log.level > 0)
    more = len(told) - MOST_EVENTS
    columns = (
        number("time", lambda i: log.time[i], "s", 3),
        words("level", lambda i: EVENT_LEVELS[min(int(log.level[i]), 2)]),
        words("what happened", lambda i: log.text[i]),
    )
    title = "Warnings and faults of its log" + (f"; {more:,} more are in the file" if more > 0 else "")
    return Table(columns, told[:MOST_EVENTS].tolist(), title)


def _side_by_side(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Table:
    of_paper = ["paper"] if any(row.paper for run in runs for row in run.rows) else []
    rows = []
    for name in run_metrics():
        found = [run.row(name) for run in runs]
        first = next((row for row in found if row is not None), None)
        if first is None:
            continue
        cells = [first.label, first.unit, found[0].shown if found[0] else NONE]
        for row, comparison in zip(found[1:], comparisons):
            cells.append(Marked(row.shown if row else NONE, below=_against(found[0], row, comparison)))
        rows.append((*cells, first.paper))
    title = (
        f"Figures side by side; with each its ratio to that of {runs[0].letter} and, where both were fed with the "
        "same, the word for it. A median time within 10 % says nothing: identical code differs by as much"
    )
    headings = ("figure", "unit", *(run.label for run in runs), *of_paper)
    return Table.of_cells(headings, rows, title, numbers=headings[2:])


def _against(base: SummaryRow | None, head: SummaryRow | None, comparison: Comparison) -> str:
    if base is None or head is None:
        return ""
    found = compared(base, head, comparison)
    ratio = "" if math.isnan(found.ratio) or found.word == SAME else f"{found.ratio:.3g} ×"
    return " ".join(part for part in (ratio, found.word) if part)


KEY_FIGURES: Sequence[Mapping[str, str]] = (
    {"penetration_max": "depth, max"},
    {"contact_error_max": "off the mesh, max"},
    {"force_contact_mean": "force, mean", "force_hold_mean": "force in the hold, mean"},
    {"force_contact_step": "force step", "force_step": "force step, moving"},
    {
        TREMBLING: "variation, trembling",
        "force_variation_contact": "variation in contact",
        "force_variation_hold": "variation in the hold",
    },
    {"tick_cpu_p50": "tick, p50"},
    {"tick_cpu_p99": "tick, p99"},
    {"stuck_ticks": "stuck ticks"},
    {"lag_max": "lag, max"},
)
"""Run metrics that may stand in each column, with short headings: the first that most results have is shown."""
SHOWN_WORDS = (BETTER, WORSE, WITHIN, NOT_COMPARABLE)


def key_table(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Table:
    """Return a line for each result; `comparisons` are those of each result but the first with the first."""
    headings: dict[str, str] = {}
    for names in KEY_FIGURES:
        rows = {name: [row for run in runs if (row := run.row(name)) is not None] for name in names}
        known = {name: sum(math.isfinite(row.value) for row in found) for name, found in rows.items()}
        name = max(known, key=lambda name: known[name])
        if known[name]:
            unit = rows[name][0].unit
            headings[name] = f"{names[name]} [{unit}]" if unit else names[name]
    lines = []
    for run, comparison in zip(runs, (None, *comparisons)):
        # Below the verdict stand the figures over their limits that have no column.
        others = (row for name in run.verdict.missed if name not in headings and (row := run.row(name)) is not None)
        missed = "; ".join(f"{row.label} {row.shown} {row.unit}".strip() for row in others)
        cells = (_cell(run, name, runs[0], comparison) for name in headings)
        lines.append([run.label, Marked(run.verdict.word, run.mood, missed), *cells])
    caption = (
        "Key figures. Times are CPU times of ticks in contact. Red: over the limit that hhsim gate has by default."
    )
    if len(runs) > 1:
        caption += f" Below a figure: beside that of {runs[0].letter}, where both were fed with the same."
    return Table.of_cells(["result", "verdict", *headings.values()], lines, caption, numbers=list(headings.values()))


def _cell(run: ReportRun, name: str, first: ReportRun, comparison: Comparison | None) -> str:
    row, base = run.row(name), first.row(name)
    if row is None:
        return MISSING
    word = "" if comparison is None or base is None else compared(base, row, comparison).word
    return Marked(row.shown, "bad" if name in run.verdict.missed else "", word if word in SHOWN_WORDS else "")
