"""The verdict of a report: a word and a few sentences that stand at its top."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hhsim.gate.suite import default_suite
from hhsim.mesh.solidify import ASSUMED_SOLID
from hhsim.replay.summary_table import SummaryRow
from hhsim.result.reader import Result

OK, MISSED, SHORT, LATE, EMPTY = "within limits", "limits missed", "cut short", "ticks missed", "no ticks"
"""The words. A run that is cut short and misses limits is one that misses limits."""


@dataclass(frozen=True)
class Verdict:
    """Of one result.

    Attributes:
        word: One of the words.
        sentences: What it rests on, the limits that were missed last.
        missed: Names of the figures that are over their limits.
    """

    word: str
    sentences: tuple[str, ...]
    missed: tuple[str, ...] = ()


def verdict(result: Result, rows: Sequence[SummaryRow]) -> Verdict:
    """Judge a result by the limits that `hhsim gate` has for its method where a project sets none.

    A figure that is undefined, or that the file lacks, is not judged.
    """
    if result.ticks == 0:
        return Verdict(EMPTY, ("The file holds no tick.",))
    figures = {row.name: row for row in rows}
    limits = {
        name: limit
        for name, limit in default_suite().limits_of(result.method).items()
        if name in figures and math.isfinite(figures[name].value)
    }
    missed = tuple(name for name, limit in limits.items() if not figures[name].value <= limit)
    parts = [] if result.complete else [f"The run was stopped after {result.ticks:,} ticks; what follows is of these."]
    parts += [_contact(figures), *_assumed(result), _speed(result, figures)]
    # A tick that never was is in no figure of the ticks.
    late = int(result.summary.get("missed", 0))
    if late:
        parts.append(f"{late:,} periods of the session had no tick at all, beside the {result.ticks:,} that had one.")
    if missed:
        over = "; ".join(_over(figures[name], limits[name]) for name in missed)
        parts.append(f"Over the limits that hhsim gate has by default: {over}.")
    elif limits:
        parts.append(
            f"All {len(limits)} figures that hhsim gate has a default limit for, and that are defined here, hold it."
        )
    word = MISSED if missed else SHORT if not result.complete else LATE if late else OK
    return Verdict(word, tuple(part for part in parts if part), missed)


def _contact(figures: dict[str, SummaryRow]) -> str:
    near, depth = figures.get("candidates_max"), figures.get("penetration_max")
    if depth is None:
        return ""
    if near is not None and near.value == 0:
        return "The hand never comes near the object."
    if depth.shown == depth.figure.shown(0.0):
        return "The shown hand stays out of the object's spheres in every tick."
    return f"The shown hand is up to {depth.shown} {depth.unit} inside the object's spheres."


def _assumed(result: Result) -> list[str]:
    """What of the object's own surface no guarantee is of."""
    said = [text for text in result.scene.get("object_repairs") or [] if text.startswith(ASSUMED_SOLID)]
    return [f"{text[:1].upper()}{text[1:]}." for text in said]


def _speed(result: Result, figures: dict[str, SummaryRow]) -> str:
    p50, p99, over = (figures.get(name) for name in ("tick_cpu_p50", "tick_cpu_p99", "tick_wall_over_1ms"))
    if p50 is None or p99 is None or math.isnan(p50.value):
        return ""
    text = f"A tick in contact takes {p50.shown} {p50.unit} of CPU time in the median, {p99.shown} {p99.unit} at p99"
    if over is None or math.isnan(over.value):
        return f"{text}."
    late = round(0.01 * over.value * result.ticks)
    count = f"{late:,}" if late else "none"
    return f"{text}; {count} of {result.ticks:,} ticks took more than 1 ms by the wall clock."


def _over(row: SummaryRow, limit: float) -> str:
    unit = f" {row.unit}" if row.unit else ""
    return f"{row.label} {row.shown}{unit} (limit {limit / row.figure.scale:g})"
