"""A scene: one object with its sphere tree, one hand, one motion, in the world frame.

An object that moves as recorded stands still in a scene: all is in the frame that moves with it, which is the world's
at the first tick. `Scene.driven` has the motion in the world.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hhsim.errors import InputError
from hhsim.hand.model import HandModel, Side
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ResampleMode, TickInput, Trajectory
from hhsim.scene.demonstration import Demonstration
from hhsim.scene.free_object import FreeObject
from hhsim.scene.script import Script
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True, repr=False)
class Scene:
    """Object, hand and motion of a replay.

    Attributes:
        mesh: Surface of the object [m], world frame.
        tree: Its sphere tree, world frame.
        hand: Hand model.
        trajectory: Motion of the haptic hand, with the object's pose.
        ticks: Motion at the tick rate, as the object sees it.
        description: Origin of the scene as plain values, for its results.
        driven: Motion of hand and object in the world where the object moves as recorded; else None.
        free: Physical properties of a free object, whose mesh is where it is before the first tick; else None.

    Raises:
        InputError: A free object, and a motion that moves it.
    """

    mesh: Mesh
    tree: SphereTree
    hand: HandModel
    trajectory: Trajectory
    ticks: TickInput
    description: Mapping[str, Any] = field(default_factory=dict)
    driven: TickInput | None = None
    free: FreeObject | None = None

    def __post_init__(self) -> None:
        if self.free is not None and self.driven is not None:
            name = self.trajectory.name or "the motion"
            raise InputError(f"in {name} the object moves as recorded, so it cannot be free")

    def __repr__(self) -> str:
        ticks, leaves = self.ticks, self.tree.leaf_count
        return (
            f"Scene({self.mesh.name or 'object'} with {leaves:,} leaf spheres, {self.hand.side} hand, "
            f"{self.trajectory.name or 'motion'}: {ticks.tick_count:,} ticks at {ticks.rate:g} Hz)"
        )

    @property
    def all_pairs(self) -> int:
        """Number of pairs that a model without trees tests every tick; see `all_pairs`."""
        return all_pairs(self.hand, self.tree)


def all_pairs(hand: HandModel, tree: SphereTree) -> int:
    """Return the number of pairs of a hand body (phalanx or palm sphere) and an object sphere."""
    return (hand.radius[:, 1:].size + hand.palm_tree.leaf_count) * tree.leaf_count


def side_of(motion: Script | Demonstration | Trajectory) -> Side:
    """Return the side of the recorded hand; scripts close either, and default to the right."""
    return "left" if getattr(motion, "hand", "") == "left" else "right"


def make_scene(
    mesh: Mesh,
    tree: SphereTree,
    hand: HandModel,
    motion: Script | Demonstration | Trajectory,
    *,
    rate: float = 1000.0,
    mode: ResampleMode = "interpolate",
    seed: int = 0,
    description: Mapping[str, Any] | None = None,
) -> Scene:
    """Put object and tree, both in the object's own frame, hand and motion together.

    Args:
        motion: A recording, which holds the object's pose; a script, which closes on the object where it is; or a
            demonstration, which places the object where the recorded hand touches it.
        rate: Ticks per second [Hz].
        mode: Resampling of a motion of another rate.
        seed: Seed of a script's tremor and sensor noise.
        description: Origin of the scene.

    Raises:
        TrajectoryError: The script or the demonstration cannot be done on this object.
    """
    if isinstance(motion, Script):
        from hhsim.scene.synthesis import synthesize

        motion = synthesize(motion, hand, tree, seed)
    elif isinstance(motion, Demonstration):
        motion = motion.placed(hand, tree)
    rotation = np.empty((3, 3))
    quaternion_to_matrix(motion.object_orientation.copy(), rotation)
    ticks = motion.resampled(rate, mode)
    return Scene(
        mesh=mesh.transformed(rotation, motion.object_position),
        tree=tree.transformed(rotation, motion.object_position),
        hand=hand,
        trajectory=motion,
        ticks=ticks.seen_from_object(),
        description=description or {},
        driven=None if ticks.object_motion is None else ticks,
    )
