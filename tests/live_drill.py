"""A live session whose glove's server is a process of ours that writes down what it is told."""

import os
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from fake_gloves import FakeDexmo
from machine_share import MachineShare
from numpy.typing import NDArray

from hhsim.hand.model import HandModel
from hhsim.live.gloves import Hand, PoseConfig, configure
from hhsim.live.processes import RingReader, Stage
from hhsim.live.session.scene import LiveScene, grasping_hand, make_live_scene
from hhsim.live.session.settings import LiveSetup, OutputLimits
from hhsim.live.session.supervisor import LOOP, WATCHDOG, Supervisor
from hhsim.mesh.catalogue import load_object
from hhsim.result.safety import Safety
from hhsim.scene.body import CLEARANCE
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

IN_TIME = 50_000_000
"""Fingers are free so long after a fault [ns], the machine's share taken out (`MachineShare`)."""
PATIENCE = 180.0
"""Longest wait for something that comes soon on a quiet machine [s]."""
STIFF = 0.2
RATE = 250.0
"""Ticks a second [Hz]."""


def grasping_setup(port: int, record: Path | None, side: Hand = "right") -> LiveSetup:
    """Fingers that close on a cube at the place where they grasp it, and are stopped soon."""
    scene = grasping_scene(port, side)
    warm_up(scene.scene.hands[0].model, SolverOptions())
    return _held(scene, record)


def two_grasping_setup(ports: Sequence[int], record: Path | None, *, free: bool = False) -> LiveSetup:
    """The same of both hands at one cube, free or not."""
    right = grasping_scene(ports[0], "right", free=free)
    return _held(right.both(grasping_scene(ports[1], "left", free=free, beside=right)), record)


def grasping_scene(port: int, side: Hand, *, free: bool = False, beside: LiveScene | None = None) -> LiveScene:
    """The cube, and a glove of a hand where it grasps it."""
    item = load_object("cube")
    tree = cached_sphere_tree(item.mesh, TreeOptions(level=3))
    device = configure("dexmo", port=port, hand=side)
    hand, bodies = HandModel.default(side), DeclaredBodies.of_mesh(item.mesh, tree)
    other = None if beside is None else grasping_hand(beside.scene.hands[0].model, tree, None)
    low = float(item.mesh.bounds[0, 2])
    freed = (lambda scene: scene.freed(mass=0.1, table=low - CLEARANCE)) if free else (lambda scene: scene)
    pose = PoseConfig("fixed")
    return make_live_scene(bodies, hand, device, pose, None, rate=RATE, other=other, freed=freed)


def _held(scene: LiveScene, record: Path | None) -> LiveSetup:
    return LiveSetup(
        **scene._asdict(),
        options=SolverOptions(),
        output=OutputLimits(stiffness=(0.5,) * 5, stiffness_rise=50.0, ramp=0.1),
        record=record,
        duration=600.0,
        rate=RATE,
    )


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


class Watched:
    """A session that is looked after, `carriers` by whose processes gloves hear of it, and what its supervisor said."""

    session: Supervisor

    def __init__(self) -> None:
        self.log: list[str] = []
        self.carriers: list[int] = []

    def begun(self, setup: LiveSetup) -> Supervisor:
        """Make the session, which logs."""
        self.session = Supervisor(setup, lambda text, level: self.log.append(text))
        return self.session

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
        return Fault(breaks, *self.carriers, *(pid for pid in running if pid is not None))

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


class Drill(Watched):
    """A session, its glove, and what both of them saw."""

    def __init__(self, glove: FakeDexmo, record: Path | None = None) -> None:
        super().__init__()
        self.glove, self.carriers = glove, [glove.pid]
        self.begun(grasping_setup(glove.port, record))
        self._ring = RingReader(self.session.memory.ticks)
        self._ticks: list[NDArray[Any]] = []

    def __enter__(self) -> "Drill":
        self.session.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self.session.__exit__(*error)

    @property
    def ticks(self) -> NDArray[Any]:
        """All ticks so far."""
        _, more = self._ring.read(16_000)
        self._ticks.append(more)
        self._ticks = [np.concatenate(self._ticks)]
        return self._ticks[0]

    @property
    def stiffness(self) -> float:
        """That the stiffest finger is told now."""
        return float(self.session.memory.status["command_stiffness"].max())

    def until_held(self) -> None:
        """Look after the session until a finger is stopped."""
        self.until(lambda: self.stiffness > STIFF, "finger that is stopped")

    def grasp(self) -> None:
        """Wait until a finger is held, and let the user's hand stand still there."""
        self.glove.order("move")
        self.until_held()
        self.glove.order("hold")
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

    def loop_client(self) -> int:
        """The number of the loop's connection: it tells the glove something in every tick."""
        return int(np.bincount(self.commands()["client"]).argmax())


def stiff(commands: NDArray[Any]) -> NDArray[np.bool_]:
    """Which commands, or ticks, hold a finger."""
    names = commands.dtype.names or ()
    return np.asarray((commands["stiffness" if "stiffness" in names else "command_stiffness"] > 0.0).any(axis=1))


__all__ = ["LOOP", "Drill", "FakeDexmo", "Fault", "Safety", "Stage", "stiff"]
