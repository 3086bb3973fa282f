"""Surfaces for the solver. A new one is a module of `hhsim.kernels.surfaces` with a `SURFACE` and its kernels."""

from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.errors import InputError
from hhsim.registry import Registry

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hhsim.kernels.contact.surface import Surface
    from hhsim.kernels.contact.surface_code import SurfaceCode
    from hhsim.kernels.hand.kinematics import HandArrays

SURFACES: Registry["Surface"] = Registry("hhsim.kernels.surfaces", "SURFACE", "surface", first=("spheres", "mesh"))
"""Surfaces by name."""


def surface_code(
    arrays: Any, hand: "HandArrays", state_dtype: "np.dtype[Any]"
) -> tuple["NDArray[np.int64]", "SurfaceCode"]:
    """Return what holds the addresses of a surface's arrays, and the surface as ticks take it, with states of a type.

    The caller keeps both, and the arrays. What looks at this kind of surface is compiled or loaded if need be.
    Raises InputError for arrays that kernels would take field by field.
    """
    from numba import typeof

    from hhsim.kernels.by_reference import Reference, write_rows
    from hhsim.kernels.contact.detection import Reach, count_pairs, evaluate, find_contacts
    from hhsim.kernels.contact.surface_code import SurfaceCode
    from hhsim.kernels.jit import JIT_ENABLED
    from hhsim.kernels.machine_code import code_of

    if JIT_ENABLED and not isinstance(typeof(arrays), Reference):
        raise InputError(f"{type(arrays).__name__} of a surface: expected a NamedTuple that is declared by_reference")
    # A state that nobody writes to, for the types of what is in it.
    state = np.empty(1, state_dtype).view(np.recarray)[0]
    written = write_rows([arrays])
    return written, SurfaceCode(
        code_of(evaluate, hand, state.pose, arrays, Reach(0.0, 0.0, 0.0), state.candidates, state.work),
        code_of(find_contacts, arrays, hand, state.pose, state.candidates, 0.0, state.contacts),
        code_of(count_pairs, arrays, hand, state.candidates, 0.0),
        written.ctypes.data if JIT_ENABLED else arrays,
    )


def surface_of(arrays: Any) -> "Surface":
    """Return the surface of arrays, of several parts that of a part; InputError for arrays of no surface."""
    arrays = getattr(arrays, "pieces", arrays)
    for surface in SURFACES.values():
        if type(arrays) is surface.arrays:
            return surface
    expected = f"expected the arrays of {', '.join(SURFACES)}"
    raise InputError(f"{type(arrays).__name__} is no surface of an object; {expected}")
