"""Flags of samples: bits that a trajectory file holds about the faults and repairs of an import."""

from enum import IntFlag
from typing import Self

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import BoolArray


class SampleFlag(IntFlag):
    """One bit per kind of finding, with its meaning; a sample's flags are their sum, 0 for none."""

    _value_: int
    meaning: str

    def __new__(cls, bit: int, meaning: str) -> Self:
        """Make a flag of a bit and its meaning in one line."""
        flag = int.__new__(cls, bit)
        flag._value_, flag.meaning = bit, meaning
        return flag

    REORDERED = 1 << 0, "came out of order and was sorted in by its stamp"
    CUT_BEFORE = 1 << 1, "samples between this one and the one before were left out"
    GAP_BEFORE = 1 << 2, "no sample for more than three usual steps before this one"
    UNIT = 1 << 3, "a unit was wrong and was converted"
    PALM_FILLED = 1 << 4, "the palm's pose was missing and was interpolated"
    FINGERS_FILLED = 1 << 5, "a joint angle was missing and was interpolated"
    PALM_OUTLIER = 1 << 6, "the palm's pose was off by more than a hand can move and was interpolated"
    FINGERS_OUTLIER = 1 << 7, "a joint angle was off by more than a finger can move and was interpolated"
    JUMP = 1 << 8, "came faster than a hand can move and stayed there; left as it is"
    SUSPECT = 1 << 9, "sticks out of its neighbours, though a hand could do it; left as it is"
    FLIPPED = 1 << 10, "its quaternion had the other sign; the rotation is the same"
    RENORMALISED = 1 << 11, "its quaternion was not of unit length and was scaled"
    LIMITED = 1 << 12, "a joint angle lay beyond the hand's limits and was set to the limit"
    FROZEN = 1 << 13, "the same bytes as the samples around it, while the rest of the recording moves"
    INVALID = 1 << 14, "the device itself said that it was not sure"
    ESTIMATED = 1 << 15, "a joint angle was computed from others, not measured"

    @property
    def word(self) -> str:
        """Name of the flag in tables and files, in lower case."""
        return str(self.name).lower()


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
DAMAGED = SampleFlag.PALM_OUTLIER | SampleFlag.FINGERS_OUTLIER | SampleFlag.JUMP | SampleFlag.SUSPECT
"""Flags of samples with numbers that a hand hardly makes."""


def marked(flags: NDArray[np.uint32], flag: SampleFlag) -> BoolArray:
    """Return True where any bit of `flag` is set, shape (T,)."""
    return np.asarray((flags & np.uint32(flag.value)) != 0)


def mark(flags: NDArray[np.uint32], where: BoolArray, flag: SampleFlag) -> None:
    """Set `flag` in place where `where` is true."""
    flags[where] |= np.uint32(flag.value)
