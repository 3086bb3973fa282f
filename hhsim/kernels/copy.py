"""Copy of arrays without allocation: numba's own `target[:] = source` guards against overlap."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import jit


@jit
def copy_values(source: NDArray[Any], target_out: NDArray[Any]) -> None:
    """Copy `source` to an array of the same shape in other memory."""
    for index in np.ndindex(source.shape):
        target_out[index] = source[index]
