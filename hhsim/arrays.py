"""Types of arrays in annotations; docstrings give shape, unit and frame."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
AnyArray: TypeAlias = NDArray[Any]
Codes: TypeAlias = NDArray[np.int32]
Flags: TypeAlias = NDArray[np.uint32]
Records: TypeAlias = NDArray[np.void]
