"""The loop: glove in, graphic hand, fingers out, once a period, in memory that is there before the first tick."""

from collections.abc import Callable
from dataclasses import asdict, replace
from operator import attrgetter
from typing import Any

import numpy as np

from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.state import (
    STATUS_CAPACITY_EXCEEDED,
    STATUS_INPUT_INVALID,
    STATUS_START_INSIDE,
    WORK_TOUCHING,
)
from hhsim.live.device import COUNTERS, GLOVE_SAMPLE, Capability, DeviceCounters, DeviceError, GloveDevice
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import FAULT, INFORMATION, LIVE_TICK, WARNING, SessionMemory
from hhsim.live.ipc.status import Stage
from hhsim.live.loop.deadlines import Clock, Deadlines
from hhsim.live.loop.finger_command import FingerCommander
from hhsim.live.loop.interlock import Interlock, SafetyLog
from hhsim.live.loop.miss_accounts import Accounts, MissAccounts
from hhsim.live.loop.plausibility import GloveWatch, reading_of_no_hand
from hhsim.live.loop.sample_interval import SampleInterval
from hhsim.live.loop.tick_times import TickTimes
from hhsim.live.pose.registry import PoseSource
from hhsim.result.miss_cause import WORDS, MissCause, TimeTaken, by_name
from hhsim.result.safety import Safety
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

MOST_SAMPLES = 64
"""Read in one tick; what is left waits for the next one."""
RECONNECT_SECONDS = 0.01
BEGINS_INSIDE = (
    "the hand begins inside the object: the shown hand begins at the nearest free place, and may be caught there; "
    "begin anew with the hand open, or elsewhere"
)
STEAL_UNREAD = "what the host takes cannot be read in a tick here: periods that it took are named woken late"
_NONE_TAKEN = TimeTaken(0, 0, 0, 0, 0)
COUNTER_TICKS = 16
"""Counters of the glove are shown once in so many ticks."""

_read_counters: Callable[[DeviceCounters], tuple[int, ...]] = attrgetter(*COUNTERS)
_SOLVER_FAILED = int(Safety.SOLVER_FAILED)
_NOT_FINITE = int(Safety.NOT_FINITE)
_OVERRUN_STREAK = int(Safety.OVERRUN_STREAK)
_DEVICE_LOST = int(Safety.DEVICE_LOST)
_STALE_INPUT = int(Safety.STALE_INPUT)


def loop_options(options: SolverOptions, rate: float) -> SolverOptions:
    """The options that a loop solves with: its own period, and one thread.

    Helpers of a real-time thread would spin on its own processor. The same bytes come out with one.
    """
    return replace(options.at_rate(rate), threads=1)


