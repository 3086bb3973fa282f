"""Setup of a live session: scene, gloves and limits; its processes read it pickled from memory that they inherit."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import Meta

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.live.device import FINGER_COUNT
from hhsim.live.drivers.played import Playback
from hhsim.live.gloves import GLOVES, POSES, GloveConfig, PoseConfig
from hhsim.live.real_time import RealTimeWishes
from hhsim.live.session.watchdog import WatchedGlove
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.dexmo_regression import DexmoRegression
from hhsim.replay.stored_scene import body_name
from hhsim.result.safety import AFTER_STALL
from hhsim.scene.body import Body, Driven, Fixed, Free
from hhsim.scene.closure_search import OtherHand
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.engine_scene import EngineScene, engine_scene, standing_apart
from hhsim.scene.motion_catalogue import Motion, load_script
from hhsim.scene.scene import Scene, require_one_object, scene_of
from hhsim.scene.script import Script
from hhsim.scene.synthesis import planned
from hhsim.solver.options import SolverOptions
from hhsim.system.settings_file import Positive, between, check_fields, one_of
from hhsim.trees.sphere_tree import SphereTree

ABOVE = 0.05
"""Height of the palm above an object that no hand can grasp [m]."""
Stiffness = Annotated[float, between(0.0, 1.0)]
OF_FINGERS = Meta(min_length=FINGER_COUNT, max_length=FINGER_COUNT, description="five numbers, 0 (free) to 1")
SLOW_PERIODS = 2.5
"""Number of periods without a heartbeat that are allowed to a slow loop."""


@dataclass(frozen=True)
class OutputLimits:
    """Limits of the finger commands; raises InputError for a value out of range."""

    # Stiffness of each finger in contact, 0 (free) to 1, five numbers.
    stiffness: Annotated[tuple[Stiffness, ...], OF_FINGERS] = (0.3,) * FINGER_COUNT
    stiffness_rise: Positive = 20.0  # largest rate at which the stiffness grows [1/s]; it falls at once
    bend_speed: Positive = 10.0  # largest rate at which the bend limit moves, both ways [1/s]
    # Time in which the stiffness reaches its full value at the start and after every fault [s].
    ramp: Annotated[float, between(0.0)] = 1.0
    # Force on all phalanges of a finger together below which it is free [N].
    contact_force: Annotated[float, between(0.0)] = 0.02
    ease: Positive = 0.1  # time in which the full stiffness falls to 0 if a stall is eased [s]

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class SafetyLimits:
    """Limits beyond which the fingers are freed; raises InputError for a value out of range."""

    stale: Positive = 0.025  # age of the newest sample, or of the pose if its source can go silent [s]
    overruns: Annotated[int, between(1, 1_000_000_000)] = 10  # number of periods missed in a row
    watchdog: bool = True  # True if a watchdog is required
    watchdog_stale: Positive = 0.1  # age of the watchdog's heartbeat [s]
    heartbeat_stale: Positive = 0.02  # age of the loop's heartbeat at which the watchdog frees the fingers [s]
    # Treatment of held fingers after `overruns` missed periods, one of `AFTER_STALL`.
    after_stall: Annotated[str, one_of(AFTER_STALL)] = "release"

    def __post_init__(self) -> None:
        check_fields(self)

    def release_at(self, period_ns: int) -> int:
        """Return the number of periods missed in a row at which the fingers are freed whatever `after_stall` is.

        With hold and ease it is as many as fit between two ticks `heartbeat_stale` apart: the watchdog may have freed
        the fingers by then, and only the ramp may bring the stiffness back. `period_ns` is that of a tick [ns].
        """
        if self.after_stall == "release":
            return self.overruns
        # Between the two ticks lie up to two periods more than were missed.
        return max(self.overruns, round(1e9 * self.heartbeat_stale) // period_ns - 1)


@dataclass(frozen=True, eq=False)
class WornGlove:
    """Glove on a hand of a session."""

    model: HandModel
    device: GloveConfig  # its calibration relates bend to joint angles, and so makes the set points
    pose: PoseConfig  # source of the palm's pose
    description: Mapping[str, Any] = field(default_factory=dict)  # further plain values of the scene for the file

    def bend_lines(self) -> tuple[FloatArray, FloatArray]:
        """Return `DexmoRegression.bend_lines` of the glove's calibration, or of the default one."""
        lines: tuple[FloatArray, FloatArray] = (self.device.calibration or DexmoRegression.default()).bend_lines()
        return lines


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveSetup:
    """Settings of a live session."""

    scene: Scene  # of one tick: the bodies, and all hands
    worn: tuple[WornGlove, ...]  # glove of each hand of the scene
    options: SolverOptions  # options of the solver; the loop replaces their period by its own
    rate: float = 1000.0  # ticks a second [Hz]
    duration: float | None = None  # duration [s]; None until it is stopped
    output: OutputLimits = field(default_factory=OutputLimits)
    safety: SafetyLimits = field(default_factory=SafetyLimits)
    real_time: RealTimeWishes = field(default_factory=RealTimeWishes)
    record: Path | None = None  # file of the session; None records nothing
    rerun: str | None = None  # "spawn", an address or a file for the viewer; None shows nothing
    dry_run: bool = False
    command: tuple[str, ...] = ()
    supervisor: int = field(default_factory=os.getpid)  # process id of the supervisor; the loop ends with it

    @property
    def recorded_bodies(self) -> int:
        """Number of bodies whose motion is recorded: none of fixed ones."""
        solids = self.scene.solids
        return len(solids) if any(isinstance(body.motion, Free) for body in solids) else 0

    @property
    def periods(self) -> int:
        """Number of periods after which the loop ends by itself, -1 for none."""
        return -1 if self.duration is None else max(1, round(self.duration * self.rate))

    @property
    def period_ns(self) -> int:
        """Period of a tick [ns]."""
        return round(1e9 / self.rate)

    @property
    def oldest_heartbeat_ns(self) -> int:
        """Age of the loop's heartbeat beyond which the loop counts as gone [ns]: `SLOW_PERIODS` at least."""
        return max(round(1e9 * self.safety.heartbeat_stale), round(SLOW_PERIODS * self.period_ns))

    @cached_property
    def seen(self) -> EngineScene:
        """The scene as its engine sees it."""
        return engine_scene(standing_apart(self.scene, self.options.surface))

    def for_watchdog(self, statuses: Sequence[int]) -> list[WatchedGlove]:
        """Return the setup of the watchdog, of each glove; `statuses` are the descriptors of their statuses."""
        bare = (replace(worn.device, playback=None, calibration=None) for worn in self.worn)
        common = self.real_time, self.oldest_heartbeat_ns, self.supervisor
        return [WatchedGlove(device, *common, status, self.periods) for device, status in zip(bare, statuses)]


