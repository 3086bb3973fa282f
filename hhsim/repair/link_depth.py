"""Depth of a robot's links in an object, by the links' convex hulls, as MuJoCo collides them."""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import object_bvh
from hhsim.repair.retarget import Retargeted
from hhsim.repair.robot_hand import RobotHand
from hhsim.system.progress import Progress, silent

DEPTH_FRAMES = 500
"""Most frames whose depth is measured, spread evenly."""


class LinkDepth(NamedTuple):
    """Depth of a robot's deepest link in an object at some frames [m], 0 outside, and its name, else "", shape (K,)."""

    frames: IntArray
    depth: FloatArray
    link: tuple[str, ...]


def link_depths(robot: RobotHand, motion: Retargeted, mesh: Mesh, progress: Progress = silent) -> LinkDepth:
    """Measure how deep the convex hulls of a robot's links are in an object, and it in them.

    A hull's depth is that of its deepest corner in the mesh, or of the deepest vertex of the mesh in the hull.
    `mesh` is closed, in the frame of the motion.
    """
    from scipy.spatial import cKDTree

    bvh, vertices = object_bvh(mesh), cKDTree(mesh.vertices)
    low, high = mesh.bounds
    reach = [float(np.linalg.norm(shape.vertices, axis=1).max()) for shape in robot.shapes]
    frames = np.unique(np.linspace(0, len(motion.angles) - 1, min(DEPTH_FRAMES, len(motion.angles))).astype(int))
    depth, names = np.zeros(len(frames)), [""] * len(frames)
    for row, frame in enumerate(frames):
        progress("depth", row, len(frames))
        root = rotation_matrix(motion.orientation[frame])
        places, turns = robot.shape_poses(motion.angles[frame])
        for shape, size, place, turn in zip(
            robot.shapes, reach, places @ root.T + motion.position[frame], root @ turns
        ):
            if ((place < low - size) | (place > high + size)).any():
                continue
            found = -float(mesh_signed_distance(bvh, shape.vertices @ turn.T + place).min())
            near = (mesh.vertices[vertices.query_ball_point(place, size)] - place) @ turn
            near = near[((near >= shape.vertices.min(axis=0)) & (near <= shape.vertices.max(axis=0))).all(axis=1)]
            if len(near):
                found = max(found, -float((near @ shape.planes[:, :3].T + shape.planes[:, 3]).max(axis=1).min()))
            if found > depth[row]:
                depth[row], names[row] = found, shape.link
    return LinkDepth(frames, depth, tuple(names))
