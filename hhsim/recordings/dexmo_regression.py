"""Linear regression from the eleven channels of a Dexmo glove to the twenty joint angles of the hand.

The glove senses the metacarpophalangeal joints alone: rotate, split and bend of the thumb, split and bend of the other
fingers. Every angle is an offset plus a slope for each channel (Gu et al., "Dexmo", CHI 2016). The coefficients of that
work are not public. The default is an assumption: a fist bends the fingers by 85°, 100° and two thirds of that for the
last joint (Rijpkema & Girard 1991).

Channels are normalised: 0 is the flat hand with the fingers together, 1 the fist for bend, spread for split, opposed
for rotate. A TOML file calibrates raw counts::

    [channel]                        # readings at 0 and at 1; without them the channels are normalised
    index_bend = { open = 812.0, closed = 3166.0 }

    [angle]
    unit = "deg"                     # default rad

    [joint]                          # only what differs from the default
    index_flex2 = { offset = 2.0, index_bend = 98.0 }   # angle = offset + Σ slope · channel
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Self

import numpy as np
from msgspec import field
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.fingers import FINGERS
from hhsim.recordings.column_map import JOINT_NAMES, AngleUnit, Joint
from hhsim.recordings.unit_detection import ANGLE_UNITS
from hhsim.system.settings_file import Settings, between, one_of, read_settings

CHANNELS = ("thumb_rotate",) + tuple(f"{finger}_{kind}" for finger in FINGERS for kind in ("split", "bend"))
"""Channels in the glove's order; its pinky is the little finger."""
BEND = [CHANNELS.index(f"{finger}_bend") for finger in FINGERS]

DEFAULT_DEGREES: dict[str, dict[str, float]] = {
    "thumb_flex1": {"thumb_bend": 20.0, "thumb_split": -15.0},
    "thumb_flex2": {"thumb_bend": 50.0},
    "thumb_flex3": {"thumb_bend": 70.0},
    **{f"{finger}_flex1": {f"{finger}_bend": 85.0} for finger in FINGERS[1:]},
    **{f"{finger}_flex2": {f"{finger}_bend": 100.0} for finger in FINGERS[1:]},
    **{f"{finger}_flex3": {f"{finger}_bend": 100.0 * 2.0 / 3.0} for finger in FINGERS[1:]},
    "thumb_abd": {"offset": -10.0, "thumb_rotate": 45.0},
    "index_abd": {"index_split": 15.0},
    "middle_abd": {"middle_split": 5.0},
    "ring_abd": {"ring_split": -10.0},
    "little_abd": {"little_split": -20.0},
}
"""Default regression [degrees]; positive abduction turns towards the thumb side."""

Channel = Annotated[str, one_of(CHANNELS)]
Term = Annotated[str, one_of(("offset", *CHANNELS))]
Reading = Annotated[float, between(-1e6, 1e6)]
"""Value of a reading or an angle in a calibration."""
LEAST_SPAN = 100.0
"""Smallest usual span of a channel of raw counts between its two poses."""
MOST_NORMALISED, MOST_COUNT = 1.5, 4095.0
"""Largest magnitude of a channel that is no raw count, and the largest count of a 12-bit sensor."""
LEAST_OF_HAND, MOST_OF_HAND = -0.5, 1.5
"""Range of the normalised bends of a hand; splits are clipped to it."""


