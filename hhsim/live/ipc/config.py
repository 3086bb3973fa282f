"""All that is set of a live session before it begins; its processes get it pickled in memory that they inherit."""

import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from msgspec import Meta

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.live.device import FINGER_COUNT
from hhsim.live.devices.registry import GloveConfig, for_release
from hhsim.live.ipc.status import WatchdogSetup
from hhsim.live.pose.registry import PoseConfig
from hhsim.live.real_time import RealTimeWishes
from hhsim.mesh.mesh import Mesh
from hhsim.recordings.dexmo_regression import DexmoRegression
from hhsim.result.safety import AFTER_STALL
from hhsim.scene.free_object import FreeObject
from hhsim.solver.options import SolverOptions
from hhsim.system.settings_file import Positive, between, check_fields, one_of
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from hhsim.trees.contact_surface import ContactSurface

Stiffness = Annotated[float, between(0.0, 1.0)]
OF_FINGERS = Meta(min_length=FINGER_COUNT, max_length=FINGER_COUNT, description="five numbers, 0 (free) to 1")
RATE_RANGE = (10.0, 10_000.0)
"""Ticks per second [Hz] that a loop is asked for."""


@dataclass(frozen=True)
class OutputLimits:
    """What the fingers may be told, and how fast it may change.

    Attributes:
        stiffness: Of each finger while it carries contact force, 0 (free) to 1, five numbers.
        stiffness_rise: Fastest growth of the stiffness [1/s]; it falls at once.
        bend_speed: Fastest change of the bend at which a finger is stopped, both ways [1/s].
        ramp: How long the stiffness takes to its full value at the start and after every fault [s].
        contact_force: A finger whose phalanges feel less than this together is free [N].
        ease: How long the full stiffness takes to fall to 0 where a stall is eased [s].
    """

    stiffness: Annotated[tuple[Stiffness, ...], OF_FINGERS] = (0.3,) * FINGER_COUNT
    stiffness_rise: Positive = 20.0
    bend_speed: Positive = 10.0
    ramp: Annotated[float, between(0.0)] = 1.0
    contact_force: Annotated[float, between(0.0)] = 0.02
    ease: Positive = 0.1

    def __post_init__(self) -> None:
        """Raise InputError for what no glove takes."""
        check_fields(self)


@dataclass(frozen=True)
class SafetyLimits:
    """From when on the fingers are freed.

    Attributes:
        stale: Age of the newest sample, or of the pose where its source can go silent [s].
        overruns: Periods missed one after the other.
        watchdog: Whether a watchdog must be there.
        watchdog_stale: Age of the watchdog's last sign of life [s].
        heartbeat_stale: Age of the loop's last sign of life at which the watchdog frees the fingers [s].
        after_stall: What becomes of held fingers when `overruns` periods were missed: one of `AFTER_STALL`.
    """

    stale: Positive = 0.025
    overruns: Annotated[int, between(1, 1_000_000_000)] = 10
    watchdog: bool = True
    watchdog_stale: Positive = 0.1
    heartbeat_stale: Positive = 0.02
    after_stall: Annotated[str, one_of(AFTER_STALL)] = "release"

    def __post_init__(self) -> None:
        """Raise InputError for limits that are none."""
        check_fields(self)

    def release_at(self, period_ns: int) -> int:
        """Periods missed one after the other at which the fingers are freed, whatever `after_stall` says.

        With hold and ease it is so many that two ticks may lie `heartbeat_stale` apart: from then on the watchdog may
        have freed the fingers, and nothing but the ramp may bring them back.

        Args:
            period_ns: Of a tick [ns].
        """
        if self.after_stall == "release":
            return self.overruns
        # Between the two ticks lie up to two periods more than were missed.
        return max(self.overruns, round(1e9 * self.heartbeat_stale) // period_ns - 1)


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveSetup:
    """A live session before it begins.

    Attributes:
        mesh: The object's surface [m], world frame.
        tree: Its sphere tree, world frame.
        options: Of the solver; its period is that of the rate.
        device: Which glove; its calibration says what a bend is in angles, and so makes the set points.
        pose: Where the palm's pose comes from.
        free: What the object is besides, where it is free; mesh and tree are then where it is at first.
        rate: Ticks per second [Hz].
        duration: How long to run [s]; None until it is stopped.
        output: What the fingers may be told.
        safety: When they are freed.
        real_time: What the system is asked for.
        record: The session's file; None keeps nothing.
        rerun: "spawn", an address or a file for the viewer; None shows nothing.
        dry_run: Nothing is sent to the glove.
        command: The command line, for the record.
        description: What else the file is to say of how the scene came about, as plain values; `object_position` [m]
            and `object_orientation` (w, x, y, z) are the object's pose, where its own frame is not the world's.
        supervisor: Process id of who makes the setup and starts the others; the loop ends with it.
    """

    mesh: Mesh
    tree: SphereTree
    hand: HandModel
    options: SolverOptions
    device: GloveConfig
    pose: PoseConfig
    free: FreeObject | None = None
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
            InputError: Out of range.
        """
        low, high = RATE_RANGE
        if not low <= self.rate <= high:
            raise InputError(f"the rate is {self.rate:g} Hz: expected {low:g} to {high:g} Hz")
        if self.duration is not None and not 0.0 < self.duration < math.inf:
            raise InputError(f"the duration is {self.duration:g} s: it must be positive and finite")

    @property
    def period_ns(self) -> int:
        """Of a tick [ns]."""
        return round(1e9 / self.rate)

    def contact_surface(self) -> "ContactSurface":
        """What the hand touches."""
        from hhsim.trees.contact_surface import contact_surface

        return contact_surface(self.options.surface, self.mesh, self.tree)

    def object_pose(self) -> tuple[FloatArray, FloatArray]:
        """Origin of the object's own frame at first [m], shape (3,), world, and object to world, shape (4,)."""
        position = self.description.get("object_position", (0.0, 0.0, 0.0))
        orientation = self.description.get("object_orientation", (1.0, 0.0, 0.0, 0.0))
        return np.array(position, np.float64), np.array(orientation, np.float64)

    def bend_lines(self) -> tuple[FloatArray, FloatArray]:
        """See `Calibration.bend_lines`; the default regression's for a glove without a calibration."""
        return (self.device.calibration or DexmoRegression.default()).bend_lines()

    def for_watchdog(self, status: int) -> WatchdogSetup:
        """What the watchdog is to know; `status` is the descriptor of the status block."""
        return WatchdogSetup(
            status=status,
            device=None if self.dry_run else for_release(self.device),
            heartbeat_stale=self.safety.heartbeat_stale,
            period_ns=self.period_ns,
            real_time=self.real_time,
            supervisor=self.supervisor,
        )

    def limits_json(self) -> dict[str, Any]:
        """Limits and wishes as plain values, and what a bend is in angles [rad]: no set point is known without that."""
        slope, offset = self.bend_lines()
        return {
            **{name: asdict(getattr(self, name)) for name in ("output", "safety", "real_time")},
            "bend": {"slope": slope.tolist(), "offset": offset.tolist()},
        }
