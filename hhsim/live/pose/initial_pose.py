"""Default place of the palm at an object: as five fingers grasp it."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.synthesis import planned
from hhsim.trees.sphere_tree import SphereTree

ABOVE = 0.05
"""Height of the palm above an object that no hand can grasp [m]."""


def palm_place(hand: HandModel, tree: SphereTree, back: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Compute the palm's pose of the script `grasp` in its hold, or above an object too large for a grasp.

    Args:
        tree: Object, world frame.
        back: Distance by which the palm is drawn back from the grasp [m].

    Returns:
        Palm origin [m], shape (3,), and unit quaternion (w, x, y, z), world frame.
    """
    try:
        closure = planned(load_script("grasp"), hand, tree)
    except TrajectoryError:
        leaves = tree.level == tree.level.max()
        top = float((tree.center[leaves, 2] + tree.radius[leaves]).max())
        middle = tree.center[leaves].mean(axis=0)
        return np.array([middle[0], middle[1], top + ABOVE + back]), np.array([1.0, 0.0, 0.0, 0.0])
    return closure.position + back * closure.back, quaternion_from_matrix(closure.rotation)
