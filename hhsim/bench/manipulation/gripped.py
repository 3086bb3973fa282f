"""The pinch played with hhsim's own solver and the hand of two opposed fingers."""

from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.manipulation.gripper import INDEX, REACH, THUMB, closed, gripper, gripper_options
from hhsim.bench.manipulation.pinch import Pinch, PinchOutcome
from hhsim.bench.manipulation.stage import Played, block, play, touched
from hhsim.scene.free_object import FreeObject

AXIS_POINTS = 21
"""Of each phalanx; its end, which touches, is one of them."""
TORSION = 0.005
"""Of a fingertip [m]: about half the radius of its contact, a soft finger's."""


def gripped(pinch: Pinch, *, torsion: float = TORSION, off_center: float = 0.0) -> Played:
    """Pinch, lift, ease and hold.

    Args:
        pinch: What is pinched, and how.
        torsion: Torsional moment of a contact over its normal force [m].
        off_center: How far the centre of mass is before the line between the fingertips [m].
    """
    mesh = block([pinch.side] * 3, [0.0, REACH, 0.0])
    free = FreeObject.of_mesh(mesh, mass=pinch.mass, friction=pinch.friction, torsion=torsion, table=-0.5 * pinch.side)
    free = replace(free, center=(0.0, REACH + off_center, 0.0), gravity=(0.0, 0.0, -pinch.gravity))
    ticks = np.arange(1, pinch.ticks + 1)
    position = np.zeros((pinch.ticks, 3))
    position[:, 2] = pinch.height_at(ticks)
    inward = pinch.gap * pinch.closed_at(ticks) + pinch.squeeze_at(ticks) / pinch.stiffness
    hand = gripper(pinch.side + 2.0 * pinch.gap, pinch.tip_radius)
    return play(free, touched(mesh), hand, gripper_options(pinch.stiffness), closed(inward, position))


def own_outcome(pinch: Pinch) -> PinchOutcome:
    """What hhsim's pinch comes to."""
    played = gripped(pinch)
    normal = 0.5 * played.summed(played.normal_force, of_table=False)
    height = played.center[:, 2] - played.center[0, 2]
    depth = max(0.0, -float(clearance(played, pinch).min()))
    return pinch.outcome(height, depth, float(normal[pinch.held_from :].mean()))


def clearance(played: Played, pinch: Pinch) -> FloatArray:
    """Signed distance of the two fingers from the block at every tick [m], shape (T,): of points on their axes."""
    joints = played.joints[:, (THUMB, INDEX)]
    share = np.linspace(0.0, 1.0, AXIS_POINTS)[:, None]
    axis = joints[:, :, :-1, None] * (1.0 - share) + joints[:, :, 1:, None] * share
    beyond = np.abs(axis - [0.0, REACH, 0.0]) - 0.5 * pinch.side
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    distance = outside + np.minimum(beyond.max(axis=-1), 0.0) - pinch.tip_radius
    return np.asarray(distance.reshape(len(distance), -1).min(axis=1))
