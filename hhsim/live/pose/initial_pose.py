"""Where the palm is at an object when nobody says: as five fingers grasp it."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.synthesis import planned
from hhsim.trees.sphere_tree import SphereTree

ABOVE = 0.05
"""The palm is this far above an object that no hand can grasp [m]."""


def palm_place(hand: HandModel, tree: SphereTree, back: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Find a place for the palm.

    Args:
        tree: The object, world frame.
        back: How far the palm is drawn back from where the fingers grasp [m].

    Returns:
        The palm's origin [m], shape (3,), and its unit quaternion (w, x, y, z), both in the world frame: of the script
        `grasp` in its hold, or above an object that is too large for a grasp.
    """
    try:
        closure = planned(load_script("grasp"), hand, tree)
    except TrajectoryError:
        leaves = tree.level == tree.level.max()
        top = float((tree.center[leaves, 2] + tree.radius[leaves]).max())
        middle = tree.center[leaves].mean(axis=0)
        return np.array([middle[0], middle[1], top + ABOVE + back]), np.array([1.0, 0.0, 0.0, 0.0])
    return closure.position + back * closure.back, quaternion_from_matrix(closure.rotation)
