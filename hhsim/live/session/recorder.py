"""The process that writes a session to its file: `python -m hhsim.live.session.recorder --setup FD --status FD …`.

It only reads the rings, so that whatever happens to it, or to the disk, is nothing to the loop, far below which it
stands: it is in real time only since the rings overflow where a busy machine lets it wait. It ends when the session has
ended and all of it is written, or when the loop is gone.

Exit codes: 0 all that came is written; 1 a fault of hhsim's own; 2 the file cannot be written (the line on stderr says
why, and where what was written is). After 1 and 2 `recorder_failed` is set in the status.
"""

import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import replace
from types import FrameType

from hhsim.errors import HhsimError
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import SessionMemory, session_process
from hhsim.live.ipc.status import Stage
from hhsim.live.loop.loop import loop_options
from hhsim.live.real_time import become_ordinary, become_real_time, keep_off
from hhsim.live.session.writer import RINGS, SessionWriter
from hhsim.live.shared_memory import RingReader
from hhsim.result.miss_cause import by_name
from hhsim.result.reader import CHUNK_TICKS, check_result_path
from hhsim.solver.compile import warm_up

POLL = 0.05
"""The rings are looked at this often [s]; they hold 16 s of ticks at 1 kHz, 4 s with a free object."""
LONGEST_WAIT = 1.0
"""What came is written after this time at the latest [s]."""
PRIORITY = 1
"""Under SCHED_FIFO, where the session is in real time."""
AT_ONCE = 2 * CHUNK_TICKS
"""Most records of a ring in one block: a disk that gets full takes no more than them."""
CUT_SHORT = "the recorder was told to stop before the session ended"
LOOP_DIED = "the loop failed or was killed"


class Recorder:
    """Reads the rings of a session and writes its file.

    Args:
        setup: Of the session; `record` names the file.
        memory: Of the session.
    """

    def __init__(self, setup: LiveSetup, memory: SessionMemory) -> None:
        """Nothing is read or written yet."""
        if setup.record is None:
            raise ValueError("the session is not to be recorded")
        self._path = setup.record
        self._setup = setup
        self._memory = memory
        self._readers = {ring: RingReader(getattr(memory, ring)) for ring in RINGS}
        self._parent = os.getppid()
        self._loop = -1
        self._stop = False

    def stop(self, number: int, frame: FrameType | None) -> None:
        """A signal's handler: write what is there, and end."""
        self._stop = True

    def run(self) -> None:
        """Record until the session has ended.

        Raises:
            OutputError: The file cannot be written.
        """
        check_result_path(self._path)
        options = loop_options(self._setup.options, self._setup.rate)
        # Measuring penetration must not have to be compiled while ticks wait.
        warm_up(self._setup.hand, options, self._setup.free)
        while not self._memory.read_facts():
            # The glove is being connected; without it there is no session.
            if self._end() or self._stop:
                return
            self._breathe()
        with SessionWriter(self._path, self._setup, options, self._memory.read_facts()) as writer:
            ended = self._follow(writer)
            become_ordinary()
            if writer.empty:
                return
            status = self._memory.status
            if ended == CUT_SHORT:
                writer.write(status["counters"], ended)
                return
            writer.finish(ended, status["counters"], int(status["missed"]), by_name(status["missed_by"]))
            self._show_progress(writer)

    def _follow(self, writer: SessionWriter) -> str:
        """Write block after block until the session has ended; returns why it did."""
        written = time.monotonic()
        while True:
            # Looked at before the rings: what came before the end is read after it.
            ended = self._end()
            more = self._take(writer)
            now = time.monotonic()
            over = not more and (bool(ended) or self._stop)
            if over or writer.waiting_ticks >= CHUNK_TICKS or now - written >= LONGEST_WAIT:
                writer.write(self._memory.status["counters"])
                written = now
            self._show_progress(writer)
            if over:
                return ended or CUT_SHORT
            if not more:
                self._breathe()

    def _take(self, writer: SessionWriter) -> bool:
        """Take what came, so much that a block does not get too large; whether there may be more."""
        more = False
        for ring, reader in self._readers.items():
            first, records = reader.read(AT_ONCE)
            writer.take(ring, first, records)
            writer.lost[ring] = reader.lost
            more = more or len(records) == AT_ONCE
        return more

    def _show_progress(self, writer: SessionWriter) -> None:
        status = self._memory.status
        status["recorder_ticks"] = writer.ticks
        status["recorder_lost"] = writer.lost["ticks"]

    def _breathe(self) -> None:
        self._memory.status["recorder_ns"] = time.monotonic_ns()
        time.sleep(POLL)

    def _end(self) -> str:
        """Why the session has ended, "" while it goes on."""
        status = self._memory.status
        gone = self._loop_gone()
        if status["stage"] == Stage.ENDED:
            reason = self._memory.read_facts().get("summary", {}).get("reason")
            return str(reason or LOOP_DIED)
        if gone:
            return LOOP_DIED
        if status["loop_pid"] == 0 and os.getppid() != self._parent:
            return "the session's supervisor died before the loop began"
        return ""

    def _loop_gone(self) -> bool:
        """Whether the loop's process has ended, also where nobody has asked for its exit code yet."""
        if self._loop < 0:
            number = int(self._memory.status["loop_pid"])
            if number == 0:
                return False
            try:
                self._loop = os.pidfd_open(number)
            except ProcessLookupError:
                return True
        return bool(select.select([self._loop], [], [], 0.0)[0])


def main(arguments: Sequence[str] | None = None) -> int:
    """Record a session; returns the exit code."""
    setup, memory = session_process("recorder", LiveSetup, arguments)
    keep_off(setup.real_time.loop_cpu)
    become_real_time(replace(setup.real_time, priority=PRIORITY, lock_memory=False, cpu=-1, freeze_gc=False))
    recorder = Recorder(setup, memory)
    # Ctrl-C is for the session: its end is recorded too.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, recorder.stop)
    try:
        recorder.run()
    except HhsimError as error:
        memory.status["recorder_failed"] = 1
        print("; ".join([f"hhsim: {error}", *getattr(error, "__notes__", ())]), file=sys.stderr)
        return error.exit_code
    except Exception:  # said, and told to the others by the status
        memory.status["recorder_failed"] = 1
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
