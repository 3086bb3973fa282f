"""All that a live session is told before it begins; its processes get it pickled in memory that they inherit."""

import math
import os
import pickle
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.live.device import FINGER_COUNT
from hhsim.live.devices.registry import DeviceConfig
from hhsim.live.pose.config import PoseConfig
from hhsim.mesh.mesh import Mesh
from hhsim.recordings.dexmo_regression import DexmoRegression
from hhsim.solver.options import SolverOptions
from hhsim.trees.sphere_tree import SphereTree

RATE_RANGE = (10.0, 4000.0)
"""Ticks per second [Hz] that a loop is asked for."""


@dataclass(frozen=True)
class OutputLimits:
    """What the fingers may be told, and how fast it may change.

    Attributes:
        stiffness: of each finger while it carries contact force, 0 (free) to 1, five numbers.
        stiffness_rise: fastest growth of the stiffness [1/s]; it falls at once.
        bend_speed: fastest change of the bend at which a finger is stopped, both ways [1/s].
        ramp: how long the stiffness takes to its full value at the start and after every fault [s].
        contact_force: a finger whose phalanges feel less than this together is free [N].
    """

    stiffness: tuple[float, ...] = (0.3,) * FINGER_COUNT
    stiffness_rise: float = 20.0
    bend_speed: float = 10.0
    ramp: float = 1.0
    contact_force: float = 0.02

    def __post_init__(self) -> None:
        """Refuse what no glove takes.

        Raises:
            InputError: a stiffness out of range, or a limit that is none.
        """
        if len(self.stiffness) != FINGER_COUNT:
            raise InputError(f"{len(self.stiffness)} values of stiffness: expected {FINGER_COUNT}, one a finger")
        for value in self.stiffness:
            if not 0.0 <= value <= 1.0:
                raise InputError(f"the stiffness is {value:g}: expected 0 (free) to 1")
        _require_positive("stiffness_rise", self.stiffness_rise, "1/s")
        _require_positive("bend_speed", self.bend_speed, "1/s")
        for name, value, unit in (("ramp", self.ramp, "s"), ("contact_force", self.contact_force, "N")):
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} is {value:g} {unit}: it must be finite and not negative")


@dataclass(frozen=True)
class SafetyLimits:
    """From when on the fingers are freed.

    Attributes:
        stale: age of the newest sample, or of the pose where its source can go silent [s].
        overruns: periods missed one after the other.
        guardian: whether a guardian must be there.
        guardian_stale: age of the guardian's last sign of life [s].
        heartbeat_stale: age of the loop's last sign of life at which the guardian frees the fingers [s].
    """

    stale: float = 0.025
    overruns: int = 10
    guardian: bool = True
    guardian_stale: float = 0.1
    heartbeat_stale: float = 0.02

    def __post_init__(self) -> None:
        """Refuse limits that are none.

        Raises:
            InputError: a limit that is not positive.
        """
        for name in ("stale", "guardian_stale", "heartbeat_stale"):
            _require_positive(name, getattr(self, name), "s")
        if self.overruns < 1:
            raise InputError(f"overruns is {self.overruns}: at least 1 missed period")


