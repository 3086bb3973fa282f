"""Processes of a session: how one is started and followed, and the memory, status and setup that it shares with others.

Memory has no name (memfd): children inherit the descriptor, and nothing is left behind however the processes end.
Readers rely on words of eight bytes being written whole, and on stores becoming visible in order, as on x86-64.
"""

import contextlib
import mmap
import os
import pickle
import select
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from enum import IntEnum
from types import FrameType
from typing import Any, Self

import numpy as np

from hhsim.arrays import AnyArray, IntArray
from hhsim.errors import HhsimError
from hhsim.live.real_time import name_process

MADV_POPULATE_WRITE = 23
"""Advice to prefault every page for writing (madvise(2), Linux 5.14)."""
LAST_OUTPUT_BYTES = 4_000
"""Bytes at the end of a process's output that `ChildProcess.last_line` looks at."""
LOOK = 0.05
"""Time between two looks at the progress of a process that is waited for [s]."""


class Stage(IntEnum):
    """Stage of a session."""

    STARTING = 0
    RUNNING = 1
    ENDING = 2
    ENDED = 3


LIVE_STATUS = np.dtype(
    [
        # Written by the loop.
        *((name, np.int64) for name in ("heartbeat_ns", "stage", "ending_ns", "loop_pid", "ticks", "missed")),
        ("missed_by", np.int64, (4,)),
        *((name, np.int64) for name in ("safety", "contacts", "battery", "sample_ns")),
        ("force", np.float64, (5,)),
        ("command_bend", np.float64, (5,)),
        ("command_stiffness", np.float64, (5,)),
        ("command_force", np.float64, (5, 3, 3)),
        ("command_safety", np.int64),
        ("command_version", np.int64, (1,)),
        ("loop_ready", np.int64),
        # Written by the driver, a thread of the loop's process.
        *((name, np.int64) for name in ("driver_ns", "device_lost")),
        ("counters", np.int64, (9,)),
        ("palm_ns", np.int64),
        ("palm_position", np.float64, (3,)),
        ("palm_orientation", np.float64, (4,)),
        ("palm_version", np.int64, (1,)),
        # Written by the watchdog.
        *((name, np.int64) for name in ("watchdog_ns", "watchdog_armed", "watchdog_releases")),
        # Written by the recorder and by the viewer.
        *((name, np.int64) for name in ("recorder_ticks", "recorder_lost", "recorder_failed", "viewer_ns")),
        # Written by the supervisor.
        *((name, np.int64) for name in ("stop_requested", "pose_version")),
        ("pose_position", np.float64, (3,)),
        ("pose_orientation", np.float64, (4,)),
    ],
    align=True,
)
"""State of a session that changes in place; every field has one writer. Times are CLOCK_MONOTONIC [ns]; that of
`ending_ns` is when the loop had made its last tick, 0 before. `counters` are those of `DeviceCounters`, `missed_by` is
by `MissCause` without NONE, both in their order. `command_version`, `palm_version` and `pose_version` are odd while
the command, the palm's pose and the pose of the keyboard are being written. `loop_ready` is 1 when the kernels are
compiled, and the glove is opened. `watchdog_armed` is 1 if the watchdog reaches the glove. `stop_requested` is 1 if the
user ends the session, -n if signal n does. Of two gloves each has a block: those of the second one's loop, stop and
recorder say the same.
"""


class LoopProcess:
    """Process of the loop, whose end wakes a process that did not start it; `status` is the record of `LIVE_STATUS`."""

    def __init__(self, status: Any) -> None:
        self._status = status
        self._descriptor = -1
        self.known = self.gone = False

    @property
    def alive(self) -> bool:
        """True from its begin to its end, as far as `wait` has seen either."""
        return self.known and not self.gone

    def wait(self, timeout: float = 0.0) -> None:
        """Sleep for `timeout` [s], or until the process ends."""
        number = int(self._status["loop_pid"])
        if not self.known and number:
            self.known = True
            try:
                self._descriptor = os.pidfd_open(number)
            except ProcessLookupError:
                self.gone = True
        ended, _, _ = select.select([self._descriptor] if self.alive else [], [], [], timeout)
        if ended:
            self.gone = True
            os.close(self._descriptor)


class SharedBlock:
    """An array of one element of `dtype` in the memory of a descriptor; every process must use the same beginning."""

    def __init__(self, descriptor: int, dtype: np.dtype[Any]) -> None:
        self.descriptor, self.dtype = descriptor, dtype
        self._map = mmap.mmap(descriptor, dtype.itemsize)
        self.array: AnyArray = np.frombuffer(self._map, dtype, 1)

    @classmethod
    def create(cls, name: str, dtype: np.dtype[Any]) -> Self:
        """Allocate memory of zeros with an inheritable descriptor; HhsimError if the system has none of this kind."""
        if not hasattr(os, "memfd_create"):
            raise HhsimError(f"live sessions need Linux, whose memory needs no file (memfd); this is {sys.platform}")
        descriptor = os.memfd_create(f"hhsim-{name}", 0)
        os.ftruncate(descriptor, dtype.itemsize)
        os.set_inheritable(descriptor, True)
        return cls(descriptor, dtype)

    def part(self, name: str) -> AnyArray:
        """Return a field as an array of one element of its own type."""
        assert self.dtype.fields is not None
        kind, offset, *_ = self.dtype.fields[name]
        return np.frombuffer(self._map, kind, 1, offset)

    def populate(self) -> None:
        """Prefault all pages for this process, if the system can do that at once."""
        with contextlib.suppress(OSError):
            self._map.madvise(MADV_POPULATE_WRITE)


