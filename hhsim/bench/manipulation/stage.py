"""Stage of the known answers: a free block or ball, a hand, and their recorded motion."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_product, rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.motion.analytic_motion import still
from hhsim.scene.free_object import FreeObject
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.contact_surface import ContactSurface, contact_surface
from hhsim.trees.sphere_tree import SphereTree

BLOCK = 1000
"""Ticks that are run together."""
AWAY = np.array([0.0, 0.0, 5.0])
"""Place of a hand that touches nothing [m]."""
TABLE = -1
"""Body number of the table."""


@dataclass(frozen=True, eq=False)
class Played:
    """Motion of a free object, world frame.

    Attributes:
        free: Object at the start.
        center: Centre of mass [m], shape (T, 3).
        orientation: Relative to the start, (w, x, y, z), shape (T, 4).
        velocity, angular_velocity: [m/s] and [rad/s], shape (T, 3).
        hand_wrench, table_wrench: On the object, [N] and [N·m] about the centre of mass, shape (T, 6).
        table_distance: Of its lowest point [m], shape (T,).
        palm: Position of the graphic palm [m], shape (T, 3).
        joints: Of the graphic hand [m], in the object's frame, shape (T, 5, 4, 3).
        status: Flags of the ticks, shape (T,).
        tick, body, point, normal_force, slip: Of every contact that bears a force, first axis the contact.
        period: Of a tick [s].
    """

    free: FreeObject
    center: FloatArray
    orientation: FloatArray
    velocity: FloatArray
    angular_velocity: FloatArray
    hand_wrench: FloatArray
    table_wrench: FloatArray
    table_distance: FloatArray
    palm: FloatArray
    joints: FloatArray
    status: NDArray[np.int64]
    tick: NDArray[np.int64]
    body: NDArray[np.int64]
    point: FloatArray
    normal_force: FloatArray
    slip: FloatArray
    period: float

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.center)

    def summed(self, values: FloatArray, of_table: bool) -> FloatArray:
        """Return the sum over the contacts of each tick, of the table or of the hand, shape (T,)."""
        chosen = (self.body == TABLE) == of_table
        return np.asarray(np.bincount(self.tick[chosen], weights=values[chosen], minlength=self.ticks), np.float64)

    def slipped(self, of_table: bool) -> FloatArray:
        """Return the largest slip of a contact in each tick [m], shape (T,)."""
        found, chosen = np.zeros(self.ticks), (self.body == TABLE) == of_table
        np.maximum.at(found, self.tick[chosen], self.slip[chosen])
        return found

    @cached_property
    def rotation(self) -> FloatArray:
        """Rotation relative to the start, shape (T, 3, 3)."""
        return np.asarray(rotation_matrix(self.orientation))

    def energy(self) -> FloatArray:
        """Return the kinetic and potential energy [J], shape (T,)."""
        free = self.free
        spin = np.einsum("tji,tj->ti", self.rotation, self.angular_velocity)
        rotational = 0.5 * np.einsum("ti,ij,tj->t", spin, np.array(free.inertia), spin)
        kinetic = 0.5 * free.mass * (self.velocity**2).sum(axis=1)
        potential = -free.mass * self.center @ np.array(free.gravity)
        return np.asarray(kinetic + rotational + potential, np.float64)

    def angular_momentum(self) -> FloatArray:
        """Return the angular momentum about the centre of mass [N·m·s], shape (T, 3)."""
        inertia = self.rotation @ np.array(self.free.inertia) @ self.rotation.transpose(0, 2, 1)
        return np.asarray(np.einsum("tij,tj->ti", inertia, self.angular_velocity))


def play(
    free: FreeObject, surface: ContactSurface, hand: HandModel, options: SolverOptions, haptic: HandConfiguration
) -> Played:
    """Run the ticks of a motion."""
    blocks = list(_blocks(HandSolver(hand, surface, options, free=free), haptic))
    whole = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    turn, shift = whole.pop("turn"), whole.pop("shift")
    center = np.einsum("tij,j->ti", rotation_matrix(turn), np.array(free.center)) + shift
    return Played(free=free, center=center, orientation=turn, period=options.period, **whole)


def _blocks(solver: HandSolver, haptic: HandConfiguration) -> Iterator[dict[str, NDArray[Any]]]:
    begun = 0
    for first in range(0, haptic.ticks, BLOCK):
        record = solver.run(*haptic.part(first, first + BLOCK))
        found = solver.object_ticks
        ticks, rows = len(found.turn), int(found.contact[-1])
        # The hand is recorded in the object's frame.
        palm = np.einsum("tij,tj->ti", rotation_matrix(found.turn), record.position) + found.shift
        names = ("turn", "shift", "velocity", "angular_velocity", "hand_wrench", "table_wrench", "table_distance")
        yield {
            **{name: getattr(found, name) for name in names},
            **{name: np.array(getattr(found, name)[:rows]) for name in ("body", "point", "normal_force", "slip")},
            "tick": begun + np.repeat(np.arange(ticks), np.diff(found.contact[: ticks + 1])),
            "palm": palm,
            "joints": record.joints,
            "status": record.status.astype(np.int64),
        }
        begun += ticks


def away(ticks: int) -> HandConfiguration:
    """Return a hand that touches nothing."""
    return still(AWAY, ticks=ticks)


def block(size: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a box [m] about a centre, shape (3,) each."""
    corners = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    faces = [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4]]
    faces += [[2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
    return Mesh(corners * np.asarray(size) + np.asarray(center), np.array(faces), name="block")


def touched(mesh: Mesh) -> ContactSurface:
    """Return the triangles of a mesh as a surface."""
    return contact_surface("mesh", mesh, None)


def ball(radius: float) -> ContactSurface:
    """Return an exact ball about the origin [m]."""
    tree = SphereTree(np.zeros((2, 3)), np.full(2, radius), np.array([0, 1]), np.array([-1, 0]))
    return contact_surface("spheres", None, tree)


def turned_by(first: ArrayLike, second: ArrayLike) -> float:
    """Return the angle between two orientations (w, x, y, z) [rad]."""
    back = np.asarray(second) * [1.0, -1.0, -1.0, -1.0]
    w, *rest = quaternion_product(first, back)
    return float(2.0 * np.arctan2(np.linalg.norm(rest), abs(w)))
