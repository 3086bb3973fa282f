"""Results of a report with their labels, and its tables: what was run, figures, session, machine, origin.

A label is a letter, and in few words what tells each
result from the others.
"""

import hashlib
import json
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.errors import InputError
from hhsim.hand.fingers import FINGERS
from hhsim.metrics.moving_parts import bodies_mesh
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.run_ticks import HOLD
from hhsim.metrics.session_faults import broken_off, how_it_ended, recorded_faults, session_log
from hhsim.replay.compare import Comparison, compared
from hhsim.replay.run_inputs import named_options
from hhsim.replay.stored_scene import part_words
from hhsim.replay.summary_table import SummaryRow, figure_table, session_rows
from hhsim.replay.verdict import MISSED, OK, Verdict, result_rows, verdict
from hhsim.result.reader import Result
from hhsim.result.schema import LIVE_TICK
from hhsim.result.wording import commit, motion_name, object_name, option_value
from hhsim.system.counted import counted
from hhsim.system.input_file import open_input
from hhsim.table.table import MISSING, Marked, Table, number, words
from hhsim.table.verdict import BETTER, NOT_COMPARABLE, SAME, WITHIN, WORSE

UNNAMED = "method"
"""Label where a file does not say which method was run."""
MOST_WORDS = 3


def result_labels(results: Sequence[Result]) -> list[str]:
    """Return a label for each result: its method and, where these differ, object, motion and options.

    Several results have letters, hands of one run their names.
    """
    if len(results) > 1 and all(of_one_run(results[0], other) for other in results[1:]):
        return [f"{result.name} hand" for result in results]
    names = [(object_name(result), motion_name(result), result.method or UNNAMED) for result in results]
    if len(results) == 1:
        return [names[0][2]]
    varied = (*(len({name[part] for name in names}) > 1 for part in (0, 1)), True)
    labels = [
        ", ".join([" ".join(part for part, differs in zip(name, varied) if differs), *words[:MOST_WORDS]])
        for name, words in zip(names, _telling(results))
    ]
    return [f"{letter(number)}: {label}" for number, label in enumerate(labels)]


def of_one_run(one: Result, other: Result) -> bool:
    """Return True for two hands of one file."""
    return one.path == other.path and one.name != other.name


def letter(number: int) -> str:
    """Return the letters of a number: A, B, … Z, AA, AB, … for 0, 1, and so on."""
    rest, last = divmod(number, 26)
    return (letter(rest - 1) if rest else "") + chr(ord("A") + last)


def _kind(result: Result) -> list[str]:
    """Return whether it is of a session, and of a left hand, in words."""
    return [*(["live session"] if result.live else []), *(["left hand"] if result.side == "left" else [])]


def _telling(results: Sequence[Result]) -> list[list[str]]:
    """Return in words what tells each result from the first one of its method."""
    kinds = [_kind(result) for result in results]
    shared = set(kinds[0]).intersection(*kinds)
    found, first = list[list[str]](), dict[str, Mapping[str, Any]]()
    for result, kind in zip(results, kinds):
        own = named_options(result.scene)
        usual = first.setdefault(result.method, own)
        differing = [
            name for name in own if name not in ("method", "surface", "period") and own[name] != usual.get(name)
        ]
        options = [f"{name.replace('_', ' ').replace('.', ' ')} {option_value(name, own[name])}" for name in differing]
        found.append([word for word in kind if word not in shared] + options)
    return found


@dataclass(frozen=True)
class ReportRun:
    """One result."""

    result: Result  # seen from its object
    label: str
    prefix: str  # begin of the names of its pictures and anchors
    rows: tuple[SummaryRow, ...]  # the table that replay prints
    # Table of a live session; empty for a replay, and where the recording was cut short.
    session: tuple[SummaryRow, ...]
    verdict: Verdict  # verdict by the gate's default limits

    @property
    def ended(self) -> str:
        """Cause of the end of a session that did not end in order, in a few words; else ""."""
        why = broken_off(self.result)
        return f"ended: {why}" if why else ""

    @property
    def mood(self) -> str:
        """Class of the verdict: good, bad or note."""
        return {OK: "good", MISSED: "bad"}.get(self.verdict.word, "note")

    def row(self, name: str) -> SummaryRow | None:
        """Return a line of the table by its figure's name."""
        return next((row for row in self.rows if row.name == name), None)

    @property
    def letter(self) -> str:
        """Letter of the label, or name of the hand."""
        return self.label.partition(":")[0]

    @property
    def name(self) -> str:
        """Object, motion and method."""
        return f"{object_name(self.result)}, {motion_name(self.result)}, {self.result.method or UNNAMED}"


