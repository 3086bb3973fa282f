"""Whether a motion ever brings the hand to the object, and how deep in it the hand begins.

Without a touch, or from deep inside, a replay says nothing about contact.
"""

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
        fingers: That count, beside the palm; the others go through the object.
        distance: From the leaf spheres within which it touches [m].
    """
    return bool(_nearest(scene, HandConfiguration.of(scene.ticks), fingers, distance) < distance)


def depth_at_start(scene: Scene, fingers: Sequence[str] = FINGERS) -> float:
    """How deep the haptic hand is in the leaf spheres at the first tick [m]; 0 where it begins outside.

    Args:
        fingers: That count, beside the palm; the others go through the object.
    """
    first = HandConfiguration(*(values[:1] for values in HandConfiguration.of(scene.ticks)))
    return -_nearest(scene, first, fingers, 0.0)


def _nearest(scene: Scene, haptic: HandConfiguration, fingers: Sequence[str], limit: float) -> float:
    """Least signed distance of a hand to the leaf spheres over some ticks [m], at most `limit`."""
    joints = forward_kinematics(scene.hand, *haptic).joints
    shape = hand_shape(scene.hand)
    palm, finger = hand_clearance(scene.tree.arrays(), *shape, joints, haptic.position, haptic.orientation, limit=limit)
    modelled = finger[:, [name in fingers for name in FINGERS]]
    return float(min(np.nanmin(palm, initial=limit), np.nanmin(modelled, initial=limit)))
