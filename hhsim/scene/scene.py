"""A scene: one object with its sphere tree, one hand, one motion, in the world frame.

An object that moves as recorded stands still in a scene: object and `ticks` are in the frame that moves with it, which
is the world's at the first tick. `Scene.trajectory` and `Scene.driven` have the motion in the world.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hhsim.errors import InputError, check_known
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import rotation_matrix
from hhsim.linkage.object_mesh import resolve_object
from hhsim.mesh.catalogue import MESH_LEVEL, names_a_thing
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import ResampleMode, TickInput, Trajectory
from hhsim.scene.demonstration import Demonstration
from hhsim.scene.free_object import FreeObject
from hhsim.scene.linkage_bodies import load_parts, names_links
from hhsim.scene.motion_catalogue import Motion, resolve_trajectory
from hhsim.scene.parts_of_thing import ThingParts, require_no_joints
from hhsim.scene.script import Script
from hhsim.scene.things import OtherThing, Things, load_things, names_things
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.triangle_tree import tree_of_any

if TYPE_CHECKING:
    from hhsim.scene.closure_search import OtherHand

SIDES = ("right", "left")


@dataclass(frozen=True, repr=False)
class Scene:
    """Object, hand and motion of a replay; InputError for a free object that a motion moves, or of several parts."""

    mesh: Mesh  # surface of the object [m], world frame
    tree: SphereTree  # its sphere tree, world frame
    hand: HandModel
    trajectory: Trajectory  # motion of the haptic hand, with the object's pose
    ticks: TickInput  # motion at the tick rate, as the object sees it
    description: Mapping[str, Any] = field(default_factory=dict)  # origin of the scene as plain values, for its results
    # Motion of hand and object in the world where the object moves as recorded; else None.
    driven: TickInput | None = None
    # Physical properties of a free object, whose mesh is where it is before the first tick; else None.
    free: FreeObject | None = None
    # Parts of a thing that has several, whose mesh and tree are those of the first tick; or several things, whose poses
    # are those that the ticks find; else None.
    parts: MovingParts | None = None
    others: tuple[OtherThing, ...] = ()  # further things beside a free object

    def __post_init__(self) -> None:
        if self.free is not None and self.driven is not None:
            name = self.trajectory.name or "the motion"
            raise InputError(f"in {name} the object moves as recorded, so it cannot be free")
        if self.free is not None and self.parts is not None and not self.others:
            raise InputError(f"{self.mesh.name} has several parts, which move as recorded: it cannot be free")

    def __repr__(self) -> str:
        ticks, leaves = self.ticks, self.tree.leaf_count
        return (
            f"Scene({self.mesh.name or 'object'} with {leaves:,} leaf spheres, {self.hand.side} hand, "
            f"{self.trajectory.name or 'motion'}: {ticks.tick_count:,} ticks at {ticks.rate:g} Hz)"
        )


def all_pairs(hand: HandModel, tree: SphereTree) -> int:
    """Return how many pairs a model without trees tests a tick: phalanges and palm spheres by object spheres."""
    return (hand.radius[:, 1:].size + hand.palm_tree.leaf_count) * tree.leaf_count


def hand_of(motion: Motion, side: Side | None = None, hand_file: str | Path | None = None) -> HandModel:
    """Return the hand model of a side, with the sizes of a file if one is given; HhsimError for a bad file.

    The side is by default that of the recorded hand; scripts close either, and default to the right.
    """
    if side is None:
        side = "left" if getattr(motion, "hand", "") == "left" else "right"
    return HandModel.default(side) if hand_file is None else HandModel.from_toml(hand_file, side)


def make_scene(
    mesh: Mesh,
    tree: SphereTree,
    hand: HandModel,
    motion: Motion,
    *,
    rate: float = 1000.0,
    mode: ResampleMode = "interpolate",
    seed: int = 0,
    description: Mapping[str, Any] | None = None,
    other: "OtherHand | None" = None,
    thing: tuple[ThingParts, Sequence[SphereTree]] | None = None,
) -> Scene:
    """Make a scene of hand, motion, object and tree; the last two are given in the object's own frame.

    Args:
        motion: A recording, which holds the object's pose; a script, which closes on the object where it is; or a
            demonstration, which places the object where the recorded hand touches it.
        rate: Ticks per second [Hz].
        mode: Resampling of a motion of another rate.
        seed: Seed of a script's tremor and sensor noise.
        description: Origin of the scene.
        other: Hand beside which the one of a script finds its place.
        thing: A thing of several parts and their trees; `mesh` and `tree` are then its own.

    Raises:
        TrajectoryError: The script or the demonstration cannot be done on this object.
    """
    if isinstance(motion, Script):
        from hhsim.scene.synthesis import synthesize

        motion = synthesize(motion, hand, tree, seed, other=other)
    elif isinstance(motion, Demonstration):
        motion = motion.placed(hand, tree)
    rotation = rotation_matrix(motion.object_orientation)
    ticks = motion.resampled(rate, mode)
    return Scene(
        mesh=mesh.transformed(rotation, motion.object_position),
        tree=tree.transformed(rotation, motion.object_position),
        hand=hand,
        trajectory=motion,
        ticks=ticks.seen_from_object(),
        description=description or {},
        driven=None if ticks.object_motion is None else ticks,
        parts=None if thing is None else thing[0].moving(thing[1], ticks, motion),
    )


def with_things(scene: Scene, things: Things, tree_of: Callable[[Mesh], SphereTree]) -> Scene:
    """Return a scene of the first of several things with all of them; `tree_of` makes the trees."""
    others, parts, free = things.placed(scene.mesh, scene.tree, scene.trajectory, scene.ticks, tree_of)
    return replace(scene, free=free, others=others, parts=parts)


def open_scene(
    object_: str | Path | Mesh = "bunny",
    motion: str | Path | Motion = "grasp",
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
        object_: A name (`hhsim objects`), a mesh file, a URDF or MJCF file, the TOML of a thing of several parts or of
            several things, or a mesh [m].
        motion: A name (`hhsim trajectories`), a script (.toml), a recording, a result, or a loaded motion.
        unit, size: Of a mesh file, as for `hhsim.mesh.mesh.load_mesh`: m, cm, mm or inch, and [m]; None is m.
        solid: False takes the triangles of a mesh file as they are, for `SolverOptions(surface="mesh")`.
        level: Level of the leaves of the tree, or of each part's, 1 to 5; None is the object's own, 3 or 4.
        hand: A model, or right or left for the default hand of that side; None is the motion's side.
        rate: Ticks per second [Hz].
        mode: Resampling between two samples of the motion: interpolate, or hold the last one.
        seed: Seed of a script's tremor and sensor noise.

    Raises:
        UnknownNameError: No such object, trajectory or hand side; the message lists the near names.
        InputError: A file or an option that cannot be used, or a motion that cannot be done on this object.
    """
    moved = resolve_trajectory(motion) if isinstance(motion, str | Path) else motion
    thing = things = None
    if isinstance(object_, Mesh):
        mesh, usual = object_, MESH_LEVEL
    elif names_a_thing(str(object_)) or names_links(object_):
        if unit is not None or size is not None:
            raise InputError(f"unit and size are for mesh files; {object_} has its size")
        if names_things(str(object_)):
            things = load_things(str(object_), moved, solid=solid)
            mesh, usual = things.mesh, MESH_LEVEL
        else:
            thing = load_parts(object_, moved, solid=solid)
            mesh, usual = thing.mesh, MESH_LEVEL
    else:
        mesh, usual = resolve_object(object_, unit, size, solid=solid)
        require_no_joints(moved, str(object_))
    level = level or usual

    def make(mesh: Mesh) -> SphereTree:
        return cached_sphere_tree(mesh, TreeOptions(level=level)) if solid else tree_of_any(mesh, level)

    trees = () if thing is None else thing.trees(make)
    tree = make(mesh) if thing is None else thing.tree(trees)
    tree = tree if things is None else things.named(tree)
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
    model = hand if isinstance(hand, HandModel) else hand_of(moved, hand)
    parts = None if thing is None else (thing, trees)
    given: dict[str, Any] = {"rate": rate, "mode": mode, "seed": seed, "description": description, "thing": parts}
    scene = make_scene(mesh, tree, model, moved, **given)
    return scene if things is None else with_things(scene, things, make)
