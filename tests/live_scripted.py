"""A clock that is told the time and a glove that follows a script: what the tests of the loop run it with."""

import os
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hhsim.hand.model import HandModel
from hhsim.kernels.live import deadlines
from hhsim.kernels.live.loop import DRIVERS, begin_hands, wake_driver
from hhsim.kernels.live.tick import command_tick, give_hands, look_for_stop, publish_hands, take_hands, waiting_since
from hhsim.live.cpu_accounts import CpuAccounts
from hhsim.live.device import LIMITS, DeviceCounters, DeviceError, FingerCommand, GloveDevice, GloveInfo
from hhsim.live.drivers.played import Playback
from hhsim.live.drivers.poses import FixedPose, PoseSource
from hhsim.live.gloves import PoseConfig, configure
from hhsim.live.processes import RingReader, Stage
from hhsim.live.session.driver import GloveDriver
from hhsim.live.session.loop import LiveLoop, deadline_record
from hhsim.live.session.memory import SessionMemory, TickReader
from hhsim.live.session.recorder import Recorder
from hhsim.live.session.setup import LiveSetup, OutputLimits, SafetyLimits, WornGlove, make_live_scene
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import Trajectory
from hhsim.result.reader import Result, load_result
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.solver.options import SolverOptions
from hhsim.trees.sphere_tree import SphereTree
from tools.shapes.generators import sphere

BALL = SphereTree(np.array([[0.0, 0.05, -0.05]]), np.array([0.03]), np.array([0]), np.array([-1]))
"""Before the fingers of a flat hand at the origin; a fist closes on it."""
AT_REST = Trajectory(
    np.zeros(1), np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 5, 3)), np.zeros((1, 5))
)
"""A motion of one sample: a flat hand."""
FREE, FIST = 0.0, 0.9
"""Angles of every joint [rad]: a hand that touches nothing, and one that presses on the ball."""
WAKING_NS = 30_000
"""What it takes to wake a loop by a sample."""


def make_setup(mesh: Mesh | None = None, free: dict[str, Any] | None = None, **changes: Any) -> LiveSetup:
    """A session at 1 kHz with a ball, or a mesh, `free` by arguments of `Scene.freed`."""
    given: dict[str, Any] = {"options": SolverOptions(), "rate": 1000.0, **changes}
    usual = {"hand": HandModel.default(), "device": configure(playback=Playback(AT_REST)), "pose": PoseConfig()}
    hand, device, pose = of_hand = tuple(given.pop(name, value) for name, value in usual.items())
    given.setdefault("worn", (WornGlove(hand, device, pose),))
    if "scene" not in given:
        bodies = DeclaredBodies.of_mesh(mesh or sphere(0.06, 1), BALL)
        freed = (lambda scene: scene) if free is None else (lambda scene: scene.freed(**free))
        given["scene"] = make_live_scene(bodies, *of_hand, None, rate=given["rate"], placed=True, freed=freed).scene
    return LiveSetup(**given)


class FakeClock:
    """Time passes only where it is told to."""

    def __init__(self, start_ns: int = 1_000_000_000) -> None:
        self.time_ns = start_ns
        self.oversleep: list[int] = []
        """How much later than asked the next sleeps end [ns]; none are late when it is empty."""
        self.alarms: list[tuple[int, Callable[[], object]]] = []
        """Sleeps end at these times, if they would go on until later, when something is done that takes its time."""

    def now(self) -> int:
        return self.time_ns

    def sleep_until(self, time_ns: int) -> None:
        if self.alarms and self.alarms[0][0] < time_ns:
            at, action = self.alarms.pop(0)
            self.time_ns = max(self.time_ns, at)
            action()
            self.time_ns += WAKING_NS
            return
        self.time_ns = max(self.time_ns, time_ns + (self.oversleep.pop(0) if self.oversleep else 0))

    def work(self, duration_ns: int) -> None:
        self.time_ns += duration_ns


class FakeAccounts(CpuAccounts):
    """Planted accounts of the loop's thread [ns]."""

    def __init__(self, cpu_ns: int = 0, run_delay_ns: int = 0, steal_ns: int = 0) -> None:
        self.processors = []
        self.schedule = self.stat = -1
        self.steal_step_ns = 1
        self.cpu, self.delay, self.steal = cpu_ns, run_delay_ns, steal_ns

    def cpu_ns(self) -> int:
        return self.cpu

    def run_delay_ns(self) -> int:
        return self.delay

    def steal_ns(self) -> int:
        return self.steal


@dataclass
class Moment:
    """What the glove does in one tick; the driver's time counts in `work_ns` if its sample comes early."""

    angles: float | None = None
    good: bool = True
    reading: float = np.nan
    work_ns: int = 100_000
    early_ns: int = 0
    gone: bool = False
    send_fails: bool = False


