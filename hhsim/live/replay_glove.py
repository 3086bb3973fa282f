"""A recorded motion as a glove: its samples, one by one, when their stamps say so; it feels no command."""

import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hhsim.column_map import JOINT_NAMES
from hhsim.errors import InputError
from hhsim.live.glove_device import (
    UNKNOWN,
    Capability,
    DeviceCounters,
    FingerCommand,
    GloveDevice,
    GloveInfo,
)
from hhsim.live.playback import RETURN_TIME

if TYPE_CHECKING:
    from hhsim.live.devices import DeviceConfig


class ReplayGlove(GloveDevice):
    """Gives sample k of a trajectory as sample k, bit for bit, whenever it is read.

    Its channels are the joint angles [rad].

    After the last one, that sample stays and is given on at the usual rate, as by a hand that rests; a motion that is
    repeated begins anew.

    Args:
        config: `playback` is the motion.

    Raises:
        InputError: no motion.
    """

    def __init__(self, config: "DeviceConfig") -> None:
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
        )
        self.counters = DeviceCounters()
        self._next = 0

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; there is nothing to connect to."""

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        now = time.monotonic_ns()
        elapsed = self._playback.elapsed(now)
        count = 0
        while count < len(samples_out):
            index, due = self._due(self._next)
            if due > elapsed:
                break
            self._fill(samples_out[count], index, due, now)
            self._next += 1
            count += 1
        self.counters.frames += count
        self.counters.samples += count
        return count

    def _due(self, number: int) -> tuple[int, float]:
        """Index in the trajectory of the sample of this number, and when it comes [s]."""
        motion = self._playback
        total = motion.stamps.shape[0]
        if number < total:
            return number, float(motion.stamps[number])
        if motion.repeat:
            turn, index = divmod(number, total)
            return index, turn * (motion.duration + RETURN_TIME) + float(motion.stamps[index])
        return total - 1, motion.duration + (number - total + 1) * motion.period

    def _fill(self, sample: np.void, index: int, due: float, now: int) -> None:
        motion = self._playback.trajectory
        sample["seq"] = sample["device_seq"] = self._next
        sample["time_ns"] = now
        sample["device_time_ns"] = round(1e9 * due)
        sample["battery"] = UNKNOWN
        sample["good"] = True
        sample["flexion"] = motion.flexion[index]
        sample["abduction"] = motion.abduction[index]
        sample["channels"] = np.nan
        sample["channels"][:15] = motion.flexion[index].ravel()
        sample["channels"][15:20] = motion.abduction[index]

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; a recording feels nothing."""
        self.counters.commands += 1
        return True

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`."""
        return True

    def reconnect(self) -> bool:
        """See `GloveDevice.reconnect`; a recording never goes away."""
        return True

    def close(self) -> None:
        """See `GloveDevice.close`."""
