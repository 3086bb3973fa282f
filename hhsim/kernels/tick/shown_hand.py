"""Joints, contacts and coupling wrench of a shown hand that was not solved for here."""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.detection import Reach
from hhsim.kernels.contact.surface_code import SurfaceCode, evaluate_surface, pairs_near
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.hand.pose import update_kinematics
from hhsim.kernels.jit import jit
from hhsim.kernels.tick.force import clear_forces, palm_wrench
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, WORK_BODIES, WORK_CANDIDATES, WORK_TOUCHING


@jit
def look_at(hand: HandArrays, surface: SurfaceCode, options: TickOptions, states: NDArray[np.void]) -> int:
    """Compute joints, near and touching pairs and Eq. 1 of the hand; 0, or STATUS_CAPACITY_EXCEEDED far inside."""
    state = states[0]
    pose, candidates, work = state.pose, state.candidates, state.work
    update_kinematics(hand, pose)
    status = evaluate_surface(
        hand, pose, surface, Reach(options.margin, options.margin, options.skin), candidates, work
    )
    work[:] = 0
    work[WORK_BODIES], work[WORK_CANDIDATES] = pairs_near(surface, hand, candidates, options.margin)
    _, work[WORK_TOUCHING] = pairs_near(surface, hand, candidates, options.touch)
    clear_forces(state.forces)
    palm_wrench(pose, state.haptic, state.stiffness, state.scratch, state.forces)
    return STATUS_CAPACITY_EXCEEDED if status != 0 else 0