def ring_type(dtype: np.dtype[Any], capacity: int) -> np.dtype[Any]:
    """Return the type of the memory of a `SharedRing`."""
    return np.dtype([("written", np.int64), ("record", dtype, (capacity,))], align=True)


class SharedRing:
    """Ring of records in memory of `ring_type`, shape (1,); the writer never waits, a slow reader loses the oldest."""

    def __init__(self, memory: AnyArray) -> None:
        self.counter: IntArray = memory["written"]
        """Number of records written since the beginning, shape (1,)."""
        self.records = memory["record"][0]
        self.capacity = len(self.records)

    @property
    def written(self) -> int:
        """Number of records written since the beginning."""
        return int(self.counter[0])

    def slot(self) -> Any:
        """Return the record to fill next; readers see it after `publish`."""
        return self.records[self.written % self.capacity]

    def publish(self) -> None:
        """Publish the record that `slot` returned."""
        self.counter[0] += 1


class RingReader:
    """Position of one reader in a ring: its next record, at first the oldest, and how many were overwritten unread."""

    def __init__(self, ring: SharedRing) -> None:
        self._ring = ring
        self.next = 0
        self.lost = 0

    def read(self, most: int) -> tuple[int, AnyArray]:
        """Read the oldest unread records, at most `most`.

        Returns the number of the first one, from the ring's beginning, and copies; numbers that are skipped were lost.
        """
        ring = self._ring
        written = ring.written
        first = max(self.next, written - (ring.capacity - 1))
        self.lost += first - self.next
        records = ring.records[np.arange(first, min(first + most, written)) % ring.capacity]
        self.next = first + len(records)
        # The slot after the newest record may be in the making, so one record fewer than the capacity is valid.
        overwritten = min(max(0, ring.written - (ring.capacity - 1) - first), len(records))
        self.lost += overwritten
        return first + overwritten, records[overwritten:]


def write_setup(*parts: object) -> int:
    """Pickle the parts of a process's setup into inheritable memory; returns the descriptor."""
    descriptor = os.memfd_create("hhsim-setup", 0)
    os.set_inheritable(descriptor, True)
    with open(descriptor, "wb", closefd=False) as stream:
        pickle.dump(parts, stream, pickle.HIGHEST_PROTOCOL)
    return descriptor


def process_setup(name: str, arguments: Sequence[str] | None) -> tuple[Any, ...]:
    """Name this process of a session, and return the parts that `write_setup` wrote for it."""
    name_process(name)
    words = sys.argv if arguments is None else arguments
    descriptor = int(words[words.index("--setup") + 1])
    # By position: processes that inherit a descriptor share its offset in the file.
    parts: tuple[Any, ...] = pickle.loads(os.pread(descriptor, os.fstat(descriptor).st_size, 0))
    return parts


def exit_code(body: Callable[[], object], failed: Callable[[str], object] = lambda text: None) -> int:
    """Run the body of a process and return its exit code: 0, that of an error, or 1 for a fault of hhsim's own.

    `failed` is called with the text of an error or fault, which is printed too.
    """
    try:
        body()
    except HhsimError as error:
        failed(str(error))
        print("; ".join([f"hhsim: {error}", *getattr(error, "__notes__", ())]), file=sys.stderr)
        return error.exit_code
    except Exception as error:
        failed(f"a fault of hhsim's own: {type(error).__name__}: {error}")
        traceback.print_exc()
        return 1
    return 0


class ChildProcess:
    """A Python module run as a process in a session of its own, apart from the terminal.

    Ctrl-C, Ctrl-Z and a lost terminal reach the supervisor alone, which ends the processes in order, and has `reported`
    it then. Output is kept in memory for `last_line`. The child inherits the descriptor of its setup (`write_setup`),
    named on its command line, and further ones.
    """

    def __init__(self, name: str, module: str, setup: int, descriptors: Sequence[int]) -> None:
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


WORDS = {
    "SIGINT": "Ctrl-C",
    "SIGTERM": "SIGTERM",
    "SIGHUP": "the terminal is gone",
    # A suspended session would leave the hand in the glove with nobody to watch over it.
    "SIGTSTP": "Ctrl-Z, which ends a live session",
    "SIGQUIT": "Ctrl-backslash",
}
NOT_BY_THE_USER = {WORDS[number.name]: int(number) for number in (signal.SIGTERM, signal.SIGHUP)}
"""Signals that come from another program or from a lost terminal, by their words."""


@contextlib.contextmanager
def stop_signals() -> Iterator[Callable[[], str]]:
    """Record every signal that ends a session while the block runs; yields a function that returns the first in words.

    Signals are never raised: a session has to end in order, or the fingers stay held.

    A signal that is ignored already (nohup) stays ignored. Outside of the main thread nothing is recorded: "".
    """
    received: list[str] = []

    def note(number: int, frame: FrameType | None) -> None:
        received.append(WORDS[signal.Signals(number).name])

    before = {}
    if threading.current_thread() is threading.main_thread():
        for name in WORDS:
            number = signal.Signals[name]
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, note)
    try:
        yield lambda: received[0] if received else ""
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
