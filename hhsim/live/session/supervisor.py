"""Starts the processes of a live session, watches them, and ends them in order: the loop first, the watchdog last.

| process | dies by itself | then |
|---|---|---|
| loop | the watchdog frees the fingers | the session ends |
| watchdog | the loop frees the fingers | it is started again, and the fingers come back with their ramp |
| recorder | nothing | the session goes on; the file holds what was written |
| viewer | nothing | the session goes on |

The supervisor itself is needed by none of them: when it is killed, the loop frees the fingers and ends.
"""

import contextlib
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hhsim.errors import HhsimError
from hhsim.live.child_process import ChildProcess
from hhsim.live.device import DeviceCounters, DeviceError
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import SessionMemory
from hhsim.live.ipc.status import Stage
from hhsim.live.real_time import keep_off
from hhsim.live.session.statistics import LiveTally
from hhsim.live.session.stop_signals import NOT_BY_THE_USER
from hhsim.live.shared_memory import RingReader, write_setup
from hhsim.result.miss_cause import by_name
from hhsim.result.schema import FAULT, INFORMATION, WARNING

Say = Callable[[str, int], None]
"""Called with a line for people and its level."""

LOOP, WATCHDOG, RECORDER, VIEWER = "loop", "watchdog", "recorder", "viewer"
MODULES = {
    LOOP: "hhsim.live.loop.process",
    WATCHDOG: "hhsim.live.loop.watchdog",
    RECORDER: "hhsim.live.session.recorder",
    VIEWER: "hhsim.live.session.viewer",
}

LOOP_PATIENCE = 3.0
"""How much time of its own (`OwnTime`) the loop has to end after it was asked; it then gets SIGTERM,
and SIGKILL after as much again [s]."""
PREPARATION = 60.0
"""How much it has where it has not begun, and gets SIGTERM at once: a kernel that is compiled is first ended [s]."""
RECORDER_PATIENCE = 60.0
"""How much the recorder has without writing a tick [s]."""
TOLD = 1.0
"""What is waited for longer than this is told of [s]."""
RELEASE_PATIENCE = 0.25
"""How long the watchdog has to free the fingers after a loop that did not [s]: a dozen times what it needs."""
VIEWER_PATIENCE = 5.0
WATCHDOG_PATIENCE = 2.0
SILENCE = 0.5
"""A loop without a sign of life for so long is told of [s]; the watchdog has freed the fingers long before."""
RESTART_PAUSES = (0.0, 0.1, 0.5, 2.0)
"""Before a watchdog is started again, the first time, the second and so on [s]."""
STEADY = 10.0
"""A watchdog that has lived so long begins again at the first pause [s]."""


@dataclass
class SessionOutcome:
    """What became of a session.

    Attributes:
        reason: Why it ended.
        seconds: How long the loop ran.
        ticks: That the loop did.
        missed: Periods without a tick.
        tally: Of its ticks.
        facts: What the loop said of it (`SessionMemory.read_facts`).
        counters: Of the device.
        record: The recording, where there is one.
        recorded: Ticks in it.
        record_lost: Ticks that it lacks.
        record_failed: What ended it early; "" where nothing did.
        missed_by: Periods without a tick by who took their time.
        notices: What was reported: seconds since the beginning, level, text.
        watchdog_restarts: How often the watchdog was started again.
        watchdog_releases: How often it freed the fingers.
        loop_failed: How the loop ended, where it did not end as it should.
    """

    reason: str
    seconds: float
    ticks: int
    missed: int
    tally: LiveTally
    facts: dict[str, Any]
    counters: DeviceCounters
    record: Path | None = None
    recorded: int = 0
    record_lost: int = 0
    record_failed: str = ""
    missed_by: dict[str, int] = field(default_factory=dict)
    notices: list[tuple[float, int, str]] = field(default_factory=list)
    watchdog_restarts: int = 0
    watchdog_releases: int = 0
    loop_failed: str = ""


