"""Calibration of a live glove: a `DexmoRegression` of our TOML, or the default, and what its numbers are good for."""

from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.live.gloves import DexmoOptions
from hhsim.recordings.dexmo_regression import BEND, CHANNELS, LEAST_SPAN, DexmoRegression, read_calibration

MOST_NORMALISED = 1.5
"""Larger channels are raw counts."""
MOST_COUNT = 4095.0
"""Largest count of a 12-bit sensor."""
BENDS = list(BEND)
LEAST, MOST = -0.5, 1.5
"""Range of the normalised bends of a hand; splits are clipped to it."""


def glove_calibration(options: DexmoOptions, hand: str) -> DexmoRegression:
    """Return the calibration that a glove's settings name, or the default; either hand has the same channels.

    InputError for a file that is unreadable or malformed.
    """
    return read_calibration(Path(options.calibration)) if options.calibration else DexmoRegression.default()


def in_counts(calibration: DexmoRegression) -> bool:
    """Return True if the calibrated range is in raw counts."""
    return bool(np.abs(calibration.closed - calibration.open).max() > MOST_NORMALISED)


def doubtful_channels(calibration: DexmoRegression) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return messages about channels of counts with too small a range, or one beyond the sensor's.

    Returned besides are the numbers of the fingers whose bend has too small a range to push on.
    """
    if not in_counts(calibration):
        return (), ()
    low, high = calibration.open, calibration.closed
    span = np.abs(high - low)
    doubtful = [
        f"{name} spans {count:.0f} counts of {MOST_COUNT:.0f}: it says little"
        for name, count in zip(CHANNELS, span)
        if count < LEAST_SPAN
    ]
    beyond = [name for name, a, b in zip(CHANNELS, low, high) if min(a, b) < 0.0 or max(a, b) > MOST_COUNT]
    if beyond:
        doubtful.append(f"counts beyond 0 to {MOST_COUNT:.0f}: {', '.join(beyond)}")
    return tuple(doubtful), tuple(finger for finger, k in enumerate(BEND) if span[k] < LEAST_SPAN)


def hand_angles(calibration: DexmoRegression, readings: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return flexion (5, 3) and abduction (5,) [rad] of finite readings (11,); None beyond a hand's range.

    So are numbers from 0 to 1 where the calibration is for counts, and counts where it is not.
    """
    normalised = calibration.normalised(readings)
    if not all(LEAST <= bend <= MOST for bend in normalised[BENDS].tolist()):
        return None
    if in_counts(calibration) and np.abs(readings).max() <= MOST_NORMALISED:
        return None
    angles = calibration.slope @ np.minimum(np.maximum(normalised, LEAST), MOST) + calibration.offset
    return angles[:15].reshape(5, 3), angles[15:]
