"""Fault drills: whatever breaks, the glove is told stiffness 0 in time, and what can go on goes on.

Each drill first has a finger stopped and the user's hand held still, so that there is something to free. Processes are
killed as a crash would kill them. The time is taken from the fault to the last instant at which the glove was told, or
would have been told, to hold a finger: by the server's own log where it lives, else by the session's ticks. What the
machine took of it, by the system's accounts, is no part of it (`machine_share.MachineShare`).

The faults that a session survives are held in one session; a drill that fails takes it along, and the next has another.
"""

import contextlib
import json
import os
import re
import resource
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest
from fake_gloves import FakeDexmo
from live_peers import free_ports, until
from machine_share import MachineShare, assert_in_time, keeps_time
from numpy.typing import NDArray
from own_command import HHSIM

from hhsim.hand.model import SIDES, HandModel
from hhsim.kernels.live.plausibility import TRUST
from hhsim.live.gloves import Hand, PoseConfig, configure
from hhsim.live.processes import RingReader, Stage
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.setup import LiveScene, LiveSetup, OutputLimits, grasping_hand, make_live_scene
from hhsim.live.session.supervisor import LOOP, RECORDER, WATCHDOG, Supervisor
from hhsim.mesh.catalogue import load_object
from hhsim.result.reader import load_result
from hhsim.result.safety import Safety
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import warm_up
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

pytestmark = [pytest.mark.slow, keeps_time]

IN_TIME = 50_000_000
"""Fingers are free so long after a fault [ns], the machine's share taken out (`MachineShare`)."""
PATIENCE = 180.0
"""Longest wait for something that comes soon on a quiet machine [s]."""
JUST_BEFORE = 1_000_000_000
"""A finger is held so shortly before a fault [ns]."""
STIFF = 0.2
RATE = 250.0
"""Ticks a second [Hz]."""


def grasping_setup(ports: Sequence[int], record: Path | None = None, sides: Sequence[Hand] = ("right",)) -> LiveSetup:
    """Fingers that close on a cube at the place where they grasp it, and are stopped soon."""
    right, *left = (grasping_scene(port, side) for port, side in zip(ports, sides))
    for scene in left:
        right = right.both(scene)
    if not left:
        warm_up(right.scene.hands[0].model, SolverOptions())
    return LiveSetup(
        **right._asdict(),
        options=SolverOptions(),
        output=OutputLimits(stiffness=(0.5,) * 5, stiffness_rise=50.0, ramp=0.1),
        record=record,
        duration=600.0,
        rate=RATE,
    )


def grasping_scene(port: int, side: Hand) -> LiveScene:
    """The cube, and a glove of a hand where it grasps it: the left one beside the right one."""
    item = load_object("cube")
    tree = cached_sphere_tree(item.mesh, TreeOptions(level=3))
    device = configure("dexmo", port=port, hand=side)
    hand, bodies = HandModel.default(side), DeclaredBodies.of_mesh(item.mesh, tree)
    other = None if side == "right" else grasping_hand(HandModel.default("right"), tree, None)
    return make_live_scene(bodies, hand, device, PoseConfig("fixed"), None, rate=RATE, other=other)


class Fault:
    """Something that is broken on purpose between `before` and `since` [ns]; `processes` carry word of it."""

    def __init__(self, breaks: Callable[[], object], *processes: int) -> None:
        self._share = MachineShare(*processes)
        self.before = time.monotonic_ns()
        breaks()
        self.since = time.monotonic_ns()
        self._over = False
        self._allowed = IN_TIME

    def look(self) -> None:
        """Read what the machine took so far: what a process waited that ends before is not known."""
        if not self._over:
            self._allowed = IN_TIME + self._share.taken_ns

    def is_over(self, now: int) -> bool:
        """Whether fingers may be held no more at this time [ns]; from then on `allowed` stays as it is."""
        self.look()
        self._over = self._over or now > self.since + self._allowed
        return self._over

    @property
    def allowed(self) -> int:
        """How long after it fingers may still be held [ns]."""
        self.look()
        return self._allowed


