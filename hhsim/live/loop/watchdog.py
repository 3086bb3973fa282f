"""Process of the watchdog: frees the fingers when the loop cannot; `python -m hhsim.live.loop.watchdog --setup FD`.

It has its own connection to the glove, stands above the loop under SCHED_FIFO, and watches the loop's heartbeat and the
end of its process. The heartbeat is usually quicker: a process with much locked memory takes time to end. While either
fails it frees the fingers every 20 ms. It does not end before the loop has, whatever signal it gets, and releases a
session that has ended once more.

Of two gloves in one session it has a connection to each, and frees those whose driver has failed, or both where the
loop has. That a fault of one hand frees the other one is the loop's task.

It imports little: its own setup, the status block, and the part of the glove's driver that connects.
"""

import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from types import FrameType

from hhsim.live.device import DeviceError, FingerRelease
from hhsim.live.devices.registry import open_release
from hhsim.live.ipc.status import LIVE_STATUS, LoopProcess, Stage, WatchdogSetup
from hhsim.live.real_time import become_ordinary, become_real_time, keep_off
from hhsim.live.shared_memory import SharedBlock, process_setup

WATCH_SECONDS = 0.004
"""Longest time between two looks [s]."""
RELEASE_NS = 20_000_000
"""Time between two releases while the loop fails [ns]."""
CONNECT_NS = 250_000_000
"""Time between two tries to reach the glove [ns]."""
LAST_WORDS_NS = 200_000_000
"""Time in which the fingers are freed again and again after a loop that ended without announcing it [ns]."""


class WatchedHand:
    """A loop, its driver, and the watchdog's own connection to its glove, not yet opened; None sends nothing."""

    def __init__(self, setup: WatchdogSetup, device: FingerRelease | None) -> None:
        self._supervisor = setup.supervisor
        self._stale_ns = setup.oldest_ns
        self._periods = setup.periods
        self._block = SharedBlock(setup.status, LIVE_STATUS)
        self._status = self._block.array[0]
        self._device = device
        self.loop = LoopProcess(self._status)
        self._opened = False
        self._armed = False
        self._tried_ns = -CONNECT_NS
        self._released_ns = -RELEASE_NS
        self._gone_ns = -1

    def close(self) -> None:
        """Release the glove once more, and disconnect."""
        self._status["watchdog_armed"] = 0
        self._free_fingers()
        if self._opened and self._device is not None:
            self._device.close()

    def amiss(self, now: int) -> bool:
        """Return whether the loop or its driver is dead or silent: nobody else frees the fingers."""
        status, stage = self._status, int(self._status["stage"])
        running = stage in (Stage.RUNNING, Stage.ENDING)
        amiss = running and (self.loop.gone or now - int(status["heartbeat_ns"]) > self._stale_ns)
        # A driver that is dead or hangs sends no command, not even one that frees the fingers.
        amiss = amiss or (stage == Stage.RUNNING and now - int(status["driver_ns"]) > self._stale_ns)
        return amiss or self._broke_off(stage)

    def _broke_off(self, stage: int) -> bool:
        """Return whether the loop ends by itself before its time, as after the death of its driver."""
        status = self._status
        over = 0 <= self._periods <= int(status["ticks"] + status["missed"])
        return stage in (Stage.ENDING, Stage.ENDED) and status["stop_requested"] == 0 and not over

    def look(self, now: int) -> None:
        """Say that the watchdog is alive, and free the fingers now and then while that is needed."""
        status = self._status
        status["watchdog_ns"] = now
        self._stay_connected(now)
        status["watchdog_armed"] = self._armed
        if self.amiss(now) and now - self._released_ns >= RELEASE_NS:
            self._released_ns = now
            if self._free_fingers():
                status["watchdog_releases"] += 1

    def over(self, now: int, may_end: bool) -> bool:
        """Return True if nothing is left that needs a watchdog; it `may_end` if it got a signal."""
        stage = int(self._status["stage"])
        if stage == Stage.ENDED:
            return not self.loop.alive
        running = stage in (Stage.RUNNING, Stage.ENDING)
        if self.loop.alive:
            self._gone_ns = -1
            return False
        if self._gone_ns < 0:
            self._gone_ns = now
        orphan = os.getppid() != self._supervisor
        # After a loop that was killed while it ran, the first release may have been lost.
        long_enough = not running or now - self._gone_ns >= LAST_WORDS_NS
        return (may_end or orphan) and long_enough

    def _stay_connected(self, now: int) -> None:
        if self._device is None:
            return
        if self._armed:
            try:
                self._device.drain()
            except DeviceError:
                self._armed = False
                self._status["watchdog_armed"] = 0
        if not self._armed and now - self._tried_ns >= CONNECT_NS:
            self._tried_ns = now
            try:
                if self._opened:
                    self._armed = self._device.reconnect()
                else:
                    self._device.open_for_release(1.0)
                    self._opened = self._armed = True
            except DeviceError:
                self._armed = False

    def _free_fingers(self) -> bool:
        return self._opened and self._device is not None and self._device.release()


class Watchdog:
    """Watches the one hand of a session, or both."""

    def __init__(self, hands: Sequence[WatchedHand]) -> None:
        self._hands = hands
        self._may_end = False

    def allow_end(self, number: int, frame: FrameType | None) -> None:
        """End as soon as the loops have, and not before; a signal handler."""
        self._may_end = True

    def watch(self) -> None:
        """Watch until the session has ended, then release each glove once more."""
        try:
            while not self._step():
                pass
        finally:
            for hand in self._hands:
                hand.close()

    def _step(self) -> bool:
        """Look once at each hand; True if there is nothing left to watch."""
        hands = self._hands
        for hand, patience in zip(hands, (WATCH_SECONDS, 0.0)):
            hand.loop.wait(patience)
        now = time.monotonic_ns()
        for hand in hands:
            hand.look(now)
        over = [hand.over(now, self._may_end) for hand in hands]
        return all(over)


def main(arguments: Sequence[str] | None = None) -> int:
    """Watch a session under real-time scheduling; signals do not end it while the loop lives. Returns the exit code."""
    setups: Sequence[WatchdogSetup] = process_setup("watchdog", arguments)
    setup = setups[0]
    watchdog = Watchdog(
        [WatchedHand(each, None if each.device is None else open_release(each.device)) for each in setups]
    )
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, watchdog.allow_end)
    keep_off(setup.real_time.loop_cpu)
    become_real_time(replace(setup.real_time, cpu=-1), above=1)
    watchdog.watch()
    become_ordinary()
    return 0


if __name__ == "__main__":
    sys.exit(main())
