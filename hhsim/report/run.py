"""One result of a report, with its label, and depths by its poses, whatever the file's own columns say.

A label is a letter, and in few words what tells each from the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.run_ticks import PLACED, result_ticks, touched_object
from hhsim.metrics.session_faults import broken_off
from hhsim.replay.run_inputs import unusual_options
from hhsim.replay.summary_table import SummaryRow, session_rows
from hhsim.replay.verdict import MISSED, OK, Verdict, checked_figures, read_ticks, verdict
from hhsim.result.reader import Result
from hhsim.result.wording import motion_name, object_name, option_value

UNNAMED = "method"
"""Label where a file does not say which method was run."""
MOST_WORDS = 3

DEPTH, PALM, FINGER = "penetration_depth", "penetration_palm", "penetration_finger"
"""Datasets of /tick that follow from the poses."""
BLOCK_TICKS = 16_384
ROUNDING = 1e-9
"""Depths that differ by no more are the same [m]."""


def result_labels(results: Sequence[Result]) -> list[str]:
    """Return a label for each result: its method and, where these differ, object, motion and unusual options.

    Several results have letters, hands of one run their names.
    """
    if len(results) > 1 and all(of_one_run(results[0], other) for other in results[1:]):
        return [f"{result.name} hand" for result in results]
    names = [(object_name(result), motion_name(result), result.method or UNNAMED) for result in results]
    if len(results) == 1:
        return [names[0][2]]
    varied = (*(len({name[part] for name in names}) > 1 for part in (0, 1)), True)
    options = _telling([_words(result) for result in results])
    labels = [
        ", ".join([" ".join(part for part, differs in zip(name, varied) if differs), *words[:MOST_WORDS]])
        for name, words in zip(names, options)
    ]
    return [f"{letter(number)}: {label}" for number, label in enumerate(labels)]


def of_one_run(one: Result, other: Result) -> bool:
    """Return True for two hands of one file."""
    return one.path == other.path and one.name != other.name


def letter(number: int) -> str:
    """Return the letters of a number: A, B, … Z, AA, AB, … for 0, 1, and so on."""
    rest, last = divmod(number, 26)
    return (letter(rest - 1) if rest else "") + chr(ord("A") + last)


def _words(result: Result) -> list[str]:
    """Return how a result was run, but for its method, as far as it is not usual."""
    side = result.scene.get("hand", {}).get("side", "right")
    kind = [*(["live session"] if result.live is not None else []), *([f"{side} hand"] if side != "right" else [])]
    stated = unusual_options(result.scene).items()
    return kind + [f"{name.replace('_', ' ').replace('.', ' ')} {option_value(name, value)}" for name, value in stated]


def _telling(words: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return of each result's words those that not every result has."""
    shared = set(words[0]).intersection(*words) if words else set()
    return [[word for word in of if word not in shared] for of in words]


@dataclass(frozen=True, repr=False)
class PosedResult(Result):
    """A result with depths [m] computed from its poses, and the deepest by the file's own column (NaN without one)."""

    stated_depth: float = np.nan

    @property
    def deepest(self) -> float:
        """Deepest penetration of all ticks, by their poses [m]."""
        return _deepest(self.replaced[DEPTH])

    def contradiction(self) -> str:
        """Return in a sentence where the file's own depth differs; "" where it agrees."""
        if self.ticks == 0 or abs(self.stated_depth - self.deepest) <= ROUNDING:
            return ""
        return (
            f"The file says that the deepest penetration is {1e6 * self.stated_depth:,.3f} µm; its poses are "
            f"{1e6 * self.deepest:,.3f} µm deep, and that is what is shown here. hhsim verify looks further."
        )


def posed_result(result: Result) -> PosedResult:
    """Compute the depths of a result from its poses, seen from its object, in its columns and in its summary.

    InputError if the file cannot be read, or its tree is damaged.
    """
    result = result.seen_from_object
    touched = touched_object(result)
    depths = {name: np.empty(result.ticks) for name in (DEPTH, PALM)} | {FINGER: np.empty((result.ticks, len(FINGERS)))}
    stated, first = 0.0, 0
    for block in result.blocks([*PLACED, DEPTH], BLOCK_TICKS):
        count = len(block[DEPTH])
        part = slice(first, first + count)
        found = touched.penetration(PlacedHand(*(block[name] for name in PLACED)), part)
        finite = np.logical_and.reduce([np.isfinite(block[name]).reshape(count, -1).all(1) for name in PLACED])
        for name, values in ((DEPTH, found.depth), (PALM, found.palm), (FINGER, found.finger)):
            values[~finite] = np.nan
            depths[name][part] = values
        stated, first = max(stated, _deepest(block[DEPTH])), part.stop
    ticks = result_ticks(result, depths)
    # Figures of the summary that follow from depths alone.
    figures = {
        name: float(metric.compute(ticks))
        for name, metric in run_metrics().items()
        if name in result.summary and metric.compute is not None and metric.needs and set(metric.needs) <= depths.keys()
    }
    given = {one.name: getattr(result, one.name) for one in fields(Result)}
    given |= {"summary": {**result.summary, **figures}, "replaced": depths, "_loaded": {}}
    return PosedResult(**given, stated_depth=max(stated, float(result.summary.get("penetration_max", 0.0))))


def _deepest(depth: AnyArray) -> float:
    return float(np.fmax.reduce(depth[np.isfinite(depth)], initial=0.0))


@dataclass(frozen=True)
class ReportRun:
    """One result."""

    result: PosedResult  # the file, with depths of its poses
    label: str
    prefix: str  # begin of the names of its pictures and anchors
    rows: tuple[SummaryRow, ...]  # the table that replay prints
    misstated: str  # sentence on figures of the file that are not those of its ticks; else ""
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
    """Compute what a report says of each result, with depths of the poses."""
    runs = []
    for label, result in zip(result_labels(results), map(posed_result, results)):
        ticks = read_ticks(result)
        rows, misstated = checked_figures(result, ticks)
        runs.append(
            ReportRun(
                result=result,
                label=label,
                prefix="" if len(results) == 1 else f"{label.partition(':')[0].lower().removesuffix(' hand')}-",
                rows=rows,
                misstated=misstated,
                session=() if result.live is None else session_rows(result.summary),
                verdict=verdict(result, rows),
            )
        )
    return runs