class Drill:
    """A session of a glove for each of `sides`, at a server of its own, and what they saw; `glove` is the first one."""

    def __init__(self, folder: Path, sides: Sequence[Hand] = ("right",), *, recorded: bool = True) -> None:
        self.log: list[str] = []
        self._stack, self._sides = ExitStack(), sides
        self._record = folder / "session.h5" if recorded else None
        self.gloves = [FakeDexmo(folder / f"{side}.log", "--gloves", f"7:{side}") for side in sides]
        self.glove = self.gloves[0]
        self._ticks: list[NDArray[Any]] = []

    def __enter__(self) -> Self:
        for glove in self.gloves:
            glove.port = free_ports(socket.SOCK_STREAM)
            self._stack.enter_context(glove)
        setup = grasping_setup([glove.port for glove in self.gloves], self._record, self._sides)
        self.session = self._stack.enter_context(Supervisor(setup, lambda text, level: self.log.append(text)))
        self.hands = self.session.memory.hands
        self._ring = RingReader(self.session.memory.ticks)
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.close()

    def until(self, reached: Callable[[], bool], what: str) -> None:
        """Look after the session until something is so."""
        limit = time.monotonic() + PATIENCE
        while not reached():
            assert self.session.poll(), f"the session ended before {what}: {self.session.end().notices}"
            assert time.monotonic() < limit, f"no {what} within {PATIENCE:g} s: {self.session.end().notices}"
            time.sleep(0.002)

    def fault(self, breaks: Callable[[], object]) -> Fault:
        """Break something, while a finger is held."""
        running = (self.session.pid(name) for name in (LOOP, WATCHDOG))
        return Fault(breaks, *(glove.pid for glove in self.gloves), *(pid for pid in running if pid is not None))

    def kill_pid(self, pid: int, number: int = signal.SIGKILL) -> Fault:
        """Kill a process as a crash would, or send it another signal."""
        return self.fault(lambda: os.kill(pid, number))

    def kill(self, name: str, number: int = signal.SIGKILL) -> Fault:
        """The same by the process's name."""
        return self.kill_pid(self.session.pid(name), number)

    def let_it_end(self, fault: Fault) -> None:
        """Look after the session until it ends of a fault."""
        while self.session.poll():
            fault.is_over(time.monotonic_ns())
            time.sleep(0.002)
        self.session.end()

    @property
    def sound(self) -> bool:
        """Return True if another drill can be held with it."""
        return self.session.pid(LOOP) is not None and self.session.stage == Stage.RUNNING

    @property
    def ticks(self) -> NDArray[Any]:
        """All ticks so far."""
        _, more = self._ring.read(16_000)
        self._ticks.append(more)
        self._ticks = [np.concatenate(self._ticks)]
        return self._ticks[0]

    def until_held(self) -> None:
        """Look after the session until a finger of each hand is stopped."""
        self.until(lambda: min(held_by(hand) for hand in self.hands) > STIFF, "finger that is stopped")

    def grasp(self) -> None:
        """Wait until a finger of each hand is held, and let the user's hands stand still there."""
        for hand, glove in zip(self.hands, self.gloves):
            glove.order("move")
            self.until(lambda hand=hand: held_by(hand) > STIFF, "finger that is stopped")
            glove.order("hold")
        self.go_on(0.1)
        self.until_held()

    def go_on(self, seconds: float) -> None:
        """Look after the session for a time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.session.poll()
            time.sleep(0.002)

    def still_holds(self) -> None:
        """The loop goes on after a fault that is none of its business, and a finger is held as before."""
        before = len(self.ticks)
        self.go_on(0.2)
        # A machine that is busy may let the input grow old meanwhile: then they are held again soon.
        self.until_held()
        assert self.session.stage == Stage.RUNNING
        assert stiff(self.ticks[before:]).any()

    def order(self, text: str) -> Fault:
        """Have the glove do something that is a fault."""
        return self.fault(lambda: self.glove.order(text))

    def until_over(self, fault: Fault, seen: Callable[[], NDArray[Any]]) -> None:
        """Look after the session until `seen`, commands or ticks, go beyond the time in which fingers may be held."""

        def over() -> bool:
            rows = seen()
            return bool(rows.size) and fault.is_over(int(rows["time_ns"][-1]))

        self.until(over, "command after the time in which fingers may be held")

    def commands(self) -> NDArray[Any]:
        """What the glove was told so far."""
        return self.glove.commands


def held_by(hand: SessionMemory) -> float:
    """What the stiffest finger of a hand is told now."""
    return float(hand.status["command_stiffness"].max())


def assert_free_in_time(commands: NDArray[Any], fault: Fault, late: int = 0) -> None:
    """Fingers were held right before a fault, and `commands` holds none of them any more soon after it."""
    times = commands["time_ns"][stiff(commands)]
    assert ((times < fault.before) & (times > fault.before - JUST_BEFORE)).any(), "nothing was held: it shows nothing"
    assert_in_time(int(times.max()) - fault.since, fault.allowed + late)


def assert_told_free(commands: NDArray[Any], fault: Fault) -> None:
    """The same, and a glove is told so, and not only told nothing more."""
    assert_free_in_time(commands, fault)
    freed = commands["time_ns"][~stiff(commands) & (commands["time_ns"] > fault.before)]
    assert_in_time(int(freed.min()) - fault.since, fault.allowed)
    assert not stiff(commands[-1:]).any()


def stiff(commands: NDArray[Any]) -> NDArray[np.bool_]:
    """Which commands, or ticks, hold a finger."""
    names = commands.dtype.names or ()
    return np.asarray((commands["stiffness" if "stiffness" in names else "command_stiffness"] > 0.0).any(axis=1))


DRIVER = "driver"
KILL, STOP = signal.SIGKILL, signal.SIGSTOP
ENOUGH = 150
"""Ticks that are recorded before the recorder meets its fault."""
HANGS = "hangs"
HANGING = """
import os, time
from hhsim.live.drivers.dexmo import DexmoGlove
read = DexmoGlove.read
def hang(self, samples_out):
    while os.path.exists({flag!r}):
        if os.path.getsize({flag!r}):
            raise RuntimeError("on purpose")
        time.sleep(0.01)
    return read(self, samples_out)
