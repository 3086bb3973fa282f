"""Fits our hand to OpenXR's joints, a sample at a time, as `hhsim.recordings.joint_positions` does for recordings.

A runtime's orientations and radii of the joints are not used, as rigs differ in them.
"""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand.tracked_hand import OurHand, fit_tracked_hand
from hhsim.kernels.jit import as_argument
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import finger_axes, middle_of_knuckles, palm_in_knuckles
from hhsim.recordings.frames import world_matrix
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS
from hhsim.recordings.joint_positions import HAND_LENGTHS

FARTHEST = 100.0
"""Largest coordinate of a joint [m]; a larger one was sent in another unit."""
# A joint has eight numbers: orientation (x, y, z, w), position, radius.
_POSITIONS = np.array([8 * OPENXR_JOINTS.index(name) + 4 + k for name in KEYPOINTS for k in range(3)])


class TrackedHand:
    """Fit of our hand; making one compiles the kernel, so that no tick does.

    `joints` are `KEYPOINTS` of the last sample [m], the runtime's world, shape (21, 3); palm [m], (w, x, y, z), z up,
    and angles [rad], shapes (5, 3) and (5,), those of the last usable one.
    """

    def __init__(self, side: HandSide) -> None:
        distal, dorsal, across = finger_axes(side)
        self._ours = OurHand(
            axes=as_argument(np.stack([distal, dorsal, across], axis=1)),
            palm=as_argument(rotation_matrix(palm_in_knuckles(side)[0])),
            middle=as_argument(middle_of_knuckles(side)),
            world=as_argument(world_matrix("y")),
            mirror=np.array([-1.0 if side == "left" else 1.0]),
        )
        self.joints = np.zeros((len(KEYPOINTS), 3))
        self.position, self.orientation = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self.flexion, self.abduction = np.zeros((5, 3)), np.zeros(5)
        self._turn = np.zeros((3, 3))
        self._found = (np.zeros(3), np.zeros(4), np.zeros((5, 3)), np.zeros(5))
        fit_tracked_hand(self.joints, self._ours, self._turn, *self._found)

    def take(self, numbers: FloatArray) -> bool:
        """Fit our hand to the numbers of a packet, shape (208,); False where they are no hand."""
        np.take(numbers, _POSITIONS, out=self.joints.reshape(-1))
        length = fit_tracked_hand(self.joints, self._ours, self._turn, *self._found)
        # NaN compares false.
        if not (HAND_LENGTHS[0] <= length <= HAND_LENGTHS[1] and (np.abs(self.joints) <= FARTHEST).all()):
            return False
        self.position[:], self.orientation[:], self.flexion[:], self.abduction[:] = self._found
        return True
