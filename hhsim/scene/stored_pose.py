"""A hand's place on one object, stored with a script: what a description such as "thumb in the handle" needs.

A script that closes anywhere finds its place by itself (`hhsim.scene.closure_search`). Where it has to touch named
parts of an object, the place was searched for once (`tools/placement_search.py`) and is kept in the script::

    [[placement]]
    object = "cup"                 # of the catalogue; the frame below is the object's own
    position = [0.03, 0.0, 0.12]   # palm origin where the fingers close [m]
    orientation = [1.0, 0.0, 0.0, 0.0]   # palm to object, (w, x, y, z)
    back = [0.0, 0.0, 1.0]         # the way that the hand comes from and goes back to
    open = [0.0, 0.2, 0.0, 0.0, 0.0]     # flexion of the open fingers' first joint beyond the open hand's [rad]
    abduction = [0.0, 0.0, 0.0, 0.0, 0.0]   # [rad]
    slide = [1.0, 0.0, 0.0]        # direction of a slide; only of scripts that have one

Only the place is stored: how far each finger closes follows from the object's spheres, so that another sphere tree
needs no other place.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.catalogue import object_names
from hhsim.system.settings_file import Settings, between

_SIZES = ("position", "orientation", "back", "open", "abduction", "slide")
_OPTIONAL = ("open", "abduction", "slide")


@dataclass(frozen=True, eq=False)
class Placement:
    """A hand's place on one object; the module's docstring says what each field means.

    Attributes:
        object_name: Of the catalogue; empty where it is no stored one.
        position: [m], shape (3,), object's frame, as all the others.
        orientation: Unit (w, x, y, z), shape (4,).
        back: Unit, shape (3,).
        open: [rad], shape (5,).
        abduction: [rad], shape (5,).
        slide: Unit, or zeros, shape (3,).
    """

    object_name: str
    position: FloatArray
    orientation: FloatArray
    back: FloatArray
    open: FloatArray = field(default_factory=lambda: np.zeros(len(FINGERS)))
    abduction: FloatArray = field(default_factory=lambda: np.zeros(len(FINGERS)))
    slide: FloatArray = field(default_factory=lambda: np.zeros(3))

    def to_toml(self) -> str:
        """As a table of a script; lengths to 10 µm, angles and directions to 10⁻⁴."""
        lines = ["[[placement]]", f'object = "{self.object_name}"']
        for name in _SIZES:
            values = getattr(self, name)
            if name in _OPTIONAL and not values.any():
                continue
            digits = 5 if name == "position" else 4
            lines.append(f"{name} = [{', '.join(f'{round(float(v), digits) + 0.0:g}' for v in values)}]")
        return "\n".join(lines)


Number = Annotated[float, between(-10.0, 10.0)]
Three = tuple[Number, Number, Number]
OfFingers = tuple[Number, Number, Number, Number, Number]


class PlacementTable(Settings, frozen=True):
    """A [[placement]] table of a script; the module's docstring says what each key means."""

    object: str
    position: Three
    orientation: tuple[Number, Number, Number, Number]
    back: Three
    open: OfFingers | None = None
    abduction: OfFingers | None = None
    slide: Three | None = None

    def check(self) -> None:
        """Check the object's name, and that directions have unit length."""
        check_known("object", [self.object], object_names())
        for key in ("orientation", "back", "slide"):
            size = float(np.linalg.norm(getattr(self, key) or 1.0))
            if not math.isclose(size, 1.0, abs_tol=1e-2):
                raise InputError(f"{key} has length {size:.3g}; expected 1")

    def placement(self) -> Placement:
        """Return the place, with directions of unit length."""
        given = {name: np.array(value) for name in _SIZES if (value := getattr(self, name)) is not None}
        for key in ("orientation", "back", "slide"):
            if key in given:
                given[key] /= np.linalg.norm(given[key])
        return Placement(self.object, **given)
