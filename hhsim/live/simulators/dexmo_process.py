"""The fake Dexmo server as another process, and what it writes down."""

import struct
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.live.simulators.process import FakeProcess


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


class FakeDexmo(FakeProcess):
    """The server in a process of its own, for tests and long runs; a context.

    Args:
        log: File of its records, `read_log`.
        port: 0 for any that is free; after `kill`, `start` takes the same again.
        arguments: More of the command line, as "--seed", "3".
    """

    port: int

    def __init__(self, log: Path, *arguments: str, port: int = 0) -> None:
        """Nothing runs yet."""
        super().__init__("hhsim.live.simulators.dexmo_server", log, ready="listening")
        self.port, self._more = port, arguments

    def start(self) -> None:
        """Start the process, and wait until it listens."""
        self._arguments = ("--port", str(self.port), *self._more)
        super().start()
        self.port = int(self.where)

    def records(self, kind: Kind | None = None) -> NDArray[Any]:
        """What it wrote down so far, of one kind or of all."""
        found = read_log(self.log)
        return found if kind is None else found[found["kind"] == kind]
