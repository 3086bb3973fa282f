"""A session's loop: its memory, what it is made of, and what it tells; `hhsim.kernels.live` runs and decides.

The ticks run in one compiled call, `run_loop`. It asks Python for two things: to put the shown hand where it can begin,
which another thread does while the loop goes on, and to solve the ticks of methods and QP solvers that are not
compiled.
"""

import signal
import time
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.live.loop import ASKS_PYTHON, run_loop, wake_driver
from hhsim.kernels.live.notes import NOTES
from hhsim.kernels.live.phase import PHASE
from hhsim.kernels.live.tick import (
    LOOP,
    NOT_PLACED,
    PLACED,
    PLACING,
    STOP_ASKED,
    STOP_DURATION,
    STOP_SIGNAL,
    LiveArrays,
    begin_tick,
    command_tick,
    count_work,
    look_for_stop,
    publish_tick,
    waiting_since,
)
from hhsim.kernels.parallel.atomic import load_acquire, store_release
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.live.device import MOST_CHANNELS, Capability, GloveInfo
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import SessionMemory
from hhsim.live.ipc.status import Stage
from hhsim.live.loop.deadlines import Clock, Deadlines
from hhsim.live.loop.finger_command import FingerCommander
from hhsim.live.loop.interlock import Interlock
from hhsim.live.loop.miss_accounts import NO_FILES, Accounts, MissAccounts
from hhsim.live.loop.plausibility import GloveWatch
from hhsim.live.loop.story import Story
from hhsim.live.loop.tick_times import TickTimes
from hhsim.result.miss_cause import by_name
from hhsim.result.safety import Safety
from hhsim.result.schema import INFORMATION
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import zeroed
from hhsim.system.log_histogram import LogHistogram

STEAL_UNREAD = "what the host takes cannot be read in a tick here: periods that it took are named woken late"
PLACE_SECONDS = 0.001
"""Between two looks for a hand that is to be put somewhere."""
WAKE_NS = 800_000
"""The driver is woken for a command so often, in every tick at 1 kHz, and at once for one with news; more often, it
would do nothing else, and slow the loop where both have threads of one core."""
REFUSED = np.dtype(
    [("channels", np.float64, (MOST_CHANNELS,)), ("known", np.int64, (MOST_CHANNELS,))],
    align=True,
)
"""The channels of a sample that could not be used, and which of them the last usable one had as finite numbers."""

_SOLVER_FAILED = int(Safety.SOLVER_FAILED)


def loop_options(options: SolverOptions, rate: float) -> SolverOptions:
    """The options that a loop solves with: its own period, and one thread.

    Helpers of a real-time thread would spin on its own processor. The same bytes come out with one.
    """
    return replace(options.at_rate(rate), threads=1)


def object_row(rows: Any) -> ObjectRecord:
    """Where a tick with a free object writes what became of it.

    Args:
        rows: Of `hhsim.live.ipc.session_memory.FREE_TICK`, shape (1,).
    """
    fields = {name: rows[name].view(np.ndarray) for name in ObjectRecord._fields}
    first = ObjectRecord._fields.index("contact")
    # The rows of its contacts are numbered from this tick on.
    return ObjectRecord(**fields | {name: fields[name][0] for name in ObjectRecord._fields[first:]})


