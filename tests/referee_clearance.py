"""The clearance of hands from a mesh by the referee, apart from the kernels."""

import numpy as np

from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.verify.mesh_distance import TrueSurface


def referee_clearance(hand: HandModel, mesh: Mesh, placed: PlacedHand) -> float:
    """Least signed distance [m] of a hand to a mesh over some ticks; of an open mesh nothing is inside."""
    return float(TrueSurface(mesh, open_too=True).clearances(hand_shape(hand), placed, np.inf).min())
