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
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.catalogue import object_names
from hhsim.system.toml_document import check_keys

_SIZES = {"position": 3, "orientation": 4, "back": 3, "open": 5, "abduction": 5, "slide": 3}
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


def parse_placements(where: str, given: Any, *, slides: bool) -> tuple[Placement, ...]:
    """Read the [[placement]] tables of a script.

    Args:
        where: Names the script in messages.
        given: The tables.
        slides: Whether the script slides, and so may name a direction.

    Raises:
        TrajectoryError: A key, name or value that no placement has.
    """
    if not isinstance(given, list) or not all(isinstance(entry, Mapping) for entry in given):
        raise TrajectoryError(f"{where}: placement = {given!r}; expected [[placement]] tables")
    found = tuple(_placement(f"{where}: placement {n}", entry, slides) for n, entry in enumerate(given, start=1))
    names = [placement.object_name for placement in found]
    if len(set(names)) < len(names):
        raise TrajectoryError(f"{where}: two placements on one object; expected one for each")
    return found


def _placement(where: str, table: Mapping[str, Any], slides: bool) -> Placement:
    known = ("object", *_SIZES)
    check_keys(where, table, known, TrajectoryError)
    for key in known:
        if key not in table and key not in _OPTIONAL:
            raise TrajectoryError(f"{where} has no {key}")
    if "slide" in table and not slides:
        raise TrajectoryError(f"{where}: slide belongs to a script with a slide")
    name = table["object"]
    if name not in object_names():
        raise TrajectoryError(f"{where}: {UnknownNameError('object', str(name), object_names())}")
    values = {key: _numbers(where, key, table[key]) for key in _SIZES if key in table}
    for key in ("orientation", "back", "slide"):
        if key in values:
            size = float(np.linalg.norm(values[key]))
            if not math.isclose(size, 1.0, abs_tol=1e-2):
                raise TrajectoryError(f"{where}: {key} has length {size:.3g}; expected 1")
            values[key] /= size
    return Placement(object_name=name, **values)


def _numbers(where: str, key: str, given: Any) -> FloatArray:
    count = _SIZES[key]
    good = isinstance(given, list) and len(given) == count
    if not good or not all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 10.0 for v in given):
        raise TrajectoryError(f"{where}: {key} = {given!r}; expected {count} numbers")
    return np.array(given, dtype=np.float64)
