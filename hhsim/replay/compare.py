"""Comparison of two results: differences of input and of options, and the figures that are better or worse."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.run_inputs import named_differences, new_options, run_inputs, tick_digest
from hhsim.replay.summary_table import SummaryRow
from hhsim.result.reader import Result
from hhsim.result.wording import commit, object_name, option_value
from hhsim.table.verdict import NOT_COMPARABLE, SAME, WITHIN, word_of

HOW = ("level", "max_error", "spheres of the tree", "sphere tree")
"""What changes how a run is made, not its input, beside the options of the solver."""
SEEDED_NOISE = {TREMBLING: 2.0, f"{TREMBLING}_std": 2.0}
"""Relative differences within the noise of a hand with random tremor.

A hold of a second has ten periods of the tremor: of eight seeds the largest mean was 2.1 to 3.4 times the least,
on two objects, with three motions and two methods.
"""

DEVIATIONS = 2.0
"""Standard deviations of the difference of two runs within which times measured repeatedly are noise."""


@dataclass(frozen=True)
class Comparison:
    """One result beside the first one."""

    scene: tuple[str, ...]  # differences of object, hand or motion; figures can only be compared without any
    how: tuple[str, ...]  # differences of method, options, tree
    around: tuple[str, ...]  # other differences: machine, versions, schema
    same_machine: bool  # True if times can be compared
    same_bits: bool = False  # True if poses and forces are equal to the last bit in every tick
    # Difference of each time that is noise, where one result was run repeatedly [s or %].
    spread: Mapping[str, float] = field(default_factory=dict)

    @property
    def comparable(self) -> bool:
        """True if both had the same input."""
        return not self.scene

    def sentence(self) -> str:
        """Return in one sentence whether the figures can be compared."""
        if not self.comparable:
            return f"Not comparable: not the same scene ({'; '.join(self.scene)})."
        times = "" if self.same_machine else "; times cannot, since they are of different machines"
        bits = " Poses and forces are equal to the last bit." if self.same_bits else ""
        return f"The same object, hand and motion: figures can be compared{times}.{bits}"


@dataclass(frozen=True)
class ComparedFigure:
    """A figure's ratio to that of the first result, NaN where undefined, and the gate's word for it, or ""."""

    ratio: float
    word: str


def compare(base: Result, head: Result) -> Comparison:
    """Return the differences of two results."""
    one, other = run_inputs(base), run_inputs(head)
    unlike = named_differences(one, other)
    schema, texts = unlike.pop("result schema", None), dict(unlike)
    if "object mesh" in texts and object_name(base) != object_name(head):
        texts["object mesh"] = f"object: {object_name(base)} and {object_name(head)}"
    for name in unlike.keys() & one.solver.keys():
        values = [option_value(name, inputs.solver[name]) for inputs in (one, other)]
        # What differs in later digits than people read is told in full.
        texts[name] = f"{name}: {' and '.join(values)}" if values[0] != values[1] else unlike[name]
    of_how = {name for name in unlike if name in HOW or name in one.solver}
    how = [texts[name].replace("None", "none") for name in unlike if name in of_how]
    how += [f"option that only one has: {name}" for name in new_options(one, other)]
    around = [*([schema] if schema else []), *_around(base, head)]
    scene = tuple(texts[name].replace("None", "none") for name in unlike if name not in of_how)
    scene = ("one is a live session", *scene) if (base.live is None) != (head.live is None) else scene
    same_bits = base.ticks == head.ticks and tick_digest(base) == tick_digest(head)
    return Comparison(scene, tuple(how), tuple(around), base.machine == head.machine, same_bits, _spread(base, head))


def compared(base: SummaryRow, head: SummaryRow, comparison: Comparison) -> ComparedFigure:
    """Compare a figure with that of the first result."""
    metric = run_metrics()[head.name]
    known = math.isfinite(base.value) and math.isfinite(head.value)
    # Of what is shown as nothing there is no ratio worth telling: it is rounding, or would be infinite.
    ratio = head.value / base.value if known and head.figure.shown(0.0) not in (base.shown, head.shown) else math.nan
    # A time that single ticks decide about: a pause of the machine, not the method.
    by_chance = math.isinf(metric.noise)
    if not (known and metric.less_is_better) or by_chance or not comparison.comparable:
        return ComparedFigure(ratio, "")
    if metric.noise > 0.0 and not comparison.same_machine:
        return ComparedFigure(ratio, NOT_COMPARABLE)
    if head.shown == base.shown:
        return ComparedFigure(ratio, SAME)
    if abs(head.value - base.value) <= comparison.spread.get(head.name, -1.0):
        return ComparedFigure(ratio, WITHIN)
    ours, before = (abs(row.value) if metric.signed else row.value for row in (head, base))
    return ComparedFigure(ratio, word_of(ours, before, SEEDED_NOISE.get(head.name, metric.noise)))


def _spread(base: Result, head: Result) -> dict[str, float]:
    one, other = base.repeated.get("times", {}), head.repeated.get("times", {})
    # A result of one run is taken to differ as much as the other.
    pairs = {name: (one.get(name, other.get(name)), other.get(name, one.get(name))) for name in one.keys() | other}
    return {name: DEVIATIONS * math.hypot(a["std"], b["std"]) for name, (a, b) in pairs.items()}


def _around(base: Result, head: Result) -> list[str]:
    found = [
        f"{name}: {_in_words(one.get(name))} and {_in_words(other.get(name))}"
        for one, other in ((base.machine, head.machine), (base.packages, head.packages))
        for name in sorted(one.keys() | other.keys())
        if one.get(name) != other.get(name)
    ]
    if base.hhsim_version != head.hhsim_version:
        found.append(f"hhsim: {base.hhsim_version} and {head.hhsim_version}")
    if (base.git_revision, base.git_dirty) != (head.git_revision, head.git_dirty):
        found.append(f"commit: {commit(base)} and {commit(head)}")
    if base.complete != head.complete:
        found.append(f"complete: {_in_words(base.complete)} and {_in_words(head.complete)}")
    return found


def _in_words(value: Any) -> str:
    return "none" if value is None else "yes" if value is True else "no" if value is False else str(value)
