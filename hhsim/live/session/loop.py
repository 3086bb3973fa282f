"""Process of the loop: `python -m hhsim.live.session.loop --setup FD`, started by the supervisor.

The loop is the memory of `hhsim.kernels.live`, which ticks and decides in one compiled call, `run_loop`, and what that
needs of Python, which finds the first free place of the shown hands, in another thread while the loop goes on, and
solves the ticks of methods and QP solvers that are not compiled. Of two gloves each has its samples, its commands and
its judgement; periods and ticks are one.

Kernels are ready before the gloves are opened. Each has a driver, a thread that puts its samples into shared memory and
sends it the newest command; it needs the interpreter, which the loop's thread does not, and which no other thread of
this process holds for long. A driver releases its glove however the loop ends; if the process is killed, the watchdog
does.

Exit codes: 0 it was stopped, 1 a fault of hhsim's own, 2 the glove or the pose cannot be reached, or the setup cannot
be used. The reason is the last event and a line on stderr.
"""

import contextlib
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import FrameType
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import SIDES
from hhsim.kernels.live import tick
from hhsim.kernels.live.deadlines import DEADLINES, MISSES, PHASE, account_steal, account_waking, begin_periods
from hhsim.kernels.live.finger_command import COMMANDER, DRY_RUN, INTERLOCK
from hhsim.kernels.live.loop import ASKS_PYTHON, SystemFiles, run_loop
from hhsim.kernels.live.plausibility import NOTES, WATCH, begin_watch
from hhsim.kernels.parallel.thread_team import load_acquire, store_release
from hhsim.kernels.tick.block import HapticBlock
from hhsim.live.cpu_accounts import CpuAccounts
from hhsim.live.device import FORCES, MOST_CHANNELS, GloveInfo
from hhsim.live.drivers.poses import make_pose_source
from hhsim.live.gloves import open_device
from hhsim.live.processes import Stage, exit_code, process_setup
from hhsim.live.real_time import become_ordinary, become_real_time, described, end_with, keep_off, processors_awake
from hhsim.live.session.driver import GloveDriver
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.setup import LiveSetup, OutputLimits, SafetyLimits, WornGlove
from hhsim.live.session.story import Story
from hhsim.result.safety import Safety
from hhsim.result.schema import FAULT, INFORMATION, WARNING
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import OneTick, SceneSolver, warm_up
from hhsim.solver.workspace import zeroed

NEVER = 1 << 60
"""More periods than a session can miss."""
TELL_SECONDS = 0.02
"""Period at which the loop's notes are logged, and hands that it waits for are placed [s]."""
DRIVER_PATIENCE = 10.0
"""Time that the driver has to release the glove and end [s]."""
SWITCH_SECONDS = 0.0005
"""Longest time for which a thread of the loop's process holds the interpreter while another one waits for it [s]."""
BELOW_DRIVER = -2
COMMAND_KILLED = "the command was killed"
WAKE_NS = 800_000
"""Shortest time between two wake-ups of the driver for commands without news [ns]: each tick at 1 kHz. More often, the
driver would do nothing else, and slow the loop on a shared core."""
REFUSED = np.dtype([("channels", np.float64, (MOST_CHANNELS,)), ("known", np.int64, (MOST_CHANNELS,))], align=True)
"""Channels of the last unusable sample, and 1 for those that were finite in the last usable one."""


def deadline_record(period_ns: int, now_ns: int) -> Any:
    """Return `DEADLINES` one period apart, the first one period after `now_ns`, CLOCK_MONOTONIC [ns]."""
    deadlines = zeroed(DEADLINES)
    deadlines[0].period_ns = period_ns
    begin_periods(deadlines[0], now_ns)
    return deadlines


