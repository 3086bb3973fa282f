"""Plane cuts of what collides: spheres, a mesh, a finger along its own plane.

All joints of a finger flex about one axis, so that its three round cones have their middle lines in one plane and are
cut there into the hulls of two circles each: a section shows what the solver sees, at full size.
"""

from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import forward_kinematics
from hhsim.kernels.rotation import quaternion_to_matrix

Pose = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Plane:
    """A plane with a drawing's axes.

    Attributes:
        origin: [m], world, shape (3,).
        axes: Rows right, up and out of the drawing, unit, world, shape (3, 3).
    """

    origin: FloatArray
    axes: FloatArray

    def flat(self, points: FloatArray) -> FloatArray:
        """Right and up of points [m], shape (..., 3), dropped onto the plane: shape (..., 2)."""
        return np.asarray((points - self.origin) @ self.axes[:2].T)

    def height(self, points: FloatArray) -> FloatArray:
        """How far points [m], shape (..., 3), are out of the drawing [m], shape (...)."""
        return np.asarray((points - self.origin) @ self.axes[2])


def finger_plane(hand: HandModel, pose: Pose, finger: int, up: FloatArray) -> Plane:
    """The plane in which a finger flexes, through its tip sphere's centre.

    Args:
        hand: Whose finger.
        pose: Position [m] and orientation of the palm, world, flexion and abduction [rad], as `HandModel.joints` takes
            them.
        finger: 0 thumb to 4 little finger.
        up: Direction that is up in the drawing as far as the plane has it, world, shape (3,).
    """
    position, orientation, flexion, abduction = (np.array(values, np.float64) for values in pose)
    rotation = np.empty((3, 3))
    quaternion_to_matrix(orientation, rotation)
    joints, direction = np.empty((5, 4, 3)), np.empty((5, 3, 3))
    axis, abduction_axis = np.empty((5, 3)), np.empty((5, 3))
    forward_kinematics(hand.arrays(), position, rotation, flexion, abduction, joints, direction, axis, abduction_axis)
    out = axis[finger]
    upward = up - (up @ out) * out
    upward /= np.linalg.norm(upward)
    return Plane(joints[finger, 3], np.array([np.cross(upward, out), upward, out]))


def cut_spheres(plane: Plane, center: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Circles in which a plane cuts spheres [m], shapes (n, 3) and (n,).

    Returns:
        Centres, shape (k, 2); radii [m], shape (k,); which spheres they are of, shape (k,).
    """
    square = radius**2 - plane.height(center) ** 2
    cut = np.flatnonzero(square > 0.0)
    return plane.flat(center[cut]), np.sqrt(square[cut]), cut


def cut_mesh(plane: Plane, vertices: FloatArray, faces: IntArray) -> list[FloatArray]:
    """Closed curves in which a plane cuts a closed mesh.

    Args:
        plane: A vertex that lies exactly in it counts as above it.
        vertices: [m], world, shape (n, 3).
        faces: Shape (m, 3).

    Returns:
        The corners of each curve [m], shape (k, 2), the first one not repeated.
    """
    above = plane.height(vertices) >= 0.0
    crossed = faces[above[faces].any(axis=1) & ~above[faces].all(axis=1)]
    # Each crossed triangle has two crossed edges, and each crossed edge two such triangles: the curves are rings.
    neighbours: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face in crossed.tolist():
        edges = [(min(a, b), max(a, b)) for a, b in zip(face, face[1:] + face[:1]) if above[a] != above[b]]
        for edge, other in (edges, edges[::-1]):
            neighbours.setdefault(edge, []).append(other)
    curves = []
    while neighbours:
        ring = [next(iter(neighbours))]
        while True:
            following = [edge for edge in neighbours.pop(ring[-1]) if edge in neighbours]
            if not following:
                break
            ring.append(following[0])
        ends = vertices[np.array(ring)]
        height = plane.height(ends)
        share = height[:, 0] / (height[:, 0] - height[:, 1])
        curves.append(plane.flat(ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])))
    return curves


def round_cone_outline(a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, corners: int = 60) -> FloatArray:
    """Outline of the hull of two circles in a plane [m], shape (2 * corners, 2), counterclockwise.

    The larger circle alone where it holds the other.
    """
    between = b - a
    length = float(np.linalg.norm(between))
    if length <= abs(radius_a - radius_b):
        angle = np.linspace(0.0, 2.0 * np.pi, 2 * corners, endpoint=False)
        center, radius = (a, radius_a) if radius_a >= radius_b else (b, radius_b)
        return np.asarray(center + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    heading = float(np.arctan2(between[1], between[0]))
    # Where the common tangents touch, seen from either centre.
    side = float(np.arccos((radius_a - radius_b) / length))
    front, rear = np.linspace(-side, side, corners), np.linspace(side, 2.0 * np.pi - side, corners)
    angle = heading + np.concatenate([front, rear])
    centers, radii = np.repeat([b, a], corners, axis=0), np.repeat([radius_b, radius_a], corners)
    return np.asarray(centers + radii[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
