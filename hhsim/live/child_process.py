"""One process of a session as its supervisor sees it."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

LONGEST_COMPLAINT = 4_000
"""Bytes of what a process wrote last that are looked at."""
LOOK = 0.05
"""Between two looks at the accounts of a process that is waited for [s]."""


class ChildProcess:
    """A Python module run as a process of its own, apart from the terminal.

    It leads a session of its own: Ctrl-C, Ctrl-Z and a terminal that goes reach the supervisor alone, which ends the
    processes in their order. What it writes is kept in memory for `complaint`.

    Args:
        name: For people.
        descriptors: That it inherits.

    Attributes:
        command: What the interpreter runs, before the arguments; by default the module.
        reported: Whether its end has been reported; for the supervisor.
    """

    command: tuple[str, ...] = ()

    def __init__(self, name: str, module: str, arguments: Sequence[str], descriptors: Sequence[int]) -> None:
        """Start it."""
        self.name = name
        self.reported = False
        self._output = os.memfd_create(f"hhsim-{name}-output")
        self._process = subprocess.Popen(
            # -P: a folder of clones, or a file that is named as a module, may be where the command was typed.
            [sys.executable, "-P", *(self.command or ("-m", module)), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=self._output,
            pass_fds=list(descriptors),
            start_new_session=True,
        )
        self.began = time.monotonic()

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def code(self) -> int | None:
        """Its exit code, the negative signal that ended it, or None while it runs."""
        return self._process.poll()

    @property
    def running(self) -> bool:
        """Whether it still runs."""
        return self.code is None

    def how_it_ended(self) -> str:
        """In words: by which signal or code, and its last line."""
        code = self.code
        if code is None:
            return "is running"
        line = self.complaint()
        if code < 0:
            how = f"was ended by {signal.Signals(-code).name}"
        else:
            how = f"ended with code {code}"
        return f"{how}: {line}" if line else how

    def complaint(self) -> str:
        """The last line that it wrote, without the "hhsim: error: " in front; "" where it wrote nothing."""
        size = os.fstat(self._output).st_size
        tail = os.pread(self._output, LONGEST_COMPLAINT, max(0, size - LONGEST_COMPLAINT))
        lines = [line.strip() for line in tail.decode("utf-8", "replace").splitlines() if line.strip()]
        return lines[-1].removeprefix("hhsim: ").removeprefix("error: ") if lines else ""

    def wait(self, seconds: float) -> bool:
        """Wait until it has ended, at most so long [s]; whether it has."""
        try:
            self._process.wait(max(seconds, 0.0))
        except subprocess.TimeoutExpired:
            return False
        return True

    def wait_its_time(self, seconds: float, progress: Callable[[], object] = lambda: None) -> bool:
        """Wait until it has ended, or has had so much time of its own for it (`OwnTime`).

        Args:
            seconds: Of its own time [s].
            progress: Called at every look: while what it returns changes, the time begins anew.

        Returns:
            Whether it has ended.
        """
        own, done = OwnTime(self.pid), progress()
        while not self.wait(LOOK):
            if (now := progress()) != done:
                own, done = OwnTime(self.pid), now
            if own.passed() >= seconds:
                return False
        return True

    def send(self, number: signal.Signals) -> None:
        """Send a signal; nothing where it has ended."""
        if self.running:
            self._process.send_signal(number)

    def close(self) -> None:
        """Forget what it wrote."""
        if self._output >= 0:
            os.close(self._output)
            self._output = -1


class OwnTime:
    """The time of a process that passes for it: what it and the processes that it started compute or sleep.

    While they wait for a processor that others have, none passes, however long that takes. Where the system keeps no
    account of it, it is the time of the clock.

    Args:
        process: Its number.
    """

    def __init__(self, process: int) -> None:
        """None has passed."""
        self._process = process
        self._had, self._then = 0.0, time.monotonic()
        self._ran, self._waited = _processor_time(process)

    def passed(self) -> float:
        """How much since the beginning [s]; to be looked at every `LOOK` seconds."""
        then, ran, waited = self._then, self._ran, self._waited
        self._then, (self._ran, self._waited) = time.monotonic(), _processor_time(self._process)
        # Whoever looks may have had to wait for a processor, too.
        idle = min(self._then - then, 2.0 * LOOK) - max(0.0, self._waited - waited)
        self._had += max(self._ran - ran, idle, 0.0)
        return self._had


def _processor_time(process: int) -> tuple[float, float]:
    """What the threads of a process, and of those that it started, have computed, and waited for a processor [s]."""
    ran = waited = 0.0
    # Any of them may end while it is looked at.
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{process}/task").iterdir():
            with contextlib.suppress(OSError):
                numbers = (task / "schedstat").read_text().split()
                ran, waited = ran + 1e-9 * int(numbers[0]), waited + 1e-9 * int(numbers[1])
                for child in map(int, (task / "children").read_text().split()):
                    its, delay = _processor_time(child)
                    ran, waited = ran + its, waited + delay
    return ran, waited
