"""Calibration of a live glove: our TOML (`hhsim.recordings.dexmo_regression`), or the vendor's JSON of profiles.

The vendor's server keeps raw 12-bit counts of the open and the closed hand, in named profiles::

    {"RIGHT": {"anna": {"max": {"thumb_bend": 3166, …}, "min": {"thumb_bend": 712, …}}}, "LEFT": {…}}

It sends channels already normalised to 0 to 1: its counts only say which channels are too narrow to be believed.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, UnknownNameError
from hhsim.live.drivers.dexmo import CHANNELS
from hhsim.live.gloves import DexmoOptions
from hhsim.recordings.dexmo_regression import BEND, LEAST_SPAN, DexmoRegression, read_calibration
from hhsim.system.input_file import read_input_text
from hhsim.system.settings_file import typed

MOST_NORMALISED = 1.5
"""Larger channels are raw counts."""
MOST_COUNT = 4095.0
"""Largest count of a 12-bit sensor."""
MOST_FILE = 4 << 20
"""Largest calibration file [bytes]."""
BENDS = list(BEND)
FAR = (-0.5, 1.5)
"""Range of the normalised bends of a hand; splits are clipped to it."""
Count = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6, description=f"a count, 0 to {MOST_COUNT:.0f}")]
_Counts = msgspec.defstruct("_Counts", [(name, Count) for name in CHANNELS])
_Profile = msgspec.defstruct("_Profile", [("min", _Counts), ("max", _Counts)])


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
    """Read the calibration that a glove's settings name, `.json` of the vendor or `.toml` of ours, or the default.

    The vendor's file holds both hands; its profile is "" where `hand`, "right" or "left", has only one. InputError for
    an unreadable or malformed file, or no such hand or profile in it.
    """
    if not options.calibration:
        return GloveCalibration(DexmoRegression.default())
    path = Path(options.calibration)
    if path.suffix.lower() != ".json":
        found = GloveCalibration(read_calibration(path))
        return _spanned(found.regression, found.regression.open, found.regression.closed) if found.in_counts else found
    where = str(path)
    try:
        # Some files call the little finger so, where the glove's channels have its other name.
        text = read_input_text(path, "utf-8-sig", most=MOST_FILE).replace('"little_', '"pinky_')
        whole = msgspec.json.decode(text)
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not JSON: {error}; expected a calibration of the vendor's server") from None
    sides = {key.lower(): value for key, value in typed(whole, dict[str, Any], where).items()}
    if hand not in sides:
        raise InputError(f"{where}: no {hand.upper()}; it has {', '.join(whole) or 'nothing'}")
    where = f"{where}: {hand.upper()}"
    profiles = typed(sides[hand], dict[str, Any], where)
    if not options.profile and len(profiles) != 1:
        known = ", ".join(map(repr, profiles)) or "them"
        raise InputError(f"{where} has {len(profiles)} profiles: name one of {known}")
    profile = options.profile or next(iter(profiles))
    if profile not in profiles:
        raise InputError(f"{where}: {UnknownNameError('profile', profile, profiles)}")
    where = f"{where}.{profile}"
    ends: Any = typed(profiles[profile], _Profile, where)
    low, high = (np.array(msgspec.structs.astuple(end)) for end in (ends.min, ends.max))
    dead = high - low <= 0.0
    if dead[BENDS].any():
        name = next(CHANNELS[k] for k in BEND if dead[k])
        raise InputError(f"{where}: {name}: min is not below max; expected the counts of a finger that moves")
    base = DexmoRegression.default()
    # A channel without span says nothing: its joints stay at their offset.
    return _spanned(replace(base, slope=np.where(dead, 0.0, base.slope)), low, high)


def _spanned(regression: DexmoRegression, low: FloatArray, high: FloatArray) -> GloveCalibration:
    """Return a calibration with doubts about channels of too narrow a range of counts, or one beyond the sensor's."""
    span = np.abs(high - low)
    doubtful = [
        f"{name} spans {count:.0f} counts of {MOST_COUNT:.0f}: it says little"
        for name, count in zip(CHANNELS, span)
        if count < LEAST_SPAN
    ]
    beyond = [name for name, a, b in zip(CHANNELS, low, high) if min(a, b) < 0.0 or max(a, b) > MOST_COUNT]
    if beyond:
        doubtful.append(f"counts beyond 0 to {MOST_COUNT:.0f}: {', '.join(beyond)}")
    return GloveCalibration(
        regression, tuple(doubtful), tuple(finger for finger, k in enumerate(BEND) if span[k] < LEAST_SPAN)
    )
