"""Supervisor of a live session: starts its processes, watches them, and ends them, the loop first, the watchdog last.

| process | if it dies | then |
|---|---|---|
| loop | the watchdog frees the fingers | the session ends |
| watchdog | the loop frees the fingers | it is restarted, and the fingers come back with their ramp |
| recorder | nothing | the session goes on; the file holds what was written |
| viewer | nothing | the session goes on |

None of them needs the supervisor: if it is killed, the loop frees the fingers and ends.
"""

import contextlib
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from hhsim.errors import HhsimError
from hhsim.live.device import DeviceCounters
from hhsim.live.processes import NOT_BY_THE_USER, ChildProcess, RingReader, Stage, write_setup
from hhsim.live.real_time import keep_off
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.setup import LiveSetup
from hhsim.live.session.statistics import LiveTally
from hhsim.result.miss_cause import by_name
from hhsim.result.schema import FAULT, INFORMATION, WARNING

Say = Callable[[str, int], None]
"""Called with a line of the log and its level."""

LOOP, WATCHDOG, RECORDER, VIEWER = "loop", "watchdog", "recorder", "viewer"
MODULES = {name: f"hhsim.live.session.{name}" for name in (LOOP, WATCHDOG, RECORDER, VIEWER)}

LOOP_PATIENCE = 15.0
"""Time [s] that the loop has to end before SIGTERM, and again before SIGKILL: a busy machine may keep it waiting."""
PREPARATION = 300.0
"""The same for a loop that has not begun, which gets SIGTERM at once: a kernel in compilation is finished first."""
RECORDER_PATIENCE = 60.0
"""Time [s] that the recorder has to end after it wrote a tick."""
TOLD = 1.0
"""Longer waits than this are reported [s]."""
RELEASE_PATIENCE = 0.25
"""Time for the watchdog to free the fingers after a loop that did not [s]: a dozen times what it needs."""
VIEWER_PATIENCE, WATCHDOG_PATIENCE = 15.0, 10.0
SILENCE = 0.5
"""Age of the loop's heartbeat that is reported [s]; the watchdog has freed the fingers long before."""
RESTART_SECONDS = 0.5
"""Shortest time from the begin of a watchdog to that of the next one [s]."""


@dataclass
class SessionOutcome:
    """Outcome of a session, of a hand; `facts` are those that the loop wrote (`SessionMemory.facts`)."""

    reason: str = ""
    seconds: float = 0.0  # duration of the loop
    ticks: int = 0
    missed: int = 0  # periods without a tick
    tally: LiveTally = field(default_factory=LiveTally)
    facts: dict[str, Any] = field(default_factory=dict)
    counters: DeviceCounters = field(default_factory=DeviceCounters)
    record: Path | None = None  # file of the recording, with `recorded` ticks; it lacks `record_lost`
    recorded: int = 0
    record_lost: int = 0
    record_failed: str = ""  # failure that ended the recording early; "" if there was none
    missed_by: dict[str, int] = field(default_factory=dict)  # periods without a tick, by cause
    # Reported events: seconds since the beginning, level, text.
    notices: list[tuple[float, int, str]] = field(default_factory=list)
    watchdog_restarts: int = 0
    watchdog_releases: int = 0  # number of times that the watchdog freed the fingers
    loop_failed: str = ""  # failure that ended the loop early; "" if there was none
    error: str = ""  # what failed, in a line: no glove, a dead loop, a recording that is not whole; "" if nothing did
    side: str = "right"  # of the hand
    fault_at_end: str = ""  # first fault reported while the session ended, fingers not freed for one; "" for none
    beside: "SessionOutcome | None" = None  # of the left hand, in that of the right one

    @property
    def hands(self) -> "tuple[SessionOutcome, ...]":
        """Outcomes of all hands, this one first."""
        return (self,) if self.beside is None else (self, self.beside)


