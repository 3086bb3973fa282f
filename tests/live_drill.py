"""A live session whose glove's server is a process of ours that writes down what it is told."""

import os
import signal
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import numpy as np
from fake_gloves import FakeDexmo
from live_peers import free_ports
from machine_share import MachineShare, assert_in_time
from numpy.typing import NDArray

from hhsim.hand.model import HandModel
from hhsim.live.gloves import Hand, PoseConfig, configure
from hhsim.live.processes import RingReader, Stage
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.setup import LiveScene, LiveSetup, OutputLimits, grasping_hand, make_live_scene
from hhsim.live.session.supervisor import LOOP, WATCHDOG, Supervisor
from hhsim.mesh.catalogue import load_object
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

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
        pid = self.session.pid(name)
        assert pid is not None
        return self.kill_pid(pid, number)

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
