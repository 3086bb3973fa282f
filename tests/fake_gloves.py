"""The fake Dexmo server as another process: started, given orders, killed; and what it wrote down."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tools.import_graph import REPOSITORY

PRIORITY = 1
"""Of a fake glove under SCHED_FIFO, where that is granted: below all of a session but its recorder."""
DEXMO_FRAME = np.dtype([("time_ns", np.int64), ("client", np.int64), ("number", np.int64)])
DEXMO_COMMAND = np.dtype(
    [
        *(("time_ns", np.int64), ("client", np.int64), ("number", np.int64), ("kept", np.int64)),
        *(("stiffness", np.float32, (5,)), ("set_point", np.float32, (5,))),
    ]
)


class FakeDexmo:
    """`python -m tools.dexmo_server --log FILE …` while the block runs; `start` after `kill` takes the same port again.

    A process that is started again goes on with its log.
    """

    port = 0

    def __init__(self, log: Path, *arguments: str) -> None:
        self.log, self._arguments = log, arguments
        self._process: subprocess.Popen[str] | None = None
        self._read = 0
        self._lines: dict[str, list[list[str]]] = {"sent": [], "command": [], "note": []}

    def start(self) -> None:
        """Start the process, and wait until it listens; RuntimeError if it ended instead."""
        words = ["-m", "tools.dexmo_server", "--log", str(self.log), "--port", str(self.port), *self._arguments]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen([sys.executable, *words], stdin=pipe, stdout=pipe, text=True, cwd=REPOSITORY)
        word, _, port = self._answer().partition(" ")
        if word != "ready":
            raise RuntimeError("the fake server did not start")
        self.port = int(port)
        # A glove has a processor of its own: on a busy machine its stamps would tell of that and not of the session.
        with contextlib.suppress(OSError):
            os.sched_setscheduler(self._process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))

    @property
    def pid(self) -> int:
        """Its number, while it runs."""
        return self._process.pid

    def order(self, text: str) -> None:
        """Give an order, and wait until it is obeyed; RuntimeError if there is no such order, or the process ended."""
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()
        if self._answer() != "ok":
            raise RuntimeError(f"the fake server did not obey '{text}'")

    def kill(self) -> None:
        """Kill the process (SIGKILL), as a crash would."""
        self._process.kill()
        self.end()

    def end(self) -> None:
        """End the process in good order, if it runs."""
        if self._process is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
            self._process.wait()
            self._process.stdout.close()
            self._process = None

    def _rows(self, kind: str) -> list[list[str]]:
        """The lines of a kind, as words without that one; a last line that was cut off is left out."""
        if self.log.exists():
            with self.log.open("rb") as file:
                file.seek(self._read)
                fresh = file.read()
            whole = fresh[: fresh.rfind(b"\n") + 1]
            self._read += len(whole)
            for line in whole.decode().splitlines():
                now, word, *rest = line.split(" ")
                self._lines[word].append([now, *rest])
        return self._lines[kind]

    def _answer(self) -> str:
        return self._process.stdout.readline().strip()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.end()

    @property
    def frames(self) -> NDArray[Any]:
        """The frames that it sent, of `DEXMO_FRAME`: when, to which client, of which number."""
        return np.array([tuple(map(int, row)) for row in self._rows("sent")], DEXMO_FRAME)

    @property
    def commands(self) -> NDArray[Any]:
        """The commands that came, of `DEXMO_COMMAND`; `number` is the glove's."""
        rows = self._rows("command")
        return np.array([(*map(int, row[:4]), tuple(row[4:9]), tuple(row[9:])) for row in rows], DEXMO_COMMAND)

    def noted(self, word: str) -> int:
        """How many notes begin so."""
        return sum(row[1:2] == [word] for row in self._rows("note"))
