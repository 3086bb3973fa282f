"""Verdict of the referee on one claim of a result, with the worst deviation, its tick and the tolerance."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray

HOLDS = "holds"
FAILS = "FAILS"
NOT_CLAIMED = "not claimed"
"""Verdict on what the file does not claim; the deviation is shown all the same."""
NOT_JUDGED = "not judged"


@dataclass(frozen=True)
class Claim:
    """One claim and the verdict on it."""

    name: str  # short name of the claim
    says: str  # statement of the file, as a sentence
    verdict: str  # `HOLDS`, `FAILS`, `NOT_CLAIMED` or `NOT_JUDGED`
    worst: float = float("nan")  # deviation that is the largest multiple of its tolerance, in `unit`; NaN for none
    tolerance: float = float("nan")  # tolerance of that deviation, in `unit`
    unit: str = "1"  # SI unit of both
    tick: int | None = None  # tick of the worst deviation; None where it belongs to no tick
    checked: int = 0  # number of ticks (or other things) that were judged
    why: str = ""  # reason of the tolerance
    note: str = ""  # remark for the reader
    group: str = ""  # what it is of: seal, second run, depth, forces, friction, motion, joints, trees
    hand: str = ""  # hand that it is of, right or left; "" in a file of one, or of the file as a whole

    @property
    def share(self) -> float:
        """Deviation as a multiple of its tolerance, 0 to 1 where the claim holds; NaN for none."""
        return self.worst / max(self.tolerance, float(np.finfo(float).tiny))

    @property
    def failed(self) -> bool:
        """True if the claim is false."""
        return self.verdict == FAILS


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
    """Judge deviations, shape (N,) and not negative, against tolerances, a scalar or shape (N,).

    The worst deviation is the largest multiple of its tolerance; NaN fails. `ticks`, shape (N,), are the deviations'.
    """
    found = np.atleast_1d(np.asarray(deviation, np.float64))
    limit = np.broadcast_to(np.asarray(tolerance, np.float64), found.shape)
    if found.size == 0:
        return Claim(name, says, NOT_JUDGED, unit=unit, why=why, note=note or "there is nothing in the file to judge")
    with np.errstate(over="ignore"):
        share = np.where(np.isnan(found), np.inf, found / np.maximum(limit, np.finfo(float).tiny))
    worst = int(share.argmax())
    verdict = HOLDS if share[worst] <= 1.0 else FAILS
    tick = None if ticks is None or found[worst] == 0.0 else int(np.asarray(ticks)[worst])
    return Claim(name, says, verdict, float(found[worst]), float(limit[worst]), unit, tick, found.size, why, note)


def all_true(
    name: str, says: str, wrong: ArrayLike, *, ticks: ArrayLike | None = None, note: str = "", why: str = "exact"
) -> Claim:
    """Judge flags `wrong`, shape (N,): the claim fails if any is True, and its worst figure is their number."""
    found = np.atleast_1d(np.asarray(wrong, bool))
    claim = judged(name, says, found.astype(float), 0.5, "1", why, ticks=ticks, note=note)
    if claim.verdict == NOT_JUDGED:
        return claim
    count = int(found.sum())
    note = note or (f"{count:,} wrong" if count else "")
    return replace(claim, worst=float(count), tolerance=0.0, unit="", note=note)


def difference(stored: FloatArray, own: FloatArray) -> FloatArray:
    """|stored − own|; 0 where both are NaN, infinite where one is."""
    stored = np.asarray(stored, np.float64)
    one, other = np.isnan(stored), np.isnan(own)
    return np.where(one & other, 0.0, np.where(one | other, np.inf, np.abs(stored - own)))
