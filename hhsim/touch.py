"""What a script demands of a hold, which finger touches which part of the object, and whether a hand does it.

A hold of a script may say what it touches::

    [[phase]]
    name = "hold"
    duration = 0.9
    touch = { thumb = "handle_inside", middle = "inside", index = ["ear_left", "ear_right"] }

The names are regions of the object (`hhsim.regions`); a list demands each of them. "anywhere" is any place. A hold that
says nothing demands, after a closing, that the fingers that closed touch anywhere, and the palm where it is to touch;
after a slide, nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.brute_distance import round_cone_contact, sphere_contact
from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand import FINGERS, HandModel
from hhsim.regions import object_region
from hhsim.sphere_tree import SphereTree

Array = NDArray[np.float64]

ANYWHERE = "anywhere"
PALM = "palm"
TOUCHERS = (*FINGERS, PALM)
TOUCHING = 1e-5
"""A part of the hand that is this near [m] to a sphere of the object touches it."""


@dataclass(frozen=True)
class Touch:
    """A finger or the palm, and the region that it must touch; `ANYWHERE` for any place."""

    part: str
    region: str = ANYWHERE

    def __str__(self) -> str:
        return self.part if self.region == ANYWHERE else f"{self.part} at {self.region.replace('_', ' ')}"


def parse_touch(where: str, given: Any) -> tuple[Touch, ...]:
    """Read the `touch` table of a hold.

    Raises:
        TrajectoryError: a part of the hand or a kind of value that it cannot name.
    """
    if not isinstance(given, Mapping):
        raise TrajectoryError(f'{where}: touch = {given!r}; expected a table such as {{ thumb = "handle" }}')
    found = []
    for part, regions in given.items():
        if part not in TOUCHERS:
            raise TrajectoryError(f"{where}: {UnknownNameError('part of the hand', part, TOUCHERS)}")
        names = [regions] if isinstance(regions, str) else regions
        if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
            raise TrajectoryError(f"{where}: touch.{part} = {regions!r}; expected the name of a region, or several")
        found += [Touch(part, name) for name in names]
    return tuple(found)


def touch_distances(
    touches: Sequence[Touch],
    object_name: str,
    hand: HandModel,
    tree: SphereTree,
    joints: Array,
    position: Array,
    rotation: Array,
) -> Array:
    """How far each demanded touch is from happening [m], shape (n,); infinite where nothing of the part is in reach.

    By brute force over all spheres: the least distance of the part to a sphere that it would touch within the region.

    Args:
        touches: what is demanded.
        object_name: of the catalogue, whose regions are meant; may be anything where all touches are anywhere.
        hand: the hand.
        tree: the object at rest in its own frame.
        joints: of the hand [m], object's frame, shape (5, 4, 3).
        position: of the palm [m], object's frame, shape (3,).
        rotation: palm to object, shape (3, 3).

    Raises:
        UnknownNameError: the object has no such region.
    """
    found = np.full(len(touches), np.inf)
    for number, touch in enumerate(touches):
        for distance, point in _contacts(touch.part, hand, tree, joints, position, rotation):
            held = np.ones(len(distance), bool)
            if touch.region != ANYWHERE:
                held = object_region(object_name, touch.region).holds(point)
            found[number] = min(found[number], distance[held].min(initial=np.inf))
    return found


def _contacts(
    part: str, hand: HandModel, tree: SphereTree, joints: Array, position: Array, rotation: Array
) -> list[tuple[Array, Array]]:
    """For each body of a part of the hand: distances to all leaves, shape (L,), and points on them, shape (L, 3)."""
    center, radius = tree.leaf_center, tree.leaf_radius
    if part == PALM:
        palm = hand.palm_tree
        places = palm.leaf_center @ rotation.T + position
        return [sphere_contact(center, radius, place, size) for place, size in zip(places, palm.leaf_radius)]
    f = FINGERS.index(part)
    return [
        round_cone_contact(center, radius, joints[f, k], joints[f, k + 1], *hand.radius[f, k : k + 2]) for k in range(3)
    ]