DexmoGlove.read = hang
"""
"""Has a driver's thread hang as long as a file is there, and fail where it is not empty."""


@pytest.fixture(scope="module", autouse=True)
def kernels() -> None:
    """Scene and kernels are made before a drill begins."""
    grasping_setup([1])


@pytest.fixture(scope="module")
def running() -> Iterator[contextlib.ExitStack]:
    """Ends the session of `HELD`."""
    with contextlib.ExitStack() as stack:
        yield stack
    HELD.clear()


HELD: list[Drill] = []
"""The session with a recorder that drills use in turn, for the faults that it survives."""


@pytest.fixture
def drill(
    request: pytest.FixtureRequest, running: contextlib.ExitStack, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Drill]:
    """The session, made anew after a drill that failed: none fails since the one before it did."""
    if not HELD or not HELD[0].sound:
        running.close()
        folder = tmp_path_factory.mktemp("drill")
        (folder / "sitecustomize.py").write_text(HANGING.format(flag=str(folder / HANGS)))
        running.enter_context(pytest.MonkeyPatch.context()).setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
        HELD[:] = [running.enter_context(Drill(folder))]
    yield HELD[0]
    if getattr(request.node, "has_failed", False):
        HELD.clear()


def assert_ramp(drill: Drill, since: int) -> None:
    """A finger is held again, and no harder than the ramp lets it be since then, however late a command comes."""
    drill.until_held()
    drill.go_on(0.05)
    commands = drill.commands()
    held = commands[(commands["time_ns"] > since) & stiff(commands)]
    assert len(held)
    setup = drill.session.setup
    # The ramp rises by the period, of which the first and the last one need not be whole.
    risen = (1e-9 * (held["time_ns"] - since) + 2.0 / setup.rate) / setup.output.ramp
    most = 1.001 * max(setup.output.stiffness) * risen
    assert (held["stiffness"].max(axis=1) <= most).all(), "they come back by the ramp"


def flag_of(drill: Drill) -> Path:
    """The file at which the driver hangs."""
    return drill.session.setup.record.parent / HANGS


