"""What a glove is to the loop: samples in; out, for each finger, where it is stopped and what it feels.

A position limit is what most gloves that push back have in common: Dexmo's set point, the curl of OpenGloves and
XR_MNDX_force_feedback_curl are one thing, the bend at which a finger is stopped. Few take a force, in newtons and with
a direction; others shake a finger. `Capability` says which.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields
from enum import Flag, auto
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError

FINGER_COUNT = 5
MOST_CHANNELS = 64
"""Channels of a sample; a glove with fewer leaves the rest NaN."""
UNKNOWN = -1
UNTOLD_SECONDS = 0.0005
"""A glove that does not tell when something has come is looked at this often."""

GLOVE_SAMPLE = np.dtype(
    [
        ("seq", np.int64),
        ("time_ns", np.int64),
        ("handed_ns", np.int64),
        ("device_time_ns", np.int64),
        ("device_seq", np.int64),
        ("battery", np.int64),
        ("good", np.bool_),
        ("channels", np.float64, (MOST_CHANNELS,)),
        ("flexion", np.float64, (FINGER_COUNT, 3)),
        ("abduction", np.float64, (FINGER_COUNT,)),
    ],
    align=True,
)
"""A sample of a glove.

| field | meaning |
|---|---|
| seq | number of the sample since the device was opened, from 0; the driver counts |
| time_ns | CLOCK_MONOTONIC when its bytes were read [ns] |
| handed_ns | right before the driver put it into its ring; drivers of gloves leave that to the one of the session |
| device_time_ns, device_seq | as the device stamped it, -1 where it does not |
| battery | charge [%], -1 where it is not known |
| good | all that the driver uses of it is finite and in range; others are recorded and never used |
| channels | as the device sent them, in the order of `GloveInfo.channels`, the rest NaN |
| flexion, abduction | of the hand [rad] |
"""


class DeviceError(HhsimError):
    """A glove that cannot be reached, or that went away; the message says what to look at."""


class Capability(Flag):
    """What a glove can do."""

    NONE = 0
    POSITION_LIMIT = auto()
    """Takes the bend at which a finger is stopped."""
    STIFFNESS = auto()
    """Takes how hard it is stopped there, 0 (free) to 1."""
    SPLAY = auto()
    """Senses how the fingers are spread."""
    JOINTS = auto()
    """Senses every joint, and not only one bend of a finger."""
    BATTERY = auto()
    """Tells its charge."""
    STAMPS = auto()
    """Stamps its samples."""
    FORCE = auto()
    """Takes the force vector on each fingertip."""
    POWER = auto()
    """Takes how strongly each finger is shaken, 0 to 1."""
    PALM = auto()
    """Tells where the palm is: `GloveDevice.palm`."""


@dataclass(frozen=True)
class GloveInfo:
    """What a driver says of its glove.

    Attributes:
        name: As people call it, with where it is: "dexmo at 127.0.0.1:55555".
        capabilities: What it can do.
        channels: Names of the channels of a sample.
        hand: "right" or "left"; "" where it is not known.
        unit: Of the channels, "" for normalised ones.
        doubtful: Channels whose calibration says little, in words; the loop logs them.
        kept_free: Numbers of the fingers, 0 (thumb) to 4, whose bend says too little to push on; no stiffness for them.
        noiseless: A finger that rests keeps every bit of its samples.
    """

    name: str
    capabilities: Capability
    channels: tuple[str, ...]
    hand: str = ""
    unit: str = ""
    doubtful: tuple[str, ...] = ()
    kept_free: tuple[int, ...] = ()
    noiseless: bool = False


@dataclass
class DeviceCounters:
    """What came from a device and what became of it; every frame is in one of these."""

    frames: int = 0
    """Whole frames, as the device's protocol has them."""
    samples: int = 0
    """Samples of our glove handed on."""
    rejected: int = 0
    """Samples of our glove with values that are not finite or far out of range."""
    other: int = 0
    """Frames or messages for another hand or device, or without hand data."""
    malformed: int = 0
    """Frames that could not be decoded."""
    resyncs: int = 0
    """Times the stream was searched for the next frame, or the connection made anew, since its framing was lost."""
    dropped: int = 0
    """Samples that did not fit where they were to go, or that the device says it sent and that never came."""
    commands: int = 0
    """Commands sent."""
    commands_refused: int = 0
    """Commands that could not be sent at once, since the device does not take them fast enough; not sent later."""


COUNTERS = tuple(item.name for item in fields(DeviceCounters))
"""Names of the counters, in their order."""


@dataclass
class FingerCommand:
    """What the fingers are commanded; written in place, tick by tick.

    Attributes:
        bend: Where each finger is stopped, 0 (flat) to 1 (fist), shape (5,).
        stiffness: How hard, 0 (free) to 1, shape (5,).
        force: What the object does to each phalanx [N], in the frame of the shown hand's palm, shape (5, 3, 3): finger,
            phalanx from the knuckle on, x y z. It comes and goes with the stiffness: by the same ramp, and 0 where that
            is 0. Always 0 for a glove that takes neither FORCE nor POWER.
    """

    bend: FloatArray = field(default_factory=lambda: np.zeros(FINGER_COUNT))
    stiffness: FloatArray = field(default_factory=lambda: np.zeros(FINGER_COUNT))
    force: FloatArray = field(default_factory=lambda: np.zeros((FINGER_COUNT, 3, 3)))


