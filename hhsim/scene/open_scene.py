"""A scene from names and files, for programs: what `hhsim replay OBJECT TRAJECTORY` runs."""

from pathlib import Path

from hhsim.errors import check_known
from hhsim.hand.model import HandModel, Side
from hhsim.mesh.catalogue import MESH_LEVEL, resolve_object
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ResampleMode, Trajectory
from hhsim.scene.demonstration import Demonstration
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.scene import Scene, make_scene, side_of
from hhsim.scene.script import Script
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.triangle_tree import tree_of_any

SIDES = ("right", "left")


def open_scene(
    object_: str | Path | Mesh = "bunny",
    motion: str | Path | Script | Demonstration | Trajectory = "grasp",
    *,
    unit: str | None = None,
    size: float | None = None,
    solid: bool = True,
    level: int | None = None,
    hand: HandModel | Side | None = None,
    rate: float = 1000.0,
    mode: ResampleMode = "interpolate",
    seed: int = 0,
) -> Scene:
    """Load an object and a motion, take the object's sphere tree from the cache or build it, and put them together.

    Args:
        object_: A name (`hhsim objects`), a mesh file, or a mesh [m].
        motion: A name (`hhsim trajectories`), a script (.toml), a recording, a result, or a loaded motion.
        unit: Length unit of a mesh file: m, cm, mm or inch; None is m.
        size: Longest extent that a mesh file gets [m], whatever its unit.
        solid: False takes the triangles of a mesh file as they are, for `SolverOptions(surface="mesh")`.
        level: Level of the tree's leaves, 1 to 5; None is the object's own, 3 or 4.
        hand: A model, or right or left for the default hand of that side; None is the motion's side.
        rate: Ticks per second [Hz].
        mode: Resampling between two samples of the motion: interpolate, or hold the last one.
        seed: Seed of a script's tremor and sensor noise.

    Raises:
        UnknownNameError: No such object, trajectory or hand side; the message lists the near names.
        InputError: A file or an option that cannot be used, or a motion that cannot be done on this object.
    """
    if isinstance(object_, Mesh):
        mesh, usual = object_, MESH_LEVEL
    else:
        mesh, usual = resolve_object(object_, unit, size, solid=solid)
    moved = resolve_trajectory(motion) if isinstance(motion, str | Path) else motion
    level = level or usual
    tree = cached_sphere_tree(mesh, TreeOptions(level=level)) if solid else tree_of_any(mesh, level)
    description = {
        "object": mesh.name if isinstance(object_, Mesh) else str(object_),
        "object_mesh": mesh.sha256,
        "unit": unit,
        "size_mm": None if size is None else 1e3 * size,
        "object_repairs": list(mesh.repairs),
        "level": level,
        "tree_options": dict(tree.options),
        "trajectory": str(motion) if isinstance(motion, str | Path) else moved.name,
        "samples": mode,
        "place_object": "recorded",
        "seed": seed,
    }
    if isinstance(hand, str):
        check_known("hand", [hand], SIDES)
    model = hand if isinstance(hand, HandModel) else HandModel.default(hand or side_of(moved))
    return make_scene(mesh, tree, model, moved, rate=rate, mode=mode, seed=seed, description=description)
