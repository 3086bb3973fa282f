"""A scene whose object is put where the hand of a recording touches it.

So where it would touch nothing otherwise, or would begin in the object: keypoints of a camera, or a glove without a
tracker, are in no world, and their palm stands at its origin, in the middle of whatever object is there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ResampleMode, Trajectory
from hhsim.scene.demonstration import Demonstration
from hhsim.scene.recorded_grasp_pose import GraspPlacement, place_at_grasp
from hhsim.scene.scene import Scene, make_scene
from hhsim.scene.script import Script
from hhsim.scene.touch import depth_at_start, touches
from hhsim.trees.sphere_tree import SphereTree

Place = Literal["recorded", "auto"]

MOST_START_DEPTH = 0.005
"""A hand that begins deeper [m] in the object was not recorded at it: fit, tracker and spheres are off by less."""


@dataclass(frozen=True)
class PlacedScene:
    """A scene, and how its object came to where it is.

    Attributes:
        placement: Where the object was put for a recording; None where the motion says it, or finds it.
        by_itself: Whether it was put there because it says nothing where it was, and not because somebody asked.
        note: What there is to say of it, or "".
    """

    scene: Scene
    placement: GraspPlacement | None = None
    by_itself: bool = False
    note: str = ""

    @property
    def place(self) -> Place:
        """As `--place-object` would say it."""
        return "recorded" if self.placement is None else "auto"

    def to_json(self) -> dict[str, Any] | None:
        """The placement as plain values, SI; None where there is none."""
        if self.placement is None:
            return None
        return {**self.placement.to_json(), "by_itself": self.by_itself}


def placed_scene(
    mesh: Mesh,
    tree: SphereTree,
    hand: HandModel,
    motion: Script | Demonstration | Trajectory,
    *,
    asked: Place | None = None,
    fingers: Sequence[str] = FINGERS,
    rate: float = 1000.0,
    mode: ResampleMode = "interpolate",
    seed: int = 0,
) -> PlacedScene:
    """Make a scene; of a recording as asked, else as it was recorded, else where its fingers close.

    Args:
        mesh: The object [m], in its own frame.
        tree: Its sphere tree, in the same frame.
        motion: Of the hand; only a recording is placed.
        asked: Where the object of a recording is to be; None: as recorded, unless the hand touches nothing there, or
            begins in it, of an import (which has flags) that places no object.
        fingers: That the scene uses.
        rate, mode, seed: As of `hhsim.scene.scene.make_scene`.

    Raises:
        TrajectoryError: The motion cannot be done on this object, or cannot be placed although that was asked for.
    """

    def make(moved: Script | Demonstration | Trajectory) -> Scene:
        return make_scene(mesh, tree, hand, moved, rate=rate, mode=mode, seed=seed)

    if asked == "auto" and isinstance(motion, Trajectory):
        found = place_at_grasp(motion, hand, tree)
        return PlacedScene(make(found.motion), found, note=found.text)
    scene = make(motion)
    if asked == "recorded" or not isinstance(motion, Trajectory) or motion.object_motion is not None:
        return PlacedScene(scene)
    # Only an import says nothing of the object. A session, or a motion that was made, may well begin in it.
    imported = motion.flags is not None and not motion.object_position.any()
    inside = imported and depth_at_start(scene, fingers) > MOST_START_DEPTH
    if not inside and touches(scene, fingers):
        return PlacedScene(scene)
    why = f"as the recording has it, the hand {'begins inside the object' if inside else 'touches nothing'}"
    try:
        found = place_at_grasp(motion, hand, tree)
        if inside and found.start_gap <= 0.0:
            raise TrajectoryError("the hand would begin inside wherever its fingers close on the object")
    except TrajectoryError as error:
        return PlacedScene(scene, note=f"{why}, and no other place was found: {error}")
    return PlacedScene(make(found.motion), found, by_itself=True, note=f"{why}, so {found.text}")
