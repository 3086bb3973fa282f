"""Motions and scenes of both hands on one object."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import Trajectory
from hhsim.result.motion import holds_a_result, load_result_motion
from hhsim.result.reader import hand_paths
from hhsim.result.schema import SIDES
from hhsim.scene.closure_search import OtherHand
from hhsim.scene.described_scene import PlacedScene, SceneWords, described_scene
from hhsim.scene.motion_catalogue import Motion, Reading, clean_imported, is_imported, read_imported, resolve_trajectory
from hhsim.scene.parts_of_thing import ThingParts
from hhsim.scene.script import Script
from hhsim.scene.synthesis import planned
from hhsim.trees.sphere_tree import SphereTree

SAME_STAMP = 1e-6
"""Stamps no farther apart are one [s]."""


def motion_of_side(word: str, side: str, reading: Reading | None = None) -> Motion:
    """Return the motion of one of two hands, where a word names a recording or a result of both; "" has one hand."""
    path = Path(word)
    if side and (is_imported(path) or (holds_a_result(path) and len(hand_paths(path)) == len(SIDES))):
        return two_handed_motions(word, reading)[side == "left"]
    return resolve_trajectory(word, reading)


def two_handed_motions(word: str, reading: Reading | None = None) -> tuple[Motion, Motion]:
    """Return the motions of the right and of the left hand that a word on the command line means, over the same time.

    Errors as `resolve_trajectory`; also for a motion of one hand, or hands never seen together.
    """
    path = Path(word)
    if is_imported(path):
        recordings = [read_imported(path, side, reading) for side in SIDES]
        # On the file's own clock: stamps count from each hand's first one.
        stamps = [one.time + one.first_stamp for one in recordings]
        low, high = max(np.nanmin(each) for each in stamps), min(np.nanmax(each) for each in stamps)
        if not low < high:
            raise TrajectoryError(f"{word}: no time in which both hands were recorded")
        shared = [(each >= low - SAME_STAMP) & (each <= high + SAME_STAMP) for each in stamps]
        right, left = (clean_imported(path, one.chosen(inside)) for one, inside in zip(recordings, shared))
        return right, left
    if holds_a_result(path):
        both = hand_paths(path)
        if len(both) == 1:
            raise TrajectoryError(f"{word} holds one hand; --hand both expects a result of two hands")
        return load_result_motion(both[0]), load_result_motion(both[1])
    motion = resolve_trajectory(word)
    if not isinstance(motion, Script):
        raise TrajectoryError(f"{word} is of one hand; --hand both expects a script, or a recording of two hands")
    return motion.of_two(), motion.of_two()


def two_handed_scenes(
    words: SceneWords,
    mesh: Mesh,
    tree: SphereTree,
    hands: Sequence[HandModel],
    motions: Sequence[Motion],
    fingers: Sequence[str] = FINGERS,
    thing: tuple[ThingParts, Sequence[SphereTree]] | None = None,
) -> tuple[PlacedScene, PlacedScene]:
    """Make the scenes of the right and of the left hand; arguments and errors as of `described_scene`.

    In a script the left hand finds its place beside the right one. An object without a place in a recording is placed
    for the right hand.
    """
    given = words, mesh, tree
    right = described_scene(*given, hands[0], motions[0], fingers, thing=thing)
    motion = motions[1]
    if isinstance(motion, Script):
        other = OtherHand(hands[0], planned(motion, hands[0], tree))
        return right, described_scene(*given, hands[1], motion, fingers, other, thing)
    first = right.scene.trajectory
    if isinstance(motion, Trajectory) and first.object_motion is None:
        motion = motion.placed(first.object_position, first.object_orientation)
    as_placed = msgspec.structs.replace(words, place_object="recorded")
    return right, described_scene(as_placed, mesh, tree, hands[1], motion, fingers, thing=thing)
