"""Sizes of a hand of which positions are stored."""

from typing import NamedTuple

from hhsim.kernels.jit import Array


class HandShape(NamedTuple):
    """Sizes of a hand [m]: phalanx_radius (5, 4); palm_center (P, 3), palm frame, and palm_radius (P,)."""

    phalanx_radius: Array
    palm_center: Array
    palm_radius: Array
