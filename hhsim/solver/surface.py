"""Surfaces for the solver. A new one is a module of `hhsim.kernels.surfaces` with a `SURFACE` and its kernels."""

from typing import TYPE_CHECKING, Any

from hhsim.errors import InputError
from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.kernels.contact.surface import Surface

SURFACES: Registry["Surface"] = Registry("hhsim.kernels.surfaces", "SURFACE", "surface", first=("spheres", "mesh"))
"""Surfaces by name."""


def surface_of(arrays: Any) -> "Surface":
    """Return the surface of arrays, of several parts that of a part; InputError for arrays of no surface."""
    arrays = getattr(arrays, "pieces", arrays)
    for surface in SURFACES.values():
        if type(arrays) is surface.arrays:
            return surface
    expected = f"expected the arrays of {', '.join(SURFACES)}"
    raise InputError(f"{type(arrays).__name__} is no surface of an object; {expected}")
