"""Touches that a script demands at the end of a hold, the distances of a hand from them, and regions of an object.

docs/toml.md has the keys of a hold and of the regions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np
from msgspec import Meta

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import check_known
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import object_description
from hhsim.metrics.brute_force_distance import round_cone_contact, round_cone_distance, sphere_contact
from hhsim.reproducible import dot, matmul
from hhsim.system.settings_file import Settings, a_list, one_of, typed
from hhsim.trees.sphere_tree import SphereTree

ANYWHERE = "anywhere"
PALM = "palm"
TOUCHERS = (*FINGERS, PALM)
CHUNK = 64
"""Number of leaves whose contact points are computed together."""
TOUCHING = 1e-5
"""A body that is this near [m] to a sphere of the object touches it."""

Point = tuple[float, float, float]


class Shape(Settings, frozen=True):
    """A box or a straight cone frustum in the object's frame; docs/toml.md explains the keys."""

    box: tuple[Point, Point] | None = None
    cylinder: tuple[Point, Point] | None = None
    radius: tuple[float, float] = (0.0, 0.0)
    outside: bool = False

    def holds(self, points: FloatArray) -> BoolArray:
        """Return True for each point [m], shape (n, 3), that it holds; shape (n,)."""
        if self.box is not None:
            inside = ((points >= self.box[0]) & (points <= self.box[1])).all(axis=1)
        else:
            ends, radius = np.array(self.cylinder), np.array(self.radius)
            axis = ends[1] - ends[0]
            share = dot(points - ends[0], axis) / dot(axis, axis)
            away = np.linalg.norm(points - ends[0] - share[:, None] * axis, axis=1)
            limit = radius[0] + share * (radius[1] - radius[0])
            inside = (share >= 0.0) & (share <= 1.0) & (away <= limit)
        return np.asarray(inside != self.outside)


Region = Annotated[tuple[Shape, ...], a_list("[{ box = [[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]] }]")]
"""Region of an object: the intersection of its shapes."""


def holds(region: Region, points: FloatArray) -> BoolArray:
    """Return True for each point of the object's frame [m], shape (n, 3), that a region holds; shape (n,)."""
    return np.asarray(np.all([shape.holds(points) for shape in region], axis=0))


@cache
def object_regions(name: str) -> dict[str, Region]:
    """Return the regions of a catalogue object by name; most have none. InputError for an invalid description."""
    return typed(object_description(name).get("regions", {}), dict[str, Region], f"objects/{name}.toml: regions")


@dataclass(frozen=True)
class Touch:
    """A finger or the palm, and the region that it must touch; `ANYWHERE` for any place."""

    part: str
    region: str = ANYWHERE

    def __str__(self) -> str:
        return self.part if self.region == ANYWHERE else f"{self.part} at {self.region.replace('_', ' ')}"


Name = Annotated[str, Meta(min_length=1)]
Names = Annotated[
    Name | Annotated[tuple[Name, ...], Meta(min_length=1)], Meta(description="the name of a region, or several")
]
TouchTable = dict[Annotated[str, one_of(TOUCHERS)], Names]
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
    rest, a catalogue object if a touch names a region. Raises UnknownNameError where the object has no such region.
    """
    bodies = {part: _bodies(part, hand, joints, position, rotation) for part in {touch.part for touch in touches}}
    return np.array(
        [min(_nearest(touch, object_name, tree, *body) for body in bodies[touch.part]) for touch in touches]
    )


def _bodies(
    part: str, hand: HandModel, joints: FloatArray, position: FloatArray, rotation: FloatArray
) -> list[tuple[FloatArray, FloatArray, float, float]]:
    if part == PALM:
        places = matmul(hand.palm_tree.leaf_center, rotation.T) + position
        return [(place, place, size, size) for place, size in zip(places, hand.palm_tree.leaf_radius.tolist())]
    f = FINGERS.index(part)
    return [(joints[f, k], joints[f, k + 1], *hand.radius[f, k : k + 2].tolist()) for k in range(3)]


def _nearest(
    touch: Touch, object_name: str, tree: SphereTree, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> float:
    center, radius = tree.leaf_center, tree.leaf_radius
    # A sphere of the palm comes from `_bodies` with one array as both ends.
    ball = a is b
    if ball:
        distance = np.linalg.norm(center - a, axis=1) - radius - radius_a
    else:
        distance = round_cone_distance(center, a, b, radius_a, radius_b) - radius
    if touch.region == ANYWHERE:
        return float(distance.min())
    known, nearest = object_regions(object_name), np.argsort(distance)
    check_known(f"region of the {object_name}", [touch.region], known)
    # Contact points cost more than distances, and the nearest leaves decide.
    for first in range(0, len(nearest), CHUNK):
        some = nearest[first : first + CHUNK]
        leaves = center[some], radius[some]
        _, points = (
            sphere_contact(*leaves, a, radius_a) if ball else round_cone_contact(*leaves, a, b, radius_a, radius_b)
        )
        held = holds(known[touch.region], points)
        if held.any():
            return float(distance[some[held]].min())
    return np.inf
