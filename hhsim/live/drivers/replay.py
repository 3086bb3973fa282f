"""Recorded motion in the place of a glove: gives each sample at its stamp and ignores commands."""

import math
import time

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.live.device import Capability, DeviceCounters, FingerCommand, GloveDevice, GloveInfo, NothingHeld
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.playback import RETURN_TIME
from hhsim.recordings.column_map import JOINT_NAMES


class ReplayGlove(NothingHeld, GloveDevice):
    """Gives sample k of a trajectory as sample k, bit for bit; its channels are the joint angles [rad].

    After the last one the fingers return to the first within `RETURN_TIME`, at the usual rate and as the palm does, and
    the motion begins anew. InputError without a `playback`.
    """

    def __init__(self, config: GloveConfig) -> None:
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
        """Number of samples between the last one and the first one of the next cycle."""

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`."""

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

    def _fill(self, sample: np.void, before: int, after: int, share: float, due: float, now: int) -> None:
        motion = self._playback.trajectory
        flexion, abduction = motion.flexion[before], motion.abduction[before]
        if share > 0.0:
            flexion = (1.0 - share) * flexion + share * motion.flexion[after]
            abduction = (1.0 - share) * abduction + share * motion.abduction[after]
        channels = np.concatenate([flexion.ravel(), abduction])
        stamps = {"device_time_ns": round(1e9 * due), "device_seq": self._next}
        self._write_sample(sample, now, True, channels, (flexion, abduction), **stamps)

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; the command is counted and ignored."""
        self.counters.commands += 1
        return True
