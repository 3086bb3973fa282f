"""Stage of the known answers: a free block or ball, the task of a pinch, and a hand whose squeeze is known.

The hand has two opposed fingers. Thumb and index lie along the palm's y axis, one at either side, and curl towards each
other in the plane of the palm. They are as thick as their tips, so that the tip alone touches a flat face between them.
The palm's spheres are far behind. The palm's coupling bears the weight, the joints' the squeeze, independently: a block
between the tips, at a distance L before the palm, sinks by m g (1 / k_t + L² / k_r) below the command.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_product, rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.scene.synthesis import minimum_jerk
from hhsim.solver.free_object import FreeObject
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.trees.contact_surface import ContactSurface, contact_surface

BLOCK = 1000
"""Ticks that are run together."""
TABLE = -1
"""Body number of the table."""
OF_TICKS = ("turn", "shift", "velocity", "angular_velocity", "hand_wrench", "table_wrench", "table_distance")
"""Arrays of the solver's object, a row a tick."""


@dataclass(frozen=True, eq=False)
class Played:
    """Motion of a free object, world frame."""

    free: FreeObject  # object at the start
    center: FloatArray  # centre of mass [m], shape (T, 3)
    orientation: FloatArray  # relative to the start, (w, x, y, z), shape (T, 4)
    velocity: FloatArray  # [m/s], shape (T, 3)
    angular_velocity: FloatArray  # [rad/s], shape (T, 3)
    hand_wrench: FloatArray  # on the object, [N] and [N·m] about the centre of mass, shape (T, 6)
    table_wrench: FloatArray
    table_distance: FloatArray  # of its lowest point [m], shape (T,)
    joints: FloatArray  # of the graphic hand [m], in the object's frame, shape (T, 5, 4, 3)
    # Of every contact that bears a force, first axis the contact.
    tick: NDArray[np.int64]
    body: NDArray[np.int64]
    normal_force: FloatArray
    slip: FloatArray

    def of_hand(self, values: FloatArray) -> FloatArray:
        """Return the sum over the hand's contacts of each tick, shape (T,)."""
        own = self.body != TABLE
        return np.asarray(np.bincount(self.tick[own], weights=values[own], minlength=len(self.center)), np.float64)

    def slipped(self) -> FloatArray:
        """Return the largest slip of a contact of the hand in each tick [m], shape (T,)."""
        found, own = np.zeros(len(self.center)), self.body != TABLE
        np.maximum.at(found, self.tick[own], self.slip[own])
        return found


def play(
    free: FreeObject, surface: ContactSurface, hand: HandModel, options: SolverOptions, haptic: HandConfiguration
) -> Played:
    """Run the ticks of a motion."""
    solver, blocks = HandSolver(hand, surface, options, free=free), list[dict[str, NDArray[Any]]]()
    for first in range(0, haptic.ticks, BLOCK):
        record = solver.run(*haptic.part(first, first + BLOCK))
        found = solver.object_ticks
        ticks, rows = len(found.turn), int(found.contact[-1])
        block = {name: getattr(found, name) for name in OF_TICKS}
        block |= {name: np.array(getattr(found, name)[:rows]) for name in ("body", "normal_force", "slip")}
        block["tick"] = first + np.repeat(np.arange(ticks), np.diff(found.contact[: ticks + 1]))
        blocks.append({**block, "joints": record.joints})
    whole = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    turn, shift = whole.pop("turn"), whole.pop("shift")
    center = np.einsum("tij,j->ti", rotation_matrix(turn), np.array(free.center)) + shift
    return Played(free=free, center=center, orientation=turn, **whole)


