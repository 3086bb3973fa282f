"""Independent clearance of hands from an object, and the points by which hands are compared."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import closest_points
from hhsim.metrics.field.hands import object_bvh
from hhsim.metrics.mesh_penetration import mesh_clearance
from hhsim.trees.contact_surface import ContactSurface

CLEAR = 2e-6
"""Clearance that a hand needs which the solver did not make [m]: above the error of the measure."""


class HandJudge:
    """Clearance of hands from a closed mesh by closest points, with nothing of the solver."""

    def __init__(self, hand: HandModel, surface: ContactSurface) -> None:
        assert surface.mesh is not None
        self.hand, self.shape, self.bvh = hand, hand_shape(hand), object_bvh(surface.mesh)

    def clearance(self, frames: HandConfiguration, limit: float = CLEAR) -> FloatArray:
        """Return the least signed distance of each hand [m], shape (T,), at most `limit`; NaN for a hand of NaN."""
        return self.placed_clearance(forward_kinematics(self.hand, *frames), limit)

    def placed_clearance(self, placed: PlacedHand, limit: float = CLEAR) -> FloatArray:
        """Return the same for any joints and palms."""
        return mesh_clearance(self.bvh, self.shape, placed, limit)

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return signed distances of points from the closed mesh [m], shape (n,), and their gradients, (n, 3)."""
        closest, distance = np.empty_like(points), np.empty(len(points))
        closest_points(self.bvh, points, closest, distance)
        # On the surface no direction is known.
        known = (np.abs(distance) > 1e-9)[:, None]
        return distance, np.where(known, points - closest, 0.0) / np.where(known, distance[:, None], 1.0)

    def points(self, frames: HandConfiguration) -> FloatArray:
        """Return joints, tips and palm origin of each hand [m], shape (T, 21, 3)."""
        return forward_kinematics(self.hand, *frames).points


def farthest(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the largest distance between corresponding points [m], shapes (T, P, 3); shape (T,)."""
    return np.asarray(np.linalg.norm(first - second, axis=-1).max(axis=-1))