class LiveLoop:
    """A session's loop.

    A tick whose haptic hand is not known yet, or whose solver raised, is not published: there is nothing to replay.

    Args:
        setup: Of the session.
        memory: Of the session; this is the loop that writes it.
        device: The glove, open.
        pose: Of the palm, open.
        clock: CLOCK_MONOTONIC by default.
        accounts: Of who had the processor; the system's by default.

    Attributes:
        deadlines: Of the periods.
        wakeups: How late the loop woke, from the deadline that was slept for.
        latencies: From the newest sample's bytes read to the command sent.
        works: From waking to the end of the tick's work.
    """

    def __init__(
        self,
        setup: LiveSetup,
        memory: SessionMemory,
        device: GloveDevice,
        pose: PoseSource,
        *,
        clock: Clock | None = None,
        accounts: Accounts | None = None,
    ) -> None:
        """Allocate everything; nothing is read, sent or computed yet."""
        self.setup = setup
        self.memory = memory
        self.device = device
        self.pose = pose
        period = setup.period_ns
        self.deadlines = Deadlines(period, clock)
        self._misses = MissAccounts(self.deadlines, accounts)
        self.wakeups, self.latencies, self.works = TickTimes(), TickTimes(), TickTimes()
        self.solver = HandSolver(setup.hand, setup.surface_arrays(), loop_options(setup.options, setup.rate))
        self.commander = FingerCommander(setup.output, setup.bend_lines(), 1e-9 * period)
        self.interlock = Interlock(setup.safety, dry_run=setup.dry_run, period_ns=period)
        self.watch = GloveWatch(device.info)
        self._safety_log = SafetyLog()
        self._interval = SampleInterval()
        self._periods = None if setup.duration is None else max(1, round(setup.duration * setup.rate))
        self._reconnect_ticks = max(1, round(RECONNECT_SECONDS * setup.rate))
        self._longest_ns = setup.safety.release_at(period) * period
        self._next_reconnect = 0
        self._stop = ""
        self._rows = np.zeros(1, LIVE_TICK)
        self._row = self._rows[0]
        self._record = TickRecord(*(self._rows[name] for name in TickRecord._fields))
        names = ("haptic_position", "haptic_orientation", "haptic_flexion", "haptic_abduction")
        self._haptic = HapticBlock(*(self._rows[name] for name in names))
        self._position, self._orientation, self._flexion, self._abduction = (part[0] for part in self._haptic)
        self._graphic, self._phalanx = self._record.flexion[0], self._record.phalanx[0]
        feels = device.info.capabilities & (Capability.FORCE | Capability.POWER)
        self._palm_turn = self._record.orientation[0] if feels else None
        self._samples = np.zeros(MOST_SAMPLES, GLOVE_SAMPLE)
        self._sample_ns = self._pose_ns = -1
        self._input_seq = -1
        self._usable = True
        self._lost = self._stale = False
        self._status = memory.status
        self._due: list[Callable[[], None]] = []
        self._row["input_seq"] = -1
        self._orientation[0] = 1.0

    def stop(self, reason: str) -> None:
        """Make the next tick the last one; safe to call from a signal's handler."""
        self._stop = self._stop or reason

    def run(self) -> str:
        """Run until told otherwise, then release the glove.

        Returns:
            Why it ended.
        """
        self._begin()
        try:
            while not self._stop:
                self.deadlines.wait()
                self._look_for_stop()
                self.tick()
        finally:
            self.end()
        return self._stop

    def _begin(self) -> None:
        status = self._status
        self._pass_over_backlog()
        self.deadlines.start()
        self._misses.begin()
        if self._misses.steal_unread:
            self.memory.log(INFORMATION, STEAL_UNREAD)
        status["heartbeat_ns"] = self.deadlines.woke_ns
        self._log_plausibility()
        status["stage"] = Stage.RUNNING

    def end(self) -> None:
        """Release the glove and say so; may be called twice."""
        self._status["stage"] = Stage.ENDING
        self._status["command_stiffness"] = 0.0
        self.commander.free()
        if not self.setup.dry_run and not self.device.release():
            self.memory.log(FAULT, "the glove could not be told to free the fingers")
        self._status["counters"][:] = _read_counters(self.device.counters)

    def tick(self) -> None:
        """All that is done in a period, after `deadlines.wait`."""
        deadlines, row, status, clock = self.deadlines, self._row, self._status, self.deadlines.clock
        now = deadlines.woke_ns
        status["heartbeat_ns"] = now
        self._misses.woke()
        asked = clock.now()
        arrived = self._take_samples()
        pose_ns = self.pose.read(now, self._position, self._orientation)
        self._misses.device_ns += clock.now() - asked
        if pose_ns >= 0:
            self._pose_ns = pose_ns
        safety = self.interlock.judge(
            now,
            sample_ns=self._sample_ns,
            pose_ns=self._pose_ns,
            usable=self._usable,
            missed=deadlines.missed,
            watchdog_ns=int(status["watchdog_ns"]),
            armed=bool(status["watchdog_armed"]),
            lost=self._lost,
            stopping=bool(self._stop),
        )
        solved = self._sample_ns >= 0 and self._pose_ns >= 0
        if solved:
            solved, safety = self._solve(safety)
        if clock.now() - now >= self._longest_ns:
            # What was judged good then need not be so now.
            safety |= _OVERRUN_STREAK
            self._safety_log.detail[Safety.OVERRUN_STREAK] = "during a tick; the recording tells the cause"
        if safety or not solved:
            self.commander.free()
        asked = clock.now()
        safety, sent = self._send(safety)
        done = clock.now()
        self._misses.device_ns += done - asked
        cause, taken = self._name_miss()
        latency = done - arrived if sent and arrived >= 0 else -1
        if solved:
            row["tick"] = deadlines.tick
            row["time_ns"] = deadlines.deadline_ns
            row["wakeup_ns"] = deadlines.late_ns
            row["latency_ns"] = latency
            row["missed"] = deadlines.missed
            row["input_seq"] = self._input_seq
            row["safety"] = safety
            row["cause"] = cause
            row["taken"] = taken
            row["command_bend"] = self.commander.command.bend
            row["command_stiffness"] = self.commander.command.stiffness
            ticks = self.memory.ticks
            ticks.records[ticks.written % ticks.capacity] = row
            ticks.publish()
        self._show(safety)
        self._count(latency)
        if safety & _STALE_INPUT and not self._stale:
            self._tell_age()
        self._stale = bool(safety & _STALE_INPUT)
        for level, text in self._safety_log.changed(safety, now):
            self.memory.log(level, text, now)
        self._work_at_leisure(clock.now() - now)

    def _name_miss(self) -> tuple[MissCause, TimeTaken]:
        """Who took the time of the periods missed right before this tick; NONE where none was."""
        missed = self.deadlines.missed
        if not missed:
            return MissCause.NONE, _NONE_TAKEN
        taken = self._misses.taken()
        cause = taken.cause()
        self._status["missed_by"][cause - 1] += missed
        self._safety_log.detail[Safety.OVERRUN_STREAK] = f"{missed:,} the last time, {WORDS[cause]}"
        return cause, taken

    def _tell_age(self) -> None:
        stale = self.setup.safety.stale
        self._safety_log.detail[Safety.STALE_INPUT] = (
            f"for more than {1e3 * stale:g} ms, as --stale says{self._interval.hint(stale)}"
        )

    def _pass_over_backlog(self) -> None:
        """Record what came while the loop was made ready, and use none of it: read at once, it has lost its times."""
        try:
            while True:
                count = self.device.read(self._samples)
                self._keep(count)
                if count < MOST_SAMPLES:
                    return
        except DeviceError as error:
            self._lose(error)

    def _keep(self, count: int) -> None:
        ring = self.memory.samples
        for sample in self._samples[:count]:
            ring.records[ring.written % ring.capacity] = sample
            ring.publish()

    def _take_samples(self) -> int:
        """Read the glove; returns when the newest sample's bytes were read [ns], -1 where none came."""
        if self._lost and not self._reconnected():
            return -1
        try:
            count = self.device.read(self._samples)
        except DeviceError as error:
            self._lose(error)
            return -1
        if count == 0:
            return -1
        self._keep(count)
        for sample in self._samples[:count]:
            was_usable, self._usable = self._usable, self.watch.use(sample, self._flexion, self._abduction)
            if was_usable and not self._usable:
                self._safety_log.detail[Safety.NOT_FINITE] = reading_of_no_hand(
                    sample, self.device.info, self.watch.known
                )
            if self._usable:
                self._sample_ns = int(sample["time_ns"])
                self._interval.add(self._sample_ns)
                self._input_seq = int(sample["seq"])
        self._status["sample_ns"] = self._sample_ns
        self._status["battery"] = sample["battery"]
        self._log_plausibility()
        return int(sample["time_ns"])

    def _reconnected(self) -> bool:
        if self.deadlines.tick < self._next_reconnect:
            return False
        self._next_reconnect = self.deadlines.tick + self._reconnect_ticks
        try:
            if not self.device.reconnect():
                return False
        except DeviceError as error:
            self.memory.log(WARNING, f"the glove is still gone: {error}")
            return False
        self._lost = False
        return True

    def _lose(self, error: DeviceError) -> None:
        self._lost = True
        self._safety_log.detail[Safety.DEVICE_LOST] = str(error)

    def _solve(self, safety: int) -> tuple[bool, int]:
        """Solve the tick and make its command; whether there is a graphic hand, and the tick's safety bits."""
        try:
            status = self.solver.tick(self._haptic, self._record)
        except Exception as error:  # whatever it is, the fingers are freed and the loop goes on
            self._safety_log.detail[Safety.SOLVER_FAILED] = f"{type(error).__name__}: {error}"
            return False, safety | _SOLVER_FAILED
        if status & STATUS_CAPACITY_EXCEEDED:
            self._safety_log.detail[Safety.SOLVER_FAILED] = "more contacts than the solver holds"
            safety |= _SOLVER_FAILED
        if status & STATUS_INPUT_INVALID:
            safety |= _NOT_FINITE
        if status & STATUS_START_INSIDE:
            self.memory.log(WARNING, BEGINS_INSIDE)
        if self.interlock.eases:
            self.commander.ease()
        return True, self.commander.update(self._graphic, self._phalanx, safety, self.watch.free, self._palm_turn)

    def _send(self, safety: int) -> tuple[int, bool]:
        """Send the command; the tick's safety bits, and whether the glove has it (or would have it, in a dry run)."""
        if self.setup.dry_run:
            return safety, True
        if self._lost:
            return safety, False
        try:
            return safety, self.device.send(self.commander.command)
        except DeviceError as error:
            self._lose(error)
            self.commander.free()
            return safety | _DEVICE_LOST, False

    def _show(self, safety: int) -> None:
        status, deadlines = self._status, self.deadlines
        status["ticks"] += 1
        status["missed"] = deadlines.missed_total
        status["streak"] = self.interlock.streak
        status["safety"] = safety
        status["contacts"] = self._record.work[0, WORK_TOUCHING]
        status["force"] = self.commander.force
        status["command_bend"] = self.commander.command.bend
        status["command_stiffness"] = self.commander.command.stiffness
        if deadlines.tick % COUNTER_TICKS == 0:
            status["counters"][:] = _read_counters(self.device.counters)

    def _count(self, latency: int) -> None:
        if self.wakeups.add(self.deadlines.late_ns):
            self._due += [self.wakeups.count, self._show_wakeups]
        if latency >= 0 and self.latencies.add(latency):
            self._due += [self.latencies.count, self._show_latencies]

    def _work_at_leisure(self, work_ns: int) -> None:
        """Count the tick's work, and do one thing that was put off: none of them delays what the fingers are told."""
        if self.works.add(work_ns):
            self._due.append(self.works.count)
        if self._due:
            self._due.pop(0)()
        self._misses.at_leisure()

    def _show_wakeups(self) -> None:
        self._status["wakeup_p50_ns"] = self.wakeups.percentile(50.0)
        self._status["wakeup_p99_ns"] = self.wakeups.percentile(99.0)

    def _show_latencies(self) -> None:
        self._status["latency_p50_ns"] = self.latencies.percentile(50.0)
        self._status["latency_p99_ns"] = self.latencies.percentile(99.0)

    def _log_plausibility(self) -> None:
        for level, text in self.watch.events():
            self.memory.log(level, text)

    def _look_for_stop(self) -> None:
        if self._status["stop_requested"]:
            self.stop("stopped")
        if self._periods is not None and self.deadlines.tick + 1 >= self._periods:
            self.stop("duration")

    def summary(self) -> dict[str, Any]:
        """What became of the ticks, as plain values; times in ns."""
        return {
            "reason": self._stop,
            "ticks": int(self._status["ticks"]),
            "missed": self.deadlines.missed_total,
            "missed_by": by_name(self._status["missed_by"]),
            "wakeup": self.wakeups.summary(),
            "latency": self.latencies.summary(),
            "work": self.works.summary(),
            "counters": asdict(self.device.counters),
        }