def commander_record(
    limits: OutputLimits, bend_lines: tuple[FloatArray, FloatArray], period: float, *, feels: bool = False
) -> Any:
    """Return the `COMMANDER` of free fingers by `DexmoRegression.bend_lines` and the period of a tick [s].

    `feels` is True if the glove takes forces.
    """
    commander = zeroed(COMMANDER)
    at = commander[0]
    slope, offset = bend_lines
    size = (slope * slope).sum(axis=1, keepdims=True)
    at.configured[:] = limits.stiffness
    at.rise = limits.stiffness_rise * period
    at.move = limits.bend_speed * period
    at.fall[:] = at.configured * (period / limits.ease)
    at.ramp_ticks = max(1, math.ceil(limits.ramp / period))
    at.contact_force = limits.contact_force
    at.feels = int(feels)
    # As `DexmoRegression.bends`, with the division done beforehand.
    at.gain[:] = np.divide(slope, size, out=np.zeros_like(slope), where=size > 0.0)
    at.offset[:] = offset
    return commander


def interlock_record(limits: SafetyLimits, *, dry_run: bool = False, period_ns: int = 1_000_000) -> Any:
    """Return the `INTERLOCK` by which `judge` frees the fingers; a dry run sends nothing and needs no watchdog."""
    interlock = zeroed(INTERLOCK)
    at = interlock[0]
    at.stale_ns = round(1e9 * limits.stale)
    at.watchdog_ns = round(1e9 * limits.watchdog_stale)
    at.eased = limits.overruns if limits.after_stall == "ease" else NEVER
    at.released = limits.release_at(period_ns)
    at.watched = limits.watchdog and not dry_run
    at.always = DRY_RUN if dry_run else 0
    return interlock


def watch_record(info: GloveInfo) -> Any:
    """Return the `WATCH` of a glove before its first sample."""
    watch = zeroed(WATCH)
    watch[0].always_free[list(info.kept_free)] = 1
    watch[0].noiseless = info.noiseless
    begin_watch(watch[0])
    return watch


def loop_options(options: SolverOptions, rate: float) -> SolverOptions:
    """Return the options that a loop solves with: its own period, and one thread.

    Helper threads of a real-time thread would spin on its own processor; results do not depend on their number.
    """
    return replace(options.at_rate(rate), threads=1)


def whose_hands(setup: LiveSetup) -> list[str]:
    """Return what the lines of each hand's log begin with: whose they are, where there are two."""
    return [""] if len(setup.worn) == 1 else [f"{side} hand: " for side in SIDES]


class LoopHand:
    """A hand of a loop: its records of `hhsim.kernels.live`, its row, its log; periods and misses are the loop's."""

    def __init__(self, loop: "LiveLoop", worn: WornGlove, memory: SessionMemory, info: GloveInfo, whose: str) -> None:
        self.memory, setup, period = memory, loop.setup, loop.setup.period_ns
        feels = not set(FORCES).isdisjoint(info.capabilities)
        self.rows: Any = zeroed(memory.ticks.records.dtype)
        rows = self.rows
        rows["haptic_orientation"][:, 0] = 1.0
        rows["input_seq"] = -1
        self.haptic = HapticBlock(*(rows[f"haptic_{name}"].view(np.ndarray) for name in HapticBlock._fields))
        self.live = tick.LiveArrays(
            loop=zeroed(tick.LOOP),
            deadlines=loop.deadlines,
            phase=zeroed(PHASE),
            interlock=interlock_record(setup.safety, dry_run=setup.dry_run, period_ns=period),
            commander=commander_record(setup.output, worn.bend_lines(), 1e-9 * period, feels=feels),
            watch=watch_record(info),
            misses=loop.misses,
            notes=zeroed(NOTES),
            refused=zeroed(REFUSED),
            status=memory.status_array.view(np.recarray),
            row=rows,
            ticks=memory.ticks.records.view(np.recarray),
            ticks_written=memory.ticks.counter,
            samples=memory.samples.records.view(np.recarray),
            samples_written=memory.samples.counter,
        )
        self.story = Story(setup, memory, info, self.live, whose)
        at: Any = self.live.loop[0]
        self.at = at
        at.periods = setup.periods
        at.longest_ns = setup.safety.release_at(period) * period
        at.driver_ns = round(1e9 * setup.safety.heartbeat_stale)
        at.sample_ns = at.pose_ns = at.input_seq = at.arrived_ns = at.latency_ns = -1
        at.usable = 1
        at.wake_ns = WAKE_NS


