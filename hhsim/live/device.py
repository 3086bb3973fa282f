"""Interface of a glove to the loop: samples in, finger commands out.

Most gloves with force feedback take a position limit: Dexmo's set point and XR_MNDX_force_feedback_curl are both the
bend at which a finger is stopped.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError

FINGER_COUNT = 5
MOST_CHANNELS = 64
"""Channels of a sample; unused ones are NaN."""
UNKNOWN = -1
POLL_SECONDS = 0.0005
"""Period at which a glove without descriptors is polled [s]."""

GLOVE_SAMPLE = np.dtype(
    [
        *((name, np.int64) for name in ("seq", "time_ns", "handed_ns", "device_time_ns", "device_seq", "battery")),
        ("good", np.bool_),
        ("channels", np.float64, (MOST_CHANNELS,)),
        ("flexion", np.float64, (FINGER_COUNT, 3)),
        ("abduction", np.float64, (FINGER_COUNT,)),
    ],
    align=True,
)
"""One sample of a glove.

| field | meaning |
|---|---|
| seq | number of the sample since the device was opened, from 0; counted by the driver |
| time_ns | CLOCK_MONOTONIC when its bytes were read [ns] |
| handed_ns | the same when it was put into the ring; set by the session's driver process |
| device_time_ns, device_seq | stamp and number of the device, -1 if it has none |
| battery | charge [%], -1 if unknown |
| good | True if all values that the driver uses are finite and in range; others are recorded and never used |
| channels | as the device sent them, in the order of `GloveInfo.channels`, then NaN |
| flexion, abduction | joint angles of the hand [rad] |
"""

LIMITS, FORCES = ("POSITION_LIMIT", "STIFFNESS"), ("FORCE",)
"""Capabilities of a glove that takes the bend at which a finger is stopped, and how stiffly; or a force vector on each
fingertip."""


class DeviceError(HhsimError):
    """A glove that cannot be reached, or that is gone; the message names what to check."""


@dataclass(frozen=True)
class GloveInfo:
    """A driver's description of its glove."""

    name: str  # name and address for messages: "dexmo at 127.0.0.1:55555"
    channels: tuple[str, ...]  # names of the channels of a sample
    capabilities: tuple[str, ...] = ()  # commands that it takes: `LIMITS`, `FORCES` or none
    hand: str = ""  # "right" or "left"; "" if unknown
    unit: str = ""  # unit of the channels, "" for normalised ones
    doubtful: tuple[str, ...] = ()  # warnings about channels with a poor calibration, for the log
    # Fingers, 0 (thumb) to 4, whose bend is too poorly known to push on; their stiffness stays 0.
    kept_free: tuple[int, ...] = ()
    noiseless: bool = False  # True if the samples of a resting finger are identical


@dataclass
class DeviceCounters:
    """Counts of what came from a device; every frame is in one of them."""

    frames: int = 0  # whole frames of the device's protocol
    samples: int = 0  # good samples of our glove
    rejected: int = 0  # samples of our glove with values that are not finite or far out of range
    other: int = 0  # frames or messages for another hand or device, or without hand data
    malformed: int = 0  # frames that could not be decoded
    resyncs: int = 0  # losses of the framing, after which the stream was searched for the next frame or connected anew
    dropped: int = 0  # samples without space in the output, or numbered ones that came behind a newer one, or never
    commands: int = 0  # commands sent
    commands_refused: int = 0  # commands that the device was too slow to take; they are not sent later

    def values(self) -> list[int]:
        """Return the counts in the order of `COUNTERS`."""
        return [getattr(self, name) for name in COUNTERS]


COUNTERS = tuple(item.name for item in fields(DeviceCounters))
"""Names of the counters, in their order."""


