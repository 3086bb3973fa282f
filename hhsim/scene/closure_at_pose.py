"""Closing a hand at a given place on an object."""

from collections.abc import Callable

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.hand.kinematics import BODY_COUNT
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.mesh.catalogue import object_description
from hhsim.scene.closure_search import OPEN_SHARE
from hhsim.scene.finger_closure import Closer, FingerClosure
from hhsim.scene.script import Script
from hhsim.scene.stored_pose import Placement
from hhsim.trees.sphere_tree import SphereTree

PALM_WAY = 0.03
"""A palm that touches is searched for within this distance [m] before and behind its stored place."""


def find_placement(script: Script, hand: HandModel, tree: SphereTree) -> Placement | None:
    """Return the script's own placement on the object of a tree; None where a search finds one.

    Raises:
        TrajectoryError: The script is made for other objects, or for a right hand.
    """
    for placement in script.placements:
        if tree.mesh_sha256 and object_description(placement.object_name)["sha256"] == tree.mesh_sha256:
            if hand.side == "right":
                return placement
            if script.objects:
                raise TrajectoryError(
                    f"script {script.name}: its place on the {placement.object_name} is a right hand's"
                )
            return None
    if script.objects:
        raise TrajectoryError(f"script {script.name} is made for {' and '.join(script.objects)}, not for this object")
    return None


def close_placed(
    script: Script,
    hand: HandModel,
    tree: SphereTree,
    placement: Placement,
    object_position: FloatArray | None = None,
    object_rotation: FloatArray | None = None,
) -> FingerClosure:
    """Close the script's fingers with the palm at a place on an object (`tree`, world frame).

    Args:
        object_position: [m], shape (3,), world; None: the origin.
        object_rotation: Object to world, shape (3, 3); None: upright.

    Raises:
        TrajectoryError: No named finger reaches the object from there, or the palm that is to touch does not.
    """
    closure = PlacedCloser(script, hand, tree).close(placement, object_position, object_rotation)
    if script.contact and not closure.reached:
        raise TrajectoryError(
            f"script {script.name}: {', '.join(script.fingers)} cannot reach the object from its place"
        )
    if script.palm_depth > 0.0 and closure.distance[-1] >= 0.0:
        raise TrajectoryError(f"script {script.name}: the palm cannot touch the object from its place")
    return closure


class PlacedCloser(Closer):
    """Closes a script's hand on an object, at any number of placements."""

    def opened(self, placement: Placement) -> FloatArray:
        """Return the flexion of the open hand at a place [rad], shape (5, 3)."""
        wide = OPEN_SHARE * np.minimum(self.hand.flexion_min, 0.0) + placement.open[:, None] * self.rates
        return np.ascontiguousarray(np.clip(wide, self.hand.flexion_min, self.hand.flexion_max))

    def close(
        self,
        placement: Placement,
        object_position: FloatArray | None = None,
        object_rotation: FloatArray | None = None,
        clear: Callable[[FloatArray, FloatArray, FloatArray], bool] | None = None,
    ) -> FingerClosure:
        """Close the hand; arguments as for `close_placed`.

        If `clear` refuses position, rotation and open flexion of a place, the fingers stay open.
        """
        turn = np.eye(3) if object_rotation is None else object_rotation
        rotation = np.empty((3, 3))
        quaternion_to_matrix(placement.orientation.copy(), rotation)
        rotation = np.ascontiguousarray(turn @ rotation)
        back = np.ascontiguousarray(turn @ placement.back)
        position = turn @ placement.position + (0.0 if object_position is None else object_position)
        opened, abduction = self.opened(placement), np.ascontiguousarray(placement.abduction)
        if self.script.palm_depth > 0.0:
            start = position + PALM_WAY * back
            travel, _ = kernel.advance_hand(
                *(self.hand, self.tree, start, rotation, opened, abduction, -back),
                *(np.zeros(BODY_COUNT), 2.0 * PALM_WAY, self.work),
            )
            position = start - travel * back
        fingers = self.fingers if clear is None or clear(position, rotation, opened) else []
        return self.closed((position, rotation, back), opened, abduction, turn @ placement.slide, fingers)