class LiveScene(NamedTuple):
    """Bodies of a session at its first tick, and the gloves on its hands."""

    scene: Scene  # of one tick; nothing in it is driven, and of several bodies one is free
    worn: tuple[WornGlove, ...]

    def both(self, left: "LiveScene") -> "LiveScene":
        """Return the scene of this hand, the right one, and the left one; InputError for bodies at another place."""
        hands = (*self.scene.hands, *left.scene.hands)
        require_one_object([hand.trajectory for hand in hands])
        return LiveScene(replace(self.scene, hands=hands), (*self.worn, *left.worn))


def make_live_scene(
    bodies: DeclaredBodies,
    hand: HandModel,
    device: GloveConfig,
    pose: PoseConfig,
    motion: Motion | None,
    *,
    rate: float = 1000.0,
    placed: bool = False,
    seed: int = 0,
    other: OtherHand | None = None,
    freed: Callable[[Scene], Scene] = lambda scene: scene,
) -> LiveScene:
    """Put bodies with their sphere trees [m], glove and palm together; driven bodies stay where they begin.

    `motion` is that of a simulated or replayed glove, or of a replayed palm; None if neither plays one. If `placed`,
    the palm begins at the pose of `pose`; otherwise where it can grasp, beside the user's `other` hand. `rate` is that
    of the ticks [Hz], `seed` of a script's tremor and sensor noise; `freed` may make the body of a scene free. Raises
    TrajectoryError for a motion that cannot be done on these bodies.
    """
    palm, still = POSES[pose.kind], np.array([[1.0, 0.0, 0.0, 0.0]])
    rest = Trajectory(np.zeros(1), np.zeros((1, 3)), still, np.zeros((1, 5, 3)), np.zeros((1, 5)))
    scene = freed(scene_of(bodies, [hand], [motion or rest], rate=rate, seed=seed, other=other))
    played = scene.hands[0].trajectory
    first = _standing_still(scene.first(1))
    where = {}
    if motion is not None:
        where = {name: getattr(played, name).tolist() for name in ("object_position", "object_orientation")}
        # One for both, so that fingers and palm stay together.
        playback = Playback(played.seen_from_object())
        if GLOVES[device.kind].plays:
            device = replace(device, playback=playback)
        if palm.plays:
            pose = replace(pose, playback=playback)
    if palm.placed and not placed:
        position, orientation = palm_place(hand, engine_scene(first).tree, palm.back, other)
        x, y, z = map(float, position)
        a, b, c, d = map(float, orientation)
        pose = replace(pose, position=(x, y, z), orientation=(a, b, c, d))
    described = {
        "tree_options": dict(bodies.tree.options),
        "motion": None if motion is None else motion.name,
        "pose": pose.kind,
        **where,
        "palm_begins": [*pose.position, *pose.orientation] if palm.placed else None,
    }
    return LiveScene(first, (WornGlove(hand, device, pose, described),))


