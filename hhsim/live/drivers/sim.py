"""Simulated glove: a virtual user whose fingers obey the position limit.

Each finger follows its user with the lag of a limb. Where it is stopped, muscle and motor are two springs in
opposition: at full stiffness the finger rests beyond the set point by 1/(1 + `MOTOR_STIFFNESS`) of the wanted way. It
models a position limit, and no glove that can be bought.
"""

import math
import time

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.live import device
from hhsim.live.device import FINGER_COUNT, Capability, GloveDevice, NothingHeld
from hhsim.live.devices.registry import GloveConfig
from hhsim.recordings.dexmo_regression import BEND, DexmoRegression

PERIOD = 1.0 / 200.0
"""Time from one sample to the next [s]."""
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


class SimGlove(NothingHeld, GloveDevice):
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
        self._limit = np.zeros(FINGER_COUNT)
        self._stiffness = np.zeros(FINGER_COUNT)
        self._held_back = np.zeros(FINGER_COUNT)
        self._start_ns = -1
        self._next = 0
        self.info = device.GloveInfo(
            name="simulated glove",
            capabilities=Capability.POSITION_LIMIT | Capability.STIFFNESS | Capability.JOINTS | Capability.STAMPS,
            channels=tuple(f"{finger}_bend" for finger in ("thumb", "index", "middle", "ring", "little")),
            hand=config.hand,
        )
        self.counters = device.DeviceCounters()

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
        flexion, abduction = self._wanted(self._next * PERIOD)
        bend = self._regression.bends(flexion)
        motor = MOTOR_STIFFNESS * self._stiffness
        beyond = np.maximum(0.0, bend - self._limit)
        self._held_back += self._follow * (beyond * motor / (1.0 + motor) - self._held_back)
        counts = np.round(self._random.standard_normal(FINGER_COUNT))
        felt = np.round(COUNTS * (bend - self._held_back)) + counts
        angles = flexion + (felt / COUNTS - bend)[:, None] * self._slope, abduction
        stamp = round(1e9 * self._next * PERIOD)
        self._write_sample(sample, now, True, felt / COUNTS, angles, device_time_ns=stamp, device_seq=self._next)

    def _wanted(self, elapsed: float) -> tuple[FloatArray, FloatArray]:
        """Return flexion (5, 3) and abduction (5,) [rad] of the user without a motor."""
        if self._playback is not None:
            motion = self._playback.trajectory
            before, after, share = self._playback.place(elapsed)
            flexion = (1.0 - share) * motion.flexion[before] + share * motion.flexion[after]
            return flexion, (1.0 - share) * motion.abduction[before] + share * motion.abduction[after]
        bend = 0.5 * CLOSED * (1.0 - np.cos(2.0 * np.pi * elapsed / self._cycle))
        channels = np.zeros(11)
        channels[list(BEND)] = bend
        return self._regression.angles(channels)

    def send(self, command: device.FingerCommand) -> bool:
        """See `GloveDevice.send`."""
        self._limit[:] = command.bend
        self._stiffness[:] = np.clip(command.stiffness, 0.0, 1.0)
        self.counters.commands += 1
        return True

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`."""
        self._stiffness[:] = 0.0
        return True
