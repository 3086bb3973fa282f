"""A recorded motion as a glove: its samples, one by one, when their stamps say so; it feels no command."""

import math
import time

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.live.device import (
    UNKNOWN,
    Capability,
    DeviceCounters,
    FingerCommand,
    GloveDevice,
    GloveInfo,
    NothingHeld,
)
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.playback import RETURN_TIME
from hhsim.recordings.column_map import JOINT_NAMES


class ReplayGlove(NothingHeld, GloveDevice):
    """Gives sample k of a trajectory as sample k, bit for bit, whenever it is read.

    Its channels are the joint angles [rad].

    After the last one, that sample stays and is given on at the usual rate, as by a hand that rests. In a motion that
    is repeated the fingers go back to the first one within `RETURN_TIME`, as the palm does.

    Args:
        config: `playback` is the motion.

    Raises:
        InputError: No motion.
    """

    def __init__(self, config: GloveConfig) -> None:
        """Nothing is read yet."""
        if config.playback is None:
            raise InputError("device replay has no motion; expected a trajectory")
        self._playback = config.playback
        motion = config.playback.trajectory
        self.info = GloveInfo(
            name=f"replay of {motion.name or 'a motion'}",
            capabilities=Capability.SPLAY | Capability.JOINTS | Capability.STAMPS,
            channels=JOINT_NAMES,
            hand=motion.hand,
            unit="rad",
            noiseless=True,
        )
        self.counters = DeviceCounters()
        self._next = 0
        self._returning = max(0, math.ceil(RETURN_TIME / config.playback.period) - 1)
        """Samples between the last one and the first one of the next turn."""

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; there is nothing to connect to."""

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        now = time.monotonic_ns()
        elapsed = self._playback.elapsed(now)
        count = 0
        while count < len(samples_out):
            before, after, share, due = self._due(self._next)
            if due > elapsed:
                break
            self._fill(samples_out[count], before, after, share, due, now)
            self._next += 1
            count += 1
        self.counters.frames += count
        self.counters.samples += count
        return count

    def pause(self) -> float:
        """See `GloveDevice.pause`; the next sample is due then."""
        return max(0.0, self._due(self._next)[3] - self._playback.elapsed(time.monotonic_ns()))

    def _due(self, number: int) -> tuple[int, int, float, float]:
        """What the sample of this number is: two samples of the motion, the share of the way from one to the other.

        Last, when it comes [s].
        """
        motion = self._playback
        last = motion.stamps.shape[0] - 1
        turn = 0
        if motion.repeat:
            turn, number = divmod(number, last + 1 + self._returning)
        begun = turn * (motion.duration + RETURN_TIME)
        if number <= last:
            return number, number, 0.0, begun + float(motion.stamps[number])
        waited = (number - last) * motion.period
        due = begun + motion.duration + waited
        return (last, 0, waited / RETURN_TIME, due) if motion.repeat else (last, last, 0.0, due)

    def _fill(self, sample: np.void, before: int, after: int, share: float, due: float, now: int) -> None:
        motion = self._playback.trajectory
        flexion, abduction = motion.flexion[before], motion.abduction[before]
        if share > 0.0:
            flexion = (1.0 - share) * flexion + share * motion.flexion[after]
            abduction = (1.0 - share) * abduction + share * motion.abduction[after]
        sample["seq"] = sample["device_seq"] = self._next
        sample["time_ns"] = now
        sample["device_time_ns"] = round(1e9 * due)
        sample["battery"] = UNKNOWN
        sample["good"] = True
        sample["flexion"] = flexion
        sample["abduction"] = abduction
        sample["channels"] = np.nan
        sample["channels"][:15] = flexion.ravel()
        sample["channels"][15:20] = abduction

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; a recording feels nothing."""
        self.counters.commands += 1
        return True
