"""Verdict on a repaired recording by its table: penetration, correction, kept contacts and smoothness."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hhsim.metrics.field.contact import KEPT, TOUCHING
from hhsim.metrics.field.correction import INSIDE, LARGEST, RATIO
from hhsim.metrics.field.field_table import FieldRow
from hhsim.replay.verdict import verdict

OK, MISSED, EMPTY = "within limits", "limits missed", "no frames"
"""Words of verdicts."""
DOUBT = "object"
"""Name of the missed limit where the object may be in another place."""
LEAST_KEPT = 95.0
"""Smallest share of contacts within 5 mm that are kept [%]."""
MOST_ACCELERATION = 1.1
"""Largest acceleration after over before."""
DEPTHS = ("depth_joints_max", "depth_skin_max", "depth_cones_max")


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
    # More kept contacts are better: their negative is below its limit.
    limits = {**dict.fromkeys(DEPTHS, INSIDE), KEPT: -LEAST_KEPT, RATIO: MOST_ACCELERATION, LARGEST: max_correction}
    judged = {row.name: row for row in rows if row.name in limits and not math.isnan(row.after)}
    if not judged.keys() & set(DEPTHS):
        return FieldVerdict(EMPTY, (), f"{EMPTY}: no frame has all of its joints in both recordings")
    missed = verdict({name: -row.after if name == KEPT else row.after for name, row in judged.items()}, limits)
    said = [*doubts]
    for figure, after, limit in ((judged[name].figure, judged[name].after, limits[name]) for name in missed):
        unit, side = f" {figure.unit}" if figure.unit else "", "most" if limit > 0.0 else "least"
        # A depth of micrometres is 0 in the table's digits.
        shown = f"{after / figure.scale:.4g}{unit} (at {side} {abs(limit) / figure.scale:g}{unit})"
        said.append(f"{figure.label} {shown}")
    if said:
        return FieldVerdict(MISSED, (*(DOUBT for _ in doubts[:1]), *missed), f"{MISSED}: {'; '.join(said)}")
    return FieldVerdict(OK, (), f"{OK}: {', '.join(row.figure.label for row in judged.values())}")
