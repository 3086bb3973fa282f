"""Copying arrays where nothing may be allocated: numba's own `target[:] = source` guards itself against overlap."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import jit


@jit
def copy_values(source: NDArray[Any], target_out: NDArray[Any]) -> None:
    """Write every value of `source` to the same place of an array of its shape, which is not the same memory."""
    for index in np.ndindex(source.shape):
        target_out[index] = source[index]