@dataclass
class ScriptedGlove(GloveDevice):
    """Plays a script, one moment a tick, and repeats the last one; keeps what it is told."""

    clock: FakeClock
    script: Sequence[Moment]
    at_tick: dict[int, Callable[[], None]] = field(default_factory=dict)
    commands: list[FingerCommand] = field(default_factory=list)
    released: list[int] = field(default_factory=list)
    backlog: int = 0
    """Samples that came before the loop runs, which reads them once beforehand."""
    tick: int = -2

    def __post_init__(self) -> None:
        self.info = GloveInfo("scripted glove", ("bend",), LIMITS)
        self.counters = DeviceCounters()

    def open(self, timeout: float = 5.0) -> None:
        return

    def moment(self, tick: int) -> Moment:
        return self.script[min(max(tick, 0), len(self.script) - 1)]

    def read(self, samples_out: NDArray[np.void]) -> int:
        self.tick += 1
        if self.tick < 0:
            for sample in samples_out[: self.backlog]:
                self._fill(sample, 1.0, True)
            return self.backlog
        moment = self.moment(self.tick)
        self.clock.work(moment.work_ns)
        if self.tick in self.at_tick:
            self.at_tick[self.tick]()
        if moment.gone:
            raise DeviceError("the scripted glove is gone")
        if moment.angles is None:
            return 0
        self._fill(samples_out[0], moment.angles, moment.good)
        samples_out[0]["channels"][0] = moment.reading
        return 1

    def _fill(self, sample: np.void, angles: float, good: bool) -> None:
        sample["seq"] = self.counters.samples
        sample["time_ns"] = self.clock.now()
        sample["device_time_ns"] = sample["device_seq"] = sample["battery"] = -1
        sample["good"] = good
        sample["channels"] = np.nan
        sample["flexion"] = angles
        sample["abduction"] = 0.0
        self.counters.samples += 1

    def send(self, command: FingerCommand) -> bool:
        if self.moment(self.tick).send_fails:
            raise DeviceError("the scripted glove takes nothing")
        self.commands.append(deepcopy(command))
        self.counters.commands += 1
        return True

    def release(self, timeout: float = 0.05) -> bool:
        self.released.append(self.clock.now())
        return True

    def reconnect(self) -> bool:
        return True

    def close(self) -> None:
        return


class Deadlines:
    """The compiled loop's periods, waited for in Python by any clock."""

    def __init__(self, period_ns: int, clock: Any, state: Any = None) -> None:
        self.clock = clock
        self.state = deadline_record(period_ns, clock.now()) if state is None else state
        self.at = self.state[0]

    def wait(self, waiting_since: Callable[[], int] = lambda: deadlines.NOTHING) -> None:
        """Sleep until the next tick is due; `waiting_since`: when something came that no tick has taken [ns]."""
        now = self.clock.now()
        deadlines.next_deadline(self.at, now)
        due = deadlines.due_time(self.at, waiting_since(), now)
        while now < due:
            self.clock.sleep_until(due)
            now = self.clock.now()
            due = deadlines.due_time(self.at, waiting_since(), now)
        deadlines.woken(self.at, now, due)


class SteppedLoop(LiveLoop):
    """The steps of `run_loop`, in Python and by a clock that is told the time."""

    def __init__(
        self, setup: LiveSetup, memory: SessionMemory, clock: FakeClock, accounts: CpuAccounts, *infos: GloveInfo
    ) -> None:
        super().__init__(setup, memory, *infos, now=clock.now)
        self.clock, self.accounts = clock, accounts
        self.deadlines = Deadlines(setup.period_ns, clock, self.live.deadlines)

    def start(self) -> None:
        self._wake = self.begin(self.accounts).descriptors[DRIVERS:].tolist()

    def wait(self) -> None:
        self.deadlines.wait(lambda: int(waiting_since(self.live)))
        look_for_stop(self.live)

    def tick(self) -> None:
        clock, at = self.clock, self.deadlines.at
        misses = self.misses[0]
        if not at.at_once:
            spent = self.accounts.cpu_ns(), self.accounts.run_delay_ns()
            deadlines.account_waking(misses, at.woke_ns, at.wakeup_ns, *spent)
        hands = tuple(hand.live for hand in self.hands)
        solved = bool(begin_hands(hands))
        if solved:
            give_hands(hands, self.world)
            solved = self.solve()
        if solved:
            take_hands(hands, self.world)
        for hand, wake in zip(self.hands, self._wake):
            command_tick(hand.live, clock.now(), solved, int(hand.at.status))
            wake_driver(hand.live, wake, clock.now())
        done = clock.now()
        if at.missed > 0:
            long_stall = deadlines.measure_miss(misses, at.asked_ns, at.late_ns)
            deadlines.name_miss(misses, self.accounts.steal_ns() if long_stall else -1)
        publish_hands(hands, self.world, done, solved)


