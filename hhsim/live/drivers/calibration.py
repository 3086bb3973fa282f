"""Calibration of a live glove: our TOML (`hhsim.recordings.dexmo_regression`), or the default."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.live.drivers.dexmo import CHANNELS
from hhsim.live.gloves import DexmoOptions
from hhsim.recordings.dexmo_regression import BEND, LEAST_SPAN, DexmoRegression, read_calibration

MOST_NORMALISED = 1.5
"""Larger channels are raw counts."""
MOST_COUNT = 4095.0
"""Largest count of a 12-bit sensor."""
BENDS = list(BEND)
FAR = (-0.5, 1.5)
"""Range of the normalised bends of a hand; splits are clipped to it."""


@dataclass(frozen=True, eq=False)
class GloveCalibration:
    """Calibration of a live glove."""

    regression: DexmoRegression  # from the channels that the glove sends to joint angles
    doubtful: tuple[str, ...] = ()  # messages about channels of too small a span
    kept_free: tuple[int, ...] = ()  # numbers of the fingers whose bend has too small a span to push on

    @property
    def in_counts(self) -> bool:
        """True if the calibrated range of the regression is in raw counts."""
        return bool(np.abs(self.regression.closed - self.regression.open).max() > MOST_NORMALISED)

    def bend_lines(self) -> tuple[FloatArray, FloatArray]:
        """See `DexmoRegression.bend_lines`."""
        return self.regression.bend_lines()

    def bend_ends(self) -> tuple[FloatArray, FloatArray]:
        """Return the readings of the bends in the flat hand and in the fist, each of shape (5,)."""
        return self.regression.open[BENDS], self.regression.closed[BENDS]

    def angles(self, readings: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return flexion (5, 3) and abduction (5,) [rad] of finite readings (11,); None beyond a hand's range.

        So are numbers from 0 to 1 where the calibration is for counts, and counts where it is not.
        """
        normalised = self.regression.normalised(readings)
        least, most = FAR
        if not all(least <= bend <= most for bend in normalised[BENDS].tolist()):
            return None
        if self.in_counts and np.abs(readings).max() <= MOST_NORMALISED:
            return None
        angles = self.regression.slope @ np.minimum(np.maximum(normalised, least), most) + self.regression.offset
        return angles[:15].reshape(5, 3), angles[15:]


def glove_calibration(options: DexmoOptions, hand: str) -> GloveCalibration:
    """Read the calibration that a glove's settings name, or return the default; either hand has the same channels.

    Doubtful are channels of too narrow a range of counts, or one beyond the sensor's. InputError for a file that is
    unreadable or malformed.
    """
    if not options.calibration:
        return GloveCalibration(DexmoRegression.default())
    found = GloveCalibration(read_calibration(Path(options.calibration)))
    if not found.in_counts:
        return found
    low, high = found.regression.open, found.regression.closed
    span = np.abs(high - low)
    doubtful = [
        f"{name} spans {count:.0f} counts of {MOST_COUNT:.0f}: it says little"
        for name, count in zip(CHANNELS, span)
        if count < LEAST_SPAN
    ]
    beyond = [name for name, a, b in zip(CHANNELS, low, high) if min(a, b) < 0.0 or max(a, b) > MOST_COUNT]
    if beyond:
        doubtful.append(f"counts beyond 0 to {MOST_COUNT:.0f}: {', '.join(beyond)}")
    kept_free = tuple(finger for finger, k in enumerate(BEND) if span[k] < LEAST_SPAN)
    return GloveCalibration(found.regression, tuple(doubtful), kept_free)