class LiveLoop:
    """A session's loop.

    A tick whose haptic hand is not known yet, or whose solver raised, is not published: there is nothing to replay.

    Args:
        setup: Of the session.
        memory: Of the session; this is the loop that writes it.
        info: Of the glove, as its driver says.
        clock: Of `tick` and `wait`; CLOCK_MONOTONIC by default, as it always is of `run`.
        accounts: Of who had the processor; the system's by default.

    Attributes:
        deadlines: Of the periods.
        wakeups: How late the loop woke, from the deadline that was slept for.
        latencies: From the newest sample's bytes read to the command handed to the driver.
        works: From waking to the end of the tick's work.
        story: What the loop has to tell.
    """

    def __init__(
        self,
        setup: LiveSetup,
        memory: SessionMemory,
        info: GloveInfo,
        *,
        clock: Clock | None = None,
        accounts: Accounts | None = None,
    ) -> None:
        """Allocate everything; nothing is taken, commanded or computed yet."""
        self.setup = setup
        self.memory = memory
        period = setup.period_ns
        self.deadlines = Deadlines(period, clock)
        self._misses = MissAccounts(self.deadlines, accounts)
        largest = np.zeros(3, np.int64)
        self.wakeups, self.latencies, self.works = (TickTimes(largest[i : i + 1]) for i in range(3))
        options = loop_options(setup.options, setup.rate)
        self.solver = HandSolver(setup.hand, setup.contact_surface(), options, setup.free)
        feels = bool(info.capabilities & (Capability.FORCE | Capability.POWER))
        self.commander = FingerCommander(setup.output, setup.bend_lines(), 1e-9 * period, feels=feels)
        self.interlock = Interlock(setup.safety, dry_run=setup.dry_run, period_ns=period)
        self.watch = GloveWatch(info)
        self._rows: Any = zeroed(memory.ticks.records.dtype)
        self._rows["haptic_orientation"][:, 0] = 1.0
        self._rows["input_seq"] = -1
        self._record = TickRecord(*(self._rows[name].view(np.ndarray) for name in TickRecord._fields))
        self._object = None if setup.free is None else object_row(self._rows)
        names = ("haptic_position", "haptic_orientation", "haptic_flexion", "haptic_abduction")
        self._haptic = HapticBlock(*(self._rows[name].view(np.ndarray) for name in names))
        self._loop = zeroed(LOOP)
        self.at: Any = self._loop[0]
        self._refused = zeroed(REFUSED)
        notes = zeroed(NOTES)
        self.live = LiveArrays(
            loop=self._loop,
            deadlines=self.deadlines.state,
            phase=zeroed(PHASE),
            interlock=self.interlock.state,
            commander=self.commander.state,
            watch=self.watch.state,
            misses=self._misses.state,
            notes=notes,
            refused=self._refused,
            status=memory.status_block.array.view(np.recarray),
            row=self._rows,
            ticks=memory.ticks.records.view(np.recarray),
            ticks_written=memory.ticks.counter,
            samples=memory.samples.records.view(np.recarray),
            samples_written=memory.samples.counter,
            wakeups=self.wakeups.counts,
            latencies=self.latencies.counts,
            works=self.works.counts,
            largest=largest,
        )
        self.story = Story(setup, memory, info, notes, self._refused, self._loop)
        self._signal = ""
        self._block: Any = None
        self._run: Any = None
        self._set_limits(setup)

    def _set_limits(self, setup: LiveSetup) -> None:
        at, period = self.at, setup.period_ns
        at.periods = -1 if setup.duration is None else max(1, round(setup.duration * setup.rate))
        at.longest_ns = setup.safety.release_at(period) * period
        at.driver_ns = round(1e9 * setup.safety.heartbeat_stale)
        at.sample_ns = at.pose_ns = at.input_seq = at.arrived_ns = at.latency_ns = -1
        at.usable = 1
        at.wake_ns = WAKE_NS
        at.ratio = LogHistogram.RATIO

    @property
    def compiled(self) -> bool:
        """Whether no tick needs Python."""
        return bool(self._block[0])

    @property
    def stopped(self) -> str:
        """Why the loop is to end, "" while it is not."""
        code = int(self._loop["stop"][0, 0])
        return {STOP_SIGNAL: self._signal, STOP_ASKED: self._asked(), STOP_DURATION: "duration"}.get(code, "")

    def _asked(self) -> str:
        """Who asks for the end by `stop_requested`, "" while nobody does."""
        by = int(self.memory.status["stop_requested"])
        return signal.Signals(-by).name if by < 0 else "stopped" if by else ""

    def stop(self, reason: str) -> None:
        """Make the next tick the last one; safe to call from a signal's handler."""
        if not self.stopped:
            # A loop that has not begun is sent a signal for what the command was asked.
            self._signal = self._asked() or reason
            self._loop["stop"][0, 0] = STOP_SIGNAL

    def run(self, cpu: int = -1) -> str:
        """Run until told otherwise, then free the fingers.

        `prepare` came before; other threads call `place` and `tell`.

        Args:
            cpu: The processor that the calling thread stays on; -1 for any.

        Returns:
            Why it ended.
        """
        try:
            files = self.begin(cpu)
            while not self.stopped or self.at.asks:
                address, block = self._block
                code = self._run(self.live, files, address, block)
                if code == ASKS_PYTHON:
                    self.at.solved, self.at.status = self._solve()
        finally:
            self.end()
        return self.stopped

    def prepare(self) -> None:
        """Compile, or load from the cache, what `run` calls; the solver's own kernels are there."""
        address, block = self.solver.compiled_tick(self._haptic, self._record, self._object)
        self._block = address, block
        compiled: Any = run_loop
        self._run = compiled.entry(self.live, NO_FILES, *self._block) if JIT_ENABLED else run_loop
        # What `place` calls is compiled here, and not while a hand waits for it.
        placing = self._loop["placing"][0]
        store_release(placing, 0, load_acquire(placing, 0))

    def place(self) -> None:
        """Put the shown hand where it can begin, once there is a user's hand; returns then, or with the session's end.

        Of a loop that is `compiled`, in another thread than its own: it takes many periods where the hand begins inside
        the object.
        """
        placing, status = self._loop["placing"][0], self.memory.status
        while load_acquire(placing, 0) != PLACING:
            if status["stage"] >= Stage.ENDING:
                return
            time.sleep(PLACE_SECONDS)
        try:
            self.at.status = self.solver.begin(self._haptic)
            store_release(placing, 0, PLACED)
        except Exception as error:  # as of a tick
            self.story.detail[Safety.SOLVER_FAILED] = f"{type(error).__name__}: {error}"
            store_release(placing, 0, NOT_PLACED)

    def begin(self, cpu: int = -1) -> Any:
        """Begin the first period, and pass over what came before: read at once, it has lost its times.

        Args:
            cpu: As in `run`.

        Returns:
            What compiled code reads of the system.
        """
        self.at.taken = self.memory.samples.written
        self.deadlines.start()
        files = self._misses.begin(cpu)
        files.descriptors[2:] = -1 if self.setup.dry_run else self.memory.wake, self.memory.sampled
        self._wake = int(files.descriptors[2])
        if self._misses.steal_unread:
            self.memory.log(INFORMATION, STEAL_UNREAD)
        status = self.memory.status
        self.memory.populate()
        status["heartbeat_ns"] = self.deadlines.clock.now()
        status["stage"] = Stage.RUNNING
        return files

    def tell(self) -> None:
        """Tell what the loop notes, and read what is too slow to be read in a tick; in another thread, now and then."""
        self.story.tell()
        self._misses.keep_steal()

    def end(self) -> None:
        """Command free fingers and say that the session ends, on which the driver releases the glove."""
        status = self.memory.status
        self.commander.command.stiffness[:] = 0.0
        self.commander.command.force[:] = 0.0
        status["command_stiffness"] = status["command_force"] = 0.0
        status["stage"] = Stage.ENDING

    def wait(self) -> None:
        """Sleep until the next period, in Python."""
        self.deadlines.wait(lambda: int(waiting_since(self.live)))
        look_for_stop(self.live)

    def tick(self) -> None:
        """All that is done in a period, after `wait`, in Python: what `run_loop` does, on whatever clock."""
        clock, live = self.deadlines.clock, self.live
        self._misses.woke()
        solved, status = bool(begin_tick(live)), 0
        if solved:
            solved, status = self._solve()
        command_tick(live, clock.now(), solved, status)
        wake_driver(live, self._wake, clock.now())
        done = clock.now()
        self._misses.name()
        publish_tick(live, done, solved)
        count_work(live, clock.now())

    def _solve(self) -> tuple[bool, int]:
        """Whether there is a graphic hand, and the solver's status bits."""
        try:
            return True, self.solver.tick(self._haptic, self._record, self._object)
        except Exception as error:  # whatever it is, the fingers are freed and the loop goes on
            self.at.safety |= _SOLVER_FAILED
            self.story.detail[Safety.SOLVER_FAILED] = f"{type(error).__name__}: {error}"
            return False, 0

    def summary(self) -> dict[str, Any]:
        """What became of the ticks, as plain values; times in ns."""
        status = self.memory.status
        return {
            "reason": self.stopped,
            "ticks": int(status["ticks"]),
            "missed": int(status["missed"]),
            "missed_by": by_name(status["missed_by"]),
            "wakeup": self.wakeups.summary(),
            "latency": self.latencies.summary(),
            "work": self.works.summary(),
        }
