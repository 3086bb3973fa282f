"""A hand of two opposed fingers, whose squeeze is known: for answers that can be worked out by hand.

Thumb and index lie along the palm's y axis, one at either side, and curl towards each other in the plane of the palm.
They are as thick as their tips throughout, so that a flat face between them is touched by the tip alone. The palm's
spheres are far behind, and the other fingers are not modelled. Weight is borne by the palm's coupling, squeeze by the
joints', and neither changes the other: a block that hangs between the tips, at a distance L before the palm, sinks by
m g (1 / k_t + L² / k_r) below what is commanded.
"""

from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.solver.options import SolverOptions, Stiffness

LENGTHS = (0.04, 0.03, 0.03)
"""Of the phalanges [m]."""
REACH = sum(LENGTHS)
"""From the palm's origin to the fingertips' centres, straight [m]."""
THUMB, INDEX = 0, 1
BEHIND = np.array([0.0, -0.5, 0.0])
"""Where the palm's spheres are [m]: out of the way."""
FLEXION = 0.0145
"""k_θ of a fingertip held by 1 N/m: Σ lever² of its joints [m²]."""


def gripper(opening: float, tip_radius: float) -> HandModel:
    """The hand.

    Args:
        opening: Between the surfaces of the straight fingers [m].
        tip_radius: Of the fingers [m].
    """
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
    """The solver's for it: the mesh itself, two fingers, palm and fingertips held by so much [N/m].

    The palm hardly turns: k_r is what `stiffness` at a lever of 1 m would be.
    """
    coupling = Stiffness(translation=stiffness, rotation=stiffness, flexion=FLEXION * stiffness)
    return SolverOptions(method="coupled", surface="mesh", fingers=("thumb", "index"), stiffness=coupling)


def closed(inward: FloatArray, position: FloatArray) -> HandConfiguration:
    """The haptic hand whose fingertips go inward so far.

    Args:
        inward: Of either tip from where it is straight, along its arc about the first joint [m], shape (T,).
        position: Of the palm [m], world, shape (T, 3).
    """
    ticks = len(inward)
    flexion = np.zeros((ticks, 5, 3))
    flexion[:, THUMB, 0] = flexion[:, INDEX, 0] = np.asarray(inward) / REACH
    return HandConfiguration(
        np.ascontiguousarray(position), np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1)), flexion, np.zeros((ticks, 5))
    )
