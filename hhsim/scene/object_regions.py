"""Named parts of the catalogue's objects: the bunny's ears, the cup's handle, the teapot's spout.

A region is where a contact point may lie, in the object's frame. The description of an object (`objects/*.toml`) states
each as a list of shapes that must all hold the point, lengths in metres::

    [regions]
    handle = [{ box = [[0.024, -0.01, -0.035], [0.06, 0.01, 0.04]] }]
    inside = [{ cylinder = [[-0.017, 0.0, -0.04], [-0.017, 0.0, 0.05]], radius = [0.034, 0.038] }]
    outside = [{ cylinder = […], radius = […], outside = true }]

A cylinder has a radius at each end and ends there. A sphere is
`{ sphere = [x, y, z], radius = r }`. With `outside = true` the point must not be in the shape.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError, UnknownNameError
from hhsim.mesh.catalogue import object_description

SHAPES = ("box", "cylinder", "sphere")


@dataclass(frozen=True, eq=False)
class Shape:
    """A box, a straight cone frustum or a ball in the object's frame.

    Attributes:
        kind: Of `SHAPES`.
        points: Lowest and highest corner, the two ends of the axis, or the centre [m], shape (2, 3) or (1, 3).
        radius: At the two ends, or of the ball [m]; empty for a box.
        outside: Whether it holds what is not in it.
    """

    kind: str
    points: FloatArray
    radius: FloatArray
    outside: bool = False

    def holds(self, points: FloatArray) -> BoolArray:
        """Whether it holds points [m], shape (n, 3); shape (n,)."""
        if self.kind == "box":
            inside = ((points >= self.points[0]) & (points <= self.points[1])).all(axis=1)
        elif self.kind == "sphere":
            inside = np.linalg.norm(points - self.points[0], axis=1) <= self.radius[0]
        else:
            axis = self.points[1] - self.points[0]
            share = (points - self.points[0]) @ axis / (axis @ axis)
            away = np.linalg.norm(points - self.points[0] - share[:, None] * axis, axis=1)
            limit = self.radius[0] + share * (self.radius[1] - self.radius[0])
            inside = (share >= 0.0) & (share <= 1.0) & (away <= limit)
        return np.asarray(inside != self.outside)


@dataclass(frozen=True, eq=False)
class Region:
    """A named part of an object: what all of its shapes hold."""

    name: str
    shapes: tuple[Shape, ...]

    def holds(self, points: ArrayLike) -> BoolArray:
        """Whether it holds points of the object's frame [m], shape (n, 3); shape (n,)."""
        array = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        held = np.ones(len(array), bool)
        for shape in self.shapes:
            held &= shape.holds(array)
        return held


@cache
def object_regions(name: str) -> dict[str, Region]:
    """The regions of an object of the catalogue, by name; none for most.

    Raises:
        UnknownNameError: No such object.
        InputError: Its description holds a region that is none.
    """
    given = object_description(name).get("regions", {})
    return {region: parse_region(f"objects/{name}.toml", region, shapes) for region, shapes in given.items()}


def object_region(name: str, region: str) -> Region:
    """One region of an object of the catalogue.

    Raises:
        UnknownNameError: No such object, or it has no such region.
    """
    known = object_regions(name)
    if region not in known:
        raise UnknownNameError(f"region of the {name}", region, known)
    return known[region]


def parse_region(where: str, name: str, shapes: Any) -> Region:
    """Read a region from its part of a TOML file; `where` names that in messages.

    Raises:
        InputError: It is no list of shapes, or a shape is not as the module's docstring says.
    """
    where = f"{where}: region {name}"
    if not isinstance(shapes, list) or not shapes:
        raise InputError(f"{where}: expected a list of shapes")
    return Region(name, tuple(_shape(where, table) for table in shapes))


def _shape(where: str, table: Any) -> Shape:
    if not isinstance(table, Mapping) or sum(kind in table for kind in SHAPES) != 1:
        raise InputError(f"{where}: {table!r}; expected a shape, one of {', '.join(SHAPES)}")
    kind = next(kind for kind in SHAPES if kind in table)
    known = {kind, "outside"} | ({"radius"} if kind != "box" else set())
    outside = table.get("outside", False)
    if set(table) - known or not isinstance(outside, bool) or (kind != "box") != ("radius" in table):
        raise InputError(f"{where}: {dict(table)!r}; expected the keys {', '.join(sorted(known))}")
    count = 1 if kind == "sphere" else 2
    points = _numbers(where, table[kind], 3 * count).reshape(count, 3)
    radius = _numbers(where, table["radius"], count) if kind != "box" else np.zeros(0)
    if (radius < 0.0).any() or (kind == "box" and (points[0] > points[1]).any()):
        raise InputError(f"{where}: {dict(table)!r} holds no point")
    if kind == "cylinder" and np.array_equal(points[0], points[1]):
        raise InputError(f"{where}: a cylinder needs two different ends")
    return Shape(kind, points, radius, outside)


def _numbers(where: str, given: Any, count: int) -> FloatArray:
    try:
        values = np.asarray(given, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.size != count or not np.isfinite(values).all():
        raise InputError(f"{where}: {given!r}; expected {count} numbers [m]")
    return values
