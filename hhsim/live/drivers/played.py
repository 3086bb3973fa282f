"""Gloves that need no hardware: a simulated one, and a recording in the place of one.

The fingers of a simulated glove obey a position limit. Each follows its user with the lag of a limb. Where it is
stopped, muscle and motor are two springs in opposition: at full stiffness the finger rests beyond the set point by
1/(1 + `MOTOR_STIFFNESS`) of the wanted way. It models a position limit, and no glove that can be bought.
"""

import math
import time

import numpy as np
from numpy.typing import NDArray

from hhsim.hand.fingers import FINGERS
from hhsim.live.device import FINGER_COUNT, LIMITS, DeviceCounters, FingerCommand, GloveDevice, GloveInfo
from hhsim.live.gloves import GloveConfig
from hhsim.live.playback import RETURN_TIME
from hhsim.recordings.column_map import JOINT_NAMES
from hhsim.recordings.dexmo_regression import BEND, DexmoRegression

PERIOD = 1.0 / 200.0
"""Time from one sample of the simulated glove to the next [s]."""
MOTOR_STIFFNESS = 20.0
"""Stiffness of the motor at command 1, relative to the user's muscle."""
LIMB_LAG = 0.02
"""Time constant of a finger [s]."""
COUNTS = 2000.0
"""Sensor counts from an open to a closed finger; the noise is one count."""
CLOSED = 0.7
"""Largest bend of fingers without a motion."""
LONGEST_PAUSE = 1.0
"""Time without a read after which samples are dropped [s]."""


class ReplayGlove(GloveDevice):
    """Gives sample k of a trajectory as sample k, bit for bit, at its stamp; its channels are the joint angles [rad].

    After the last one the fingers return to the first within `RETURN_TIME`, at the usual rate and as the palm does, and
    the motion begins anew. Commands are counted and ignored.
    """

    def __init__(self, config: GloveConfig) -> None:
        assert config.playback is not None
        self._playback = config.playback
        motion = config.playback.trajectory
        name = f"replay of {motion.name or 'a motion'}"
        self.info = GloveInfo(name, JOINT_NAMES, hand=motion.hand, unit="rad", noiseless=True)
        self.counters = DeviceCounters()
        self._next = 0
        self._returning = max(0, math.ceil(RETURN_TIME / config.playback.period) - 1)
        """Number of samples between the last one and the first one of the next cycle."""

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`."""

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        now = time.monotonic_ns()
        elapsed = self._playback.elapsed(now)
        count = 0
        while count < len(samples_out) and (due := self._due(self._next))[3] <= elapsed:
            flexion, abduction = self._playback.fingers(*due[:3])
            stamps = {"device_time_ns": round(1e9 * due[3]), "device_seq": self._next}
            channels = np.concatenate([flexion.ravel(), abduction])
            self._write_sample(samples_out[count], now, True, channels, (flexion, abduction), **stamps)
            self._next += 1
            count += 1
        self.counters.frames += count
        return count

    def pause(self) -> float:
        """See `GloveDevice.pause`."""
        return max(0.0, self._due(self._next)[3] - self._playback.elapsed(time.monotonic_ns()))

    def _due(self, number: int) -> tuple[int, int, float, float]:
        """Return two samples of the motion, the weight of the second, and the time at which sample `number` comes."""
        motion = self._playback
        last = motion.stamps.shape[0] - 1
        cycle, number = divmod(number, last + 1 + self._returning)
        begun = cycle * (motion.duration + RETURN_TIME)
        if number <= last:
            return number, number, 0.0, begun + float(motion.stamps[number])
        waited = (number - last) * motion.period
        return last, 0, waited / RETURN_TIME, begun + motion.duration + waited

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`."""
        self.counters.commands += 1
        return True

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`."""
        return True


class SimGlove(GloveDevice):
    """Simulated glove whose channels are the bends of the fingers.

    Its fingers make the motion of the `playback`, else open and close as the seed says. Each sample follows from the
    seed, the motion and the commands before it, not from the time at which it is read.
    """

    def __init__(self, config: GloveConfig) -> None:
        self._regression = DexmoRegression.default()
        self._slope, _ = self._regression.bend_lines()
        self._playback = config.playback
        self._follow = 1.0 - math.exp(-PERIOD / LIMB_LAG)
        self._random = np.random.default_rng(config.seed)
        self._cycle = self._random.uniform(1.6, 2.4, FINGER_COUNT)
        self._limit, self._stiffness, self._held_back = (np.zeros(FINGER_COUNT) for _ in range(3))
        self._start_ns = -1
        self._next = 0
        channels = tuple(f"{finger}_bend" for finger in FINGERS)
        self.info = GloveInfo("simulated glove", channels, LIMITS, hand=config.hand)
        self.counters = DeviceCounters()

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`."""

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        now = time.monotonic_ns()
        if self._start_ns < 0:
            # Fingers and palm of one motion begin together.
            self._start_ns = now if self._playback is None else now - round(1e9 * self._playback.elapsed(now))
        elapsed = 1e-9 * (now - self._start_ns)
        late = int((elapsed - LONGEST_PAUSE) / PERIOD)
        if late > self._next:
            self.counters.dropped += late - self._next
            self._next = late
        count = 0
        while count < len(samples_out) and self._next * PERIOD <= elapsed:
            self._fill(samples_out[count], now)
            self._next += 1
            count += 1
        self.counters.frames += count
        return count

    def pause(self) -> float:
        """See `GloveDevice.pause`."""
        return max(0.0, self._next * PERIOD - 1e-9 * (time.monotonic_ns() - self._start_ns))

    def _fill(self, sample: np.void, now: int) -> None:
        elapsed = self._next * PERIOD
        if self._playback is not None:
            flexion, abduction = self._playback.fingers(*self._playback.place(elapsed))
        else:
            channels = np.zeros(11)
            channels[list(BEND)] = 0.5 * CLOSED * (1.0 - np.cos(2.0 * np.pi * elapsed / self._cycle))
            flexion, abduction = self._regression.angles(channels)
        bend = self._regression.bends(flexion)
        motor = MOTOR_STIFFNESS * self._stiffness
        beyond = np.maximum(0.0, bend - self._limit)
        self._held_back += self._follow * (beyond * motor / (1.0 + motor) - self._held_back)
        counts = np.round(self._random.standard_normal(FINGER_COUNT))
        felt = np.round(COUNTS * (bend - self._held_back)) + counts
        angles = flexion + (felt / COUNTS - bend)[:, None] * self._slope, abduction
        stamp = round(1e9 * elapsed)
        self._write_sample(sample, now, True, felt / COUNTS, angles, device_time_ns=stamp, device_seq=self._next)

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`."""
        self._limit[:] = command.bend
        self._stiffness[:] = np.clip(command.stiffness, 0.0, 1.0)
        self.counters.commands += 1
        return True

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`."""
        self._stiffness[:] = 0.0
        return True
