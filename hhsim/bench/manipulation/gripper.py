"""Hand of two opposed fingers, whose squeeze is known, and the pinch played with it by hhsim's own solver.

Thumb and index lie along the palm's y axis, one at either side, and curl towards each other in the plane of the palm.
They are as thick as their tips throughout, so that the tip alone touches a flat face between them. The palm's spheres
are far behind. The palm's coupling bears the weight, the joints' the squeeze, independently: a block between the tips,
at a distance L before the palm, sinks by m g (1 / k_t + L² / k_r) below the command.
"""

from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.manipulation.pinch import Pinch, PinchOutcome
from hhsim.bench.manipulation.stage import Played, block, play, touched
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.scene.free_object import FreeObject
from hhsim.solver.options import SolverOptions, Stiffness

LENGTHS = (0.04, 0.03, 0.03)
"""Lengths of the phalanges [m]."""
REACH = sum(LENGTHS)
"""Distance of the straight fingertips' centres from the palm's origin [m]."""
THUMB, INDEX = 0, 1
BEHIND = np.array([0.0, -0.5, 0.0])
"""Place of the palm's spheres [m]: out of the way."""
FLEXION = 0.0145
"""k_θ of a fingertip held by 1 N/m: Σ lever² of its joints [m²]."""
AXIS_POINTS = 21
"""Points of a phalanx's axis at which its clearance is measured; its end, which touches, is one of them."""
TORSION = 0.005
"""Torsional limit of a fingertip [m]: about half the radius of a soft finger's contact."""


def gripper(opening: float, tip_radius: float) -> HandModel:
    """Return the hand, `opening` [m] between the surfaces of its straight fingers of radius `tip_radius` [m]."""
    hand = HandModel.default()
    base, distal, dorsal = np.zeros((5, 3)), np.tile([0.0, 1.0, 0.0], (5, 1)), np.tile([1.0, 0.0, 0.0], (5, 1))
    base[THUMB, 0], base[INDEX, 0] = -0.5 * opening - tip_radius, 0.5 * opening + tip_radius
    dorsal[THUMB] *= -1.0
    base[2:] = BEHIND
    return replace(
        hand,
        base=base,
        distal=distal,
        dorsal=dorsal,
        length=np.tile(LENGTHS, (5, 1)),
        radius=np.full((5, 4), tip_radius),
        flexion_min=np.full((5, 3), -1.5),
        flexion_max=np.full((5, 3), 1.5),
        palm_mesh=hand.palm_mesh.transformed(np.eye(3), BEHIND),
        palm_tree=hand.palm_tree.transformed(np.eye(3), BEHIND),
    )


def gripper_options(stiffness: float = 1000.0) -> SolverOptions:
    """Return the solver's options: the mesh, two fingers, palm and fingertips held by `stiffness` [N/m].

    The palm hardly turns: k_r is that of `stiffness` at a lever of 1 m.
    """
    coupling = Stiffness(translation=stiffness, rotation=stiffness, flexion=FLEXION * stiffness)
    return SolverOptions(method="coupled", surface="mesh", fingers=("thumb", "index"), stiffness=coupling)


def closed(inward: FloatArray, position: FloatArray) -> HandConfiguration:
    """Return the haptic hand whose fingertips have moved inward.

    Args:
        inward: Way of either tip along its arc about the first joint [m], shape (T,).
        position: Of the palm [m], world, shape (T, 3).
    """
    ticks = len(inward)
    flexion = np.zeros((ticks, 5, 3))
    flexion[:, THUMB, 0] = flexion[:, INDEX, 0] = np.asarray(inward) / REACH
    return HandConfiguration(
        np.ascontiguousarray(position), np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1)), flexion, np.zeros((ticks, 5))
    )


def gripped(pinch: Pinch, *, torsion: float = TORSION, off_center: float = 0.0) -> Played:
    """Pinch, lift, ease and hold.

    Args:
        torsion: Limit of the torsional moment of a contact over its normal force [m].
        off_center: Distance of the centre of mass before the line between the fingertips [m].
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
    """Return the outcome of a pinch by hhsim."""
    played = gripped(pinch)
    height = played.center[:, 2] - played.center[0, 2]
    return pinch.outcome(height, max(0.0, -float(clearance(played, pinch).min())))


def clearance(played: Played, pinch: Pinch) -> FloatArray:
    """Return the signed distance of the two fingers from the block at every tick [m], shape (T,)."""
    joints = played.joints[:, (THUMB, INDEX)]
    share = np.linspace(0.0, 1.0, AXIS_POINTS)[:, None]
    axis = joints[:, :, :-1, None] * (1.0 - share) + joints[:, :, 1:, None] * share
    beyond = np.abs(axis - [0.0, REACH, 0.0]) - 0.5 * pinch.side
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    distance = outside + np.minimum(beyond.max(axis=-1), 0.0) - pinch.tip_radius
    return np.asarray(distance.reshape(len(distance), -1).min(axis=1))
