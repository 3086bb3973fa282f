"""Sizes of a hand whose places are stored."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class HandShape(NamedTuple):
    """Sizes of a hand [m]: phalanx_radius (5, 4); palm_center (P, 3), palm frame, and palm_radius (P,)."""

    phalanx_radius: Array
    palm_center: Array
    palm_radius: Array