class Supervisor:
    """A live session; use it in a `with`, which ends the session in order on every way out.

    Args:
        setup: Of the session.
        say: Told of what happens while it happens.
    """

    memory: SessionMemory
    tally: LiveTally

    def __init__(self, setup: LiveSetup, say: Say = lambda text, level: None) -> None:
        """Nothing is started yet."""
        setup = replace(setup, real_time=setup.real_time.chosen())
        self.setup = setup
        self._say = say
        self.memory = SessionMemory.create(free=setup.free is not None)
        self.tally = LiveTally(self.memory.ticks)
        self._events = RingReader(self.memory.events)
        descriptor = write_setup(setup)
        self._setups = dict.fromkeys((LOOP, RECORDER, VIEWER), descriptor)
        self._setups[WATCHDOG] = write_setup(setup.for_watchdog(self.memory.descriptors.status))
        self._children: dict[str, ChildProcess] = {}
        self._notices: list[tuple[float, int, str]] = []
        self._reason = ""
        self._loop_failed = ""
        self._record_failed = ""
        self._watchdogs = 0
        self._watchdog_restarts = 0
        self._watchdog_due = 0.0
        self._began = time.monotonic()
        self._never_ran = False
        self._hangs = False
        self._processors = os.sched_getaffinity(0)
        self._outcome: SessionOutcome | None = None

    def __enter__(self) -> Self:
        """Start all processes.

        Raises:
            HhsimError: A process cannot be started; none is left running.
        """
        self._began = time.monotonic()
        try:
            if self.setup.record is not None:
                self._start(RECORDER)
            if self.setup.safety.watchdog and not self.setup.dry_run:
                self._start(WATCHDOG)
            self._start(LOOP)
            if self.setup.rerun is not None:
                self._start(VIEWER)
        except OSError as error:
            self.end("a process could not be started")
            raise HhsimError(f"cannot start the processes of the session: {error.strerror or error}") from error
        except BaseException:
            self.end("interrupted")
            raise
        keep_off(self.setup.real_time.loop_cpu)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.end("an error" if kind is not None else "")

    @property
    def stage(self) -> Stage:
        """Where the session is."""
        return Stage(int(self.memory.status["stage"]))

    @property
    def seconds(self) -> float:
        """Since the beginning [s]."""
        return time.monotonic() - self._began

    def pid(self, name: str) -> int | None:
        """The number of a process that runs, by `LOOP`, `WATCHDOG`, `RECORDER` or `VIEWER`; None where it does not."""
        child = self._children.get(name)
        return child.pid if child is not None and child.running else None

    def poll(self) -> bool:
        """Look after the processes, tell what happened, count the ticks; to be called some ten times a second.

        Returns:
            Whether the session goes on.
        """
        self.tally.read()
        if self.stage == Stage.RUNNING:
            self.tally.note(int(self.memory.status["ticks"]), time.monotonic_ns())
        self._report_events()
        # A loop that was asked to end is waited for by `end`.
        if not self._children[LOOP].running or self.memory.status["stop_requested"]:
            return False
        self._watch_loop()
        self._watch_watchdog()
        for name, loses in ((RECORDER, "the rest of the session is not recorded"), (VIEWER, "")):
            child = self._children.get(name)
            ended_well = child is not None and child.code == 0 and self.stage == Stage.ENDED
            if child is not None and not child.running and not child.reported and not ended_well:
                child.reported = True
                if name == RECORDER:
                    self._record_failed = child.how_it_ended()
                what = f"; {loses}" if loses else ""
                self._notice(f"the {name} {child.how_it_ended()}{what}; the session goes on", WARNING)
        return True

    def request_stop(self, reason: str) -> None:
        """Ask the loop to free the fingers and end; the first reason is kept."""
        self._reason = self._reason or reason
        self.memory.status["stop_requested"] = -NOT_BY_THE_USER.get(reason, -1)

    def end(self, reason: str = "") -> SessionOutcome:
        """End all processes in order; asking again gives the same.

        Args:
            reason: Why, where nothing else has ended the session.

        Returns:
            What became of it.
        """
        if self._outcome is not None:
            return self._outcome
        if reason:
            self._reason = self._reason or reason
        self._end_loop()
        self._end_recorder()
        self._end_child(VIEWER, VIEWER_PATIENCE, lambda: "shows the rest")
        self._end_child(WATCHDOG, WATCHDOG_PATIENCE, lambda: "frees the fingers once more")
        self.tally.read()
        self._report_events()
        self._outcome = self._outcome_now()
        for child in self._children.values():
            child.close()
        for descriptor in set(self._setups.values()):
            os.close(descriptor)
        with contextlib.suppress(OSError):
            os.sched_setaffinity(0, self._processors)
        return self._outcome

    def check(self) -> None:
        """Raise what went wrong, after `end`.

        Raises:
            DeviceError: The glove could not be reached.
            HhsimError: The loop died, or the recording is not whole.
        """
        outcome = self.end()
        if self._loop_failed:
            if self._never_ran:
                raise DeviceError(self._loop_failed)
            raise HhsimError(f"the session ended early: {self._loop_failed}")
        if self._record_failed:
            where = f" {outcome.record}" if outcome.record is not None else ""
            raise HhsimError(f"the recording{where} is not whole: {self._record_failed}")

    def _start(self, name: str) -> ChildProcess:
        setup, memory = self._setups[name], self.memory
        if name == WATCHDOG:
            arguments, descriptors = [], [memory.descriptors.status]
        else:
            arguments, descriptors = memory.arguments(), list(memory.descriptors)
        child = ChildProcess(name, MODULES[name], ["--setup", str(setup), *arguments], [setup, *descriptors])
        self._children[name] = child
        return child

    def _watch_loop(self) -> None:
        heartbeat = int(self.memory.status["heartbeat_ns"])
        silent = 1e-9 * (time.monotonic_ns() - heartbeat)
        hangs = heartbeat > 0 and self.stage == Stage.RUNNING and silent > SILENCE
        if hangs and not self._hangs:
            text = f"the loop has given no sign of life for {silent:.1f} s: the watchdog keeps the fingers free"
            self._notice(text, FAULT)
        elif self._hangs and not hangs and self.stage == Stage.RUNNING:
            self._notice("the loop is alive again", INFORMATION)
        self._hangs = hangs

    def _watch_watchdog(self) -> None:
        watchdog = self._children.get(WATCHDOG)
        if watchdog is None or watchdog.running or self.stage == Stage.ENDED:
            return
        now = time.monotonic()
        if not watchdog.reported:
            watchdog.reported = True
            self._watchdogs = 0 if now - watchdog.began > STEADY else self._watchdogs + 1
            self._watchdog_due = now + RESTART_PAUSES[min(max(self._watchdogs - 1, 0), len(RESTART_PAUSES) - 1)]
            text = f"the watchdog {watchdog.how_it_ended()}: it is started again, the fingers are free until it is back"
            self._notice(text, FAULT)
        if now >= self._watchdog_due and self.memory.status["stop_requested"] == 0:
            watchdog.close()
            self._watchdog_restarts += 1
            self._start(WATCHDOG)

    def _end_loop(self) -> None:
        loop = self._children.get(LOOP)
        if loop is None:
            self.memory.status["stage"] = Stage.ENDED
            return
        self.memory.status["stop_requested"] = self.memory.status["stop_requested"] or 1
        starting = self.stage == Stage.STARTING
        if starting:
            # Nothing is held yet, and nobody looks for what is asked while a kernel is compiled.
            loop.send(signal.SIGTERM)
        self._end_child(LOOP, PREPARATION if starting else LOOP_PATIENCE, self._loop_does)
        asked = starting and loop.code == -signal.SIGTERM
        if not asked and (loop.code != 0 or self.stage != Stage.ENDED):
            died = loop.code is None or loop.code <= 0
            self._loop_failed = f"the loop {loop.how_it_ended()}" if died else loop.last_line() or loop.how_it_ended()
            self._reason = self._reason or self._loop_failed
            self._never_ran = not died and int(self.memory.status["ticks"]) == 0
            if not self._never_ran:
                self._notice(f"{self._loop_failed}; the watchdog frees the fingers", FAULT)
        if self.stage != Stage.ENDED:
            # The loop is dead and writes no more. The watchdog frees the fingers first: it stops when this is ENDED.
            self._let_watchdog_release()
            self.memory.status["stage"] = Stage.ENDED

    def _let_watchdog_release(self) -> None:
        until = time.monotonic() + RELEASE_PATIENCE
        while self.pid(WATCHDOG) is not None and time.monotonic() < until:
            time.sleep(0.01)

    def _end_recorder(self) -> None:
        recorder = self._children.get(RECORDER)
        if recorder is None:
            return
        if not self._end_child(RECORDER, RECORDER_PATIENCE, lambda: "writes the rest"):
            self._record_failed = self._record_failed or "the recorder did not end"
        if recorder.code != 0 and not self._record_failed:
            self._record_failed = recorder.last_line() or recorder.how_it_ended()

    def _end_child(self, name: str, patience: float, does: Callable[[], str]) -> bool:
        """Wait for a process to end, so much of its own time [s] before it gets a signal, and `LOOP_PATIENCE` after.

        Args:
            does: What is waited for.

        Returns:
            Whether it ended by itself.
        """
        child = self._children.get(name)
        if child is None:
            return True
        told, due = "", time.monotonic() + TOLD

        def progress() -> object:
            nonlocal told
            self.tally.read()
            self._report_events()
            if time.monotonic() > due and (doing := does()) != told and child.running:
                told = doing
                self._notice(f"waiting for the {name}, which {doing}", INFORMATION)
            status = self.memory.status
            return int(status["recorder_ticks"] if name == RECORDER else status["stage"])

        for signal_ in (None, signal.SIGTERM, signal.SIGKILL):
            if signal_ is not None:
                level = WARNING if name == VIEWER else FAULT
                self._notice(f"the {name} does not end: it gets {signal_.name}", level)
                child.send(signal_)
            if child.wait_own_time(patience if signal_ is None else min(patience, LOOP_PATIENCE), progress):
                return signal_ is None
        return False

    def _loop_does(self) -> str:
        if self.stage == Stage.STARTING:
            return "connects to the glove" if self.memory.status["loop_ready"] else "compiles a kernel"
        return "ends its tick" if self.stage == Stage.RUNNING else "has the glove released"

    def _report_events(self) -> None:
        _, events = self._events.read(256)
        for event in events:
            text, level = bytes(event["text"]).decode("utf-8", "replace"), int(event["level"])
            if level == FAULT and int(self.memory.status["ticks"]) == 0:
                # Why the loop cannot begin is told as the error that ends the command.
                self._notices.append((self.seconds, level, text))
            else:
                self._notice(text, level)

    def _notice(self, text: str, level: int) -> None:
        self._notices.append((self.seconds, level, text))
        try:
            self._say(text, level)
        except OSError:
            # A terminal that has gone hears nothing more; the session is ended in order all the same.
            self._say = lambda text, level: None

    def _outcome_now(self) -> SessionOutcome:
        status = self.memory.status
        counters = DeviceCounters(*map(int, status["counters"]))
        facts = self.memory.read_facts()
        if not self._record_failed and status["recorder_failed"]:
            self._record_failed = "the recorder failed"
        reason = self._reason or str(facts.get("summary", {}).get("reason", "")) or "the loop ended"
        return SessionOutcome(
            reason=reason,
            seconds=float((status["ticks"] + status["missed"]) / self.setup.rate),
            ticks=int(status["ticks"]),
            missed=int(status["missed"]),
            missed_by=by_name(status["missed_by"]),
            tally=self.tally,
            facts=facts,
            counters=counters,
            record=self.setup.record,
            recorded=int(status["recorder_ticks"]),
            record_lost=int(status["recorder_lost"]),
            record_failed=self._record_failed,
            notices=self._notices,
            watchdog_restarts=self._watchdog_restarts,
            watchdog_releases=int(status["watchdog_releases"]),
            loop_failed=self._loop_failed,
        )
