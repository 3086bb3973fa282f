"""Whether a motion ever brings the hand to the object: without a touch, a replay says nothing about contact."""

from collections.abc import Sequence

import numpy as np

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.metrics.metrics import hand_clearance
from hhsim.scene.scene import Scene


def touches(scene: Scene, fingers: Sequence[str] = FINGERS, distance: float = 1e-5) -> bool:
    """Whether the haptic hand comes to the object in any tick.

    Where it does not, the graphic hand is the haptic one in every tick, and there is no force.

    Args:
        scene: Object, hand and motion.
        fingers: That count, beside the palm; the others go through the object.
        distance: From the leaf spheres within which it touches [m].
    """
    haptic = HandConfiguration.of(scene.ticks)
    joints = forward_kinematics(scene.hand, *haptic).joints
    shape = hand_shape(scene.hand)
    palm, finger = hand_clearance(
        scene.tree.arrays(), *shape, joints, haptic.position, haptic.orientation, limit=distance
    )
    modelled = finger[:, [name in fingers for name in FINGERS]]
    nearest = min(np.nanmin(palm, initial=distance), np.nanmin(modelled, initial=distance))
    return bool(nearest < distance)
