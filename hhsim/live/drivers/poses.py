"""Sources of the palm's pose: one place, keys that move it, a glove that knows it, a motion, a tracker's packets."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.quaternion import conjugate, quaternion, quaternion_product, rotation_vector
from hhsim.live.device import GloveDevice, PalmReading
from hhsim.live.drivers.played import ORIENTATION, POSITION
from hhsim.live.gloves import PoseConfig
from hhsim.live.open_packet import MOST_LOOKED_AT, Kind, UdpPort


def _axes(*pairs: str) -> dict[str, FloatArray]:
    """Return the axis of each key, of the first of a pair the negative one."""
    return {key: sign * np.eye(3)[axis] for axis, pair in enumerate(pairs) for key, sign in zip(pair, (-1.0, 1.0))}


MOVES = _axes("ad", "sw", "fr")
"""Direction of each moving key in the world: x to the right, y away, z up."""
TURNS = _axes("ki", "uo", "lj")
"""Axis of each turning key in the palm frame: fingers down and up, roll, fingers to the right and left."""
HOME, FINER, COARSER = "h", "-", "+"
STOP = ("q", " ", "\x1b", "\x03", "\x04")
"""Keys that end the session: q, space, Escape, Ctrl-C and Ctrl-D."""
HELP = (
    ("a d", "left, right"),
    ("s w", "nearer, away"),
    ("f r", "down, up"),
    ("i k", "fingers up, down"),
    ("j l", "fingers left, right"),
    ("u o", "roll"),
    ("- +", "step"),
    ("h", "home"),
    ("q or space", "free the fingers and end"),
)
"""Keys and their meaning, for the command's help."""
STEPS = (0.5e-3, 1e-3, 2e-3, 5e-3, 10e-3)
"""Steps of a key stroke [m]."""
DEGREES_PER_METRE = 500.0
SPEED = 0.25
"""Largest speed of the palm [m/s]."""
TURNING = 2.0
"""Largest angular velocity of the palm [rad/s]."""
REACH = 1.0
"""Largest distance from the beginning along each axis [m]."""
FARTHEST = 100.0
"""Largest coordinate of a tracker's palm [m]; a larger one was sent in millimetres."""
LEAST_LENGTH = 1e-6
"""Length of a quaternion below which it is no rotation."""
UNIT_WITHIN = 0.1
"""Largest difference of a tracker's quaternion's length from 1."""


