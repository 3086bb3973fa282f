"""Scene of a live session: the bodies in the world, and where palm and fingers begin."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.live.gloves import GLOVES, POSES, GloveConfig, PoseConfig
from hhsim.live.playback import Playback
from hhsim.live.session.settings import WornGlove
from hhsim.motion.trajectory import Trajectory
from hhsim.replay.stored_scene import body_name
from hhsim.scene.body import Body, Driven, Fixed, Free
from hhsim.scene.closure_search import OtherHand
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.motion_catalogue import Motion, load_script
from hhsim.scene.scene import Scene, require_one_object, scene_of
from hhsim.scene.script import Script
from hhsim.scene.synthesis import planned
from hhsim.solver.scene_solver import seen_scene
from hhsim.trees.sphere_tree import SphereTree

ABOVE = 0.05
"""Height of the palm above an object that no hand can grasp [m]."""


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
        position, orientation = palm_place(hand, seen_scene(first).tree, palm.back, other)
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
    seen = seen_scene(scene)
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
