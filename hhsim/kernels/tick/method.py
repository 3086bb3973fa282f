"""Dispatch by method: a method is the type of its options, and its tick is declared for that type.

`coupled` and `progressive` are ticks of hands and bodies, `kernels.world.tick`.
"""

from typing import Any

from hhsim.kernels.contact.surface_code import SurfaceCode
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import Record, generic
from hhsim.kernels.qp.active_set import QpWork

OVERFLOW = -1
"""Status of a linearisation whose contacts do not fit into the arrays; the others are those of `qp.active_set`."""


@generic
def tick(method: Any, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Bring the graphic hand towards the haptic hand (`set_haptic`); returns status bits."""