Pose = tuple[int, FloatArray, FloatArray]
"""CLOCK_MONOTONIC when it came [ns], -1 for none yet; palm origin [m], shape (3,); unit (w, x, y, z), shape (4,)."""
NO_POSE: Pose = (-1, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


class PoseSource(ABC):
    """Source of the palm's pose in the world frame; `read` never blocks."""

    name: str

    def open(self) -> None:
        """Connect; raises DeviceError if the source cannot be reached."""
        return

    def descriptors(self) -> tuple[int, ...]:
        """File descriptors to poll for a new pose."""
        return ()

    @abstractmethod
    def read(self, now_ns: int) -> Pose:
        """Return the newest pose, all finite; one that cannot age came at `now_ns`, the time of the tick."""

    def close(self) -> None:
        """Disconnect; never raises."""
        return


def make_pose_source(config: PoseConfig, status: Any = None, glove: GloveDevice | None = None) -> PoseSource:
    """Make a source, not yet opened, of a session with a status (record of `LIVE_STATUS`) and a glove.

    InputError for an orientation that is no rotation.
    """
    if config.kind == "replay":
        return ReplayPose(config)
    if config.kind == "udp":
        return UdpPose(config)
    if config.kind == "glove":
        assert glove is not None and glove.palm is not None
        return GlovePose(config, glove.palm)
    return FixedPose(config, status)


class FixedPose(PoseSource):
    """Palm at the pose of its configuration, or where the supervisor's keys have moved it through the status.

    Without a status (record of `LIVE_STATUS`) nothing moves it. InputError for an orientation that is no rotation.
    """

    def __init__(self, config: PoseConfig, status: Any = None) -> None:
        self.name = "fixed pose" if config.kind == "fixed" else config.kind
        length = float(np.linalg.norm(config.orientation))
        if length < LEAST_LENGTH:
            raise InputError(f"orientation {config.orientation}; expected a quaternion other than 0")
        self._pose: tuple[FloatArray, FloatArray] = np.array(config.position), np.array(config.orientation) / length
        self._status, self._seen = status, 0

    def read(self, now_ns: int) -> Pose:
        """See `PoseSource.read`."""
        status = self._status
        version = self._seen if status is None else int(status["pose_version"])
        # Take a pose that is new, whole and finite.
        if version != self._seen and version % 2 == 0:
            pose = status["pose_position"].copy(), status["pose_orientation"].copy()
            if int(status["pose_version"]) == version:
                self._seen = version
                if np.isfinite(np.concatenate(pose)).all():
                    self._pose = pose
        return now_ns, *self._pose


class GlovePose(PoseSource):
    """Palm that begins at the configured position and moves from there as the hand does.

    The orientation is the hand's own: both worlds have the same up.
    """

    name = "pose of the glove"

    def __init__(self, config: PoseConfig, palm: PalmReading) -> None:
        self._palm, self._begin = palm, np.array(config.position)
        self._first: FloatArray | None = None

    def read(self, now_ns: int) -> Pose:
        """See `PoseSource.read`."""
        palm = self._palm
        if palm.came_ns < 0:
            return NO_POSE
        if self._first is None:
            self._first = palm.position.copy()
        return palm.came_ns, self._begin + (palm.position - self._first), palm.orientation


class ReplayPose(PoseSource):
    """Palm of the configuration's `playback`, begun by the first read, linear between samples."""

    def __init__(self, config: PoseConfig) -> None:
        assert config.playback is not None
        self.name = f"replay of {config.playback.trajectory.name or 'a motion'}"
        self._playback = config.playback

    def read(self, now_ns: int) -> Pose:
        """See `PoseSource.read`."""
        row = self._playback.at(self._playback.elapsed(now_ns))
        return now_ns, row[POSITION], row[ORIENTATION] / np.linalg.norm(row[ORIENTATION])


class UdpPose(PoseSource):
    """Newest valid pose sent by the tracker at the configuration's `host` and `port`; it ages while none comes."""

    def __init__(self, config: PoseConfig) -> None:
        self.name = f"udp pose from {config.host} at port {config.port}"
        self._config, self._pose = config, NO_POSE
        self._port: UdpPort | None = None

    def open(self) -> None:
        """See `PoseSource.open`; does not wait for a pose."""
        self._port = UdpPort(self._config.host, self._config.port)

    def descriptors(self) -> tuple[int, ...]:
        """See `PoseSource.descriptors`."""
        return () if self._port is None else (self._port.descriptor,)

    def read(self, now_ns: int) -> Pose:
        """See `PoseSource.read`."""
        for packet, came in () if self._port is None else self._port.read(MOST_LOOKED_AT, [Kind.POSE]):
            values = packet.values.astype(np.float64)
            length = float(np.linalg.norm(values[3:]))
            # NaN compares false.
            if (np.abs(values[:3]) <= FARTHEST).all() and abs(length - 1.0) <= UNIT_WITHIN:
                self._pose = came, values[:3], values[3:] / length
        return self._pose

    def close(self) -> None:
        """See `PoseSource.close`."""
        if self._port is not None:
            self._port.close()
        self._port = None


class PalmKeys:
    """Pose of a palm that keys move, world; begins at `position` [m] and the unit quaternion `orientation`.

    A key moves the palm's target, and the palm glides there no faster than a hand moves. (The paper uses "several keys
    on the keyboard" and names none.)
    """

    def __init__(self, position: ArrayLike, orientation: ArrayLike) -> None:
        self.position: FloatArray = np.array(position, np.float64)
        self.orientation: FloatArray = np.array(orientation, np.float64)
        self._home = (self.position.copy(), self.orientation.copy())
        self._target = (self.position.copy(), self.orientation.copy())
        self._step = 2

    @property
    def step(self) -> float:
        """Step of a key stroke [m]."""
        return STEPS[self._step]

    def press(self, keys: Iterable[str]) -> bool:
        """Apply key strokes in any case up to one that ends the session, and return whether there was one."""
        position, orientation = self._target
        for key in keys:
            key = "+" if key == "=" else key.lower()
            if key in STOP:
                return True
            if key in MOVES:
                moved = position + self.step * MOVES[key]
                position[:] = np.clip(moved, self._home[0] - REACH, self._home[0] + REACH)
            elif key in TURNS:
                turn = math.radians(DEGREES_PER_METRE * self.step) * TURNS[key]
                orientation[:] = quaternion_product(orientation, quaternion(turn))
            elif key == HOME:
                position[:], orientation[:] = self._home
            elif key in (FINER, COARSER):
                self._step = min(max(self._step + (1 if key == COARSER else -1), 0), len(STEPS) - 1)
        return False

    def advance(self, seconds: float) -> bool:
        """Glide towards the target for a time [s], and return whether the palm moved."""
        position, orientation = self._target
        shift = position - self.position
        turn = rotation_vector(quaternion_product(orientation, conjugate(self.orientation)))
        distance, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
        if distance == 0.0 and angle < 1e-12:
            return False
        share = 1.0 if distance <= SPEED * seconds else SPEED * seconds / distance
        self.position[:] = position if share == 1.0 else self.position + share * shift
        if angle <= TURNING * seconds:
            self.orientation[:] = orientation
        else:
            self.orientation[:] = quaternion_product(quaternion(TURNING * seconds / angle * turn), self.orientation)
        return True


def write_keyboard_pose(status: Any, position: ArrayLike, orientation: ArrayLike) -> None:
    """Write the palm's pose, world, that `FixedPose` reads; there is one writer."""
    # Odd while the pose is written; a reader that meets an odd or a changed version tries again in the next tick.
    status["pose_version"] += 1
    status["pose_position"] = position
    status["pose_orientation"] = orientation
    status["pose_version"] += 1
