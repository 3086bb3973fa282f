"""Calibration of a live glove: the vendor's JSON of profiles, or our TOML (`hhsim.recordings.dexmo_regression`).

The vendor's server keeps raw 12-bit counts of the open and the closed hand, in named profiles::

    {"RIGHT": {"anna": {"max": {"thumb_bend": 3166, …}, "min": {"thumb_bend": 712, …}}}, "LEFT": {…}}

It sends channels already normalised to 0 to 1, so its counts are used only where a server sends counts.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, UnknownNameError
from hhsim.live.devices.registry import ServedOptions
from hhsim.live.link.dexmo_codec import CHANNELS
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
Count = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6, description=f"a count, 0 to {MOST_COUNT:.0f}")]
_COUNTS = msgspec.defstruct("_COUNTS", [(name, Count) for name in CHANNELS])
FAR = (-0.5, 1.5)
"""Range of the normalised bends of a hand; splits are clipped to it."""


@dataclass(frozen=True, eq=False)
class GloveCalibration:
    """Calibration of a live glove."""

    regression: DexmoRegression  # from the channels that the glove sends to joint angles
    # Regression for raw counts; None where the counts of the open and the closed hand are unknown.
    counts: DexmoRegression | None = None
    doubtful: tuple[str, ...] = ()  # messages about channels of too small a span
    kept_free: tuple[int, ...] = ()  # numbers of the fingers whose bend has too small a span to push on
    name: str = ""  # source, for messages; "" for the default

    @property
    def counted(self) -> bool:
        """True if the regression is for raw counts."""
        return self.regression is self.counts

    @property
    def in_counts(self) -> bool:
        """True if the calibrated range of the regression is in raw counts."""
        return bool(np.abs(self.regression.closed - self.regression.open).max() > MOST_NORMALISED)

    def fitting(self, channels: Sequence[float]) -> "GloveCalibration":
        """Return the calibration for a glove that sends these channels, finite, shape (11,); InputError if none is."""
        most = max(abs(value) for value in channels)
        if most > MOST_NORMALISED:
            if self.counts is None:
                raise InputError(
                    f"the glove sends raw counts (up to {most:g}): expected 0 to 1, or a calibration with the counts "
                    "of the open and of the closed hand"
                )
            return replace(self, regression=self.counts)
        if self.in_counts:
            raise InputError(
                f"{self.name}: its [channel] ends are raw counts, but the glove sends 0 to 1: "
                "expected a calibration without [channel]"
            )
        return self

    def bend_lines(self) -> tuple[FloatArray, FloatArray]:
        """See `hhsim.live.device.Calibration`."""
        return self.regression.bend_lines()

    def bend_ends(self) -> tuple[FloatArray, FloatArray]:
        """Return the readings of the bends in the flat hand and in the fist, each of shape (5,)."""
        return self.regression.open[BENDS], self.regression.closed[BENDS]

    def angles(self, readings: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return flexion (5, 3) and abduction (5,) [rad] of finite readings (11,); None beyond a hand's range."""
        normalised = self.regression.normalised(readings)
        least, most = FAR
        if not all(least <= bend <= most for bend in normalised[BENDS].tolist()):
            return None
        angles = self.regression.slope @ np.minimum(np.maximum(normalised, least), most) + self.regression.offset
        return angles[:15].reshape(5, 3), angles[15:]

    def readings(self, bends: FloatArray) -> FloatArray:
        """Return all channels (11,) from bends (5,); the others are at rest."""
        found = self.regression.open.copy()
        found[BENDS] = bends
        return found


def glove_calibration(options: ServedOptions, hand: str) -> GloveCalibration:
    """Read the calibration that a glove's settings name, `.json` of the vendor or `.toml` of ours, or the default.

    The vendor's file holds both hands; its profile is "" where `hand`, "right" or "left", has only one. InputError for
    an unreadable or malformed file, or no such hand or profile in it.
    """
    if not options.calibration:
        return GloveCalibration(DexmoRegression.default())
    path = Path(options.calibration)
    if path.suffix.lower() == ".json":
        return _parse_vendor(path, hand, options.profile)
    regression = read_calibration(path)
    found = GloveCalibration(regression, name=str(path))
    if found.in_counts:
        low, high = regression.open, regression.closed
        return replace(found, counts=regression, doubtful=_narrow(low, high), kept_free=_kept_free(low, high))
    return found


def _parse_vendor(path: Path, hand: str, profile: str) -> GloveCalibration:
    where = str(path)
    try:
        whole = json.loads(read_input_text(path, "utf-8-sig", most=MOST_FILE))
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError:
        raise InputError(f"{where}: not a text file; expected a calibration of the vendor's server") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not JSON: {error}") from None
    sides = {key.lower(): value for key, value in typed(whole, dict[str, Any], where).items()}
    if hand not in sides:
        raise InputError(f"{where}: no {hand.upper()}; it has {', '.join(whole) or 'nothing'}")
    where = f"{where}: {hand.upper()}"
    profiles = typed(sides[hand], dict[str, Any], where)
    if not profile:
        if len(profiles) != 1:
            raise InputError(
                f"{where} has {len(profiles)} profiles: name one of {', '.join(map(repr, profiles)) or 'them'}"
            )
        profile = next(iter(profiles))
    if profile not in profiles:
        raise InputError(f"{where}: {UnknownNameError('profile', profile, profiles)}")
    where = f"{where}.{profile}"
    ends = typed(profiles[profile], _Profile, where)
    low, high = (_ends(f"{where}.{key}", getattr(ends, key)) for key in ("min", "max"))
    base = DexmoRegression.default()
    dead = high - low <= 0.0
    if dead[BENDS].any():
        name = next(CHANNELS[k] for k in BEND if dead[k])
        raise InputError(f"{where}: {name}: min is not below max; expected the counts of a finger that moves")
    hints = _narrow(low, high)
    beyond = [name for name, a, b in zip(CHANNELS, low, high) if a < 0.0 or b > MOST_COUNT]
    if beyond:
        hints += (f"counts beyond 0 to {MOST_COUNT:.0f}: {', '.join(beyond)}",)
    # A channel without span would divide by zero: its joints stay at their offset.
    slope = np.where(dead, 0.0, base.slope)
    counts = replace(base, open=low, closed=np.where(dead, low + 1.0, high), slope=slope)
    return GloveCalibration(replace(base, slope=slope), counts, hints, _kept_free(low, high), where)


def _narrow(low: FloatArray, high: FloatArray) -> tuple[str, ...]:
    return tuple(
        f"{name} spans {abs(b - a):.0f} counts of {MOST_COUNT:.0f}: it says little"
        for name, a, b in zip(CHANNELS, low, high)
        if abs(b - a) < LEAST_SPAN
    )


def _kept_free(low: FloatArray, high: FloatArray) -> tuple[int, ...]:
    return tuple(finger for finger, k in enumerate(BEND) if abs(high[k] - low[k]) < LEAST_SPAN)


def _ends(where: str, counts: dict[str, Any]) -> FloatArray:
    """Return the counts of all channels; other keys are ignored."""
    named = {key.replace("little_", "pinky_"): count for key, count in counts.items()}
    return np.array(msgspec.structs.astuple(typed(named, _COUNTS, where)))


class _Profile(msgspec.Struct):
    min: dict[str, Any]
    max: dict[str, Any]
