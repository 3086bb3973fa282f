"""Processes of a session with a glove that writes down what it is told, for the tests of the watchdog.

`python guarded_loop.py loop|watchdog LOG --setup FD …`; a line of the log is CLOCK_MONOTONIC [ns], who spoke, and the
stiffest finger. Lines are appended whole, so that two processes may write the same file.
"""

import argparse
import os
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import Capability, DeviceCounters, FingerCommand, GloveDevice, GloveInfo
from hhsim.live.ipc.status import WatchdogSetup
from hhsim.live.loop.watchdog import watch
from hhsim.live.shared_memory import read_setup

FIST = 0.9
CLOSING_SECONDS = 0.2


class LoggingGlove(GloveDevice):
    """A fist that closes on whatever is there, one sample a read; commands go to a file."""

    def __init__(self, log: Path, who: str) -> None:
        self.info = GloveInfo("logging glove", Capability.POSITION_LIMIT, ("bend",))
        self.counters = DeviceCounters()
        self._log = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        self._who = who
        self._begin = 0

    def open(self, timeout: float = 5.0) -> None:
        return

    def read(self, samples_out: NDArray[np.void]) -> int:
        sample = samples_out[0]
        now = time.monotonic_ns()
        # From the first read on: a hand that begins inside the object takes a long first tick to be brought out.
        self._begin = self._begin or now
        sample["seq"] = self.counters.samples
        sample["time_ns"] = now
        sample["good"] = True
        sample["battery"] = -1
        sample["flexion"] = FIST * min(1.0, 1e-9 * (now - self._begin) / CLOSING_SECONDS)
        sample["abduction"] = 0.0
        self.counters.samples += 1
        return 1

    def send(self, command: FingerCommand) -> bool:
        self._write(float(command.stiffness.max()))
        return True

    def release(self, timeout: float = 0.05) -> bool:
        self._write(0.0)
        return True

    def reconnect(self) -> bool:
        return True

    def close(self) -> None:
        self._write(-1.0)

    def _write(self, stiffness: float) -> None:
        os.write(self._log, f"{time.monotonic_ns()} {self._who} {stiffness:.6f}\n".encode())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("who", choices=["loop", "driver", "watchdog"])
    parser.add_argument("log", type=Path)
    known, rest = parser.parse_known_args()
    if known.who == "loop":
        run_loop(known.log, rest)
        return
    # What the loop's driver says is what the loop said.
    glove = LoggingGlove(known.log, "loop" if known.who == "driver" else known.who)
    if known.who == "driver":
        run_driver(glove, rest)
    else:
        parser.add_argument("--setup", type=int)
        setup = read_setup(parser.parse_args().setup, WatchdogSetup)
        watch(setup, None if setup.device is None else glove)


def run_loop(log: Path, arguments: list[str]) -> None:
    # The watchdog does without the numerics that these load.
    from hhsim.live.child_process import ChildProcess
    from hhsim.live.ipc.config import LiveSetup
    from hhsim.live.ipc.session_memory import SessionMemory
    from hhsim.live.loop import process

    class Driver(ChildProcess):
        command: tuple[str, ...] = (__file__, "driver", str(log))

    def start(setup: LiveSetup, memory: SessionMemory) -> ChildProcess:
        given = [str(descriptor) for descriptor in memory.descriptors]
        if setup.dry_run:
            Driver.command = (*Driver.command, "--dry-run")
        return Driver("driver", "", [*memory.arguments(), "--setup", given[0]], list(memory.descriptors))

    sys.exit(process.main(arguments, start))


def run_driver(glove: LoggingGlove, arguments: list[str]) -> None:
    from hhsim.live.ipc.session_memory import add_memory_options, attached
    from hhsim.live.loop.driver import GloveDriver, drive
    from hhsim.live.pose.fixed import FixedPose
    from hhsim.live.pose.registry import PoseConfig
    from hhsim.live.real_time import RealTimeWishes, end_with

    parser = argparse.ArgumentParser()
    parser.add_argument("--dry-run", action="store_true")
    add_memory_options(parser)
    end_with(os.getppid())
    options = parser.parse_args(arguments)
    drive(GloveDriver(attached(options), glove, FixedPose(PoseConfig()), dry_run=options.dry_run), RealTimeWishes())


if __name__ == "__main__":
    main()