def _standing_still(scene: Scene) -> Scene:
    """Return a scene of one tick without driven bodies; where none is free all are one body."""
    stays = (
        replace(one, motion=Fixed()) if isinstance(one, Body) and isinstance(one.motion, Driven) else one
        for one in scene.bodies
    )
    scene = replace(scene, bodies=tuple(stays))
    if len(scene.solids) == 1 or any(isinstance(body.motion, Free) for body in scene.solids):
        return scene
    seen = engine_scene(scene)
    return replace(scene, bodies=(Body(body_name(scene.name), seen.mesh, seen.tree),))


def grasping_hand(hand: HandModel, tree: SphereTree, motion: Motion | None) -> OtherHand | None:
    """Return a hand as it grasps an object (`tree`, world frame) in its script, or in `grasp`; None if it cannot."""
    try:
        script = motion if isinstance(motion, Script) else load_script("grasp")
        return OtherHand(hand, planned(script, hand, tree))
    except TrajectoryError:
        return None


def palm_place(
    hand: HandModel, tree: SphereTree, back: float = 0.0, other: OtherHand | None = None
) -> tuple[FloatArray, FloatArray]:
    """Compute the palm's pose of the script `grasp` in its hold, `back` [m] from it, or above an object too large.

    Beside an `other` hand it grasps clear of that.

    Returns palm origin [m], shape (3,), and unit quaternion (w, x, y, z), world frame as of the tree.
    """
    try:
        closure = planned(load_script("grasp"), hand, tree, other=other)
    except TrajectoryError:
        leaves = tree.level == tree.level.max()
        top = float((tree.center[leaves, 2] + tree.radius[leaves]).max())
        middle = tree.center[leaves].mean(axis=0)
        return np.array([middle[0], middle[1], top + ABOVE + back]), np.array([1.0, 0.0, 0.0, 0.0])
    return closure.position + back * closure.back, quaternion_from_matrix(closure.rotation)
