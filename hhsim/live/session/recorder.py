"""Process that writes a session to its file: `python -m hhsim.live.session.recorder --setup FD`.

It only reads the rings, so that its failure, or that of the disk, does not affect the loop. Its real-time priority is
the lowest: without one, the rings would overflow on a busy machine. It ends when the session has ended and all of it is
written, or when the loop is gone.

Exit codes: 0 all records are written; 1 a fault of hhsim's own; 2 the file cannot be written (stderr says why, and
where the written part is). After 1 and 2 `recorder_failed` is set in the status.
"""

import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from types import FrameType

from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import SessionMemory, exit_code, session_process
from hhsim.live.ipc.status import LoopProcess, Stage
from hhsim.live.loop.loop import loop_options
from hhsim.live.real_time import become_ordinary, become_real_time, keep_off
from hhsim.live.session.writer import RINGS, SessionWriter
from hhsim.live.shared_memory import RingReader
from hhsim.result.miss_cause import by_name
from hhsim.result.reader import CHUNK_TICKS, check_result_path
from hhsim.solver.hand_solver import warm_up

POLL = 0.05
"""Period at which the rings are read [s]; they hold 16 s of ticks at 1 kHz, 4 s with a free object."""
LONGEST_WAIT = 1.0
"""Longest time from reading a record to writing it [s]."""
PRIORITY = 1
"""Priority under SCHED_FIFO, if the session is in real time."""
BLOCK_RECORDS = 2 * CHUNK_TICKS
"""Most records of a ring in one block: no more are lost to a full disk."""
CUT_SHORT = "the recorder was told to stop before the session ended"
LOOP_DIED = "the loop failed or was killed"


class Recorder:
    """Reads the rings of a session and writes its file; `stop` is a signal handler."""

    def __init__(self, setup: LiveSetup, memory: SessionMemory) -> None:
        if setup.record is None:
            raise ValueError("the session is not to be recorded")
        self._path = setup.record
        self._setup = setup
        self._memory = memory
        self._readers = {ring: RingReader(getattr(memory, ring)) for ring in RINGS}
        self._parent = os.getppid()
        self._loop = LoopProcess(memory.status)
        self._stop = False

    def stop(self, number: int, frame: FrameType | None) -> None:
        """Request `run` to write the records that are there, and end."""
        self._stop = True

    def run(self) -> None:
        """Record until the session has ended; raises OutputError if the file cannot be written."""
        check_result_path(self._path)
        options = loop_options(self._setup.options, self._setup.rate)
        # Kernels that measure penetration are compiled before ticks wait.
        warm_up(self._setup.hand, options, self._setup.free)
        while not self._memory.facts.read():
            # The glove is being connected; without it there is no session.
            if self._end() or self._stop:
                return
            self._loop.wait(POLL)
        with SessionWriter(self._path, self._setup, options, self._memory.facts.read()) as writer:
            ended = self._follow(writer)
            become_ordinary()
            if writer.empty:
                return
            status = self._memory.status
            if ended == CUT_SHORT:
                writer.write(status["counters"], ended)
                return
            writer.finish(ended, status["counters"], int(status["missed"]), by_name(status["missed_by"]))
            status["recorder_ticks"], status["recorder_lost"] = writer.ticks, writer.lost["ticks"]

    def _follow(self, writer: SessionWriter) -> str:
        """Write block after block until the session has ended; returns the reason."""
        written, status = time.monotonic(), self._memory.status
        while True:
            # Read before the rings: all records before the end are read after it.
            ended = self._end()
            more = False
            for ring, reader in self._readers.items():
                first, records = reader.read(BLOCK_RECORDS)
                writer.take(ring, first, records)
                writer.lost[ring] = reader.lost
                more = more or len(records) == BLOCK_RECORDS
            now = time.monotonic()
            over = not more and (bool(ended) or self._stop)
            if over or writer.waiting_ticks >= CHUNK_TICKS or now - written >= LONGEST_WAIT:
                writer.write(status["counters"])
                written = now
            status["recorder_ticks"], status["recorder_lost"] = writer.ticks, writer.lost["ticks"]
            if over:
                return ended or CUT_SHORT
            if not more:
                self._loop.wait(POLL)

    def _end(self) -> str:
        """Return the reason why the session has ended, "" while it goes on."""
        status = self._memory.status
        self._loop.wait()
        if status["stage"] == Stage.ENDED:
            return str(self._memory.facts.read().get("reason") or LOOP_DIED)
        if self._loop.gone:
            return LOOP_DIED
        if not self._loop.known and os.getppid() != self._parent:
            return "the session's supervisor died before the loop began"
        return ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Record a session; returns the exit code."""
    setup: LiveSetup
    setup, memory = session_process("recorder", arguments)
    keep_off(setup.real_time.loop_cpu)
    become_real_time(replace(setup.real_time, priority=PRIORITY, lock_memory=False, cpu=-1, freeze_gc=False))
    recorder = Recorder(setup, memory)
    # Ctrl-C is for the session: its end is recorded too.
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, recorder.stop)

    def failed(text: str) -> None:
        memory.status["recorder_failed"] = 1

    return exit_code(recorder.run, failed)


if __name__ == "__main__":
    sys.exit(main())
