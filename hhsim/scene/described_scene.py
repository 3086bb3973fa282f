"""A scene with what its results say of it: what `hhsim replay` makes of its words, for whoever makes the same runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ResampleMode, Trajectory
from hhsim.scene.demonstration import Demonstration
from hhsim.scene.placed_scene import Place, PlacedScene, placed_scene
from hhsim.scene.script import Script
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True, kw_only=True)
class SceneWords:
    """What a scene is asked for by, as `hhsim replay` takes it; what is None was not said.

    Attributes:
        object: A name of the catalogue, or a mesh file.
        trajectory: A name of the catalogue, or a file.
        unit: Of a mesh file.
        size_mm: Longest extent that a mesh file gets [mm].
        thickness_mm: Of the sheets that open parts of a mesh file become [mm].
        max_error: That the tree was chosen by [m].
        tree: File that the tree was taken from.
        hand_file: Of the hand's sizes.
        tremor_mm_deg: Amplitudes of the tremor that a script got, of position [mm] and rotation [°].
        samples: Between two samples of the motion.
        place_object: Where the object of a recording is to be.
        object_pose: Recorded, or fixed for an object that is not to move although its recording says so.
        rate: Ticks a second [Hz].
        ticks: Only the first so many.
        seed: Of a script's tremor and sensor noise.
    """

    object: str
    trajectory: str
    unit: str | None = None
    size_mm: float | None = None
    thickness_mm: float | None = None
    max_error: float | None = None
    tree: str | None = None
    hand_file: str | None = None
    tremor_mm_deg: tuple[float, ...] | None = None
    samples: ResampleMode = "interpolate"
    place_object: Place | None = None
    object_pose: str = "recorded"
    rate: float = 1000.0
    ticks: int | None = None
    seed: int = 0


def described_scene(
    words: SceneWords,
    mesh: Mesh,
    tree: SphereTree,
    level: int,
    hand: HandModel,
    motion: Script | Demonstration | Trajectory,
    fingers: Sequence[str] = FINGERS,
) -> PlacedScene:
    """Put together what was loaded, and write down how that came about.

    Args:
        mesh: The object [m], in its own frame.
        tree: Its sphere tree, in the same frame.
        level: That the tree was built to.
        motion: With its tremor.
        fingers: That the scene uses.

    Raises:
        TrajectoryError: As `hhsim.scene.placed_scene.placed_scene`.
    """
    placed = placed_scene(
        mesh,
        tree,
        hand,
        motion,
        asked=words.place_object,
        fingers=fingers,
        rate=words.rate,
        mode=words.samples,
        seed=words.seed,
    )
    scene = placed.scene
    if words.ticks is not None:
        # Cut last: where the object is put does not depend on how much of the motion is run.
        driven = None if scene.driven is None else scene.driven.first(words.ticks)
        scene = replace(scene, ticks=scene.ticks.first(words.ticks), driven=driven)
    description = {
        "object": words.object,
        "object_mesh": mesh.sha256,
        "unit": words.unit,
        "size_mm": words.size_mm,
        "thickness_mm": words.thickness_mm,
        "object_repairs": list(mesh.repairs),
        "level": level,
        "max_error": words.max_error,
        "tree": words.tree,
        "tree_options": dict(tree.options),
        "trajectory": words.trajectory,
        "samples": words.samples,
        "place_object": placed.place,
        "placement": placed.to_json(),
        "hand_file": words.hand_file,
        "tremor_mm_deg": words.tremor_mm_deg,
        "seed": words.seed,
        **({} if words.ticks is None else {"ticks": words.ticks}),
        # Said only where it changes something: files of objects that stand still are as they were.
        **({"object_pose": "fixed"} if words.object_pose == "fixed" else {}),
    }
    return replace(placed, scene=replace(scene, description=description))
