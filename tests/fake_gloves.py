"""A fake glove's program as another process: started, given orders, killed; and what it wrote down."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
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


class PeerRecord(NamedTuple):
    """A log that was read: times [ns] and values of the frames sent and of the commands received, and the notes."""

    sent_ns: NDArray[np.int64]
    sent: FloatArray
    command_ns: NDArray[np.int64]
    command: FloatArray
    notes: list[tuple[int, str]]


class FakeGlove:
    """`python -m MODULE --log FILE …` while the block runs; a context.

    The program prints a line when it can be reached, "ready WHERE", obeys a line of its standard input with "ok", and
    ends with that input. It may be started again after `kill`.

    Args:
        module: Such as `tools.udp_sender`.
        log: Its log; a process that is started again goes on with it.
        arguments: More of the command line.

    Attributes:
        where: What it says of where it can be reached: a port.
    """

    where: str

    def __init__(self, module: str, log: Path, *arguments: object) -> None:
        """Nothing runs yet."""
        self.module, self.log = module, log
        self._arguments = tuple(map(str, arguments))
        self._process: subprocess.Popen[str] | None = None
        self._read = 0
        self._lines: dict[str, list[list[str]]] = {"sent": [], "command": [], "note": []}

    def start(self) -> None:
        """Start the process, and wait until it can be reached.

        Raises:
            RuntimeError: It ended instead.
        """
        self._process = subprocess.Popen(
            [sys.executable, "-m", self.module, "--log", str(self.log), *self._arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=REPOSITORY,
        )
        word, _, self.where = self._answer().partition(" ")
        if word != "ready":
            raise RuntimeError(f"{self.module} did not start")
        # A glove has a processor of its own: on a busy machine its stamps would tell of that and not of the session.
        with contextlib.suppress(OSError):
            os.sched_setscheduler(self._process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))

    @property
    def pid(self) -> int:
        """Its number, while it runs."""
        assert self._process is not None
        return self._process.pid

    def order(self, text: str) -> None:
        """Give an order, and wait until it is obeyed.

        Raises:
            RuntimeError: There is no such order, or the process ended.
        """
        assert self._process is not None and self._process.stdin is not None
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()
        if self._answer() != "ok":
            raise RuntimeError(f"{self.module} did not obey '{text}'")

    def kill(self) -> None:
        """Kill the process (SIGKILL), as a crash would."""
        assert self._process is not None
        self._process.kill()
        self.end()

    def end(self) -> None:
        """End the process in good order, if it runs."""
        if self._process is not None:
            assert self._process.stdin is not None and self._process.stdout is not None
            with contextlib.suppress(OSError):
                self._process.stdin.close()
            self._process.wait()
            self._process.stdout.close()
            self._process = None

    def record(self) -> PeerRecord:
        """What it wrote down so far; a last line that was cut off is left out."""
        sent, command, notes = (self._rows(kind) for kind in ("sent", "command", "note"))
        return PeerRecord(
            np.array([int(row[0]) for row in sent], np.int64),
            np.array([row[1:] for row in sent], np.float64),
            np.array([int(row[0]) for row in command], np.int64),
            np.array([row[1:] for row in command], np.float64),
            [(int(now), " ".join(words)) for now, *words in notes],
        )

    def _rows(self, kind: str) -> list[list[str]]:
        """The lines of a kind, as words without that one."""
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
        assert self._process is not None and self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def __enter__(self) -> Self:
        """Start."""
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End."""
        self.end()


class FakeDexmo(FakeGlove):
    """The server of Dexmo frames; after `kill`, `start` takes the same port again.

    Args:
        log: Its log.
        arguments: More of the command line, as "--seed", "3".
    """

    port = 0

    def __init__(self, log: Path, *arguments: str) -> None:
        """Nothing runs yet."""
        super().__init__("tools.dexmo_server", log)
        self._more = arguments

    def start(self) -> None:
        """Start the process, and wait until it listens."""
        self._arguments = ("--port", str(self.port), *self._more)
        super().start()
        self.port = int(self.where)

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
