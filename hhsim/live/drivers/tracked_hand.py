"""Fits our hand to OpenXR's joints, a sample at a time, as `hhsim.recordings.joint_positions` does for recordings.

A runtime's orientations and radii of the joints are not used, as rigs differ in them.
"""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion_from_matrix, quaternion_product
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import finger_angles, finger_axes, palm_from_knuckles, palm_origin
from hhsim.recordings.frames import in_palm, world_matrix
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS
from hhsim.recordings.joint_positions import HAND_LENGTHS

FARTHEST = 100.0
"""Largest coordinate of a joint [m]; a larger one was sent in another unit."""
_WORLD = world_matrix("y")
_TURN = quaternion_from_matrix(_WORLD)
"""From the runtime's world, whose y points up, to ours: a rotation matrix and the same as a quaternion."""
_MIDDLE = (0, 9, 10, 11, 12)
"""Joints from the wrist to the tip of the middle finger."""
# A joint has eight numbers: orientation (x, y, z, w), position, radius.
_POSITIONS = np.array([8 * OPENXR_JOINTS.index(name) + 4 + k for name in KEYPOINTS for k in range(3)])


class TrackedHand:
    """Fit of our hand.

    `joints` are `KEYPOINTS` of the last sample [m], the runtime's world, shape (21, 3); palm [m], (w, x, y, z), z up,
    and angles [rad], shapes (5, 3) and (5,), those of the last usable one.
    """

    def __init__(self, side: HandSide) -> None:
        self._side: HandSide = side
        self.joints = np.zeros((len(KEYPOINTS), 3))
        self.position, self.orientation = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self.flexion, self.abduction = np.zeros((5, 3)), np.zeros(5)

    def take(self, numbers: FloatArray) -> bool:
        """Fit our hand to the numbers of a packet, shape (208,); False where they are no hand."""
        np.take(numbers, _POSITIONS, out=self.joints.reshape(-1))
        # NaN compares false.
        if not (np.abs(self.joints) <= FARTHEST).all():
            return False
        length = np.linalg.norm(np.diff(self.joints[_MIDDLE, :], axis=0), axis=1).sum()
        if not HAND_LENGTHS[0] <= length <= HAND_LENGTHS[1]:
            return False
        fingers = self.joints[None, 1:].reshape(1, 5, 4, 3)
        knuckles = fingers[:, 1:, 0]
        palm = palm_from_knuckles(knuckles, self.joints[:1], self._side)
        flexion, abduction = finger_angles(in_palm(np.diff(fingers, axis=2), palm), finger_axes(self._side))
        position = palm_origin(knuckles, palm, self._side) @ _WORLD.T
        orientation = quaternion_product(_TURN, palm)
        if not all(np.isfinite(values).all() for values in (position, orientation, flexion, abduction)):
            return False
        self.position[:], self.orientation[:] = position[0], np.copysign(1.0, orientation[0, 0]) * orientation[0]
        self.flexion[:], self.abduction[:] = flexion[0], abduction[0]
        return True
