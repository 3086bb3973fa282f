"""What a referee says of one claim of a result: whether it holds, where it is worst, and what is let pass and why."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

HOLDS = "holds"
FAILS = "FAILS"
NOT_CLAIMED = "not claimed"
"""What the file does not say; the figure is shown all the same."""
NOT_JUDGED = "not judged"


@dataclass(frozen=True)
class Claim:
    """One claim and the verdict on it.

    Attributes:
        name: Short.
        says: What the file claims.
        verdict: `HOLDS`, `FAILS`, `NOT_CLAIMED` or `NOT_JUDGED`.
        worst: Deviation where it is the largest share of what is let pass, SI; NaN where there is none to tell.
        tolerance: What is let pass there.
        unit: Of both.
        tick: Where the worst was found; None where it is no matter of a tick.
        checked: Ticks (or other things) that were looked at.
        why: Why this tolerance.
        note: What else a reader should know.
    """

    name: str
    says: str
    verdict: str
    worst: float = float("nan")
    tolerance: float = float("nan")
    unit: str = "1"
    tick: int | None = None
    checked: int = 0
    why: str = ""
    note: str = ""

    @property
    def failed(self) -> bool:
        """Whether the claim is false."""
        return self.verdict == FAILS

    def to_json(self) -> dict[str, Any]:
        """As plain values, SI."""
        return asdict(self)


def judged(
    name: str,
    says: str,
    deviation: ArrayLike,
    tolerance: ArrayLike,
    unit: str,
    why: str,
    *,
    ticks: ArrayLike | None = None,
    note: str = "",
) -> Claim:
    """The verdict on deviations, one a tick or thing; NaN is one that is as wrong as can be.

    Args:
        deviation: Not negative, shape (N,).
        tolerance: One for all, or shape (N,); the worst is where the deviation is most tolerances.
        ticks: Which tick each is of, shape (N,); None where they are of no tick.
    """
    found = np.atleast_1d(np.asarray(deviation, np.float64))
    limit = np.broadcast_to(np.asarray(tolerance, np.float64), found.shape)
    if found.size == 0:
        return Claim(name, says, NOT_JUDGED, unit=unit, why=why, note=note or "there is nothing in the file to judge")
    with np.errstate(over="ignore"):
        share = np.where(np.isnan(found), np.inf, found / np.maximum(limit, np.finfo(float).tiny))
    worst = int(share.argmax())
    return Claim(
        name,
        says,
        HOLDS if share[worst] <= 1.0 else FAILS,
        float(found[worst]),
        float(limit[worst]),
        unit,
        None if ticks is None or found[worst] == 0.0 else int(np.asarray(ticks)[worst]),
        found.size,
        why,
        note,
    )


def all_true(
    name: str, says: str, wrong: ArrayLike, *, ticks: ArrayLike | None = None, note: str = "", why: str = "exact"
) -> Claim:
    """The verdict on what is either right or wrong: `wrong` is True where it is not, shape (N,)."""
    found = np.atleast_1d(np.asarray(wrong, bool))
    claim = judged(name, says, found.astype(float), 0.5, "1", why, ticks=ticks, note=note)
    if claim.verdict == NOT_JUDGED:
        return claim
    if not claim.failed:
        return Claim(name, says, claim.verdict, 0.0, 0.0, "", None, claim.checked, why, note)
    count = int(found.sum())
    return Claim(name, says, FAILS, float(count), 0.0, "", claim.tick, claim.checked, why, note or f"{count:,} wrong")