@dataclass
class FingerCommand:
    """Command to the fingers; updated in place, tick by tick."""

    # Bend at which each finger is stopped, 0 (flat) to 1 (fist), shape (5,).
    bend: FloatArray = field(default_factory=lambda: np.zeros(FINGER_COUNT))
    # Stiffness of the stop, 0 (free) to 1, shape (5,).
    stiffness: FloatArray = field(default_factory=lambda: np.zeros(FINGER_COUNT))
    # Force of the object on each phalanx [N], frame of the shown hand's palm, shape (5, 3, 3): finger, phalanx from the
    # knuckle on, x y z. Scaled by the same ramp as the stiffness, 0 where that is 0, and always 0 for a glove that
    # takes no `FORCES`.
    force: FloatArray = field(default_factory=lambda: np.zeros((FINGER_COUNT, 3, 3)))


@dataclass
class PalmReading:
    """Pose of the palm as a glove reports it; updated in place, sample by sample."""

    came_ns: int = -1  # CLOCK_MONOTONIC when its bytes were read [ns], -1 before the first
    # Palm origin [m], shape (3,), in a world with z up and its origin at the tracker's.
    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    # Unit quaternion (w, x, y, z), shape (4,), in that world.
    orientation: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))


class FingerRelease:
    """A connection that frees the fingers: all that the watchdog needs of a glove. Only `open_for_release` may wait.

    As it is, it is that of a glove that cannot hold a finger: there is nothing to connect to.
    """

    def open_for_release(self, timeout: float = 5.0) -> None:
        """Connect beside the loop's connection, taking no samples from it, within `timeout` [s], or DeviceError."""

    def drain(self) -> None:
        """Discard what has arrived, without waiting, so that the device's buffers do not fill.

        DeviceError if the device is gone; `reconnect` may bring it back.
        """

    def release(self, timeout: float = 0.05) -> bool:
        """Send stiffness 0 for every finger, waiting at most `timeout` [s]; never raises. True if it was sent."""
        return True

    def reconnect(self) -> bool:
        """Try once, without waiting, to reconnect after a `DeviceError`; True if the device is back."""
        return True

    def close(self) -> None:
        """Close the connection without releasing the fingers; never raises."""


class GloveDevice(FingerRelease, ABC):
    """A glove. `read`, `send` and `reconnect` never block: commands and samples would come late."""

    info: GloveInfo
    counters: DeviceCounters
    palm: PalmReading | None = None
    """Pose of the palm, for a glove that reports it."""
    _seq = 0

    @abstractmethod
    def open(self, timeout: float = 5.0) -> None:
        """Connect within `timeout` [s]; sets `info`. DeviceError if nothing is there, or another protocol."""

    def open_for_release(self, timeout: float = 5.0) -> None:
        """Connect for release alone; by default the same as `open`."""
        self.open(timeout)

    @abstractmethod
    def read(self, samples_out: NDArray[np.void]) -> int:
        """Decode all that has arrived into `GLOVE_SAMPLE`, oldest first, and return the number of samples.

        What does not fit waits for the next call. DeviceError if the device is gone; `reconnect` may bring it back.
        """

    def descriptors(self) -> tuple[int, ...]:
        """Return file descriptors to poll for the glove's bytes; () if it has to be polled by time."""
        return ()

    def pause(self) -> float:
        """Return the time to the next poll of a glove without descriptors [s]."""
        return POLL_SECONDS

    def _write_sample(
        self, row: np.void, now: int, good: bool, channels: ArrayLike, angles: tuple[ArrayLike, ArrayLike], **more: int
    ) -> None:
        """Write the next sample, flexion (5, 3) and abduction (5,) [rad], into a row of `GLOVE_SAMPLE`, and count it.

        Its bytes were read at `now`; `more` has device_time_ns, device_seq and battery, as far as they are known.
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
        """Send a command, all of it or nothing, never late; False if the device takes no more now.

        DeviceError if the device is gone.
        """

    @abstractmethod
    def release(self, timeout: float = 0.05) -> bool:
        """See `FingerRelease.release`."""
