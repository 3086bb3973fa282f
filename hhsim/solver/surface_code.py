"""A surface as ticks take it: its code by address, and its arrays."""

from typing import Any

import numpy as np
from numba import typeof
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.kernels.by_reference import Reference, write_rows
from hhsim.kernels.contact.detection import Reach, SurfaceCode, count_pairs, evaluate, find_contacts
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.machine_code import code_of


def surface_code(arrays: Any, hand: HandArrays, state_dtype: np.dtype[Any]) -> tuple[NDArray[np.int64], SurfaceCode]:
    """Return the addresses of a surface's arrays, and the surface as ticks take it, which points to them.

    The caller keeps both, and the arrays. `state_dtype` is the type of the ticks' states. What looks at this kind of
    surface is compiled or loaded if need be.
    Raises InputError for arrays that kernels would take field by field.
    """
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
