"""A scene whose object is put where the hand of a recording touches it, where it would touch nothing otherwise."""

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
from hhsim.scene.touch import touches
from hhsim.trees.sphere_tree import SphereTree

Place = Literal["recorded", "auto"]


@dataclass(frozen=True)
class PlacedScene:
    """A scene, and how its object came to where it is.

    Attributes:
        scene: The scene.
        placement: Where the object was put for a recording; None where the motion says it, or finds it.
        by_itself: Whether it was put there because it was touched nowhere else, and not because somebody asked.
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
        hand: The hand.
        motion: Of the hand; only a recording is placed.
        asked: Where the object of a recording is to be; None: as recorded, unless the hand touches nothing there.
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
    if asked == "recorded" or not isinstance(motion, Trajectory) or touches(scene, fingers):
        return PlacedScene(scene)
    nothing = "as the recording has it, the hand touches nothing"
    try:
        found = place_at_grasp(motion, hand, tree)
    except TrajectoryError as error:
        return PlacedScene(scene, note=f"{nothing}, and no other place was found: {error}")
    return PlacedScene(make(found.motion), found, by_itself=True, note=f"{nothing}, so {found.text}")
