"""A scene: hands and bodies in the world, over the ticks of a replay."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.errors import InputError, check_known
from hhsim.hand.model import SIDES, HandModel, Side
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ResampleMode, TickInput, Trajectory
from hhsim.scene.body import USUAL_FRICTION, Body, Driven, Free, HalfSpace, check_names
from hhsim.scene.closure_search import OtherHand
from hhsim.scene.declared_bodies import DeclaredBodies, load_object
from hhsim.scene.motion_catalogue import Motion, resolve_trajectory
from hhsim.scene.script import Script
from hhsim.scene.synthesis import planned, synthesize
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.triangle_tree import chosen_tree

TABLE = "table"
"""Name of the plane under a body that is made free."""


@dataclass(frozen=True, eq=False)
class Hand:
    """Hand of a scene, and the user's motion in the world."""

    model: HandModel
    trajectory: Trajectory  # motion as it was recorded or made
    ticks: TickInput  # the same at the tick rate


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """Hands and bodies of a replay, in the world.

    Raises InputError for no hand, two of one side, hands or driven bodies of other ticks, bodies of one name or
    of a hand's, or a joint on no body.
    """

    hands: tuple[Hand, ...]  # one, or the right and the left one
    bodies: tuple[Body | HalfSpace, ...]
    description: Mapping[str, Any] = field(default_factory=dict)  # origin of the scene as plain values, for its results

    def __post_init__(self) -> None:
        sides = [hand.model.side for hand in self.hands]
        if len(sides) != 1 and sides != list(SIDES):
            raise InputError(f"hands {' and '.join(sides) or 'none'}: expected one, or {' and '.join(SIDES)}")
        if len({(hand.ticks.tick_count, hand.ticks.rate) for hand in self.hands}) > 1:
            raise InputError("the two hands' recordings have not the same number of ticks")
        names = [body.name for body in self.bodies]
        check_names(names)
        check_known("body", [body.joint.on for body in self.solids if body.joint and body.joint.on], names)
        ticks = self.ticks.tick_count
        for body in self.solids:
            if isinstance(body.motion, Driven) and (count := len(body.motion.poses.position)) != ticks:
                raise InputError(f"'{body.name}' has {count:,} poses for {ticks:,} ticks; expected as many")
        if not self.solids or len(names) - len(self.solids) > 1:
            raise InputError("a scene has bodies with a surface, and one plane at most")

    def __repr__(self) -> str:
        ticks, leaves = self.ticks, sum(body.tree.leaf_count for body in self.solids)
        hands = " and ".join(hand.model.side for hand in self.hands)
        return (
            f"Scene({self.name} with {leaves:,} leaf spheres, {hands} hand, "
            f"{self.hands[0].trajectory.name or 'motion'}: {ticks.tick_count:,} ticks at {ticks.rate:g} Hz)"
        )

    @property
    def ticks(self) -> TickInput:
        """Ticks of the first hand, of which times, phases and rate are those of all."""
        return self.hands[0].ticks

    @property
    def solids(self) -> tuple[Body, ...]:
        """Bodies with a surface, all but the plane."""
        return tuple(body for body in self.bodies if isinstance(body, Body))

    @property
    def plane(self) -> HalfSpace | None:
        """The body that fills all below a height; None where there is none."""
        return next((body for body in self.bodies if isinstance(body, HalfSpace)), None)

    @property
    def name(self) -> str:
        """Name of the bodies, as OBJECT has it."""
        one = self.solids[0]
        return str(self.description.get("object_name") or one.mesh.name or one.name)

    def first(self, count: int) -> "Scene":
        """Return the scene in the first ticks, at most `count`."""
        hands = (replace(hand, ticks=hand.ticks.first(count)) for hand in self.hands)
        bodies = (
            replace(body, motion=body.motion.first(count))
            if isinstance(body, Body) and isinstance(body.motion, Driven)
            else body
            for body in self.bodies
        )
        return replace(self, hands=tuple(hands), bodies=tuple(bodies))

    def freed(
        self,
        *,
        friction: float = USUAL_FRICTION,
        torsion: float = 0.0,
        table: float | None = None,
        table_friction: float | None = None,
        **free: Any,
    ) -> "Scene":
        """Return the scene with its one body free, over a table at a height [m], if there is one.

        `free` has arguments of `Free.of_mesh`. Raises InputError if the motion moves the body, or for several bodies.
        """
        if len(self.solids) > 1:
            raise InputError(f"{self.name} has several bodies, each of which says how it moves; expected one")
        body = self.solids[0]
        if isinstance(body.motion, Driven):
            name = self.hands[0].trajectory.name or "the motion"
            raise InputError(f"in {name} the object moves as recorded, so it cannot be free")
        motion = Free.of_mesh(body.placed_mesh, **free)
        moving = replace(body, motion=motion, friction=friction, torsion=torsion)
        plane = () if table is None else (HalfSpace(TABLE, table, table_friction),)
        return replace(self, bodies=(moving, *plane))


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


