"""The clearance of hands from a mesh by the referee, apart from the kernels."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import RigidMotion
from hhsim.verify.mesh_distance import HandReferee


def referee_clearance(hand: HandModel, mesh: Mesh, placed: PlacedHand) -> float:
    """Least signed distance [m] of a hand to a mesh over some ticks; of an open mesh nothing is inside."""
    return float(HandReferee(mesh, open_too=True).clearances(hand_shape(hand), placed, np.inf).min())


def bodies_clearance(hand: HandModel, meshes: Sequence[Mesh], record: Any, bodies: Sequence[Any]) -> float:
    """The same of several bodies, by their records; the hand's record is as the first body sees it."""
    moved = [RigidMotion(body.turn, body.shift) for body in bodies]
    joints, position = (moved[0].points(values) for values in (record.joints, record.position))
    world = PlacedHand(joints, position, moved[0].orientations(record.orientation))
    return min(referee_clearance(hand, mesh, own.seen_hand(world)) for mesh, own in zip(meshes, moved))
