"""A hand's place on one object, stored with a script that has to touch named parts ("thumb in the handle").

Such a place is searched for once (`tools/placement_search.py`). How far each finger closes still follows from the
object's spheres, so another sphere tree needs no other place. Keys, in the object's frame::

    [[placement]]
    object = "cup"                 # catalogue name
    position = [0.03, 0.0, 0.12]   # palm origin where the fingers close [m]
    orientation = [1.0, 0.0, 0.0, 0.0]   # palm to object, (w, x, y, z)
    back = [0.0, 0.0, 1.0]         # direction from which the hand comes and into which it retreats
    open = [0.0, 0.2, 0.0, 0.0, 0.0]     # flexion of the first joints beyond the open hand's [rad]
    abduction = [0.0, 0.0, 0.0, 0.0, 0.0]   # [rad]
    slide = [1.0, 0.0, 0.0]        # direction of a slide; only in scripts that have one
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

_REQUIRED = ("position", "orientation", "back")
_OPTIONAL = ("open", "abduction", "slide")


@dataclass(frozen=True, eq=False)
class Placement:
    """Place of a hand on one object; the module's docstring explains the fields.

    Directions have unit length; `open` and `abduction` have shape (5,); `slide` is zero in a script without one.
    """

    object_name: str
    position: FloatArray
    orientation: FloatArray
    back: FloatArray
    open: FloatArray = field(default_factory=lambda: np.zeros(len(FINGERS)))
    abduction: FloatArray = field(default_factory=lambda: np.zeros(len(FINGERS)))
    slide: FloatArray = field(default_factory=lambda: np.zeros(3))

    def to_toml(self) -> str:
        """Return the placement as a table of a script; lengths to 10 µm, angles and directions to 10⁻⁴."""
        lines = ["[[placement]]", f'object = "{self.object_name}"']
        for name in (*_REQUIRED, *_OPTIONAL):
            values, digits = getattr(self, name), 5 if name == "position" else 4
            if name in _REQUIRED or values.any():
                lines.append(f"{name} = [{', '.join(f'{round(float(v), digits) + 0.0:g}' for v in values)}]")
        return "\n".join(lines)


Number = Annotated[float, between(-10.0, 10.0)]
Three = tuple[Number, Number, Number]
OfFingers = tuple[Number, Number, Number, Number, Number]


class PlacementTable(Settings, frozen=True):
    """Table [[placement]] of a script; the module's docstring explains the keys."""

    object: str
    position: Three
    orientation: tuple[Number, Number, Number, Number]
    back: Three
    open: OfFingers | None = None
    abduction: OfFingers | None = None
    slide: Three | None = None

    def check(self) -> None:
        """Check the object's name and the unit length of directions."""
        check_known("object", [self.object], object_names())
        for key in ("orientation", "back", "slide"):
            size = float(np.linalg.norm(getattr(self, key) or 1.0))
            if not math.isclose(size, 1.0, abs_tol=1e-2):
                raise InputError(f"{key} has length {size:.3g}; expected 1")

    def placement(self) -> Placement:
        """Return the placement, with directions normalised."""
        names = (*_REQUIRED, *_OPTIONAL)
        given = {name: np.array(value) for name in names if (value := getattr(self, name)) is not None}
        for key in given.keys() & {"orientation", "back", "slide"}:
            given[key] /= np.linalg.norm(given[key])
        return Placement(self.object, **given)