@dataclass(frozen=True)
class Trouble:
    """An order to the glove's server and the one that ends it, the bit of the status, and a word in the log."""

    order: str
    mend: str
    bit: Safety | None
    word: str = ""
    told: bool = True
    """Whether the glove's own log tells when it was freed."""


TROUBLES = (
    Trouble("unplug", "plug", Safety.STALE_INPUT),
    Trouble("stall", "go", Safety.STALE_INPUT, told=False),
    Trouble("swap", "swap", Safety.STALE_INPUT, "says that it is a left hand's now"),
    Trouble("jump", "move", None, "finger jumped by"),
)


@pytest.mark.parametrize("trouble", TROUBLES, ids=lambda trouble: trouble.order)
@pytest.mark.quick("unplug", "jump")
def test_a_glove_in_trouble_is_freed_and_held_again(drill: Drill, trouble: Trouble) -> None:
    drill.grasp()
    fault = drill.order(trouble.order)
    drill.until_over(fault, lambda: drill.ticks)
    ticks = drill.ticks
    if trouble.bit is None:
        # Who comes late to look may find the fingers trusted again.
        ticks = ticks[ticks["time_ns"] < fault.before + 1e9 * TRUST]
    else:
        assert drill.session.memory.status["safety"] & trouble.bit
    assert_free_in_time(ticks, fault)
    if trouble.told and trouble.bit is not None:
        drill.until_over(fault, drill.commands)
        assert_free_in_time(drill.commands(), fault)
    drill.until(lambda: trouble.word in " ".join(drill.log), "word of it")
    heard = len(drill.commands())
    mended = drill.order(trouble.mend)
    if trouble.told:
        drill.until_held()
        return
    drill.until_held()
    # What waited in the connection is read in its order: held fingers, then free ones, and then those of the ramp.
    commands = drill.commands()[heard:]
    free = commands["time_ns"][~stiff(commands)]
    assert free.size
    assert_in_time(free[0] - mended.since, mended.allowed)


def test_peer_dies_and_comes_back(drill: Drill) -> None:
    drill.grasp()
    died = drill.fault(drill.glove.kill)
    status = drill.session.memory.status
    drill.until(lambda: bool(status["safety"] & Safety.DEVICE_LOST), "loss of the glove")
    drill.until_over(died, lambda: drill.ticks)
    assert_free_in_time(drill.ticks, died)
    back = time.monotonic_ns()
    drill.glove.start()
    assert_ramp(drill, back)


@dataclass(frozen=True)
class Loss:
    """A process that gets a signal while a finger is held, or a driver that hangs; the bit, and a word in the log."""

    process: str
    number: signal.Signals
    bit: Safety | None = None
    word: str = ""


LOSSES = (
    Loss(LOOP, STOP, word="the loop has given no sign of life"),
    Loss(DRIVER, STOP, Safety.DEVICE_LOST, "its driver has given no sign of life"),
    Loss(WATCHDOG, STOP, Safety.NO_WATCHDOG),
    Loss(WATCHDOG, KILL, Safety.NO_WATCHDOG, "the watchdog was ended by SIGKILL"),
    Loss(RECORDER, STOP),
)


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: f"{loss.process} {loss.number.name}")
@pytest.mark.quick("loop SIGSTOP", "driver SIGSTOP", "watchdog SIGKILL")
def test_a_process_is_lost_and_the_session_goes_on(drill: Drill, loss: Loss) -> None:
    drill.grasp()
    watchdog = drill.session.pid(WATCHDOG)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        # No signal ends the watchdog before the loop has ended.
        os.kill(watchdog, number)
    if loss.process == DRIVER:
        lost, mend = drill.fault(flag_of(drill).touch), flag_of(drill).unlink
    else:
        pid = drill.session.pid(loss.process)
        assert Path(f"/proc/{pid}/comm").read_text() == f"hhsim-{loss.process}\n"
        lost, mend = drill.kill_pid(pid, loss.number), partial(os.kill, pid, signal.SIGCONT)
    try:
        if loss.process == RECORDER:
            drill.still_holds()
            return
        if loss.process == WATCHDOG:
            status = drill.session.memory.status
            drill.until(lambda: bool(status["safety"] & Safety.NO_WATCHDOG), "word of the lost watchdog")
            stale = round(1e9 * drill.session.setup.safety.watchdog_stale)
            assert_free_in_time(drill.ticks, lost, stale)
        else:
            # The watchdog says it again and again.
            late = lost.since + lost.allowed
            drill.until(lambda: (drill.commands()["time_ns"] > late).sum() > 3, "words of the watchdog")
            drill.until_over(lost, drill.commands)
            assert_free_in_time(drill.commands(), lost)
        if loss.process == DRIVER:
            drill.until_over(lost, lambda: drill.ticks)
            assert_free_in_time(drill.ticks, lost)
        if loss.bit is not None:
            assert drill.session.memory.status["safety"] & loss.bit
        drill.until(lambda: loss.word in " ".join(drill.log), "word of it")
    finally:
        going = time.monotonic_ns()
        if loss.number == STOP:
            mend()
    if loss.process == WATCHDOG:
        drill.until_held()
    else:
        assert_ramp(drill, going)
    assert (drill.session.pid(WATCHDOG) == watchdog) == ((loss.process, loss.number) != (WATCHDOG, KILL))


