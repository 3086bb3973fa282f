"""Process of the watchdog: frees the fingers when the loop cannot; `python -m hhsim.live.session.watchdog --setup FD`.

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
from dataclasses import dataclass, replace

from hhsim.live.device import DeviceError, FingerRelease
from hhsim.live.gloves import GloveConfig, open_release
from hhsim.live.processes import LIVE_STATUS, LoopProcess, SharedBlock, Stage, process_setup
from hhsim.live.real_time import RealTimeWishes, become_ordinary, become_real_time, keep_off

WATCH_SECONDS = 0.004
"""Longest time between two looks [s]."""
RELEASE_NS = 20_000_000
"""Time between two releases while the loop fails [ns]."""
CONNECT_NS = 250_000_000
"""Time between two tries to reach the glove [ns]."""
LAST_WORDS_NS = 200_000_000
"""Time in which the fingers are freed again and again after a loop that ended without announcing it [ns]."""


@dataclass(frozen=True)
class WatchedGlove:
    """Settings of the watchdog for a glove, without scene and calibration."""

    device: GloveConfig
    real_time: RealTimeWishes
    oldest_ns: int  # age of the loop's heartbeat beyond which its command is void, and the fingers are freed [ns]
    parent: int  # process id of the supervisor
    status: int  # descriptor of the memory that begins with the status
    periods: int  # number of periods after which the loop ends by itself, -1 for none


class WatchedHand:
    """A loop, its driver, and the watchdog's own connection to its glove, not yet opened."""

    def __init__(self, setup: WatchedGlove, device: FingerRelease) -> None:
        self._setup = setup
        self._status = SharedBlock(setup.status, LIVE_STATUS).array[0]
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
        if self._opened:
            self._device.close()

    def amiss(self, now: int) -> bool:
        """Return whether the loop or its driver is dead or silent: nobody else frees the fingers."""
        status, stage, stale = self._status, int(self._status["stage"]), self._setup.oldest_ns
        running = stage in (Stage.RUNNING, Stage.ENDING)
        if running and (self.loop.gone or now - int(status["heartbeat_ns"]) > stale):
            return True
        # A driver that is dead or hangs sends no command, not even one that frees the fingers.
        if stage == Stage.RUNNING and now - int(status["driver_ns"]) > stale:
            return True
        # The loop ends by itself before its time, as after the death of its driver.
        over = 0 <= self._setup.periods <= int(status["ticks"] + status["missed"])
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
        orphan = os.getppid() != self._setup.parent
        # After a loop that was killed while it ran, the first release may have been lost.
        long_enough = not running or now - self._gone_ns >= LAST_WORDS_NS
        return (may_end or orphan) and long_enough

    def _stay_connected(self, now: int) -> None:
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
        return self._opened and self._device.release()


def watch(hands: Sequence[WatchedHand], wishes: RealTimeWishes) -> None:
    """Watch the one hand of a session, or both, until it has ended, then release each glove once more.

    The calling thread gets a loop's `wishes`, above the loop. A signal lets it end once the loops have, not before.
    """
    signalled: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda number, frame: signalled.append(number))
    keep_off(wishes.loop_cpu)
    become_real_time(replace(wishes, cpu=-1), above=1)
    try:
        while True:
            for hand, patience in zip(hands, (WATCH_SECONDS, 0.0)):
                hand.loop.wait(patience)
            now = time.monotonic_ns()
            for hand in hands:
                hand.look(now)
            over = [hand.over(now, bool(signalled)) for hand in hands]
            if all(over):
                return
    finally:
        for hand in hands:
            hand.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """Watch a session under real-time scheduling; signals do not end it while the loop lives. Returns the exit code."""
    setups: Sequence[WatchedGlove] = process_setup("watchdog", arguments)
    watch([WatchedHand(each, open_release(each.device)) for each in setups], setups[0].real_time)
    become_ordinary()
    return 0


if __name__ == "__main__":
    sys.exit(main())
