"""Gate: run a suite or take a result, and judge it against limits and a base.

A recorded baseline holds the figures of a suite's scenes, as a JSON file that a project commits.
"""

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import structs

from hhsim import __version__
from hhsim.errors import InputError
from hhsim.gate import verdict as verdicts
from hhsim.gate.metrics import COUNTERS, SESSION_DEFAULTS, RunFigures, compared_metrics, run_figures, without_times
from hhsim.gate.run import RunFailed, Side, Step, measured, process_times
from hhsim.gate.suite import REPLAY, SESSION, SUBMISSION, GateScene, GateSuite, default_suite, usual_limits
from hhsim.gate.verdict import GateRow, inputs_row
from hhsim.replay.run_inputs import RunInputs, differences
from hhsim.replay.summary_table import default_limits, stored_promises
from hhsim.result.reader import Result
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text
from hhsim.system.plain_json import plain_json
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import Settings, Version, typed
from hhsim.table.verdict import NOT_COMPARABLE

FORMAT = "hhsim-gate-baseline"
BASELINE_VERSION = 1
DIGITS = 15
"""Significant digits of sums in the file; the tolerance of a comparison is far above."""


class RecordedScene(Settings, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """One scene of a baseline."""

    inputs: RunInputs
    digest: str = ""  # of poses and forces
    errors: dict[str, float | None]  # figures that the gate judges; None where undefined
    counters: dict[str, int]

    @property
    def figures(self) -> RunFigures:
        """Figures of the run, NaN for those that are undefined or not in the file."""
        found = {name: self.errors.get(name) for name in compared_metrics()}
        errors = {name: math.nan if value is None else value for name, value in found.items()}
        counters = {name: self.counters[name] for name in COUNTERS if name in self.counters}
        return RunFigures(self.inputs, errors, counters, digest=self.digest)


class Baseline(Settings, frozen=True, forbid_unknown_fields=False):
    """Recorded baseline; `source` is for messages."""

    format: Literal["hhsim-gate-baseline"]
    version: Version
    scenes: dict[str, RecordedScene]
    source: str = ""


def write_baseline(path: Path, scenes: Mapping[str, RunFigures]) -> None:
    """Write a baseline of the figures of scenes; raise OutputError if the file cannot be written."""
    # It is the same from any machine: what it was made on would only make noise in its history.
    head = {"format": FORMAT, "version": BASELINE_VERSION, "hhsim": __version__}
    kept = RecordedScene.__struct_fields__
    told = {name: {field: getattr(figures, field) for field in kept} for name, figures in scenes.items()}
    document = {**head, "scenes": msgspec.to_builtins(told)}
    # Rounded, so that last bits make no differences in a history.
    rounded = plain_json(document, lambda value: float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None)
    for scene in rounded["scenes"].values():
        scene["checksum"] = _checksum(scene)
    text = json.dumps(rounded, indent=1, ensure_ascii=False)
    # A list of numbers is a line: a changed number is then a changed line, and no page of them.
    text = re.sub(r"\[[-+.,\de\s]+\]", lambda found: " ".join(found[0].split()), text)
    write_atomically(path, f"{text}\n".encode())


def _checksum(scene: Mapping[str, Any]) -> str:
    """Compute the checksum of a scene as the file holds it; scenes of two files may be merged, each with its own."""
    content = {name: value for name, value in scene.items() if name != "checksum"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def load_baseline(path: Path) -> Baseline:
    """Read a baseline; InputError if there is no such file, no baseline, another version, or other values than written.

    A value that was changed, emptied or is no number would weaken the gate without a word.
    """
    try:
        document = json.loads(read_input_text(path))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; record it with hhsim gate SUITE --write-baseline {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the baseline {path}: {getattr(error, 'strerror', None) or error}") from error
    except json.JSONDecodeError as error:
        raise InputError(f"the baseline {path} is no JSON: {error}") from error
    try:
        found = structs.replace(typed(document, Baseline, f"the baseline {path}"), source=str(path))
        for name, scene in document["scenes"].items():
            if scene.get("checksum") != _checksum(scene):
                raise InputError(f"the baseline {path}: scene {name} is not as it was recorded: its checksum differs")
        return found
    except InputError as error:
        raise InputError(f"{error}; record it anew with hhsim gate --write-baseline FILE") from None


@dataclass(frozen=True)
class GateReport:
    """Rows and verdict of the gate."""

    source: str  # the suite or result
    against: str  # base of the comparison, or ""
    rows: tuple[GateRow, ...]  # one for each figure
    notes: tuple[str, ...] = ()  # remarks, a sentence each
    # Figures of scenes for a baseline to write; empty where not every scene ran.
    recorded: dict[str, RunFigures] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """Verdict of all rows: worse where a limit is missed; "" where nothing was compared."""
        return verdicts.overall(self.rows)[0]

    @property
    def exit_code(self) -> int:
        """Exit code: 0 ok, 1 a limit was missed, 2 a scene was refused for bad input, 3 cannot compare."""
        return verdicts.overall(self.rows)[1]

    @property
    def missed(self) -> list[GateRow]:
        """Rows whose limit was missed."""
        return [row for row in self.rows if not row.passed]

    @property
    def refused(self) -> list[str]:
        """Reasons why scenes, or the whole, could not be run."""
        return [f"{row.scene}: {row.reason}" for row in self.rows if row.verdict == verdicts.REFUSED]

    def to_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {
            **({"error": "; ".join(self.refused)} if self.refused else {}),
            "source": self.source,
            "against": self.against or None,
            "verdict": self.verdict or None,
            "exit_code": self.exit_code,
            "missed": len(self.missed),
            "rows": [row.to_json() for row in self.rows],
            "notes": list(self.notes),
        }


def gate_suite(
    suite: GateSuite,
    head: Side,
    *,
    base: Side | None = None,
    baseline: Baseline | None = None,
    timed: bool = True,
    progress: Progress = silent,
) -> GateReport:
    """Run and judge every scene of a suite; bad input, such as an unknown object, becomes a row.

    Args:
        base: Side to compare with, run in the same job.
        baseline: Recorded one; where both are given, counters are compared with this one, times with `base`.
        timed: Judge times, by the base and by limits.
    """
    rows: list[GateRow] = []
    recorded: dict[str, RunFigures] = {}
    count = len(suite.scenes)
    for i, scene in enumerate(suite.scenes):

        def step(what: str, i: int = i) -> None:
            progress(what, i, count)

        try:
            recorded[scene.name] = _gate_scene(rows, suite, scene, head, base, baseline, step, timed=timed)
        except RunFailed as failed:
            rows.append(verdicts.failed_run(scene.name, str(failed), refused=failed.refused))
    progress("done", count, count)
    against_words = [f"the baseline {baseline.source}"] if baseline else []
    against_words += [f"hhsim {base.version} of {base.python}"] if base else []
    gone = [] if baseline is None else sorted(baseline.scenes.keys() - {scene.name for scene in suite.scenes})
    notes = [f"not in the suite any more: {', '.join(gone)}"] if gone else []
    if base is not None and base.package == head.package and base.folder is None:
        notes.append(f"base and head are the same hhsim, that in {head.package}: this compares it with itself")
    if timed and any(scene.timed for scene in suite.scenes) and not any(row.kind == "time" for row in rows):
        notes.append("no time was judged: that takes --base-python")
    recorded = recorded if len(recorded) == count else {}
    return GateReport(suite.source, " and ".join(against_words), tuple(rows), tuple(notes), recorded)


def _gate_scene(
    rows: list[GateRow],
    suite: GateSuite,
    scene: GateScene,
    head: Side,
    base: Side | None,
    baseline: Baseline | None,
    step: Step,
    *,
    timed: bool,
) -> RunFigures:
    """Add the rows of a scene, and return its figures; RunFailed where the head does not run every time."""
    name = scene.name
    step(f"{name}, head")
    figures = measured(scene, head, suite.folder, run_figures)
    kept = None if baseline is None else baseline.scenes.get(name)
    before, why, new = None if kept is None else kept.figures, "", list[GateRow]()
    if baseline is not None and kept is None:
        why = f"{baseline.source} has no scene {name}: record it with --write-baseline"
    if base is not None:
        step(f"{name}, base")
        try:
            of_base = measured(scene, base, suite.folder, run_figures)
        except RunFailed as failed:
            if failed.refused and base.folder is not None:
                # A change may add scenes that the base does not have.
                new.append(inputs_row(name, f"new, so judged by limits alone: {failed}"))
            else:
                why = why or str(failed)
            base = None
        else:
            before = before or (None if why else of_base)
            apart = differences(of_base.inputs, figures.inputs)
            if apart and baseline is not None:
                why = why or f"base has different inputs: {'; '.join(apart)}"
            # Times of other inputs say nothing.
            base = None if apart else base
    limits = scene.limits if timed else without_times(scene.limits)
    rows += [inputs_row(name, why, NOT_COMPARABLE)] if why else []
    rows += [*new, *verdicts.judge_run(name, figures, before, limits, scene.slack)]
    if base is None or not (timed and scene.timed):
        return figures
    try:
        both = process_times(scene, suite.folder, head, base, suite.time.processes, step)
        rows.append(verdicts.judge_time(name, *both, suite.time.limit))
    except RunFailed as failed:
        # It ran once and does not run every time.
        if failed.side == head.name:
            failed.refused = False
            raise
        rows.append(inputs_row(name, str(failed), NOT_COMPARABLE, "time"))
    return figures


def gate_result(
    result: Result, suite: GateSuite | None = None, base: Result | Baseline | None = None, *, timed: bool = True
) -> GateReport:
    """Judge a result by limits, and its counters by another result or a baseline; InputError for one without ticks.

    Times are not compared, since only runs in turn can be; if `timed`, those that the suite limits are judged. Without
    a suite the limits are the default ones, except those that the method does not promise to hold.
    """
    if result.ticks == 0:
        raise InputError(f"{result.path} holds no ticks: there is nothing to judge")
    head, name = run_figures(result), result.path.name if result.other is None else result.name
    source, before, rows = "", None, list[GateRow]()
    if isinstance(base, Result):
        source, before = str(base.path), run_figures(base)
    elif base is not None:
        source = base.source
        figures = (scene.figures for scene in base.scenes.values())
        before = next((found for found in figures if not differences(found.inputs, head.inputs)), None)
        if before is None:
            why = f"no scene of {source} has the inputs of {result.path}"
            rows.append(inputs_row(name, why, NOT_COMPARABLE))
    if suite is not None:
        kind = SESSION if result.live is not None else SUBMISSION if result.score else REPLAY
        limits, slack = usual_limits(kind, suite.limits), suite.slack
    else:
        usual, slack = default_limits(stored_promises(result.scene)), default_suite().slack
        # A default limit is left out where the run has no such figure.
        runs = (head,) if before is None else (head, before)
        had = {name for run in runs for name, value in run.errors.items() if not math.isnan(value)}
        limits = {name: limit for name, limit in usual.items() if name in had}
        limits |= SESSION_DEFAULTS if result.live is not None else {}
    # How a session ended has limits of its own; a base of as many ticks shows that no more are wanted.
    short = ""
    if result.live is not None:
        pass
    elif not result.complete:
        short = f"the run was stopped: it has only the first {result.ticks:,} ticks"
    elif result.summary.get("ticks") != result.ticks:
        short = f"its summary is not of its {result.ticks:,} ticks"
    elif before is None and "ticks" in result.scene:
        short = f"only the first {result.ticks:,} ticks were run (--ticks): a base of as many makes it comparable"
    rows += [verdicts.failed_run(name, short)] if short else []
    rows += verdicts.judge_run(name, head, before, limits if timed else without_times(limits), slack)
    return GateReport(str(result.path), source, tuple(rows))
