"""Flags of samples: bits that a trajectory file holds about the faults and repairs of an import."""

from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import BoolArray


class SampleFlag(IntFlag):
    """One bit per kind of finding; a sample's flags are their sum, 0 for none."""

    REORDERED = 1 << 0
    CUT_BEFORE = 1 << 1
    GAP_BEFORE = 1 << 2
    UNIT = 1 << 3
    PALM_FILLED = 1 << 4
    FINGERS_FILLED = 1 << 5
    PALM_OUTLIER = 1 << 6
    FINGERS_OUTLIER = 1 << 7
    JUMP = 1 << 8
    SUSPECT = 1 << 9
    FLIPPED = 1 << 10
    RENORMALISED = 1 << 11
    LIMITED = 1 << 12
    FROZEN = 1 << 13
    INVALID = 1 << 14
    ESTIMATED = 1 << 15

    @property
    def word(self) -> str:
        """Name of the flag in tables and files, in lower case."""
        return str(self.name).lower()


FLAG_MEANINGS: dict[SampleFlag, str] = {
    SampleFlag.REORDERED: "came out of order and was sorted in by its stamp",
    SampleFlag.CUT_BEFORE: "samples between this one and the one before were left out",
    SampleFlag.GAP_BEFORE: "no sample for more than three usual steps before this one",
    SampleFlag.UNIT: "a unit was wrong and was converted",
    SampleFlag.PALM_FILLED: "the palm's pose was missing and was interpolated",
    SampleFlag.FINGERS_FILLED: "a joint angle was missing and was interpolated",
    SampleFlag.PALM_OUTLIER: "the palm's pose was off by more than a hand can move and was interpolated",
    SampleFlag.FINGERS_OUTLIER: "a joint angle was off by more than a finger can move and was interpolated",
    SampleFlag.JUMP: "came faster than a hand can move and stayed there; left as it is",
    SampleFlag.SUSPECT: "sticks out of its neighbours, though a hand could do it; left as it is",
    SampleFlag.FLIPPED: "its quaternion had the other sign; the rotation is the same",
    SampleFlag.RENORMALISED: "its quaternion was not of unit length and was scaled",
    SampleFlag.LIMITED: "a joint angle lay beyond the hand's limits and was set to the limit",
    SampleFlag.FROZEN: "the same bytes as the samples around it, while the rest of the recording moves",
    SampleFlag.INVALID: "the device itself said that it was not sure",
    SampleFlag.ESTIMATED: "a joint angle was computed from others, not measured",
}
"""Meaning of every flag in one line."""

MENDED = (
    SampleFlag.REORDERED
    | SampleFlag.UNIT
    | SampleFlag.PALM_FILLED
    | SampleFlag.FINGERS_FILLED
    | SampleFlag.PALM_OUTLIER
    | SampleFlag.FINGERS_OUTLIER
    | SampleFlag.RENORMALISED
    | SampleFlag.LIMITED
)
"""Flags of samples whose numbers, or place in time, were changed."""


def marked(flags: NDArray[np.uint32], flag: SampleFlag) -> BoolArray:
    """Return True where any bit of `flag` is set, shape (T,)."""
    found: BoolArray = (flags & np.uint32(flag.value)) != 0
    return found


def mark(flags: NDArray[np.uint32], where: BoolArray, flag: SampleFlag) -> None:
    """Set `flag` in place where `where` is true."""
    flags[where] |= np.uint32(flag.value)
