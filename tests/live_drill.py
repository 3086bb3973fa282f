"""A live session whose glove's server is a process of ours that writes down what it is told."""

import contextlib
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.hand.model import HandModel
from hhsim.live.devices.registry import configure
from hhsim.live.ipc.config import LiveSetup, OutputLimits
from hhsim.live.ipc.status import Stage
from hhsim.live.pose.registry import PoseConfig
from hhsim.live.real_time import become_ordinary
from hhsim.live.session.scene import make_live_scene
from hhsim.live.session.supervisor import LOOP, Supervisor
from hhsim.live.shared_memory import RingReader
from hhsim.mesh.catalogue import load_object
from hhsim.result.safety import Safety
from hhsim.solver.compile import warm_up
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from tools.fake_gloves import FakeDexmo

IN_TIME = 50_000_000
"""Fingers are free so long after a fault where the loop runs in real time [ns]."""
WITHOUT_REAL_TIME = 500_000_000
"""And where the system grants no SCHED_FIFO, on a machine that is busy with other things [ns]."""
PATIENCE = 30.0
STIFF = 0.2


def grasping_setup(port: int, record: Path | None) -> LiveSetup:
    """Fingers that close on a cube at the place where they grasp it, and are stopped soon."""
    item = load_object("cube")
    tree = cached_sphere_tree(item.mesh, TreeOptions(level=3))
    hand = HandModel.default("right")
    device = configure("dexmo", port=port)
    scene = make_live_scene(item.mesh, tree, hand, device, PoseConfig("fixed"), None)
    options = SolverOptions()
    warm_up(hand, options)
    return LiveSetup(
        mesh=scene.mesh,
        tree=scene.tree,
        hand=hand,
        options=options,
        device=scene.device,
        pose=scene.pose,
        output=OutputLimits(stiffness=(0.5,) * 5, stiffness_rise=50.0, ramp=0.1),
        record=record,
        duration=600.0,
    )


class Drill:
    """A session, its glove, and what both of them saw.

    Args:
        glove: The server; it runs.
        record: File of the recording.
        rerun: Target of the viewer.
    """

    def __init__(self, glove: FakeDexmo, record: Path | None = None, rerun: str | None = None) -> None:
        self.glove = glove
        self.log: list[str] = []
        """What the supervisor said."""
        setup = replace(grasping_setup(glove.port, record), rerun=rerun)
        self.session = Supervisor(setup, lambda text, level: self.log.append(text))
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

    def until(self, reached: Callable[[], bool], what: str) -> None:
        """Look after the session until something is so."""
        limit = time.monotonic() + PATIENCE
        while not reached():
            assert self.session.poll(), f"the session ended before {what}: {self.session.end().notices}"
            assert time.monotonic() < limit, f"no {what} within {PATIENCE:g} s: {self.session.end().notices}"
            time.sleep(0.002)

    def grasp(self) -> None:
        """Wait until a finger is held, and let the user's hand stand still there."""
        self.glove.order("move")
        self.until(lambda: self.stiffness > STIFF, "finger that is stopped")
        self.glove.order("hold")
        self.go_on(0.1)
        self.until(lambda: self.stiffness > STIFF, "finger that is stopped")

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
        self.until(lambda: self.stiffness > STIFF, "finger that is still stopped")
        assert self.session.stage == Stage.RUNNING
        assert stiff(self.ticks[before:]).any()

    @property
    def allowed(self) -> int:
        """How long after a fault the fingers may still be held [ns]."""
        real_time = self.session.memory.read_facts().get("real_time", {})
        return IN_TIME if real_time.get("fifo") else WITHOUT_REAL_TIME

    def kill(self, name: str) -> int:
        """Kill a process as a crash would (SIGKILL); when that was, CLOCK_MONOTONIC [ns]."""
        pid = self.session.pid(name)
        assert pid is not None
        # Where the session is in real time: a busy machine would put its own time between the two lines.
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        before = time.monotonic_ns()
        os.kill(pid, 9)
        become_ordinary()
        return before

    def commands(self, client: int | None = None) -> NDArray[Any]:
        """What the glove was told so far."""
        found = self.glove.commands
        return found if client is None else found[found["client"] == client]

    def loop_client(self) -> int:
        """The number of the loop's connection: it tells the glove something in every tick."""
        return int(np.bincount(self.commands()["client"]).argmax())


def stiff(commands: NDArray[Any]) -> NDArray[np.bool_]:
    """Which commands, or ticks, hold a finger."""
    names = commands.dtype.names or ()
    return np.asarray((commands["stiffness" if "stiffness" in names else "command_stiffness"] > 0.0).any(axis=1))


__all__ = ["LOOP", "Drill", "FakeDexmo", "Safety", "Stage", "stiff"]
