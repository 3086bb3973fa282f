"""Figures of the field before and after a repair as a table, and the verdict on it.

Judged are penetration, correction, kept contacts and smoothness.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hhsim.metrics.field.figures import INSIDE, KEPT, LARGEST, METRICS, RATIO, TOUCHING, FieldMetric
from hhsim.metrics.field.hands import FieldPair
from hhsim.table.table import Table, number, words
from hhsim.table.verdict import verdict

OK, MISSED, EMPTY = "within limits", "limits missed", "no frames"
"""Words of verdicts."""
DOUBT = "object"
"""Name of the missed limit where the object may be in another place."""
LEAST_KEPT = 95.0
"""Smallest share of contacts within 5 mm that are kept [%]."""
MOST_ACCELERATION = 1.1
"""Largest acceleration after over before."""
DEPTHS = ("depth_joints_max", "depth_skin_max", "depth_cones_max")


def field_metrics() -> dict[str, FieldMetric]:
    """Return every figure by its name, in the order of the table."""
    return {metric.name: metric for metric in METRICS}


@dataclass(frozen=True)
class FieldRow:
    """One row: a figure, its values before and after (SI or %, NaN where undefined), and its parameters."""

    figure: FieldMetric
    before: float
    after: float
    parameters: str

    @property
    def name(self) -> str:
        """Key in JSON."""
        return self.figure.name

    def to_json(self) -> dict[str, Any]:
        """Return the row in stored units, None where a value is undefined."""
        values = {"before": self.before, "after": self.after}
        known: dict[str, Any] = {key: None if math.isnan(value) else value for key, value in values.items()}
        return known | {"unit": self.figure.stored_unit, "parameters": self.parameters}


def field_rows(pair: FieldPair) -> tuple[FieldRow, ...]:
    """Compute every figure that is defined for one of the two hands, in the order of the table."""
    rows = []
    for metric in field_metrics().values():
        before = math.nan if metric.of_repair else metric.compute(pair, pair.recorded)
        after = metric.compute(pair, pair.repaired)
        if not (math.isnan(before) and math.isnan(after)):
            stated = metric.parameters if isinstance(metric.parameters, str) else metric.parameters(pair)
            rows.append(FieldRow(metric, before, after, stated))
    return tuple(rows)


def field_table(rows: Sequence[FieldRow], title: str = "", doubts: Sequence[str] = ()) -> Table:
    """Return rows as a table: figure, before, after, unit and parameters; doubts about the object stand above them."""
    columns = [
        words("figure", "figure.label"),
        number("before", lambda row: row.figure.shown(row.before)),
        number("after", lambda row: row.figure.shown(row.after)),
        words("unit", "figure.unit"),
        words("parameters"),
    ]
    doubted = FieldMetric("object", "the object is in doubt", compute=lambda *_: math.nan)
    first = [FieldRow(doubted, math.nan, math.nan, doubt) for doubt in doubts]
    return Table(columns, [*first, *rows], title)


def to_json(rows: Sequence[FieldRow]) -> dict[str, dict[str, Any]]:
    """Return rows by the names of their figures, as `FieldRow.to_json`."""
    return {row.name: row.to_json() for row in rows}


@dataclass(frozen=True)
class FieldVerdict:
    """Verdict on one repair: its word, the figures beyond their limits, and both, or those that hold, in one line."""

    word: str
    missed: tuple[str, ...]
    line: str


def doubts_of(rows: Sequence[FieldRow]) -> tuple[str, ...]:
    """Return a sentence if the hand is never near the object, so that there was nothing to repair."""
    if any(row.name == TOUCHING and row.before == 0.0 for row in rows):
        return ("the hand never comes within 5 mm of the object: is the object where it was?",)
    return ()


def field_verdict(rows: Sequence[FieldRow], max_correction: float, doubts: Sequence[str] = ()) -> FieldVerdict:
    """Judge the table of a repair, whose joints may move by `max_correction` [m]; undefined figures are not judged.

    With doubts, such as those of `doubts_of`, a limit is missed: what the figures are of may be another scene.
    """
    limits = dict.fromkeys(DEPTHS, INSIDE) | {LARGEST: max_correction, KEPT: LEAST_KEPT, RATIO: MOST_ACCELERATION}
    judged = [row for row in rows if row.name in limits and not math.isnan(row.after)]
    if not any(row.name in DEPTHS for row in judged):
        return FieldVerdict(EMPTY, (), f"{EMPTY}: no frame has all of its joints in both recordings")
    beyond = verdict({row.name: row.after for row in judged}, limits, least=(KEPT,))
    missed, said = [DOUBT for _ in doubts[:1]], [*doubts]
    for row in (row for row in judged if row.name in beyond):
        missed.append(row.name)
        unit = f" {row.figure.unit}" if row.figure.unit else ""
        bound = f"at {'least' if row.name == KEPT else 'most'} {limits[row.name] / row.figure.scale:g}{unit}"
        # A depth of micrometres is 0 in the table's digits.
        said.append(f"{row.figure.label} {row.after / row.figure.scale:.4g}{unit} ({bound})")
    if missed:
        return FieldVerdict(MISSED, tuple(missed), f"{MISSED}: {'; '.join(said)}")
    kept = ", ".join(row.figure.label for row in judged)
    return FieldVerdict(OK, (), f"{OK}: {kept}")
