"""Named regions of the catalogue's objects: the bunny's ears, the cup's handle, the teapot's spout.

The description of an object (`objects/*.toml`) states each as shapes that must all hold the contact point [m]::

    [regions]
    handle = [{ box = [[0.024, -0.01, -0.035], [0.06, 0.01, 0.04]] }]
    inside = [{ cylinder = [[-0.017, 0.0, -0.04], [-0.017, 0.0, 0.05]], radius = [0.034, 0.038] }]
    outside = [{ cylinder = […], radius = […], outside = true }]

A cylinder has a radius at each end and ends there; a sphere is `{ sphere = [x, y, z], radius = r }`; with
`outside = true` the point must not be in the shape.
"""

from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError, UnknownNameError
from hhsim.mesh.catalogue import object_description
from hhsim.system.settings_file import Settings, a_list, between, typed

SHAPES: dict[str, type] = {"box": type(None), "cylinder": tuple, "sphere": float}
"""Kinds of shapes, and the type of the radius of each."""
Coordinate = Annotated[float, between(-1e6, 1e6)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Radius = Annotated[float, between(0.0, 1e6)]


class Shape(Settings, frozen=True):
    """A box, a straight cone frustum or a ball in the object's frame; the module's docstring explains the keys."""

    box: tuple[Point, Point] | None = None
    cylinder: tuple[Point, Point] | None = None
    sphere: Point | None = None
    radius: Radius | Annotated[tuple[Radius, ...], Meta(min_length=2, max_length=2)] | None = None
    outside: bool = False

    def check(self) -> None:
        """Check that it is exactly one of the shapes, with an inside."""
        kinds = [kind for kind in SHAPES if getattr(self, kind) is not None]
        if len(kinds) != 1 or not isinstance(self.radius, SHAPES[kinds[0]]):
            raise InputError("expected a box, a cylinder and its radius at both ends, or a sphere and its radius")
        if self.box is not None and np.greater(*self.box).any():
            raise InputError(f"box = {self.box} holds no point")
        if self.cylinder is not None and self.cylinder[0] == self.cylinder[1]:
            raise InputError("a cylinder needs two different ends")

    def holds(self, points: FloatArray) -> BoolArray:
        """Return True for each point [m], shape (n, 3), that it holds; shape (n,)."""
        if self.box is not None:
            inside = ((points >= self.box[0]) & (points <= self.box[1])).all(axis=1)
        elif self.cylinder is None:
            inside = np.linalg.norm(points - np.array(self.sphere), axis=1) <= self.radius
        else:
            ends, radius = np.array(self.cylinder), np.array(self.radius)
            axis = ends[1] - ends[0]
            share = (points - ends[0]) @ axis / (axis @ axis)
            away = np.linalg.norm(points - ends[0] - share[:, None] * axis, axis=1)
            limit = radius[0] + share * (radius[1] - radius[0])
            inside = (share >= 0.0) & (share <= 1.0) & (away <= limit)
        return np.asarray(inside != self.outside)


Shapes = Annotated[tuple[Shape, ...], a_list("[{ box = [[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]] }]")]


@dataclass(frozen=True, eq=False)
class Region:
    """Named region of an object: the intersection of its shapes."""

    name: str
    shapes: tuple[Shape, ...]

    def holds(self, points: ArrayLike) -> BoolArray:
        """Return True for each point of the object's frame [m], shape (n, 3), that it holds; shape (n,)."""
        array = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        return np.asarray(np.all([shape.holds(array) for shape in self.shapes], axis=0))


@cache
def object_regions(name: str) -> dict[str, Region]:
    """Return the regions of a catalogue object by name; most have none. InputError for an invalid description."""
    regions = typed(object_description(name).get("regions", {}), dict[str, Shapes], f"objects/{name}.toml: regions")
    return {region: Region(region, shapes) for region, shapes in regions.items()}


def object_region(name: str, region: str) -> Region:
    """Return one region of a catalogue object; UnknownNameError without such an object or region."""
    known = object_regions(name)
    if region not in known:
        raise UnknownNameError(f"region of the {name}", region, known)
    return known[region]
