"""Touches that a script demands at the end of a hold, and the distances of a hand from them.

A hold may state them: `touch = { thumb = "handle_inside", index = ["ear_left", "ear_right"] }`, names of regions of the
object (`hhsim.scene.object_regions`), each of a list, or "anywhere". A hold that states none demands, after a closing,
that the fingers that closed touch anywhere, and the palm if it is to touch; after a slide, nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.metrics.brute_force_distance import round_cone_contact, round_cone_distance, sphere_contact
from hhsim.scene.object_regions import object_region
from hhsim.system.settings_file import one_of
from hhsim.trees.sphere_tree import SphereTree

ANYWHERE = "anywhere"
PALM = "palm"
TOUCHERS = (*FINGERS, PALM)
CHUNK = 64
"""Number of leaves whose contact points are computed together."""
TOUCHING = 1e-5
"""A body that is this near [m] to a sphere of the object touches it."""


@dataclass(frozen=True)
class Touch:
    """A finger or the palm, and the region that it must touch; `ANYWHERE` for any place."""

    part: str
    region: str = ANYWHERE

    def __str__(self) -> str:
        return self.part if self.region == ANYWHERE else f"{self.part} at {self.region.replace('_', ' ')}"


Region = Annotated[str, Meta(min_length=1)]
Regions = Annotated[
    Region | Annotated[tuple[Region, ...], Meta(min_length=1)], Meta(description="the name of a region, or several")
]
TouchTable = dict[Annotated[str, one_of(TOUCHERS)], Regions]
"""Table `touch` of a hold: region, or regions, that each body must touch."""


def touches_of(table: TouchTable) -> tuple[Touch, ...]:
    """Return the touches that the `touch` table of a hold demands."""
    found = ((part, (named,) if isinstance(named, str) else named) for part, named in table.items())
    return tuple(Touch(part, region) for part, regions in found for region in regions)


def touch_distances(
    touches: Sequence[Touch],
    object_name: str,
    hand: HandModel,
    tree: SphereTree,
    joints: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
) -> FloatArray:
    """Compute the distance [m] of each demanded touch, shape (n,); infinite where no sphere is in its region.

    The least distance of the body to a sphere that it would touch within the region, by brute force over all spheres.
    `joints` (5, 4, 3) [m], `position` (3,) [m] and `rotation` (3, 3) of the hand are in the frame of the object at
    rest, a catalogue object if a touch names a region.

    Raises:
        UnknownNameError: The object has no such region.
    """
    bodies = {part: _bodies(part, hand, joints, position, rotation) for part in {touch.part for touch in touches}}
    return np.array(
        [min(_nearest(touch, object_name, tree, *body) for body in bodies[touch.part]) for touch in touches]
    )


def _bodies(
    part: str, hand: HandModel, joints: FloatArray, position: FloatArray, rotation: FloatArray
) -> list[tuple[FloatArray, FloatArray, float, float]]:
    if part == PALM:
        places = hand.palm_tree.leaf_center @ rotation.T + position
        return [(place, place, size, size) for place, size in zip(places, hand.palm_tree.leaf_radius.tolist())]
    f = FINGERS.index(part)
    return [(joints[f, k], joints[f, k + 1], *hand.radius[f, k : k + 2].tolist()) for k in range(3)]


def _nearest(
    touch: Touch, object_name: str, tree: SphereTree, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> float:
    center, radius = tree.leaf_center, tree.leaf_radius
    ball = a is b
    if ball:
        distance = np.linalg.norm(center - a, axis=1) - radius - radius_a
    else:
        distance = round_cone_distance(center, a, b, radius_a, radius_b) - radius
    if touch.region == ANYWHERE:
        return float(distance.min())
    region, nearest = object_region(object_name, touch.region), np.argsort(distance)
    # Contact points cost more than distances, and the nearest leaves decide.
    for first in range(0, len(nearest), CHUNK):
        some = nearest[first : first + CHUNK]
        leaves = center[some], radius[some]
        _, points = (
            sphere_contact(*leaves, a, radius_a) if ball else round_cone_contact(*leaves, a, b, radius_a, radius_b)
        )
        held = region.holds(points)
        if held.any():
            return float(distance[some[held]].min())
    return np.inf