def test_disk_full(drill: Drill) -> None:
    drill.grasp()
    status, path = drill.session.memory.status, drill.session.setup.record
    drill.until(lambda: int(status["recorder_ticks"]) > ENOUGH, "recorded ticks")
    # The file may not grow any more: a full disk that needs no root.
    size = path.stat().st_size
    resource.prlimit(drill.session.pid(RECORDER), resource.RLIMIT_FSIZE, (size, size))
    drill.until(lambda: drill.session.pid(RECORDER) is None, "full disk")
    drill.still_holds()
    assert status["recorder_failed"]
    assert any("the recorder ended with code 2: " in text for text in drill.log), drill.log
    result = load_result(path)
    assert not result.complete and result.ticks > ENOUGH


def test_a_process_is_killed_that_ends_the_session(tmp_path: Path) -> None:
    with Drill(tmp_path) as drill:
        drill.grasp()
        drill.until(lambda: int(drill.session.memory.status["recorder_ticks"]) > ENOUGH, "recorded ticks")
        drill.kill(RECORDER)
        drill.still_holds()
        # Its memory is given back before it has ended, which takes a busy machine a while.
        drill.until(lambda: any("the recorder was ended by SIGKILL" in text for text in drill.log), "word of its end")
        drill.grasp()
        # The loop tells the glove something in every tick.
        loop = np.bincount(drill.commands()["client"]).argmax()
        killed = drill.kill(LOOP)
        drill.let_it_end(killed)
        commands = drill.commands()
    assert_free_in_time(commands, killed)
    # By the watchdog, on a connection of its own, soon enough and again.
    freed = commands[(commands["client"] != loop) & (commands["time_ns"] > killed.before)]
    assert len(freed) >= 2 and not stiff(freed).any() and not stiff(commands[-1:]).any()
    assert_in_time(freed["time_ns"].min() - killed.since, killed.allowed)
    outcome = drill.session.end()
    assert "loop was ended by SIGKILL" in outcome.loop_failed and "SIGKILL" in outcome.record_failed
    assert outcome.watchdog_releases >= 2
    result = load_result(tmp_path / "session.h5")
    assert not result.complete and result.ticks > ENOUGH and np.isfinite(result["graphic/position"]).all()


@pytest.mark.soak
def test_the_watchdog_of_two_gloves_frees_both(tmp_path: Path) -> None:
    with Drill(tmp_path, SIDES, recorded=False) as drill:
        drill.grasp()
        killed = drill.kill(LOOP)
        drill.let_it_end(killed)
        for glove in drill.gloves:
            assert_told_free(glove.commands, killed)
    assert re.match("the session ended early: the loop .*SIGKILL", drill.session.end().error)