@dataclass
class PalmReading:
    """Where a glove says that the palm is; written in place, sample by sample.

    Attributes:
        came_ns: CLOCK_MONOTONIC when its bytes were read [ns], -1 before the first.
        position: Palm origin [m], shape (3,), in a world with z up whose origin is the tracker's.
        orientation: Unit (w, x, y, z), shape (4,), in that world.
    """

    came_ns: int = -1
    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    orientation: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))


class Calibration(Protocol):
    """What the readings of a glove mean: all that a session asks of it, whatever else a driver does."""

    def bend_lines(self) -> tuple[FloatArray, FloatArray]:
        """Angles of each finger as its bend alone moves them [rad]: slope and offset, each of shape (5, 3)."""


class FingerRelease(ABC):
    """A connection that frees the fingers: what the watchdog needs of a glove. Only `open_for_release` may wait."""

    @abstractmethod
    def open_for_release(self, timeout: float = 5.0) -> None:
        """Connect beside the loop's connection, and take no samples away from it.

        Args:
            timeout: Longest wait [s].

        Raises:
            DeviceError: Nothing there.
        """

    def drain(self) -> None:
        """Throw away what has arrived, so that the device's buffers do not fill.

        Never blocks. Does nothing unless a driver says otherwise.

        Raises:
            DeviceError: The device is gone; `reconnect` may bring it back.
        """
        return

    @abstractmethod
    def release(self, timeout: float = 0.05) -> bool:
        """Stiffness 0 on every finger, now; waits at most `timeout` [s] and never raises. True where it was sent."""

    @abstractmethod
    def reconnect(self) -> bool:
        """After `DeviceError`: try again, without waiting. True where the device is back; call it again until it is.

        Raises:
            DeviceError: It is not back, and it is now known better why; raised once for each loss at most.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of the device; never raises. Does not release: call `release` before."""


class NothingHeld(FingerRelease):
    """Stands for a glove in which no finger can stay held."""

    def open_for_release(self, timeout: float = 5.0) -> None:
        """See `FingerRelease.open_for_release`; there is nothing to connect to."""

    def release(self, timeout: float = 0.05) -> bool:
        """See `FingerRelease.release`."""
        return True

    def reconnect(self) -> bool:
        """See `FingerRelease.reconnect`."""
        return True

    def close(self) -> None:
        """See `FingerRelease.close`."""


class GloveDevice(FingerRelease):
    """A glove. `read`, `send` and `reconnect` never block: commands and samples would come late."""

    info: GloveInfo
    counters: DeviceCounters
    palm: PalmReading | None = None
    """Of a glove that says where the palm is; else None."""
    _seq = 0
    """Of the next sample."""

    @abstractmethod
    def open(self, timeout: float = 5.0) -> None:
        """Connect; `info` is then known.

        Args:
            timeout: Longest wait [s].

        Raises:
            DeviceError: Nothing there, or something that speaks otherwise.
        """

    def open_for_release(self, timeout: float = 5.0) -> None:
        """See `FingerRelease.open_for_release`; the same as `open` unless a driver says otherwise."""
        self.open(timeout)

    @abstractmethod
    def read(self, samples_out: NDArray[np.void]) -> int:
        """Decode all that has arrived.

        Args:
            samples_out: Of `GLOVE_SAMPLE`, oldest first. What does not fit waits for the next call.

        Returns:
            How many samples.

        Raises:
            DeviceError: The device is gone; `reconnect` may bring it back.
        """

    def descriptors(self) -> tuple[int, ...]:
        """What can be waited on for bytes of the glove; () where it is to be looked at again and again."""
        return ()

    def pause(self) -> float:
        """How long nothing can come [s], of a glove without descriptors."""
        return UNTOLD_SECONDS

    def _write_sample(
        self,
        row: np.void,
        now: int,
        good: bool,
        channels: ArrayLike,
        angles: tuple[ArrayLike, ArrayLike],
        **more: int,
    ) -> None:
        """Write the next sample as a row of `GLOVE_SAMPLE`, and count it.

        Args:
            now: When its bytes were read, CLOCK_MONOTONIC [ns].
            good: Whether all that the driver uses of it is finite and in range.
            channels: As many as the glove has.
            angles: Flexion, shape (5, 3), and abduction, shape (5,) [rad].
            more: Fields that this glove knows, of those that are unknown otherwise.
        """
        row["seq"], row["time_ns"], row["good"] = self._seq, now, good
        for name in ("device_time_ns", "device_seq", "battery"):
            row[name] = more.get(name, UNKNOWN)
        row["channels"] = np.nan
        row["channels"][: np.size(channels)] = channels
        row["flexion"], row["abduction"] = angles
        self._seq += 1
        self.counters.samples += good
        self.counters.rejected += not good

    @abstractmethod
    def send(self, command: FingerCommand) -> bool:
        """Tell the fingers; all of it or nothing.

        Returns:
            False where the device takes no more now; a command is never kept to be sent late.

        Raises:
            DeviceError: The device is gone.
        """
