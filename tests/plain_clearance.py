"""The clearance of hands, apart from the kernels: by brute force over leaf spheres, and by coal from a mesh."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.brute_force_distance import round_cone_distance
from hhsim.verify.mesh_distance import HandReferee
from tools.tree_to_hand import palm_centers


def brute_clearance(
    leaf_center: FloatArray,
    leaf_radius: FloatArray,
    phalanx_radius: ArrayLike,
    palm_center: ArrayLike,
    palm_radius: ArrayLike,
    joints: ArrayLike,
    position: ArrayLike,
    orientation: ArrayLike,
) -> float:
    """Least signed distance [m] of one hand to all leaves, NaN for a hand that is nowhere.

    Arguments as of `sphere_scenes.brute_clearance`, of a single tick.
    """
    joint, radius = np.asarray(joints, np.float64), np.asarray(phalanx_radius, np.float64)
    least = np.inf
    for finger in range(joint.shape[0]):
        for k in range(joint.shape[1] - 1):
            ends, radii = joint[finger, k : k + 2], radius[finger, k : k + 2]
            distance = round_cone_distance(leaf_center, ends[0], ends[1], float(radii[0]), float(radii[1]))
            least = float(np.minimum(least, (distance - leaf_radius).min()))
    for place, size in zip(palm_centers(palm_center, position, orientation), np.asarray(palm_radius, np.float64)):
        distance = np.linalg.norm(leaf_center - place, axis=1) - leaf_radius - size
        least = float(np.minimum(least, distance.min()))
    return least


def coal_clearance(hand: HandModel, mesh: Mesh, placed: PlacedHand) -> float:
    """Least signed distance [m] of a hand to a mesh over some ticks; of an open mesh nothing is inside."""
    return float(HandReferee(mesh, open_too=True).clearances(hand_shape(hand), placed, np.inf).min())
