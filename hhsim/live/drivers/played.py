"""Gloves that need no hardware: a recording in the place of one, and a simulated one; and the motion that they play.

The fingers of a simulated glove obey a position limit. Each follows its user with the lag of a limb. Where it is
stopped, muscle and motor are two springs in opposition: at full stiffness the finger rests beyond the set point by
1/(1 + `MOTOR_STIFFNESS`) of the wanted way. It models a position limit, and no glove that can be bought.
"""

import math
import time

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.live.device import FINGER_COUNT, LIMITS, DeviceCounters, FingerCommand, GloveDevice, GloveInfo
from hhsim.live.gloves import GloveConfig
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.column_map import JOINT_NAMES
from hhsim.recordings.dexmo_regression import DexmoRegression

RETURN_TIME = 1.0
"""Time from the last sample of the motion back to its first one [s]."""
SINGLE_RATE = 200.0
"""Sample rate of a motion of one sample [Hz]."""
ANGLES, POSITION, ORIENTATION = slice(20), slice(20, 23), slice(23, 27)
"""Columns of a row: flexion, finger by finger, and abduction [rad]; palm origin [m]; its quaternion (w, x, y, z)."""
PERIOD = 1.0 / 200.0
"""Time from one sample of the simulated glove to the next [s]."""
MOTOR_STIFFNESS = 20.0
"""Stiffness of the motor at command 1, relative to the user's muscle."""
LIMB_LAG = 0.02
"""Time constant of a finger [s]."""
COUNTS = 2000.0
"""Sensor counts from an open to a closed finger; the noise is one count."""


class Playback:
    """A trajectory on the clock, again and again; one object keeps the fingers and the palm of a motion together.

    Attributes:
        trajectory: The motion.
        duration: Time from its first to its last sample [s].
        cycle: Time after which it begins anew: `duration` and `RETURN_TIME` [s].
        stamps: Times of the rows since the first one [s], shape (n,); the last one is `cycle`.
        rows: Samples of the motion, then those of the way back at the usual rate, and the first sample, shape (n, 27).
    """

    def __init__(self, trajectory: Trajectory) -> None:
        own = self.trajectory = trajectory
        self.duration = own.duration
        self.cycle = self.duration + RETURN_TIME
        samples = np.hstack([own.flexion.reshape(-1, 15), own.abduction, own.position, own.orientation])
        first, last = samples[0].copy(), samples[-1]
        if first[ORIENTATION] @ last[ORIENTATION] < 0.0:
            first[ORIENTATION] *= -1.0
        period = 1.0 / (own.mean_rate or SINGLE_RATE)
        back = period * np.arange(1, math.ceil(RETURN_TIME / period))
        self.stamps = np.concatenate([own.time - own.time[0], self.duration + back, [self.cycle]])
        share = back[:, None] / RETURN_TIME
        self.rows = np.concatenate([samples, (1.0 - share) * last + share * first, [first]])
        self._start_ns = -1

    def elapsed(self, now_ns: int) -> float:
        """Return the time since the motion began [s], never negative; the first call begins it."""
        if self._start_ns < 0:
            self._start_ns = now_ns
        return max(0.0, 1e-9 * (now_ns - self._start_ns))

    def at(self, elapsed: float) -> FloatArray:
        """Return the row at a time [s], linear between two."""
        elapsed %= self.cycle
        after = int(np.searchsorted(self.stamps, elapsed, side="right"))
        share = (elapsed - self.stamps[after - 1]) / (self.stamps[after] - self.stamps[after - 1])
        return np.asarray((1.0 - share) * self.rows[after - 1] + share * self.rows[after])


class ReplayGlove(GloveDevice):
    """Gives row k of a playback as sample k, bit for bit, at its stamp; its channels are the joint angles [rad].

    Commands are counted and ignored.
    """

    def __init__(self, config: GloveConfig) -> None:
        assert config.playback is not None
        self._playback: Playback = config.playback
        motion = config.playback.trajectory
        name = f"replay of {motion.name or 'a motion'}"
        self.info = GloveInfo(name, JOINT_NAMES, hand=motion.hand, unit="rad", noiseless=True)
        self.counters = DeviceCounters()

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`."""

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        now = time.monotonic_ns()
        elapsed = self._playback.elapsed(now)
        for count, row in enumerate(samples_out):
            if self._due() > elapsed:
                return count
            stamps = {"device_time_ns": round(1e9 * self._due()), "device_seq": self._seq}
            channels, angles = self._sample()
            self._write_sample(row, now, True, channels, (angles[:15].reshape(5, 3), angles[15:]), **stamps)
            self.counters.frames += 1
        return len(samples_out)

    def pause(self) -> float:
        """See `GloveDevice.pause`."""
        return max(0.0, self._due() - self._playback.elapsed(time.monotonic_ns()))

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`."""
        self.counters.commands += 1
        return True

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`."""
        return True

    def _due(self) -> float:
        """Return the time of the next sample since the motion began [s]."""
        cycle, row = divmod(self._seq, len(self._playback.rows) - 1)
        return cycle * self._playback.cycle + float(self._playback.stamps[row])

    def _sample(self) -> tuple[FloatArray, FloatArray]:
        """Return channels, and angles (20,) [rad], of the next sample."""
        angles = self._playback.rows[self._seq % (len(self._playback.rows) - 1), ANGLES]
        return angles, angles


class SimGlove(ReplayGlove):
    """Simulated glove on a user who makes the motion of a playback; its channels are the bends of the fingers.

    Each sample follows from the seed, the motion and the commands before it, not from the time at which it is read.
    """

    def __init__(self, config: GloveConfig) -> None:
        super().__init__(config)
        self._regression = DexmoRegression.default()
        self._slope, _ = self._regression.bend_lines()
        self._follow = 1.0 - math.exp(-PERIOD / LIMB_LAG)
        self._random = np.random.default_rng(config.seed)
        self._limit, self._stiffness, self._held_back = (np.zeros(FINGER_COUNT) for _ in range(3))
        self.info = GloveInfo("simulated glove", tuple(f"{finger}_bend" for finger in FINGERS), LIMITS, config.hand)

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`."""
        self._limit[:] = command.bend
        self._stiffness[:] = np.clip(command.stiffness, 0.0, 1.0)
        return super().send(command)

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`."""
        self._stiffness[:] = 0.0
        return True

    def _due(self) -> float:
        return self._seq * PERIOD

    def _sample(self) -> tuple[FloatArray, FloatArray]:
        angles = self._playback.at(self._due())[ANGLES]
        bend = self._regression.bends(angles[:15].reshape(5, 3))
        motor = MOTOR_STIFFNESS * self._stiffness
        beyond = np.maximum(0.0, bend - self._limit)
        self._held_back += self._follow * (beyond * motor / (1.0 + motor) - self._held_back)
        noise = np.round(self._random.standard_normal(FINGER_COUNT))
        felt = (np.round(COUNTS * (bend - self._held_back)) + noise) / COUNTS
        angles[:15] += ((felt - bend)[:, None] * self._slope).ravel()
        return felt, angles