def scene_of(
    bodies: DeclaredBodies,
    hands: Sequence[HandModel],
    motions: Sequence[Motion],
    *,
    rate: float = 1000.0,
    mode: ResampleMode = "interpolate",
    seed: int = 0,
    description: Mapping[str, Any] | None = None,
    other: OtherHand | None = None,
) -> Scene:
    """Make a scene of bodies with their trees, and of one hand, or the right and the left one, with its motion.

    The first hand's motion places the bodies. A script closes on them where they are, the second hand beside the first
    one, which finds its place beside the `other` one; `seed` is of its tremor and sensor noise. Further arguments and
    errors are those of `open_scene`; TrajectoryError for a script that cannot be done on these bodies.
    """
    trajectories: list[Trajectory] = []
    for hand, motion in zip(hands, motions):
        if isinstance(motion, Script):
            beside = OtherHand(hands[0], planned(motion, hands[0], bodies.tree)) if trajectories else other
            trajectories.append(synthesize(motion, hand, bodies.tree, seed, other=beside))
        elif trajectories and trajectories[0].object_motion is None:
            trajectories.append(motion.placed(trajectories[0].object_position, trajectories[0].object_orientation))
        else:
            trajectories.append(motion)
    ticks = [trajectory.resampled(rate, mode) for trajectory in trajectories]
    require_one_object(trajectories)
    described = {"object_name": bodies.name, **(description or {})}
    made = tuple(Hand(*of_hand) for of_hand in zip(hands, trajectories, ticks))
    return Scene(made, bodies.placed(ticks[0], trajectories[0]), described)


def require_one_object(trajectories: Sequence[Trajectory]) -> None:
    """Raise InputError for two hands whose motions place or move the object differently."""
    first = trajectories[0]
    for other in trajectories[1:]:
        places = ("object_position", "object_orientation")
        if any(not np.array_equal(getattr(first, name), getattr(other, name)) for name in places):
            raise InputError("the two hands' recordings have not the same object")
        motions = [one.object_motion for one in (first, other) if one.object_motion is not None]
        at_once = len(motions) == 2 and np.array_equal(first.time, other.time)
        if len(motions) == 1 or (at_once and not all(map(np.array_equal, *motions))):
            raise InputError("the two hands' recordings have not the same motion of the object")


def make_scene(mesh: Mesh, tree: SphereTree, hand: HandModel, motion: Motion, **others: Any) -> Scene:
    """Make a scene of one hand and one body, whose mesh and tree [m] are in its own frame; see `scene_of`."""
    return scene_of(DeclaredBodies.of_mesh(mesh, tree), [hand], [motion], **others)


def tree_maker(level: int, *, solid: bool | None = None) -> Any:
    """Return what makes the sphere tree of a mesh, or takes it from the cache; see `open_scene`."""
    return lambda mesh: chosen_tree(mesh, level, solid=solid)[0]


def open_scene(
    object_: str | Path | Mesh = "bunny",
    motion: str | Path | Motion = "grasp",
    *,
    unit: str | None = None,
    size: float | None = None,
    solid: bool | None = None,
    level: int | None = None,
    hand: HandModel | Side | None = None,
    rate: float = 1000.0,
    mode: ResampleMode = "interpolate",
    seed: int = 0,
) -> Scene:
    """Load bodies and a motion, take the bodies' sphere trees from the cache or build them, and put them together.

    Args:
        object_: A name (`hhsim objects`), a mesh file, the TOML of bodies, or a mesh [m].
        motion: A name (`hhsim trajectories`), a script (.toml), a recording, a result, or a loaded motion.
        unit: Length unit of a mesh file, as for `hhsim.mesh.mesh.load_mesh`: m, cm, mm or inch; None is m.
        size: Longest extent that a mesh file is scaled to [m]; None leaves it as it is.
        solid: True closes a mesh file to a solid, None covers what is none as a skin, and False takes its triangles as
            they are, for `SolverOptions(surface="mesh")`.
        level: Level of the leaves of the tree of each body, 1 to 5; None is the object's own, 3 or 4.
        hand: A model, or right or left for the default hand of that side; None is the motion's side.
        rate: Ticks per second [Hz].
        mode: Resampling between two samples of the motion: interpolate, or hold the last one.
        seed: Seed of a script's tremor and sensor noise.

    Raises:
        UnknownNameError: No such object, trajectory or hand side; the message lists the near names.
        InputError: A file or an option that cannot be used, or a motion that cannot be done on this object.
    """
    moved = resolve_trajectory(motion) if isinstance(motion, str | Path) else motion
    bodies = load_object(object_, moved, unit=unit, size=size, solid=solid)
    level = level or bodies.level
    bodies = bodies.with_trees(tree_maker(level, solid=solid))
    description = {
        "object": bodies.name if isinstance(object_, Mesh) else str(object_),
        "object_mesh": bodies.mesh.sha256,
        "unit": unit,
        "size_mm": None if size is None else 1e3 * size,
        "object_repairs": list(bodies.mesh.repairs),
        "level": level,
        "tree_options": dict(bodies.tree.options),
        "trajectory": str(motion) if isinstance(motion, str | Path) else moved.name,
        "samples": mode,
        "place_object": "recorded",
        "seed": seed,
    }
    if isinstance(hand, str):
        check_known("hand", [hand], SIDES)
    model = hand if isinstance(hand, HandModel) else hand_of(moved, hand)
    return scene_of(bodies, [model], [moved], rate=rate, mode=mode, seed=seed, description=description)