@dataclass(frozen=True)
class RealTimeWishes:
    """What the loop asks the system for; each wish that is not granted is said and done without.

    Attributes:
        fifo: SCHED_FIFO, at `priority`, 1 to 98; the guardian runs one above.
        priority: of the loop.
        lock_memory: no page of the process is taken away (mlockall).
        timer_slack: wake-ups are not put together with others (1 ns instead of 50 µs).
        cpu: the processor to stay on, None to choose the last that the process may use, -1 not to be pinned.
        freeze_gc: what is there when the loop begins is no more looked through for garbage.
    """

    fifo: bool = True
    priority: int = 50
    lock_memory: bool = True
    timer_slack: bool = True
    cpu: int | None = None
    freeze_gc: bool = True

    def __post_init__(self) -> None:
        """Refuse a priority that leaves no room for the guardian.

        Raises:
            InputError: a priority or a processor out of range.
        """
        if not 1 <= self.priority <= 98:
            raise InputError(f"the real-time priority is {self.priority}: expected 1 to 98")
        if self.cpu is not None and self.cpu < -1:
            raise InputError(f"the processor is {self.cpu}: expected its number, or -1 not to be pinned")


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveSetup:
    """A live session before it begins.

    Attributes:
        mesh: the object's surface [m], world frame.
        tree: its sphere tree, world frame.
        hand: the hand.
        options: of the solver; its period is that of the rate.
        device: which glove.
        pose: where the palm's pose comes from.
        regression: what a bend is in angles; the set points are made with it.
        rate: ticks per second [Hz].
        duration: how long to run [s]; None until it is stopped.
        output: what the fingers may be told.
        safety: when they are freed.
        real_time: what the system is asked for.
        record: the session's file; None keeps nothing.
        rerun: "spawn", an address or a file for the viewer; None shows nothing.
        dry_run: nothing is sent to the glove.
        command: the command line, for the record.
        description: what else the file is to say of how the scene came about, as plain values; `object_position` [m]
            and `object_orientation` (w, x, y, z) are the object's pose, where its own frame is not the world's.
        supervisor: process id of who makes the setup and starts the others; the loop ends with it.
    """

    mesh: Mesh
    tree: SphereTree
    hand: HandModel
    options: SolverOptions
    device: DeviceConfig
    pose: PoseConfig
    regression: DexmoRegression = field(default_factory=DexmoRegression.default)
    rate: float = 1000.0
    duration: float | None = None
    output: OutputLimits = field(default_factory=OutputLimits)
    safety: SafetyLimits = field(default_factory=SafetyLimits)
    real_time: RealTimeWishes = field(default_factory=RealTimeWishes)
    record: Path | None = None
    rerun: str | None = None
    dry_run: bool = False
    command: tuple[str, ...] = ()
    description: Mapping[str, Any] = field(default_factory=dict)
    supervisor: int = field(default_factory=os.getpid)

    def __post_init__(self) -> None:
        """Refuse a rate or a duration that is none.

        Raises:
            InputError: out of range.
        """
        low, high = RATE_RANGE
        if not low <= self.rate <= high:
            raise InputError(f"the rate is {self.rate:g} Hz: expected {low:g} to {high:g} Hz")
        if self.duration is not None:
            _require_positive("the duration", self.duration, "s")

    @property
    def period_ns(self) -> int:
        """Of a tick [ns]."""
        return round(1e9 / self.rate)

    def limits_json(self) -> dict[str, Any]:
        """Limits and wishes as plain values, and what a bend is in angles [rad]: no set point is known without that."""
        slope, offset = self.regression.bend_lines()
        return {
            **{name: asdict(getattr(self, name)) for name in ("output", "safety", "real_time")},
            "bend": {"slope": slope.tolist(), "offset": offset.tolist()},
        }


def write_setup(setup: LiveSetup) -> int:
    """Put a setup into memory that children can inherit; returns the descriptor, for `--setup`."""
    descriptor = os.memfd_create("hhsim-setup", 0)
    os.set_inheritable(descriptor, True)
    with open(descriptor, "wb", closefd=False) as stream:
        pickle.dump(setup, stream, pickle.HIGHEST_PROTOCOL)
    return descriptor


def read_setup(descriptor: int) -> LiveSetup:
    """The setup that `write_setup` put there; every process may read it, whatever others have read."""
    # By position: processes that inherit a descriptor share its place in the file.
    size = os.fstat(descriptor).st_size
    setup = pickle.loads(os.pread(descriptor, size, 0))
    if not isinstance(setup, LiveSetup):
        raise TypeError(f"the setup is a {type(setup).__name__}")
    return setup


def _require_positive(name: str, value: float, unit: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{name} is {value:g} {unit}: it must be positive and finite")