def report_runs(results: Sequence[Result]) -> list[ReportRun]:
    """Compute what a report says of each result."""
    runs = []
    for label, result in zip(result_labels(results), (of.seen_from_object for of in results)):
        rows = result_rows(result)
        runs.append(
            ReportRun(
                result=result,
                label=label,
                prefix="" if len(results) == 1 else f"{label.partition(':')[0].lower().removesuffix(' hand')}-",
                rows=rows,
                session=() if result.live is None else session_rows(result.summary),
                verdict=verdict(result, rows),
            )
        )
    return runs


NONE = "—"
"""Stands for what a result does not say."""

AS_GIVEN = "as the motion has it"
DRIVEN = "moves as the motion has it; figures and pictures are seen from it"
FORCES = {"kkt": "multipliers of the program (kkt)", "paper": "Eq. 14 of the paper"}
COUPLING = {"translation": "N/m", "rotation": "N·m/rad", "flexion": "N·m/rad"}

MOST_EVENTS = 60
EVENT_LEVELS = ("information", "warning", "fault")
WORST_COLUMNS = (
    words("what"),
    number("value", digits=3),
    words("unit"),
    number("tick"),
    number("time", "time", "s", 3),
    words("phase"),
)
BRIEF_FACTS = (
    *("object", "object, extent", "sphere tree", "motion", "ticks"),
    *("hand", "method", "coupling", "not modelled"),
)
"""Facts of `run_facts` that stand beside the picture."""

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


def run_facts(result: Result) -> dict[str, str]:
    """Return object, motion, hand and method."""
    scene, bodies = result.scene, result.bodies.values()
    solver: Mapping[str, Any] = scene.get("solver", {})
    low, high = bodies_mesh(result).bounds
    extent = " × ".join(f"{1e3 * side:.0f}" for side in high - low)
    depth = max(int(body.static["tree/level"].max(initial=0)) for body in bodies)
    hand = scene.get("hand") or {"side": NONE}
    side, fingers = str(hand.get("side", "")), result.fingers
    stiffness = solver.get("stiffness", {})
    coupling = [f"{name} {stiffness[name]:g} {unit}" for name, unit in COUPLING.items() if name in stiffness]
    facts = {
        "object": object_name(result),
        "object, extent": f"{extent} mm, {counted(sum(len(body.faces) for body in bodies), 'triangle')}",
        "repairs of its mesh": "; ".join(scene.get("object_repairs") or []) or "none",
        "sphere tree": f"level {depth}, {counted(sum(body.leaves for body in bodies), 'leaf sphere')}",
        "what the hand touches": f"the {result.surface}",
        "motion": motion_name(result),
        "its source": str(scene.get("motion_source") or NONE),
        "the object's place": str((scene.get("placement") or {}).get("text") or (DRIVEN if result.frame else AS_GIVEN)),
        "ticks": f"{result.ticks:,} at {result.rate:,g} Hz, {result.ticks / result.rate:,.2f} s",
        "hand": f"{side}, {1e3 * hand['length']:.0f} mm long" if "length" in hand else side,
        "fingers": "all five" if len(fingers) == len(FINGERS) else ", ".join(fingers) or "none",
        "method": str(solver.get("method", NONE)),
        "QP solver": str(solver.get("qp", NONE)),
        "forces": FORCES.get(str(solver.get("force")), NONE),
        "linearisations of a tick, most": f"{solver.get('linearisations', NONE)}",
        "margin": f"{1e3 * solver['margin']:g} mm" if "margin" in solver else NONE,
        "coupling": ", ".join(coupling) or NONE,
        "not modelled": ", ".join(scene.get("modelled", {}).get("not_modelled", [])) or NONE,
    }
    if result.live is not None:
        facts |= _session(result, result.live)
    return facts