@dataclass(frozen=True, eq=False)
class DexmoRegression:
    """Calibration of the glove."""

    open: FloatArray  # reading of each channel at 0, shape (11,)
    closed: FloatArray  # the same at 1
    # Angle of each joint for each normalised channel [rad], shape (20, 11); joints as in `JOINT_NAMES`.
    slope: FloatArray
    offset: FloatArray  # angle of each joint where all channels are 0 [rad], shape (20,)

    @classmethod
    def default(cls, joints: Mapping[str, Mapping[str, float]] = MappingProxyType({})) -> Self:
        """Return the default regression for normalised channels, but for the terms of these joints.

        A term is "offset" or a channel [rad].
        """
        usual = {
            joint: {key: np.radians(term) for key, term in terms.items()} for joint, terms in DEFAULT_DEGREES.items()
        }
        terms = [(usual | dict(joints))[joint] for joint in JOINT_NAMES]
        slope = np.array([[each.get(channel, 0.0) for channel in CHANNELS] for each in terms])
        offset = np.array([each.get("offset", 0.0) for each in terms])
        return cls(np.zeros(len(CHANNELS)), np.ones(len(CHANNELS)), slope, offset)

    @property
    def in_counts(self) -> bool:
        """True if the readings are raw counts, not numbers from 0 to 1."""
        return bool(np.abs(self.closed - self.open).max() > MOST_NORMALISED)

    def doubtful(self) -> tuple[tuple[str, ...], tuple[int, ...]]:
        """Return messages about channels of counts with too small a range, or one beyond the sensor's.

        Returned besides are the numbers of the fingers whose bend has too small a range to push on.
        """
        if not self.in_counts:
            return (), ()
        span = np.abs(self.closed - self.open)
        doubtful = [
            f"{name} spans {count:.0f} counts of {MOST_COUNT:.0f}: it says little"
            for name, count in zip(CHANNELS, span)
            if count < LEAST_SPAN
        ]
        ends = zip(CHANNELS, self.open, self.closed)
        beyond = [name for name, a, b in ends if min(a, b) < 0.0 or max(a, b) > MOST_COUNT]
        if beyond:
            doubtful.append(f"counts beyond 0 to {MOST_COUNT:.0f}: {', '.join(beyond)}")
        return tuple(doubtful), tuple(finger for finger, k in enumerate(BEND) if span[k] < LEAST_SPAN)

    def normalised(self, readings: ArrayLike) -> FloatArray:
        """Return normalised channels, outside 0 to 1 where the hand exceeds its two poses; shape (…, 11)."""
        return np.asarray((np.asarray(readings, np.float64) - self.open) / (self.closed - self.open))

    def angles(self, readings: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Compute flexion (…, 5, 3) and abduction (…, 5) [rad] from readings of the channels, shape (…, 11)."""
        whole = self.normalised(readings) @ self.slope.T + self.offset
        return whole[..., :15].reshape(*whole.shape[:-1], 5, 3), whole[..., 15:]

    def hand_angles(self, readings: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return `angles` of finite readings (11,), with splits clipped; None beyond a hand's range.

        So are numbers from 0 to 1 where the calibration is for counts, and counts where it is not.
        """
        normalised = self.normalised(readings)
        if not all(LEAST_OF_HAND <= bend <= MOST_OF_HAND for bend in normalised[BEND].tolist()):
            return None
        if self.in_counts and np.abs(readings).max() <= MOST_NORMALISED:
            return None
        angles = self.slope @ np.minimum(np.maximum(normalised, LEAST_OF_HAND), MOST_OF_HAND) + self.offset
        return angles[:15].reshape(5, 3), angles[15:]

    def bend_lines(self) -> tuple[FloatArray, FloatArray]:
        """Return slope and offset of each finger's angles as functions of its bend [rad], each of shape (5, 3)."""
        slope = np.stack([self.slope[3 * f : 3 * f + 3, BEND[f]] for f in range(len(FINGERS))])
        return slope, self.offset[:15].reshape(len(FINGERS), 3).copy()

    def bends(self, flexion: ArrayLike) -> FloatArray:
        """Compute the normalised bend of each finger that fits its flexion [rad] best, shape (…, 5, 3) to (…, 5).

        It is the position limit for the glove; the other channels are taken as 0.
        """
        slope, offset = self.bend_lines()
        given = np.asarray(flexion, np.float64) - offset
        size = (slope * slope).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            bend = (given * slope).sum(axis=-1) / size
        return np.asarray(np.clip(np.where(size > 0.0, bend, 0.0), 0.0, 1.0))


def read_calibration(path: Path) -> DexmoRegression:
    """Read a calibration from a TOML file; joints that it lacks keep their default.

    Raises InputError for a missing file, no TOML, or a wrong key or value.
    """
    table = read_settings(path, _CalibrationTable, "calibration")
    factor = ANGLE_UNITS[table.angle.unit or "rad"]
    joints = {name: {key: factor * term for key, term in terms.items()} for name, terms in table.joint.items()}
    found = DexmoRegression.default(joints)
    if not table.channel:
        return found
    low, high = np.array([[table.channel[name].open, table.channel[name].closed] for name in CHANNELS]).T
    return replace(found, open=low, closed=high)


class _Ends(Settings, frozen=True):
    """Readings of a channel at 0 and at 1."""

    open: Reading
    closed: Reading

    def check(self) -> None:
        if self.open == self.closed:
            raise InputError(f"open and closed are both {self.open:g}; expected two readings")


class _CalibrationTable(Settings, frozen=True):
    channel: dict[Channel, _Ends] = field(default_factory=dict)
    angle: AngleUnit = AngleUnit()
    joint: dict[Joint, dict[Term, Reading]] = field(default_factory=dict)

    def check(self) -> None:
        missing = [name for name in CHANNELS if name not in self.channel]
        if self.channel and missing:
            raise InputError(f"channel.{missing[0]} is missing; expected all {len(CHANNELS)} channels, or none")