class LiveLoop:
    """Loop of a session with the glove of each hand as its driver describes it; `now` is the clock of `begin` [ns].

    A tick whose haptic hands are not all known yet, or whose solver raised, is not published: it cannot be replayed.
    `hands` are its hands; `live` has the records of the first one, `at` its record of `LOOP`, `story` its log.
    """

    def __init__(
        self, setup: LiveSetup, memory: SessionMemory, *gloves: GloveInfo, now: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.setup = setup
        self.memory = memory
        self._now = now
        self.deadlines, self.misses = deadline_record(setup.period_ns, now()), zeroed(MISSES)
        self._accounts: CpuAccounts | None = None
        options = loop_options(setup.options, setup.rate)
        each = zip(setup.worn, memory.hands, gloves, whose_hands(setup), strict=True)
        self.hands = tuple(LoopHand(self, *of) for of in each)
        first = self.hands[0]
        self.live, self.story, self.at = first.live, first.story, first.at
        self.one_tick, rows = OneTick(SceneSolver(setup.scene, options)), memory.bodies.records
        bodies = self.one_tick.row.view(np.uint8), rows.view(np.uint8).reshape(len(rows), -1)
        self.world = tick.WorldTick(self.one_tick.haptic, self.one_tick.record, *bodies)
        self._address = 0
        self._signal = ""
        self._run: Any = None

    @property
    def stopped(self) -> str:
        """Reason why the loop is to end, "" while it goes on."""
        reasons = {tick.STOP_SIGNAL: self._signal, tick.STOP_ASKED: self._requested(), tick.STOP_DURATION: "duration"}
        return reasons.get(int(self.at.stop[0]), "")

    def _requested(self) -> str:
        """Return who requested the end by `stop_requested`, "" if nobody has."""
        by = int(self.memory.status["stop_requested"])
        return signal.Signals(-by).name if by < 0 else "stopped" if by else ""

    def stop(self, reason: str) -> None:
        """Make the next tick the last one; safe in a signal handler."""
        if not self.stopped:
            # A loop that has not begun gets a signal for a request to the command.
            self._signal = self._requested() or reason
            self.at.stop[0] = tick.STOP_SIGNAL

    def run(self, cpu: int = -1) -> str:
        """Run until it is stopped, then free the fingers; returns the reason for its end.

        `prepare` has to come before; another thread calls `place` and `tell`. `cpu` is the processor that the calling
        thread stays on, -1 for any.
        """
        try:
            files = self.begin(CpuAccounts(None if cpu < 0 else cpu))
            while not self.stopped or self.at.asks:
                hands = tuple(hand.live for hand in self.hands)
                code = self._run(hands, files, self.world, self._address, self.one_tick.arguments)
                if code == ASKS_PYTHON:
                    self.at.solved = self.solve()
        finally:
            self.end()
        return self.stopped

    def prepare(self) -> None:
        """Compile, or load from the cache, what `run` calls; the solver's own kernels are there."""
        self._address = self.one_tick.address
        compiled: Any = run_loop
        hands = tuple(hand.live for hand in self.hands)
        with contextlib.closing(CpuAccounts()) as accounts:
            accounts.totals()
            given = accounts.files(-1), self.world, self._address, self.one_tick.arguments
            self._run = compiled.entry(hands, *given)
        # `place` has to find its kernels compiled.
        placing = self.at.placing
        store_release(placing, 0, load_acquire(placing, 0))

    def place(self) -> None:
        """Put the shown hands at the nearest free place if the compiled loop waits for it; in another thread.

        This takes many periods for a hand that begins inside.
        """
        placing = self.at.placing
        if load_acquire(placing, 0) != tick.PLACING:
            return
        try:
            for hand, start in zip(self.hands, self.one_tick.begin([hand.haptic for hand in self.hands])):
                hand.at.placed = start
            store_release(placing, 0, tick.PLACED)
        except Exception as error:
            self._solver_failed(error)
            store_release(placing, 0, tick.NOT_PLACED)

    def begin(self, accounts: CpuAccounts) -> SystemFiles:
        """Begin the first period with the accounts of the calling thread; earlier samples, too old, are skipped."""
        begin_periods(self.live.deadlines[0], self._now())
        # The readings that the first tick is compared with.
        self._accounts, misses = accounts, self.misses[0]
        misses.steal_read, misses.steal_ns = 1, accounts.steal_ns()
        woke = self.live.deadlines[0].woke_ns
        account_waking(misses, woke, 0, accounts.cpu_ns(), accounts.run_delay_ns())
        memories = [hand.memory for hand in self.hands]
        wake = [-1 if self.setup.dry_run else memory.wake for memory in memories]
        files = accounts.files(self.memory.sampled, *wake)
        for hand, memory in zip(self.hands, memories):
            hand.at.taken = memory.samples.written
            memory.populate()
            memory.status["heartbeat_ns"] = self._now()
            memory.status["stage"] = Stage.RUNNING
        return files

    def tell(self) -> None:
        """Log the loop's notes, and read accounts that are too slow for a tick; in another thread, now and then."""
        for hand in self.hands:
            hand.story.tell()
        if self._accounts is not None:
            # So that a miss counts only later steal.
            account_steal(self.misses[0], self._accounts.steal_ns())

    def end(self) -> None:
        """Command free fingers to each hand and announce the end, on which the drivers release the gloves."""
        for hand in self.hands:
            status, command = hand.memory.status, hand.live.commander[0]
            command.stiffness[:] = command.phalanx[:] = 0.0
            status["command_stiffness"] = status["command_force"] = 0.0
            status["ending_ns"] = time.monotonic_ns()
            status["stage"] = Stage.ENDING

    def solve(self) -> bool:
        """Solve the tick of `world` from Python; return False if there are no graphic hands."""
        try:
            self.one_tick.solve()
        except Exception as error:  # of whatever kind: the fingers are freed and the loop goes on
            for hand in self.hands:
                hand.at.safety |= int(Safety.SOLVER_FAILED)
            self._solver_failed(error)
            return False
        return True

    def _solver_failed(self, error: Exception) -> None:
        for hand in self.hands:
            hand.story.detail[Safety.SOLVER_FAILED] = f"{type(error).__name__}: {error}"


class Ending:
    """Signal handling: before the loop runs a signal ends the process, then it makes the next tick the last one."""

    loop: LiveLoop | None = None

    def __init__(self) -> None:
        self._signalled = False
        self._supervisor = os.getppid()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.loop is not None:
            # The system sends SIGTERM when the supervisor has died (`end_with`); the parent has changed by then.
            orphan = os.getppid() != self._supervisor
            self.loop.stop(COMMAND_KILLED if orphan else signal.Signals(number).name)
        elif not self._signalled:
            # Once: the second signal may come while the glove is being released.
            self._signalled = True
            raise SystemExit(0)


def run_session(setup: LiveSetup, memory: SessionMemory, ending: Ending) -> None:
    """Make everything ready, run the loop until it is stopped, and leave the gloves released.

    The loop has its own thread, in which compiled code runs, and so has each driver; the calling one places the hands
    at the beginning, and logs the loop's notes. HhsimError if a glove or a pose cannot be reached, or if a driver has
    failed.
    """
    make_ready(setup, memory)
    drivers = []
    with contextlib.ExitStack() as opened:
        for own, hand, whose in zip(setup.worn, memory.hands, whose_hands(setup)):
            hand.status["loop_ready"] = 1
            device = open_device(own.device)
            pose = make_pose_source(own.pose, hand.status, device)
            oldest = setup.oldest_heartbeat_ns
            driver = GloveDriver(hand, device, pose, whose=whose, dry_run=setup.dry_run, oldest_ns=oldest)
            driver.open()
            opened.callback(driver.close)
            drivers.append(driver)
        loop = LiveLoop(setup, memory, *(driver.device.info for driver in drivers))
        loop.prepare()
        facts = [driver.facts() for driver in drivers]
        begin, failures = threading.Event(), list[BaseException]()
        beside = replace(setup.real_time, lock_memory=False, cpu=-1, freeze_gc=False)

        def run() -> None:
            try:
                run_real_time(loop, facts, begin, drivers)
            except BaseException as error:  # raised again below
                failures.append(error)
                loop.end()

        thread = threading.Thread(target=run, name="hhsim-loop", daemon=True)
        ending.loop = loop
        thread.start()
        # What holds the interpreter has a processor to go on: a driver may wait for it.
        sys.setswitchinterval(SWITCH_SECONDS)
        keep_off(setup.real_time.loop_cpu)
        become_real_time(beside, above=BELOW_DRIVER)
        opened.pop_all()
    carrying = [threading.Thread(target=driver.run, args=(beside, begin), daemon=True) for driver in drivers]
    for other in carrying:
        other.start()
    died = ""
    while thread.is_alive():
        loop.place()
        loop.tell()
        died = next((f"the glove's driver {driver.failed}" for driver in drivers if driver.failed), "")
        if died and not loop.stopped:
            loop.stop(died)
        thread.join(TELL_SECONDS)
    begin.set()
    end = time.monotonic() + DRIVER_PATIENCE
    for other in carrying:
        other.join(max(0.0, end - time.monotonic()))
        if other.is_alive():
            memory.log(FAULT, "a glove's driver does not end: it is left")
    become_ordinary()
    loop.tell()
    if failures:
        raise failures[0]
    for hand, fact in zip(memory.hands, facts):
        hand.facts.write(fact | {"reason": loop.stopped})
    if died:
        raise HhsimError(died)


def make_ready(setup: LiveSetup, memory: SessionMemory) -> None:
    """Compile, or load, the kernels of a session's ticks and of its loop."""
    options = loop_options(setup.options, setup.rate)
    if len(setup.worn) > 1:
        # Both hands are far from everything, and their tick has every kernel of a tick of both.
        turn, flexion, abduction = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 5, 3)), np.zeros((1, 5))
        far = HandConfiguration(np.full((1, 3), 100.0), turn, flexion, abduction)
        SceneSolver(setup.scene, options).solve(far, far._replace(position=-far.position))
    if options.method not in ("coupled", "progressive") or setup.seen.free is not None:
        # `coupled` brings a hand out that begins inside the object.
        warm_up(setup.worn[0].model, replace(options, method="coupled"))
    LiveLoop(setup, memory, *(GloveInfo("", ()) for _ in memory.hands)).prepare()