class InStep:
    """A loop and its driver in one thread: the driver looks right before each tick, and right after it.

    `beside` is the left glove and the source of its palm's pose.
    """

    def __init__(
        self,
        setup: LiveSetup,
        memory: SessionMemory,
        glove: GloveDevice,
        clock: FakeClock,
        *,
        pose: PoseSource | None = None,
        accounts: FakeAccounts | None = None,
        beside: tuple[GloveDevice, PoseSource] | None = None,
    ) -> None:
        self.glove, self.clock = glove, clock
        worn = [(glove, pose or FixedPose(PoseConfig())), *([beside] if beside else [])]
        self.drivers = [
            GloveDriver(own, *of, dry_run=setup.dry_run, now=clock.now) for own, of in zip(memory.hands, worn)
        ]
        self.driver = self.drivers[0]
        infos = (own.info for own, _ in worn)
        self.loop = SteppedLoop(setup, memory, clock, accounts or CpuAccounts(), *infos)

    def run(self) -> str:
        loop = self.loop
        try:
            for driver in self.drivers:
                driver.take()
            loop.start()
            while not loop.stopped:
                self.step()
        finally:
            loop.end()
            for driver in self.drivers:
                driver.close()
            self.tell()
        return loop.stopped

    def step(self) -> None:
        at, glove = self.loop.deadlines.at, self.glove
        moment = glove.moment(glove.tick + 1) if isinstance(glove, ScriptedGlove) else Moment()
        if moment.early_ns:
            end = int(at.deadline_ns + at.period_ns + at.shift_ns)
            self.clock.alarms.append((end - moment.early_ns - moment.work_ns, self.driver.take))
        self.loop.wait()
        for driver in self.drivers:
            if not moment.early_ns or driver is not self.driver:
                driver.take()
        self.loop.tick()
        for driver in self.drivers:
            driver.give()
        self.tell()

    def tell(self) -> None:
        # The logs alone: the loop's own `tell` reads accounts, which a test plants.
        for hand in self.loop.hands:
            hand.story.tell()


QUICK = OutputLimits(ramp=0.01, stiffness_rise=1e4, bend_speed=1e3)
CLOSING = [Moment(FREE + (FIST - FREE) * i / 60) for i in range(60)]
"""A fist that closes on the ball in 60 ms."""


class ScriptedSession:
    """A loop and a scripted glove in step, which need no watchdog and end with the script unless `changes` say so."""

    def __init__(
        self,
        script: Sequence[Moment],
        pose: PoseSource | None = None,
        *,
        unit: str = "",
        takes: tuple[str, ...] = LIMITS,
        **changes: Any,
    ) -> None:
        given: dict[str, Any] = {"output": QUICK, "safety": SafetyLimits(watchdog=False)}
        self.setup = make_setup(**(given | {"duration": 1e-3 * (len(script) + 1)} | changes))
        self.memory = SessionMemory.create(bodies=self.setup.recorded_bodies)
        self.clock, self.accounts = FakeClock(), FakeAccounts()
        self.glove = ScriptedGlove(self.clock, script)
        self.glove.info = GloveInfo("scripted glove", ("bend",), takes, unit=unit)
        self.both = InStep(self.setup, self.memory, self.glove, self.clock, pose=pose, accounts=self.accounts)
        self.loop = self.both.loop

    def solving(self, action: Callable[[], object], *ticks: int) -> None:
        """Let something happen in these ticks when they are to be solved."""
        sound = self.loop.one_tick.solve

        def solve() -> None:
            if self.loop.deadlines.at.tick in ticks:
                action()
            sound()

        self.loop.one_tick.solve = solve

    def run(self) -> Self:
        self.reason = self.both.run()
        self.ticks: NDArray[Any] = TickReader(self.memory).read_hands(10**6)[1][0]
        self.samples = RingReader(self.memory.samples).read(10**6)[1]
        self.events = [text.decode() for text in RingReader(self.memory.events).read(1000)[1]["text"]]
        return self

    def recorded(self, path: Path | None = None) -> Result:
        """The file of the session, which has ended."""
        setup = self.setup if path is None else replace(self.setup, record=path)
        self.memory.status["loop_pid"] = os.getpid()
        self.memory.facts.write(self.both.driver.facts() | {"real_time": {}, "reason": "duration"})
        self.memory.status["stage"] = Stage.ENDED
        Recorder(setup, self.memory).run()
        return load_result(setup.record)


def write_session(path: Path) -> None:
    """A glove that closes on a ball and holds it; nothing goes wrong."""
    script = [*(Moment(FREE + (FIST - FREE) * i / 80) for i in range(80)), *[Moment(FIST)] * 120]
    ScriptedSession(script, record=path, output=OutputLimits(ramp=0.02)).run().recorded()
