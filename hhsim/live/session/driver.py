"""Driver of a glove, a thread of the loop's process: glove and palm's pose in, commands out.

It stands below the loop under SCHED_FIFO and decides nothing: it puts each sample into its ring with the time when its
bytes were read, and sends the newest command to the glove, never late. It releases the glove however it ends, short of
a process that is killed outright; then the watchdog does.
"""

import contextlib
import os
import select
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from hhsim.live.device import GLOVE_SAMPLE, DeviceError, FingerCommand, GloveDevice
from hhsim.live.drivers.poses import PoseSource
from hhsim.live.processes import Stage
from hhsim.live.real_time import RealTimeWishes, become_real_time
from hhsim.live.session.memory import SessionMemory
from hhsim.result.safety import Safety
from hhsim.result.schema import FAULT

MOST_SAMPLES = 64
"""Samples read at once."""
RECONNECT_NS = 10_000_000
LOOK_SECONDS = 0.004
"""Longest time between two looks [s]."""
PALM_SECONDS = 0.001
"""The same for a glove without descriptors: a palm that is played moves on meanwhile [s]."""
FLOOD_SECONDS = 0.0005
"""Pause between two looks at an endless stream, so that a flood takes the driver and not the processor [s]."""


class GloveDriver:
    """Carries samples and commands between a glove and the memory of a session; in a `dry_run` it sends nothing.

    Glove and source of the palm's pose are not yet opened. Its lines of the log begin with `whose`. A command is void
    where the loop's heartbeat is older than `oldest_ns`; `now` is the clock, CLOCK_MONOTONIC [ns].
    """

    def __init__(
        self,
        memory: SessionMemory,
        device: GloveDevice,
        pose: PoseSource,
        *,
        whose: str = "",
        dry_run: bool = False,
        oldest_ns: int = 20_000_000,
        now: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.memory = memory
        self.device, self.pose = device, pose
        self._whose, self._dry_run, self._oldest_ns, self._now = whose, dry_run, oldest_ns, now
        self._status = memory.status
        self._command = FingerCommand()
        self._version = memory.status["command_version"]
        self._sent_version = 0
        self._samples = np.zeros(MOST_SAMPLES, GLOVE_SAMPLE)
        self._lost = False
        self._reconnect_ns = 0
        self._empty_looks = 0
        self.begun = threading.Event()
        """Set when the samples from before the loop are in their ring."""
        self.failed = ""

    def open(self) -> None:
        """Connect to glove and source of the pose; raises HhsimError if one cannot be reached."""
        self.pose.open()
        self.device.open()
        self._status["driver_ns"] = self._now()

    def facts(self) -> dict[str, Any]:
        """Return pose and glove as plain values."""
        return {"pose": self.pose.name, "device": asdict(self.device.info)}

    def close(self) -> None:
        """Release the glove, and close the connections."""
        if not self._dry_run and not self.device.release():
            self.memory.log(FAULT, f"{self._whose}the glove could not be told to free the fingers")
        self._status["counters"][:] = self.device.counters.values()
        self.device.close()
        self.pose.close()

    def run(self, wishes: RealTimeWishes, begin: threading.Event) -> None:
        """Carry below a loop from `begin` until it ends, then close; the body of a thread. `failed` says of what."""
        try:
            become_real_time(wishes, above=-1)
            begin.wait()
            self.carry()
        except Exception as error:
            traceback.print_exc()
            self.failed = f"failed: {type(error).__name__}: {error}"
        finally:
            self.close()

    def carry(self) -> None:
        """Carry samples and commands until the loop has ended; earlier samples are taken first."""
        ring = self.memory.samples
        before = -MOST_SAMPLES
        while ring.written - before >= MOST_SAMPLES:
            before = ring.written
            self.take()
        self.begun.set()
        while self._status["stage"] < Stage.ENDING:
            self._wait()
            # The command first: a look for none costs nothing when a sample has come.
            self.give()
            self.take()

    def _wait(self) -> None:
        """Sleep until something comes from glove, tracker or loop, or it is time to look."""
        if self._empty_looks > 1:
            time.sleep(FLOOD_SECONDS)
        sources = () if self._lost else (*self.device.descriptors(), *self.pose.descriptors())
        timeout = LOOK_SECONDS if sources or self._lost else min(self.device.pause(), PALM_SECONDS)
        with contextlib.suppress(OSError, ValueError):
            ready, _, _ = select.select((self.memory.wake, *sources), (), (), timeout)
            if self.memory.wake in ready:
                os.eventfd_read(self.memory.wake)
            self._empty_looks = self._empty_looks + 1 if any(source in ready for source in sources) else 0

    def take(self) -> None:
        """Put the glove's samples into their ring, and the palm's pose into the status."""
        now = self._now()
        status = self._status
        status["driver_ns"] = now
        if not self._lost or self._reconnected(now):
            try:
                count = self.device.read(self._samples)
            except DeviceError as error:
                self.lose(error)
            else:
                self._keep(count)
                if 0 < count < MOST_SAMPLES:
                    self._empty_looks = 0
        came, position, orientation = self.pose.read(now)
        if came >= 0:
            status["palm_version"][0] += 1
            status["palm_position"], status["palm_orientation"], status["palm_ns"] = position, orientation, came
            status["palm_version"][0] += 1
        status["counters"][:] = self.device.counters.values()

    def give(self) -> None:
        """Send the newest command if it was not sent yet."""
        if not self._new_command() or self._dry_run or self._lost:
            return
        if self._now() - int(self._status["heartbeat_ns"]) > self._oldest_ns:
            # The command is too old: the watchdog may have freed the fingers since.
            self._command.stiffness[:] = 0.0
            self._command.force[:] = 0.0
        try:
            self.device.send(self._command)
        except DeviceError as error:
            self.lose(error)

    def lose(self, error: DeviceError) -> None:
        """Tell the loop that the glove is gone, and why."""
        self._lost = True
        self._reconnect_ns = 0
        self.memory.why_lost = str(error)
        self._status["device_lost"] = 1

    def _new_command(self) -> bool:
        version = int(self._version[0])
        # A command that is being written wakes the driver when it is whole.
        if version == self._sent_version or version % 2 == 1:
            return False
        for name in ("bend", "stiffness", "force"):
            getattr(self._command, name)[:] = self._status[f"command_{name}"]
        if int(self._version[0]) != version:
            return False
        self._sent_version = version
        return True

    def _keep(self, count: int) -> None:
        ring = self.memory.samples
        for sample in self._samples[:count]:
            sample["handed_ns"] = self._now()
            ring.records[ring.written % ring.capacity] = sample
            ring.publish()
        if count:
            os.eventfd_write(self.memory.sampled, 1)

    def _reconnected(self, now: int) -> bool:
        # Not before the loop has restarted its ramp: its earlier command must not reach the glove again.
        if now < self._reconnect_ns or not self._status["command_safety"] & int(Safety.DEVICE_LOST):
            return False
        self._reconnect_ns = now + RECONNECT_NS
        with contextlib.suppress(DeviceError):
            self._lost = not self.device.reconnect()
        self._status["device_lost"] = self._lost
        return not self._lost
