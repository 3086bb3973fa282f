"""Child processes of a live session, as their supervisor sees them."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence

LAST_OUTPUT_BYTES = 4_000
"""Bytes at the end of a process's output that `ChildProcess.last_line` looks at."""
LOOK = 0.05
"""Time between two looks at the progress of a process that is waited for [s]."""


class ChildProcess:
    """A Python module run as a process in a session of its own, apart from the terminal.

    Ctrl-C, Ctrl-Z and a lost terminal reach the supervisor alone, which ends the processes in order, and has `reported`
    it then. Output is kept in memory for `last_line`. The child inherits the descriptor of its setup
    (`hhsim.live.shared_memory.write_setup`), named on its command line, and further ones.
    """

    def __init__(self, name: str, module: str, setup: int, descriptors: Sequence[int]) -> None:
        self.name = name
        self.reported = False
        self._output = os.memfd_create(f"hhsim-{name}-output")
        self._process = subprocess.Popen(
            # -P: the working directory may hold a folder or a file named as a module.
            [sys.executable, "-P", "-m", module, "--setup", str(setup)],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=self._output,
            pass_fds=[setup, *descriptors],
            start_new_session=True,
        )
        self.pid = self._process.pid
        self.began = time.monotonic()

    @property
    def code(self) -> int | None:
        """Exit code, the negative signal that ended the process, or None while it runs."""
        return self._process.poll()

    @property
    def running(self) -> bool:
        """True while the process runs."""
        return self.code is None

    def how_it_ended(self) -> str:
        """Return in words by which signal or code it ended, and its last line."""
        code = self.code
        if code is None:
            return "is running"
        how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
        line = self.last_line()
        return f"{how}: {line}" if line else how

    def last_line(self) -> str:
        """Return the last line of its output without the prefix "hhsim: error: "; "" if there is none."""
        size = os.fstat(self._output).st_size
        tail = os.pread(self._output, LAST_OUTPUT_BYTES, max(0, size - LAST_OUTPUT_BYTES))
        lines = [line.strip() for line in tail.decode("utf-8", "replace").splitlines() if line.strip()]
        return lines[-1].removeprefix("hhsim: ").removeprefix("error: ") if lines else ""

    def wait(self, seconds: float, progress: Callable[[], object] = lambda: None) -> bool:
        """Wait for its end, at most `seconds` after the last change of `progress()`; True if it has ended."""
        done, began = progress(), time.monotonic()
        while self.running and (left := began + seconds - time.monotonic()) > 0.0:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(min(left, LOOK))
            if (now := progress()) != done:
                done, began = now, time.monotonic()
        return not self.running

    def send(self, number: signal.Signals) -> None:
        """Send a signal if it still runs."""
        if self.running:
            self._process.send_signal(number)

    def close(self) -> None:
        """Discard its output; may be called twice."""
        if self._output >= 0:
            os.close(self._output)
            self._output = -1
