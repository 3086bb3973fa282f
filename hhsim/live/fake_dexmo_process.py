"""The fake Dexmo server as another process, and what it writes down."""

import contextlib
import struct
import subprocess
import sys
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


class Kind(IntEnum):
    """Of a record."""

    FRAME = 0
    """A frame was sent; `number` is the frame's, `client` whose."""
    COMMAND = 1
    """A command came; `number` is the glove's."""
    CONNECTED = 2
    GONE = 3
    SKIPPED = 4
    """A frame was not sent to a client that takes too little."""
    BROKEN = 5
    """What came is no command."""


RECORD = np.dtype(
    [
        ("time_ns", np.int64),
        ("kind", np.int32),
        ("client", np.int32),
        ("number", np.int64),
        ("kept", np.int64),
        ("stiffness", np.float32, (5,)),
        ("set_point", np.float32, (5,)),
    ]
)
"""A line of the log; CLOCK_MONOTONIC [ns]."""
PACKED = struct.Struct("<qiiqq10f")


def read_log(path: Path) -> NDArray[Any]:
    """All whole records of a log, of `RECORD`."""
    data = path.read_bytes()
    return np.frombuffer(data[: len(data) // RECORD.itemsize * RECORD.itemsize], RECORD)


class FakeDexmo:
    """The server in a process of its own, for tests and long runs; a context.

    Args:
        log: file of its records, `read_log`.
        port: 0 for any that is free; after `kill`, `start` takes the same again.
        arguments: more of the command line, as "--seed", "3".
    """

    port: int

    def __init__(self, log: Path, *arguments: str, port: int = 0) -> None:
        """Nothing runs yet."""
        self.log, self.port, self._arguments = log, port, arguments
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start the process, and wait until it listens."""
        command = [sys.executable, "-m", "hhsim.live.fake_dexmo", "--port", str(self.port), "--log", str(self.log)]
        self._process = subprocess.Popen(
            [*command, *self._arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        word, _, port = self._answer().partition(" ")
        if word != "listening":
            raise RuntimeError("the fake Dexmo server did not start")
        self.port = int(port)

    @property
    def pid(self) -> int:
        """Its number, while it runs."""
        assert self._process is not None
        return self._process.pid

    def order(self, text: str) -> None:
        """Give an order, and wait until it is obeyed."""
        assert self._process is not None and self._process.stdin is not None
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()
        if self._answer() != "ok":
            raise RuntimeError(f"the fake Dexmo server did not obey '{text}'")

    def kill(self) -> None:
        """Kill the process (SIGKILL), as a crash would."""
        assert self._process is not None
        self._process.kill()
        self._end()

    def records(self, kind: Kind | None = None) -> NDArray[Any]:
        """What it wrote down so far, of one kind or of all."""
        found = read_log(self.log)
        return found if kind is None else found[found["kind"] == kind]

    def _answer(self) -> str:
        assert self._process is not None and self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def _end(self) -> None:
        if self._process is not None:
            assert self._process.stdin is not None and self._process.stdout is not None
            with contextlib.suppress(OSError):
                self._process.stdin.close()
            self._process.wait()
            self._process.stdout.close()
            self._process = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._end()