@pytest.mark.parametrize("number", [KILL, STOP], ids=lambda number: number.name)
@pytest.mark.parametrize("process", [LOOP, WATCHDOG, RECORDER])
@pytest.mark.soak
def test_a_process_is_lost_while_the_session_ends(tmp_path: Path, process: str, number: signal.Signals) -> None:
    """The user ends the session, and in the same moment a process is killed or stopped, for a second."""
    with Drill(tmp_path) as drill:
        drill.grasp()
        pid = drill.session.pid(process)
        going = threading.Timer(1.0, os.kill, (pid, signal.SIGCONT))

        def end() -> None:
            os.kill(pid, number)
            drill.session.request_stop("a key")

        lost = drill.fault(end)
        if number == STOP:
            going.start()
        drill.let_it_end(lost)
        going.cancel()
    assert_told_free(drill.commands(), lost)
    if number == STOP:
        assert_free_at_the_end(drill.commands())


@pytest.mark.parametrize("number", [KILL, STOP], ids=lambda number: number.name)
@pytest.mark.parametrize("process", [LOOP, WATCHDOG])
@pytest.mark.soak
def test_a_process_is_lost_while_the_session_begins(tmp_path: Path, process: str, number: signal.Signals) -> None:
    """Nobody is told to hold a finger then, and the session ends, or goes on when the process does."""
    with Drill(tmp_path, recorded=False) as drill:
        session = drill.session
        until(lambda: session.pid(process) is not None and session.stage == Stage.STARTING)
        pid = session.pid(process)
        os.kill(pid, number)
        drill.go_on(0.3)
        assert not stiff(drill.commands()).any()
        if number == STOP:
            os.kill(pid, signal.SIGCONT)
        if number == STOP or process == WATCHDOG:
            drill.grasp()
        else:
            until(lambda: not session.poll())
            assert not stiff(drill.commands()).any() and session.end().loop_failed


def test_a_driver_that_fails_ends_the_session(drill: Drill) -> None:
    drill.grasp()
    failed = drill.fault(lambda: flag_of(drill).write_text("now"))
    drill.let_it_end(failed)
    flag_of(drill).unlink()
    assert_free_in_time(drill.commands(), failed)
    assert "the glove's driver failed: RuntimeError: on purpose" in drill.session.end().loop_failed


def assert_free_at_the_end(commands: NDArray[Any]) -> None:
    """The last word of each connection holds no finger."""
    last = {client: commands[commands["client"] == client][-1:] for client in set(commands["client"].tolist())}
    assert last
    for client, command in last.items():
        assert not stiff(command).any(), f"client {client} left a finger held"


@pytest.mark.parametrize("number", [signal.SIGINT, KILL])
@pytest.mark.soak
def test_the_command_is_ended(tmp_path: Path, number: signal.Signals) -> None:
    """As a user runs it; SIGKILL of the supervisor, too, ends in free fingers and no process left."""
    glove = FakeDexmo(tmp_path / "commands.log")
    glove.port = free_ports(socket.SOCK_STREAM)
    command = [*HHSIM, "live", "glove", "cube", "--device", "dexmo", "--port", str(glove.port), "--level", "3"]
    # A slow loop is late less often on a busy machine, which would begin the ramp anew.
    command += ["--pose", "fixed", "--stiffness", "1", "--rate", "250", "--stale", "100", "--no-record", "--json"]
    streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with (
        glove,
        subprocess.Popen(command, **streams, text=True, cwd=tmp_path) as process,
        contextlib.ExitStack() as ends,
    ):
        ends.callback(process.terminate)

        def holds() -> bool:
            assert process.poll() is None, process.communicate()
            return bool((commands := glove.commands).size) and commands["stiffness"][-1].max() >= STIFF

        until(holds)
        glove.order("hold")
        time.sleep(0.05)
        # The command itself is not in real time, and looks for signals every 20 ms.
        share = MachineShare(process.pid, glove.pid)
        before = time.monotonic_ns()
        os.kill(process.pid, number)
        sent = time.monotonic_ns()
        # No process of the session is left behind.
        until(lambda: share.look() and glove.noted("gone") >= glove.noted("connected"))
        out, err = process.communicate(timeout=PATIENCE)
        commands = glove.commands
        held = commands["time_ns"][stiff(commands)]
        assert (held < before).any()
        assert_in_time(int(held.max()) - sent, IN_TIME + share.taken_ns)
        assert not stiff(commands[-1:]).any()
        if number == signal.SIGINT:
            assert process.returncode == 0, err
            assert json.loads(out)["reason"] == "Ctrl-C"