def block(size: Sequence[float], center: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a box [m] about a centre, shape (3,) each."""
    return box_mesh(size, "block").transformed(np.eye(3), np.asarray(center))


def touched(mesh: Mesh) -> ContactSurface:
    """Return the triangles of a mesh as a surface."""
    return contact_surface("mesh", mesh, None)


def turned_by(first: ArrayLike, second: ArrayLike) -> float:
    """Return the angle between two orientations (w, x, y, z) [rad]."""
    back = np.asarray(second) * [1.0, -1.0, -1.0, -1.0]
    w, *rest = quaternion_product(first, back)
    return float(2.0 * np.arctan2(np.linalg.norm(rest), abs(w)))


RATE = 1000.0
"""Tick rate [Hz]."""


@dataclass(frozen=True)
class Pinch:
    """Task of a pinch."""

    mass: float = 0.1  # of the block [kg]
    friction: float = 0.5  # μ of all contacts
    squeeze: float = 1.03  # normal force of each fingertip [N]
    hold: float = 20.0  # duration of the hold [s]
    side: float = 0.04  # of the block, a cube [m]
    tip_radius: float = 0.008
    stiffness: float = 1000.0  # of the coupling of each fingertip, in all directions [N/m]
    lift: float = 0.03  # height of the lift [m]
    gap: float = 0.002  # between fingertip and block at first [m]
    # Durations before the hold [s].
    closing: float = 0.3
    settling: float = 0.2
    lifting: float = 1.0
    easing: float = 0.0
    eased: float = 1.0  # share of the squeeze that is left after the easing
    gravity: float = 9.81  # [m/s²]

    @property
    def threshold(self) -> float:
        """Least squeeze that bears the weight, m g / 2 μ [N]."""
        return self.mass * self.gravity / (2.0 * self.friction)

    @property
    def held_from(self) -> int:
        """First tick of the hold."""
        return self.eased_from + round(RATE * self.easing)

    @property
    def eased_from(self) -> int:
        """First tick of the easing."""
        return round(RATE * (self.closing + self.settling + self.lifting))


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
    """Return the haptic hand whose tips have moved inward along their arcs [m], (T,); palm [m], world, (T, 3)."""
    ticks = len(inward)
    flexion = np.zeros((ticks, 5, 3))
    flexion[:, THUMB, 0] = flexion[:, INDEX, 0] = np.asarray(inward) / REACH
    return HandConfiguration(
        np.ascontiguousarray(position), np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1)), flexion, np.zeros((ticks, 5))
    )


def gripped(pinch: Pinch, *, torsion: float = TORSION, off_center: float = 0.0) -> Played:
    """Pinch, lift, ease and hold.

    `torsion` limits the torsional moment of a contact over its normal force [m]; the centre of mass is `off_center` [m]
    before the line between the fingertips.
    """
    mesh = block([pinch.side] * 3, [0.0, REACH, 0.0])
    free = FreeObject.of_mesh(mesh, mass=pinch.mass, friction=pinch.friction, torsion=torsion, table=-0.5 * pinch.side)
    free = replace(free, center=(0.0, REACH + off_center, 0.0), gravity=(0.0, 0.0, -pinch.gravity))
    count = pinch.held_from + round(RATE * pinch.hold)
    time = np.arange(1, count + 1) / RATE
    position = np.zeros((count, 3))
    position[:, 2] = pinch.lift * minimum_jerk((time - pinch.closing - pinch.settling) / pinch.lifting)
    # In the first half of the closing the tips come to the block; in the second the force grows, and falls as it eases.
    half = time / (0.5 * pinch.closing)
    squeeze = pinch.squeeze * minimum_jerk(half - 1.0)
    if pinch.easing:
        gone = np.clip((time - pinch.eased_from / RATE) / pinch.easing, 0.0, 1.0)
        squeeze *= 1.0 - (1.0 - pinch.eased) * gone
    inward = pinch.gap * minimum_jerk(half) + squeeze / pinch.stiffness
    hand = gripper(pinch.side + 2.0 * pinch.gap, pinch.tip_radius)
    return play(free, touched(mesh), hand, gripper_options(pinch.stiffness), closed(inward, position))


def clearance(played: Played, pinch: Pinch) -> FloatArray:
    """Return the signed distance of the two fingers from the block at every tick [m], shape (T,)."""
    joints = played.joints[:, (THUMB, INDEX)]
    share = np.linspace(0.0, 1.0, AXIS_POINTS)[:, None]
    axis = joints[:, :, :-1, None] * (1.0 - share) + joints[:, :, 1:, None] * share
    beyond = np.abs(axis - [0.0, REACH, 0.0]) - 0.5 * pinch.side
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    distance = outside + np.minimum(beyond.max(axis=-1), 0.0) - pinch.tip_radius
    return np.asarray(distance.reshape(len(distance), -1).min(axis=1))
