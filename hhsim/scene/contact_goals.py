"""What a script demands of a hold, which finger touches which part of the object, and whether a hand does it.

A hold of a script may say what it touches::

    [[phase]]
    name = "hold"
    duration = 0.9
    touch = { thumb = "handle_inside", middle = "inside", index = ["ear_left", "ear_right"] }

The names are regions of the object (`hhsim.scene.object_regions`); a list demands each of them. "anywhere" is any
place. A hold that says nothing demands, after a closing, that the fingers that closed touch anywhere, and the palm
where it is to touch; after a slide, nothing.
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
"""Leaves whose contact points are looked at together."""
TOUCHING = 1e-5
"""A part of the hand that is this near [m] to a sphere of the object touches it."""


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
"""Table `touch` of a hold: the region, or the regions, that each part of the hand must touch."""


def touches_of(table: TouchTable) -> tuple[Touch, ...]:
    """Return what the `touch` table of a hold demands."""
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
    """How far each demanded touch is from happening [m], shape (n,); infinite where nothing of the part is in reach.

    By brute force over all spheres: the least distance of the part to a sphere that it would touch within the region.

    Args:
        object_name: Of the catalogue, whose regions are meant; may be anything where all touches are anywhere.
        tree: The object at rest in its own frame.
        joints: Of the hand [m], object's frame, shape (5, 4, 3).
        position: Of the palm [m], object's frame, shape (3,).
        rotation: Palm to object, shape (3, 3).

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
    """The round cones of a finger, or the spheres of the palm as cones of no length: both ends and both radii."""
    if part == PALM:
        places = hand.palm_tree.leaf_center @ rotation.T + position
        return [(place, place, size, size) for place, size in zip(places, hand.palm_tree.leaf_radius.tolist())]
    f = FINGERS.index(part)
    return [(joints[f, k], joints[f, k + 1], *hand.radius[f, k : k + 2].tolist()) for k in range(3)]


def _nearest(
    touch: Touch, object_name: str, tree: SphereTree, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> float:
    """Least distance of a body to a leaf that it would touch within the region."""
    center, radius = tree.leaf_center, tree.leaf_radius
    ball = a is b
    if ball:
        distance = np.linalg.norm(center - a, axis=1) - radius - radius_a
    else:
        distance = round_cone_distance(center, a, b, radius_a, radius_b) - radius
    if touch.region == ANYWHERE:
        return float(distance.min())
    region = object_region(object_name, touch.region)
    nearest = np.argsort(distance)
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
