"""Verdict on a repaired recording by its table: penetration, correction, kept contacts and smoothness."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hhsim.metrics.field.contact import KEPT, TOUCHING
from hhsim.metrics.field.correction import INSIDE, LARGEST, RATIO
from hhsim.metrics.field.field_table import FieldRow
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