def origin_facts(result: Result) -> dict[str, str]:
    """Return machine, versions, the file, its state and its checksums."""
    stated: Mapping[str, Any] = result.scene.get("checksums", {})
    machine = {str(name): str(value) for name, value in result.machine.items()}
    packages = ", ".join(f"{name} {version}" for name, version in sorted(result.packages.items()))
    return {
        "processor": machine.get("cpu", NONE),
        "cores": machine.get("cores", NONE),
        "system": machine.get("system", NONE),
        "Python": machine.get("python", NONE),
        "threads of a tick": str(result.scene.get("solver", {}).get("threads", NONE)),
        "hhsim": result.hhsim_version,
        "commit": commit(result),
        "packages": packages or NONE,
        "file": result.path.name,
        "SHA-256 of the file": file_digest(result.path),
        "written": result.created_utc,
        "complete": "yes" if result.complete else "no: the run was stopped, its ticks so far are sound",
        "schema": f"{result.schema_version}",
        "object's mesh as it was read": str(result.scene.get("object_mesh") or NONE),
        **{f"SHA-256 of {part_words(part)}": str(digest) for part, digest in stated.items()},
    }


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits; raise InputError if it cannot be read."""
    try:
        with open_input(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error


def _session(result: Result, live: Mapping[str, Any]) -> dict[str, str]:
    device = _json(live.get("device"))
    return {
        "glove": str(device.get("name") or device.get("kind") or NONE),
        "palm's pose from": str(live.get("pose") or NONE),
        "glove was told": "nothing (dry run)" if live.get("dry_run") else "where to stop and how hard",
        "ended": how_it_ended(result),
    }


def _json(text: Any) -> dict[str, Any]:
    try:
        found = json.loads(text or "{}")
    except (TypeError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def result_tables(runs: Sequence[ReportRun], comparisons: Sequence[Comparison | None]) -> dict[str, Any]:
    """Return what the page shows of results besides pictures, by the names of its template."""
    facts = run_facts(runs[0].result)
    comparable: dict[str, list[str]] = {}
    for run, comparison in zip(runs[1:], comparisons):
        if comparison:
            comparable.setdefault(comparison.sentence(), []).append(run.letter)

    def of_run(title: str, run: ReportRun) -> str:
        return title if len(runs) == 1 else f"{run.label}: {title[0].lower()}{title[1:]}"

    return {
        "key_figures": key_table(runs, comparisons),
        "comparable": comparable,
        "in_short": Table.of_cells(("what", "value"), [(name, facts[name]) for name in BRIEF_FACTS], "In short"),
        "sessions": [
            (run, recorded_faults(run.result).line, log_table(run.result))
            for run in runs
            if run.result.live is not None
        ],
        "session_table": lambda run: figure_table(run.session, "Figures of the session", name="figure"),
        "all_figures": all_figures(runs, comparisons),
        "settings": facts_table("What was run", runs, run_facts),
        "typed": list(dict.fromkeys(shlex.join(run.result.command) for run in runs if run.result.command)),
        "untyped": not all(run.result.command for run in runs),
        # Commands that show a result, check it, and run it again.
        "again": [
            f"hhsim {verb} {shlex.quote(name)}"
            for name in dict.fromkeys(run.result.path.name for run in runs)
            for verb in ("view", "verify", "replay")
        ],
        "worst_table": lambda run: Table(WORST_COLUMNS, worst_ticks(run.result), of_run("Worst ticks", run)),
        "origin": facts_table("Machine, versions, files and checksums", runs, origin_facts),
        "solver_options": facts_table("Every option of the solver, SI units", runs, _options),
    }


def _options(result: Result) -> dict[str, str]:
    solver = result.scene.get("solver", {})
    return {name: json.dumps(value, ensure_ascii=False) for name, value in sorted(solver.items())}


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


def all_figures(runs: Sequence[ReportRun], comparisons: Sequence[Comparison | None]) -> Table:
    """Return the table that replay prints beside the paper's figures; of several results, beside the first's."""
    first = runs[0]
    if len(runs) > 1:
        return _side_by_side(runs, comparisons)
    whole = first.result.complete and first.result.live is None
    source = "as its replay found them, depths by its poses" if whole else "computed from the ticks in the file"
    of_paper = any(row.paper for row in first.rows)
    paper = "; the paper's are of its own machine (an Intel Core i7-8700) and scenes" if of_paper else ""
    return figure_table(first.rows, f"Figures, {source}{paper}", name="figure")


def worst_ticks(result: Result) -> list[dict[str, Any]]:
    """Return lines of the slowest tick, the deepest, the largest step of the force and the largest lag.

    Of several equal ones the first; none of what did not happen.
    """
    if result.ticks == 0:
        return []
    steps = np.zeros(result.ticks)
    steps[1:] = np.linalg.norm(np.diff(result["force/total"], axis=0), axis=1)
    # As of `hhsim.metrics.metrics.force_step`: not in holds, nor where the tick before is not in the file.
    for phase in result.phases:
        if phase.name == HOLD:
            steps[phase.first_tick : phase.last_tick + 1] = 0.0
    if result.live is not None:
        steps[1:][np.diff(result[f"{LIVE_TICK}/record"]) != 1] = 0.0
    found = []
    for what, values, unit in (
        ("slowest tick, CPU time", 1e-3 * result["duration/total_cpu"], "µs"),
        ("deepest penetration", 1e6 * result["penetration_depth"], "µm"),
        ("largest step of the force of a moving hand", steps, "N"),
        ("largest lag", 1e3 * result["lag"], "mm"),
    ):
        known = np.where(np.isfinite(values), values, 0.0)
        tick = int(np.argmax(known))
        if known[tick] > 0.0:
            about = {"tick": tick, "time": float(result["time"][tick]), "phase": result.phase_at(tick) or NONE}
            found.append({"what": what, "value": float(known[tick]), "unit": unit, **about})
    return found


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


def _side_by_side(runs: Sequence[ReportRun], comparisons: Sequence[Comparison | None]) -> Table:
    of_paper = ["paper"] if any(row.paper for run in runs for row in run.rows) else []
    rows = []
    for name in run_metrics():
        found = [run.row(name) for run in runs]
        first = next((row for row in found if row is not None), None)
        if first is None:
            continue
        cells: list[str] = [first.label, first.unit]
        for run, comparison in zip(runs, (None, *comparisons)):
            row, base = run.row(name), found[0]
            below = ""
            if row and base and comparison:
                beside = compared(base, row, comparison)
                ratio = "" if math.isnan(beside.ratio) or beside.word == SAME else f"{beside.ratio:.3g} ×"
                below = " ".join(filter(None, (ratio, beside.word)))
            cells.append(Marked(row.shown if row else NONE, below=below))
        rows.append((*cells, first.paper))
    title = (
        f"Figures side by side; with each its ratio to that of {runs[0].letter} and, where both were fed with "
        "the same, the word for it. A median time within 10 % says nothing: identical code differs by as much"
    )
    title = title if any(comparisons) else "Figures of each hand"
    headings = ("figure", "unit", *(run.label for run in runs), *of_paper)
    return Table.of_cells(headings, rows, title, numbers=headings[2:])


def key_table(runs: Sequence[ReportRun], comparisons: Sequence[Comparison | None]) -> Table:
    """Return a line for each result or hand; `comparisons` are those of each result but the first with the first."""
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
        cells: list[str] = []
        for name in headings:
            row, base = run.row(name), runs[0].row(name)
            word = compared(base, row, comparison).word if row and base and comparison else ""
            mood = "bad" if name in run.verdict.missed else ""
            cells.append(Marked(row.shown, mood, word if word in SHOWN_WORDS else "") if row else MISSING)
        lines.append([run.label, Marked(run.verdict.word, run.mood, missed), *cells])
    caption = (
        "Key figures. Times are CPU times of ticks in contact. Red: over the limit that hhsim gate has by default."
    )
    if any(comparisons):
        caption += f" Below a figure: beside that of {runs[0].letter}, where both were fed with the same."
    return Table.of_cells(
        ["result" if any(comparisons) or len(runs) == 1 else "hand", "verdict", *headings.values()],
        lines,
        caption,
        numbers=list(headings.values()),
    )
