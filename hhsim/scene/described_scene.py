"""Scenes by words, as `hhsim replay` takes them: bodies and motions are loaded, trees grown, the object placed.

The object of a recording that is in no world is placed where the hand touches it; a scene is described for its result.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, structs

from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import SIDES, HandModel, Side
from hhsim.hand.quaternion import rotation_matrix
from hhsim.linkage.file import names_a_linkage, solid_for
from hhsim.mesh.catalogue import names_a_body_file, names_a_file, object_description
from hhsim.mesh.mesh import Mesh, unit_length_of
from hhsim.metrics.metrics import hand_clearance
from hhsim.motion.trajectory import ResampleMode, Trajectory
from hhsim.ranges import RANGES
from hhsim.result.motion import holds_a_result, load_result_motion
from hhsim.result.reader import load_result
from hhsim.scene.body import CLEARANCE, Free
from hhsim.scene.contact_goals import TOUCHING
from hhsim.scene.declared_bodies import NONE, UNDER, DeclaredBodies, load_object
from hhsim.scene.motion_catalogue import Motion, Reading, clean_imported, is_imported, read_imported, resolve_trajectory
from hhsim.scene.recorded_grasp_pose import GraspPlacement, place_at_grasp
from hhsim.scene.scene import Scene, hand_of, scene_of
from hhsim.scene.script import Script
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import Settings, between
from hhsim.trees.foreign_tree import load_tree_for
from hhsim.trees.options import MOST_LEVEL
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.triangle_tree import chosen_tree

Place = Literal["recorded", "auto"]
Tremor = Annotated[float, between(0.0, 100.0)]
TWO = "two numbers, [mm] and [°], such as [0.1, 0.2]"

MOST_START_DEPTH = 0.005
"""A hand that begins deeper [m] in the object was not recorded at it: fit, tracker and spheres are off by less."""
SAME_STAMP = 1e-6
"""Stamps no farther apart are one [s]."""


class FreeWords(Settings, frozen=True, kw_only=True):
    """Properties of an object that `--free` makes free, SI; None where one was not given."""

    mass: Annotated[float, between(*RANGES["mass"][:2])] | None = None
    density: Annotated[float, between(*RANGES["density"][:2])] | None = None
    friction: Annotated[float, between(*RANGES["friction"][:2])] | None = None
    torsion: Annotated[float, between(*RANGES["torsion"][:2])] | None = None
    table: Literal["under", "none"] | float | None = None  # height [m], world
    table_friction: Annotated[float, between(*RANGES["table_friction"][:2])] | None = None

    def given(self) -> dict[str, Any]:
        """Return what was given, by name."""
        return {name: value for name, value in structs.asdict(self).items() if value is not None}


class SceneWords(Settings, frozen=True, kw_only=True):
    """Arguments of a scene, as `hhsim replay` takes them; None where an argument was not given."""

    object: str  # name of the catalogue, or a file
    trajectory: str  # name of the catalogue, or a file
    unit: str | None = None  # unit of a mesh file
    size_mm: float | None = None  # its longest extent [mm]
    solid: bool = False  # True if it is closed to a solid
    level: Annotated[int, between(1, MOST_LEVEL)] | None = None  # level of the tree
    max_error: Annotated[float, between(1e-6, 1.0)] | None = None  # error that the level was chosen by [m]
    tree: str | None = None  # file of the tree
    hand: Literal["right", "left", "both"] | None = None  # side of the hand
    free: FreeWords | None = None  # of an object that is made free
    hand_file: str | None = None  # file of the hand's sizes
    # Amplitudes of a script's tremor: position [mm] and rotation [°].
    tremor_mm_deg: Annotated[tuple[Tremor, Tremor], Meta(description=TWO)] | None = None
    reading: dict[str, Any] | None = None  # options of an import on the way in, a `Reading`
    samples: ResampleMode = "interpolate"  # interpolation between two samples of the motion
    # Placement of a recording's object; None: as recorded, unless the hand touches nothing there, or begins inside in
    # an import (which has flags) without an object place; then where the fingers close.
    place_object: Place | None = None
    # "recorded", or "fixed" for an object that stands still although its recording moves it.
    object_pose: str = "recorded"
    rate: Annotated[float, between(1.0, 100_000.0)] = 1000.0
    ticks: int | None = None  # number of first ticks to run
    seed: int = 0

    def check(self) -> None:
        """Raise InputError if two arguments choose the level."""
        if self.level is not None and self.max_error is not None:
            raise InputError("max_error chooses the level itself: leave level out")


@dataclass(frozen=True)
class PlacedScene:
    """A scene, and the placement of its object."""

    scene: Scene
    # Placement of a recording's object; None where the motion states it or a script finds it.
    placement: GraspPlacement | None = None
    by_itself: bool = False  # True if the object was placed because the recording states no place, not on demand
    note: str = ""  # a sentence for the user, or ""
    notes: tuple[str, ...] = ()  # on the choice of trees

    def to_json(self) -> dict[str, Any] | None:
        """Return the placement as plain values, SI; None where there is none."""
        return None if self.placement is None else {**self.placement.to_json(), "by_itself": self.by_itself}


@dataclass(frozen=True, eq=False)
class LoadedWords:
    """Motions and bodies, still without trees, that the words of a scene name."""

    words: SceneWords
    motions: tuple[Motion, ...]  # of one hand, or of the right and the left one
    bodies: DeclaredBodies
    solid: bool | None  # False takes triangles as they are

    @property
    def hands(self) -> list[HandModel]:
        """Models of the hands; HhsimError for a damaged file of sizes."""
        words = self.words
        sides: tuple[Side | None, ...] = SIDES if words.hand == "both" else (words.hand,)
        return [hand_of(motion, side, words.hand_file) for motion, side in zip(self.motions, sides)]

    def with_trees(self, report: Progress = silent) -> tuple[DeclaredBodies, tuple[str, ...]]:
        """Return the bodies with their trees, and notes on the choice."""
        words, notes = self.words, list[str]()

        def grow(mesh: Mesh) -> SphereTree:
            if words.tree is None:
                tree, own = chosen_tree(mesh, words.level or self.bodies.level, words.max_error, self.solid, report)
            else:
                unit_length = 1.0
                if names_a_file(words.object) and not names_a_linkage(words.object):
                    size = None if words.size_mm is None else 1e-3 * words.size_mm
                    unit_length = unit_length_of(words.object, words.unit, size)
                found = load_tree_for(Path(words.tree), mesh, unit_length)
                tree, own = found.tree, (f"the sphere tree is that of {words.tree}", *found.notes)
            notes.extend(own)
            return tree

        return self.bodies.with_trees(grow), tuple(dict.fromkeys(notes))

    def placed(self, fingers: Sequence[str] = FINGERS, report: Progress = silent) -> PlacedScene:
        """Grow the trees and make the scene, for hands that use some fingers; errors as `load_words`."""
        bodies, notes = self.with_trees(report)
        placed = described_scene(self.words, bodies, self.hands, self.motions, fingers)
        return replace(placed, scene=self.freed(placed.scene), notes=notes)

    def freed(self, scene: Scene) -> Scene:
        """Return a scene with its body free if the words say so; those of a URDF or MJCF are so already."""
        free, word = self.words.free, self.words.object
        if free is None or names_a_linkage(word):
            return scene
        known: Mapping[str, Any] = {} if names_a_file(word) else object_description(word)
        usual = {name: known[name] for name in ("density", "friction") if name in known}
        given = {**usual, "table": UNDER, **free.given()}
        heights: dict[Any, float | None] = {
            UNDER: float(scene.solids[0].placed_mesh.bounds[0, 2]) - CLEARANCE,
            NONE: None,
        }
        return scene.freed(**given | {"table": heights.get(given["table"], given["table"])})


def load_words(words: SceneWords, *, surface: str = "spheres", motions: Sequence[Motion] | None = None) -> LoadedWords:
    """Load the motions, unless they are given, and the bodies that words name.

    Triangles are taken as they are for the surface `mesh`; for spheres a mesh that is no solid is a skin. Raises
    UnknownNameError for no such object, trajectory or joint; InputError for a file or words that cannot be used, or do
    not go together; TrajectoryError for a motion that cannot be done on this object.
    """
    motions = _motions(words) if motions is None else tuple(motions)
    size = None if words.size_mm is None else 1e-3 * words.size_mm
    links = None if words.free is None or not names_a_linkage(words.object) else words.free.given()
    about: dict[str, Any] = {"unit": words.unit, "size": size, "free": links}
    # What is free has a mass.
    solid = solid_for(surface, words.solid or (surface == "spheres" and words.free is not None and links is None))
    bodies = load_object(words.object, next(iter(motions), None), solid=solid, **about)
    if len(bodies.solids) > 1 and words.tree is not None:
        raise InputError(f"--tree is for one object, not for '{words.object}'")
    if words.free is not None and links is None:
        if names_a_body_file(words.object):
            raise InputError(f"--free is for a mesh; '{words.object}' says itself how its bodies move")
        # Before the tree is built: a mesh that can have no mass is refused.
        Free.of_mesh(
            bodies.mesh, **{name: of for name, of in words.free.given().items() if name in ("mass", "density")}
        )
    return LoadedWords(words, motions, bodies, solid)


def _motions(words: SceneWords) -> tuple[Motion, ...]:
    """Return the motion that the words name, or that of the right and of the left hand, with its tremor."""
    word = words.trajectory
    if words.reading and not is_imported(Path(word)):
        raise InputError(f"{', '.join(words.reading)}: of a recording that is imported, and '{word}' is not")
    if words.hand == "both":
        return tuple(_shaped(words, motion) for motion in two_handed_motions(word, words.reading))
    # Of a recording of both hands `resolve_trajectory` takes one.
    side = "" if is_imported(Path(word)) else words.hand or ""
    return (_shaped(words, motion_of_side(word, side, words.reading)),)


def _shaped(words: SceneWords, motion: Motion) -> Motion:
    """Return a motion with its tremor, or on an object that stays; InputError for words that do not go with it."""
    word = words.trajectory
    if words.place_object == "auto" and not isinstance(motion, Trajectory):
        raise InputError(f"--place-object is for recordings; '{word}' finds its place at the object itself")
    if isinstance(motion, Trajectory) and motion.object_motion is not None:
        if words.object_pose == "fixed":
            motion = motion.placed(motion.object_position, motion.object_orientation)
        elif words.place_object == "auto":
            raise InputError(
                f"'{word}' holds where its object was at every moment: --place-object auto needs --object-pose fixed"
            )
    elif words.object_pose == "fixed" and isinstance(motion, Script):
        raise InputError(f"--object-pose is for recordings; in '{word}' the object moves by the script")
    if words.tremor_mm_deg is None:
        return motion
    if not isinstance(motion, Script):
        raise InputError(f"--tremor is for scripts; '{word}' is a recording, with what tremor the hand had")
    return motion.shaken(words.tremor_mm_deg)


def described_scene(
    words: SceneWords,
    bodies: DeclaredBodies,
    hands: Sequence[HandModel],
    motions: Sequence[Motion],
    fingers: Sequence[str] = FINGERS,
) -> PlacedScene:
    """Make a scene with its description, and place the object of a recording that is in no world.

    Keypoints of a camera are such a recording. The bodies have their trees; `hands` are one, or the right and the left
    one, with a motion each, of which the first one places the object; `fingers` are used. Raises TrajectoryError for a
    motion that cannot be done on this object, or cannot be placed as demanded.
    """
    placed = _placed_scene(words, bodies, hands, motions, fingers)
    # Cut last: where the object is placed does not depend on how much of the motion is run.
    scene = placed.scene if words.ticks is None else placed.scene.first(words.ticks)
    is_cut = scene.ticks.tick_count < placed.scene.ticks.tick_count
    as_given = ("object", "trajectory", "unit", "size_mm", "max_error", "tree", "samples", "hand_file")
    description = {
        **scene.description,
        **{name: getattr(words, name) for name in (*as_given, "tremor_mm_deg", "seed")},
        "object_mesh": bodies.mesh.sha256,
        "object_repairs": list(bodies.mesh.repairs),
        "level": bodies.tree.depth,
        "tree_options": dict(bodies.tree.options),
        "place_object": "recorded" if placed.placement is None else "auto",
        "placement": placed.to_json(),
        **({"solid": True} if words.solid else {}),
        **({"ticks": scene.ticks.tick_count} if is_cut else {}),
        **({} if words.reading is None else {"reading": words.reading}),
        **({} if words.free is None else {"free": words.free.given()}),
        # Files of objects that stand still by themselves do not mention it.
        **({"object_pose": "fixed"} if words.object_pose == "fixed" else {}),
    }
    return replace(placed, scene=replace(scene, description=description))


def _placed_scene(
    words: SceneWords,
    bodies: DeclaredBodies,
    hands: Sequence[HandModel],
    motions: Sequence[Motion],
    fingers: Sequence[str],
) -> PlacedScene:
    def make(first: Motion) -> Scene:
        more: dict[str, Any] = {"rate": words.rate, "mode": words.samples, "seed": words.seed}
        return scene_of(bodies, hands, [first, *motions[1:]], **more)

    motion, hand = motions[0], hands[0]
    if words.place_object == "auto" and isinstance(motion, Trajectory):
        found = place_at_grasp(motion, hand, bodies.tree)
        return PlacedScene(make(found.motion), found, note=found.text)
    scene = make(motion)
    if words.place_object == "recorded" or not isinstance(motion, Trajectory) or motion.object_motion is not None:
        return PlacedScene(scene)
    tree = bodies.tree.transformed(rotation_matrix(motion.object_orientation), motion.object_position)
    # Only an import states no object place. A session, or a synthesised motion, may well begin inside.
    imported = motion.flags is not None and not motion.object_position.any()
    inside = imported and least_distance(scene, tree, fingers, 0.0, ticks=1) < -MOST_START_DEPTH
    if not inside and least_distance(scene, tree, fingers) < TOUCHING:
        return PlacedScene(scene)
    why = f"as the recording has it, the hand {'begins inside the object' if inside else 'touches nothing'}"
    try:
        found = place_at_grasp(motion, hand, bodies.tree)
        if inside and found.start_gap <= 0.0:
            raise TrajectoryError("the hand would begin inside wherever its fingers close on the object")
    except TrajectoryError as error:
        return PlacedScene(scene, note=f"{why}, and no other place was found: {error}")
    return PlacedScene(make(found.motion), found, by_itself=True, note=f"{why}, so {found.text}")


def least_distance(
    scene: Scene, tree: SphereTree, fingers: Sequence[str] = FINGERS, limit: float = TOUCHING, ticks: int | None = None
) -> float:
    """Compute the least signed distance of palm and named fingers of the first haptic hand to a tree's leaves [m].

    The tree is in the world; counted are the first `ticks`, by default all, and distances up to `limit`.
    """
    model, haptic = scene.hands[0].model, HandConfiguration.of(scene.hands[0].ticks).part(0, ticks)
    placed = forward_kinematics(model, *haptic)
    palm, finger = hand_clearance(tree.arrays(), hand_shape(model), placed, limit=limit)
    modelled = finger[:, [name in fingers for name in FINGERS]]
    return float(min(np.nanmin(palm, initial=limit), np.nanmin(modelled, initial=limit)))


def motion_of_side(word: str, side: str, reading: Reading | None = None) -> Motion:
    """Return the motion of one of two hands, where a word names a recording or a result of both; "" has one hand."""
    path = Path(word)
    if side and is_imported(path):
        return two_handed_motions(word, reading)[side == "left"]
    if side and holds_a_result(path) and not load_result(path).name:
        return load_result_motion(path, side)
    return resolve_trajectory(word, reading)


def two_handed_motions(word: str, reading: Reading | None = None) -> tuple[Motion, Motion]:
    """Return the motions of the right and of the left hand that a word on the command line means, over the same time.

    Errors as `resolve_trajectory`; also for a motion of one hand, or hands never seen together.
    """
    path = Path(word)
    if path.is_dir():
        # What `hhsim scene` writes of two hands.
        right, left = (resolve_trajectory(path / f"{side}_motion.csv") for side in SIDES)
        return right, left
    if is_imported(path):
        from hhsim.recordings.unit_detection import near_origin

        # Each wrist would stand at the origin without a world: that of the recording keeps their distance.
        recordings = [read_imported(path, side, {"usual_up": "z", **(reading or {})}) for side in SIDES]
        # On the file's own clock: stamps count from each hand's first one.
        stamps = [one.time + one.first_stamp for one in recordings]
        low, high = max(np.nanmin(each) for each in stamps), min(np.nanmax(each) for each in stamps)
        if not low < high:
            raise TrajectoryError(f"{word}: no time in which both hands were recorded")
        shared = [(each >= low - SAME_STAMP) & (each <= high + SAME_STAMP) for each in stamps]
        chosen = [one.chosen(inside) for one, inside in zip(recordings, shared)]
        if not any(np.nan_to_num(one.position).any() for one in chosen):
            raise TrajectoryError(f"{word}: no place of either hand, so nothing tells how far apart they are")
        right, left = (clean_imported(path, hand) for hand in near_origin(*chosen))
        return right, left
    if holds_a_result(path):
        if load_result(path).name:
            raise TrajectoryError(f"{word} holds one hand; --hand both expects a result of two hands")
        return load_result_motion(path, SIDES[0]), load_result_motion(path, SIDES[1])
    motion = resolve_trajectory(word)
    if not isinstance(motion, Script):
        raise TrajectoryError(f"{word} is of one hand; --hand both expects a script, or a recording of two hands")
    return motion.of_two(), motion.of_two()
