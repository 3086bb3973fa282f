"""The gate: run a suite, or take a result, judge it against limits and a base, and say yes or no."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hhsim.errors import InputError
from hhsim.gate.baseline import Baseline, RecordedScene
from hhsim.gate.input_hash import differences
from hhsim.gate.limits import SESSION_DEFAULTS, without_times
from hhsim.gate.metrics import RunFigures, run_figures
from hhsim.gate.run import RunFailed, Side, interleaved_times, times_beside_reference
from hhsim.gate.suite import REPLAY, SESSION, SUBMISSION, GateScene, GateSuite, default_suite, load_suite
from hhsim.gate.verdict import (
    GateRow,
    failed_run,
    judge_counters,
    judge_errors,
    judge_inputs,
    judge_others,
    judge_suspicions,
    judge_time,
    new_scene,
    overall,
    unjudged,
)
from hhsim.kernels.machine_calibration import REFERENCE_VERSION
from hhsim.replay.limits import default_limits, stored_promises
from hhsim.result.reader import Result
from hhsim.system.progress import Progress, silent


@dataclass(frozen=True)
class GateReport:
    """What the gate found.

    Attributes:
        source: The suite or result.
        against: What it was compared with, or "".
        rows: One for each figure.
        notes: What a reader should know besides, a sentence each.
        recorded: What can be kept as a baseline, by scene; empty where not every scene ran.
    """

    source: str
    against: str
    rows: tuple[GateRow, ...]
    notes: tuple[str, ...] = ()
    recorded: dict[str, RecordedScene] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """The word for all rows: worse where a limit is missed; "" where nothing was compared with anything."""
        return overall(self.rows)[0]

    @property
    def exit_code(self) -> int:
        """0 ok, 1 a limit was missed, 3 cannot compare."""
        return overall(self.rows)[1]

    @property
    def missed(self) -> list[GateRow]:
        """Rows whose limit was missed."""
        return [row for row in self.rows if not row.passed]

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {
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
    record_times: bool = False,
    progress: Progress = silent,
) -> GateReport:
    """Run every scene of a suite and judge it.

    Args:
        base: What it is compared with, run in the same job.
        baseline: A recorded one; where both are given, counters are compared with this one, times with `base`.
        timed: Whether times are judged, by the base and by limits.
        record_times: Whether times of head are taken for a baseline to come, even where nothing is compared.

    Raises:
        InputError: A scene that hhsim refuses: an unknown object, a bad option; or a suite that is wrong.
    """
    rows: list[GateRow] = []
    recorded: dict[str, RecordedScene] = {}
    for i, scene in enumerate(suite.scenes):

        def step(what: str, i: int = i) -> None:
            progress(what, i, len(suite.scenes))

        run = _SceneRun(suite, scene, head, base, baseline, timed, record_times, step)
        rows += run.rows
        if run.recorded is not None:
            recorded[scene.name] = run.recorded
    progress("done", len(suite.scenes), len(suite.scenes))
    if len(recorded) < len(suite.scenes):
        recorded = {}
    against = [f"the baseline {baseline.source}"] if baseline else []
    against += [f"hhsim {base.version} of {base.python}"] if base else []
    notes = _notes(head, base)
    wanted = timed and not record_times and any(scene.timed for scene in suite.scenes)
    if wanted and not any(row.kind == "time" for row in rows):
        notes.append("no time was judged: that takes --base-python, or a baseline that was recorded with times")
    return GateReport(suite.source, " and ".join(against), tuple(rows), tuple(notes), recorded)


def gate_result(
    result: Result, suite: GateSuite | None = None, base: Result | Baseline | None = None, *, timed: bool = True
) -> GateReport:
    """Judge a result by limits, and its counters by another result or a baseline.

    Times are not compared: those of two runs that were not run in turn say nothing.

    Args:
        suite: Whose `[limits]` and `[counters]` hold; None: the default ones, of which a method that does not promise
            to hold one is exempt.
        base: What it is compared with.
        timed: Whether times that the suite limits are judged.

    Raises:
        InputError: A result without ticks.
    """
    if result.ticks == 0:
        raise InputError(f"{result.path} holds no ticks: there is nothing to judge")
    head, name = run_figures(result), result.path.name
    source, before, unlike = "", None, ""
    if isinstance(base, Result):
        source, before = str(base.path), run_figures(base)
    elif base is not None:
        source = base.source
        alike = [scene.figures for scene in base.scenes.values() if not differences(scene.figures.inputs, head.inputs)]
        if alike:
            before = alike[0]
        else:
            unlike = f"no scene of {source} has the inputs of {result.path}"
    if suite is not None:
        kind = SESSION if result.live is not None else SUBMISSION if result.score else REPLAY
        limits, slack = suite.limits_of(kind), suite.slack
    else:
        limits, slack = default_limits(stored_promises(result.scene)), default_suite().slack
        limits |= SESSION_DEFAULTS if result.live is not None else {}
    rows = _judged(name, head, before, limits if timed else without_times(limits), slack)
    if unlike:
        rows.insert(0, unjudged(name, "inputs", unlike))
    stopped = f"the run of {result.path} was stopped: only its first {result.ticks:,} ticks are judged"
    return GateReport(str(result.path), source, tuple(rows), () if result.complete else (stopped,))


def _judged(
    name: str,
    head: RunFigures,
    base: RunFigures | None,
    limits: Mapping[str, float],
    slack: Mapping[str, float],
    motion_may_change: bool = False,
) -> list[GateRow]:
    """All rows of a run but its time; of a base that was fed with something else, no figure is told."""
    others = [*judge_others(name, head, limits), *judge_suspicions(name, head)]
    if base is None:
        return [*judge_errors(name, head, None, limits), *others]
    inputs = judge_inputs(name, head, base, motion_may_change)
    if differences(base.inputs, head.inputs):
        return [inputs, *judge_errors(name, head, None, limits), *others]
    return [inputs, *judge_errors(name, head, base, limits), *others, *judge_counters(name, head, base, slack)]


class _SceneRun:
    """One scene: its rows, and what can be recorded of it."""

    def __init__(
        self,
        suite: GateSuite,
        scene: GateScene,
        head: Side,
        base: Side | None,
        baseline: Baseline | None,
        timed: bool,
        record_times: bool,
        step: Callable[[str], None],
    ) -> None:
        self.suite, self.scene, self.step = suite, scene, step
        self.recorded: RecordedScene | None = None
        self.rows: list[GateRow] = []
        step(f"{scene.name}, head")
        try:
            figures = head.figures(scene, suite.folder)
        except RunFailed as failed:
            if failed.refused:
                raise InputError(str(failed)) from failed
            self.rows = [failed_run(scene.name, str(failed))]
            return
        self.recorded = RecordedScene(figures)
        kept = None if baseline is None else baseline.scenes.get(scene.name)
        before, why = None, ""
        if baseline is not None and kept is None:
            why = f"{baseline.source} has no scene {scene.name}: record it with --write-baseline"
        elif kept is not None:
            before = kept.figures
        times_with = base
        if base is not None:
            step(f"{scene.name}, base")
            try:
                of_base = base.figures(scene, suite.folder)
            except RunFailed as failed:
                times_with = None
                if failed.refused and base.folder is not None:
                    # What a change brings with it, the base does not have.
                    self.rows.append(new_scene(scene.name, str(failed)))
                else:
                    why = why or str(failed)
            else:
                before = before or (None if why else of_base)
                apart = differences(of_base.inputs, figures.inputs, but_the_motion=scene.motion_may_change)
                if differences(of_base.inputs, figures.inputs):
                    times_with = None
                if apart:
                    why = why or ("" if baseline is None else f"base has different inputs: {'; '.join(apart)}")
        limits = scene.limits if timed else without_times(scene.limits)
        self.rows += _judged(scene.name, figures, before, limits, scene.slack, scene.motion_may_change)
        comparable = before is None or not differences(before.inputs, figures.inputs)
        if why:
            self.rows.insert(0, unjudged(scene.name, "inputs", why))
        if scene.timed and timed:
            try:
                self._time(head, times_with, base, kept if comparable else None, baseline, record_times)
            except RunFailed as failed:
                # What ran once and does not run again, or not every time.
                if failed.side == head.name:
                    self.recorded = None
                    self.rows.append(failed_run(scene.name, str(failed)))
                else:
                    self.rows.append(unjudged(scene.name, "time", str(failed)))

    def _time(
        self,
        head: Side,
        base: Side | None,
        wanted: Side | None,
        kept: RecordedScene | None,
        baseline: Baseline | None,
        record: bool,
    ) -> None:
        scene, suite = self.scene, self.suite
        if base is not None:
            before, after = interleaved_times(scene, suite.folder, base, head, suite.processes, self.step)
            self.rows.append(judge_time(scene.name, after, before, suite.limit))
        against = kept if wanted is None and kept is not None and kept.times else None
        if against is not None and baseline is not None and baseline.reference_version != REFERENCE_VERSION:
            reason = f"reference workload {baseline.reference_version} there, {REFERENCE_VERSION} here"
            self.rows.append(unjudged(scene.name, "time", reason))
            against = None
        if against is None and not record:
            return
        times, references = times_beside_reference(scene, suite.folder, head, suite.processes, self.step)
        assert self.recorded is not None
        self.recorded = RecordedScene(self.recorded.figures, tuple(times), tuple(references))
        if against is None:
            return
        here = [time / reference for time, reference in zip(times, references)]
        there = [time / reference for time, reference in zip(against.times, against.references)]
        self.rows.append(judge_time(scene.name, here, there, suite.recorded_limit, divided=True))


def _notes(head: Side, base: Side | None) -> list[str]:
    if base is not None and base.package == head.package and base.folder is None:
        return [f"base and head are the same hhsim, that in {head.package}: this compares it with itself"]
    return []


def find_suite(path: Path | None, usual: Path) -> GateSuite:
    """The suite of a file, else that of the current folder, else the one that ships.

    Raises:
        InputError: As `hhsim.gate.suite.load_suite`.
    """
    if path is not None:
        return load_suite(path)
    return load_suite(usual) if usual.is_file() else default_suite()
