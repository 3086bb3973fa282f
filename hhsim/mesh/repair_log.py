"""A mesh under repair, and the record of its repairs."""

from dataclasses import dataclass, field

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError


@dataclass
class MeshInRepair:
    """A mesh under repair, in the unit of its source, so that round numbers stay round until the end.

    Attributes:
        vertices: Corners [unit of the source], shape (V, 3).
        faces: Corner indices, shape (F, 3).
        name: Name of the mesh in messages.
        unit_length: Length of the unit [m], for messages.
        merged, repairs, warnings: Changes that every mesh file needs, repairs, and suspicions, a sentence each.
    """

    vertices: FloatArray
    faces: IntArray
    name: str
    unit_length: float = 1.0
    merged: list[str] = field(default_factory=list)
    repairs: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def size(self) -> float:
        """Longest extent of the faces [unit of the source]."""
        return float(np.ptp(self.vertices[self.faces].reshape(-1, 3), axis=0).max())

    def error(self, message: str) -> MeshError:
        """Return an error that names the mesh."""
        return MeshError(f"{self.name}: {message}")

    def millimetres(self, length: float) -> str:
        """Return a length [unit of the source] as text."""
        # Adding zero takes the sign off a negative one.
        return f"{1000.0 * self.unit_length * length + 0.0:.3g} mm"


def percent(share: float) -> str:
    """Return a share as text: two digits, or a whole number from 10 % on."""
    return f"{100.0 * share:.0f} %" if share >= 0.0995 else f"{100.0 * share:.2g} %"