class Supervisor:
    """A live session, as a context manager that ends it in order on every way out.

    It counts the ticks of each hand in `tallies`, and calls `say` for every event while it happens; those of one of two
    hands begin with its name. `memory` is of the first hand.
    """

    def __init__(self, setup: LiveSetup, say: Say = lambda text, level: None) -> None:
        self.setup = setup = replace(setup, real_time=setup.real_time.chosen())
        self._say = say
        self.memory = SessionMemory.create(bodies=setup.recorded_bodies, hands=len(setup.worn))
        self.tallies = [LiveTally(hand.ticks) for hand in self.memory.hands]
        self._events = [RingReader(hand.events) for hand in self.memory.hands]
        self._setups = dict.fromkeys((LOOP, RECORDER, VIEWER), write_setup(setup, self.memory))
        self._setups[WATCHDOG] = write_setup(*setup.for_watchdog(self.memory.descriptors))
        self._children: dict[str, ChildProcess] = {}
        self._outcome, self._ended = SessionOutcome(record=setup.record), False
        self._began = time.monotonic()
        self._loop_hangs = False
        self._processors = os.sched_getaffinity(0)

    def __enter__(self) -> Self:
        """Start all processes; HhsimError if one cannot be started, with none left running."""
        setup = self.setup
        wanted = {
            RECORDER: setup.record is not None,
            WATCHDOG: setup.safety.watchdog and not setup.dry_run,
            LOOP: True,
            VIEWER: setup.rerun is not None,
        }
        self._began = time.monotonic()
        try:
            for name in filter(wanted.get, wanted):
                self._start(name)
        except BaseException as error:
            self.end("a process could not be started" if isinstance(error, OSError) else "interrupted")
            if isinstance(error, OSError):
                raise HhsimError(f"cannot start the processes of the session: {error.strerror or error}") from error
            raise
        keep_off(setup.real_time.loop_cpu)
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self.end("an error" if kind is not None else "")

    @property
    def stage(self) -> Stage:
        """Stage of the session."""
        return Stage(int(self.memory.status["stage"]))

    def pid(self, name: str) -> int | None:
        """Return the process id of `LOOP`, `WATCHDOG`, `RECORDER` or `VIEWER`; None if it does not run."""
        child = self._children.get(name)
        return child.pid if child is not None and child.running else None

    def poll(self) -> bool:
        """Watch the processes, report events and count ticks, ten times a second; True while the session goes on."""
        self._read_rings()
        if self.stage == Stage.RUNNING:
            for tally in self.tallies:
                tally.note(int(self.memory.status["ticks"]), time.monotonic_ns())
        # `end` waits for a loop that was requested to end.
        if not self._children[LOOP].running or self.memory.status["stop_requested"]:
            return False
        self._watch_loop()
        self._watch_watchdog()
        for name, loss in ((RECORDER, "; the rest of the session is not recorded"), (VIEWER, "")):
            child = self._children.get(name)
            if child is None or child.running or child.reported or (child.code == 0 and self.stage == Stage.ENDED):
                continue
            child.reported = True
            if name == RECORDER:
                self._outcome.record_failed = child.how_it_ended()
            self._notice(f"the {name} {child.how_it_ended()}{loss}; the session goes on", WARNING)
        return True

    def request_stop(self, reason: str) -> None:
        """Request the loop to free the fingers and end; the first reason is kept."""
        self._outcome.reason = self._outcome.reason or reason
        self.memory.tell(stop_requested=-NOT_BY_THE_USER.get(reason, -1))

    def end(self, reason: str = "") -> SessionOutcome:
        """End all processes in order for a reason, if nothing else has ended the session; may be called again."""
        if self._ended:
            return self._outcome
        found = self._outcome
        found.reason = found.reason or reason
        self._end_loop()
        if (recorder := self._children.get(RECORDER)) is not None:
            if not self._end_child(RECORDER, RECORDER_PATIENCE, lambda: "writes the rest"):
                found.record_failed = found.record_failed or "the recorder did not end"
            if recorder.code != 0 and not found.record_failed:
                found.record_failed = recorder.last_line() or recorder.how_it_ended()
        self._end_child(VIEWER, VIEWER_PATIENCE, lambda: "shows the rest")
        self._end_child(WATCHDOG, WATCHDOG_PATIENCE, lambda: "frees the fingers once more")
        self._read_rings()
        self._complete()
        self._ended = True
        for child in self._children.values():
            child.close()
        for descriptor in set(self._setups.values()):
            os.close(descriptor)
        with contextlib.suppress(OSError):
            os.sched_setaffinity(0, self._processors)
        return self._outcome

    def _start(self, name: str) -> None:
        self._children[name] = ChildProcess(name, MODULES[name], self._setups[name], self.memory.descriptors)

    def _watch_loop(self) -> None:
        heartbeat, running = int(self.memory.status["heartbeat_ns"]), self.stage == Stage.RUNNING
        silent = 1e-9 * (time.monotonic_ns() - heartbeat)
        hangs = heartbeat > 0 and running and silent > SILENCE
        if hangs and not self._loop_hangs:
            text = f"the loop has given no sign of life for {silent:.1f} s: the watchdog keeps the fingers free"
            self._notice(text, FAULT)
        elif self._loop_hangs and not hangs and running:
            self._notice("the loop is alive again", INFORMATION)
        self._loop_hangs = hangs

    def _watch_watchdog(self) -> None:
        watchdog = self._children.get(WATCHDOG)
        if watchdog is None or watchdog.running or self.stage == Stage.ENDED:
            return
        if not watchdog.reported:
            watchdog.reported = True
            text = f"the watchdog {watchdog.how_it_ended()}: it is started again, the fingers are free until it is back"
            self._notice(text, FAULT)
        due = watchdog.began + RESTART_SECONDS
        if time.monotonic() >= due and self.memory.status["stop_requested"] == 0:
            watchdog.close()
            self._outcome.watchdog_restarts += 1
            self._start(WATCHDOG)

    def _end_loop(self) -> None:
        loop, status = self._children.get(LOOP), self.memory.status
        if loop is None:
            self.memory.tell(stage=Stage.ENDED)
            return
        self.memory.tell(stop_requested=int(status["stop_requested"]) or 1)
        starting = self.stage == Stage.STARTING
        if starting:
            # No finger is held yet, and the request is not read while a kernel is compiled.
            loop.send(signal.SIGTERM)
        self._end_child(LOOP, PREPARATION if starting else LOOP_PATIENCE, self._loop_activity)
        requested = starting and loop.code == -signal.SIGTERM
        if not requested and (loop.code != 0 or self.stage != Stage.ENDED):
            died = loop.code is None or loop.code <= 0
            failed = f"the loop {loop.how_it_ended()}" if died else loop.last_line() or loop.how_it_ended()
            found = self._outcome
            found.loop_failed, found.reason, found.error = failed, found.reason or failed, failed
            if died or status["ticks"]:
                found.error = f"the session ended early: {failed}"
                self._notice(f"{failed}; the watchdog frees the fingers", FAULT)
        if self.stage != Stage.ENDED:
            # The loop is dead. The watchdog stops at ENDED, and has to free the fingers before.
            until = time.monotonic() + RELEASE_PATIENCE
            while self.pid(WATCHDOG) is not None and time.monotonic() < until:
                time.sleep(0.01)
            self.memory.tell(stage=Stage.ENDED)

    def _end_child(self, name: str, patience: float, activity: Callable[[], str]) -> bool:
        """Wait for a process that does `activity`, `patience` [s] before SIGTERM; True if it just ends."""
        child = self._children.get(name)
        if child is None:
            return True
        reported, due = "", time.monotonic() + TOLD

        def progress() -> object:
            nonlocal reported
            self._read_rings()
            if time.monotonic() > due and (doing := activity()) != reported and child.running:
                reported = doing
                self._notice(f"waiting for the {name}, which {doing}", INFORMATION)
            return int(self.memory.status["recorder_ticks" if name == RECORDER else "stage"])

        if child.wait(patience, progress):
            return True
        for number in (signal.SIGTERM, signal.SIGKILL):
            level = WARNING if name == VIEWER else FAULT
            self._notice(f"the {name} does not end: it gets {number.name}", level)
            child.send(number)
            if child.wait(min(patience, LOOP_PATIENCE), progress):
                break
        return False

    def _loop_activity(self) -> str:
        if self.stage == Stage.STARTING:
            return "connects to the glove" if self.memory.status["loop_ready"] else "compiles a kernel"
        return "ends its tick" if self.stage == Stage.RUNNING else "has the glove released"

    def _read_rings(self) -> None:
        """Count new ticks and report new events."""
        for tally, reader in zip(self.tallies, self._events):
            tally.read()
            for event in reader.read(256)[1]:
                text, level = bytes(event["text"]).decode("utf-8", "replace"), int(event["level"])
                # A fault before the first tick is the error that ends the command, which prints it.
                silent = level == FAULT and int(self.memory.status["ticks"]) == 0
                # It is read late where the machine is busy.
                self._notice(text, level, silent=silent, before_end=event["time_ns"] < self.memory.status["ending_ns"])

    def _notice(self, text: str, level: int, *, silent: bool = False, before_end: bool = False) -> None:
        self._outcome.notices.append((time.monotonic() - self._began, level, text))
        if level == FAULT and self.stage >= Stage.ENDING and not before_end:
            self._outcome.fault_at_end = self._outcome.fault_at_end or text
        if silent:
            return
        try:
            self._say(text, level)
        except OSError:
            # The terminal is gone; the session is ended in order all the same.
            self._say = lambda text, level: None

    def _complete(self) -> None:
        """Add to the outcome what the memory of the ended session says, of two hands for each."""
        status, found = self.memory.status, self._outcome
        facts = [hand.facts.read() for hand in self.memory.hands]
        if status["recorder_failed"]:
            found.record_failed = found.record_failed or "the recorder failed"
        if found.record_failed:
            found.error = found.error or f"the recording {found.record} is not whole: {found.record_failed}"
        found.reason = found.reason or str(facts[0].get("reason", "")) or "the loop ended"
        found.ticks, found.missed = int(status["ticks"]), int(status["missed"])
        found.seconds = (found.ticks + found.missed) / self.setup.rate
        found.missed_by = by_name(status["missed_by"])
        found.recorded, found.record_lost = int(status["recorder_ticks"]), int(status["recorder_lost"])
        first, *others = [
            replace(
                found,
                side=worn.model.side,
                tally=tally,
                facts=told,
                counters=DeviceCounters(*map(int, hand.status["counters"])),
                watchdog_releases=int(hand.status["watchdog_releases"]),
            )
            for worn, hand, tally, told in zip(self.setup.worn, self.memory.hands, self.tallies, facts, strict=True)
        ]
        self._outcome = replace(first, beside=others[0]) if others else first