def run_real_time(
    loop: LiveLoop, facts: Sequence[dict[str, Any]], begin: threading.Event, drivers: Sequence[GloveDriver]
) -> None:
    """Become real time, tell the mode, also in the `facts` of each hand's session, and run the loop in this thread.

    Drivers `begin` right before: a glove that plays a motion begins it then; earlier samples of others are discarded.
    """
    memory, wishes = loop.memory, loop.setup.real_time
    mode = become_real_time(wishes)
    with processors_awake(wishes, mode):
        for hand, own in zip(memory.hands, facts):
            own["real_time"] = mode
            hand.facts.write(own)
        memory.log(INFORMATION, f"the loop runs at {loop.setup.rate:g} Hz: {described(mode)}")
        for line in mode["refused"]:
            memory.log(WARNING, line)
        begin.set()
        for driver in drivers:
            driver.begun.wait(DRIVER_PATIENCE)
        loop.run(mode["cpu"])
    become_ordinary()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the loop of a session; returns the exit code."""
    setup, memory = process_setup("loop", arguments)
    ending = Ending()

    def body() -> None:
        if not end_with(setup.supervisor):
            raise HhsimError("the loop's supervisor ended before the loop began")
        run_session(setup, memory, ending)

    memory.tell(loop_pid=os.getpid(), stage=Stage.STARTING)
    try:
        return exit_code(body, lambda text: memory.log(FAULT, text))
    finally:
        memory.tell(stage=Stage.ENDED)


if __name__ == "__main__":
    sys.exit(main())
