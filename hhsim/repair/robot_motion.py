"""Motion of a robot's hand made of a result: fingertips where the shown hand has them; its depth; the file of it."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import OutputError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import object_bvh
from hhsim.repair.retarget import Retargeted, retarget
from hhsim.repair.robot_hand import RobotHand
from hhsim.replay.stored_scene import stored_mesh
from hhsim.result.reader import Result
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import encloses

SUFFIXES = (".npz", ".csv")
DEPTH_FRAMES = 500
"""Most frames whose depth is measured, spread evenly."""


class LinkDepth(NamedTuple):
    """Depth of a robot's deepest link in an object at some frames [m], 0 outside, and its name, else "", shape (K,)."""

    frames: IntArray
    depth: FloatArray
    link: tuple[str, ...]


@dataclass(frozen=True)
class RobotMotion:
    """Motion of a robot's hand, world, and how deep it is in the object."""

    joints: tuple[str, ...]  # names of joints and mapped fingers, in the order of the arrays of `motion`
    fingers: tuple[str, ...]
    time: FloatArray  # of each tick [s], shape (T,)
    motion: Retargeted  # joints, pose of the robot's root in the world, and fingertip errors
    depth: LinkDepth | None  # depth of its links in the object; None for an object without an inside


def robot_motion(result: Result, robot: RobotHand, progress: Progress = silent) -> RobotMotion:
    """Compute a robot hand's motion by a result's shown hand; InputError for no ticks, or a mesh that is not read."""
    seen = result.seen_from_object
    fingers = [FINGERS.index(finger) for finger in robot.fingers]
    joints = seen["graphic/joints"][:, fingers]
    motion = retarget(robot, joints[:, :, 3], joints[:, :, 0], progress)
    mesh = stored_mesh(result)
    depth = link_depths(robot, motion, mesh, progress) if encloses(mesh) else None
    if result.driven:
        moved = result.moved_since_first()
        motion = motion._replace(
            position=moved.points(motion.position), orientation=moved.orientations(motion.orientation)
        )
    return RobotMotion(robot.joints, robot.fingers, seen["time"], motion, depth)


def link_depths(robot: RobotHand, motion: Retargeted, mesh: Mesh, progress: Progress = silent) -> LinkDepth:
    """Measure how deep the convex hulls of a robot's links are in an object, and it in them, as MuJoCo collides them.

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


def check_motion_path(path: Path) -> None:
    """Raise OutputError unless a motion can be written to `path`, an `.npz` or a `.csv`."""
    check_output_path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{path}: a robot's motion is written as {' or '.join(SUFFIXES)}")


def motion_bytes(found: RobotMotion, suffix: str) -> bytes:
    """Return the content of a file of one of `SUFFIXES`; SI units, quaternions (w, x, y, z)."""
    motion = found.motion
    if suffix.lower() == ".npz":
        image = io.BytesIO()
        np.savez_compressed(
            image,
            time=found.time,
            joint_names=np.array(found.joints),
            angles=motion.angles,
            root_position=motion.position,
            root_orientation=motion.orientation,
            finger_names=np.array(found.fingers),
            fingertip_error=motion.error,
        )
        return image.getvalue()
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    root = [*(f"root_{axis} [m]" for axis in "xyz"), *(f"root_q{part}" for part in "wxyz")]
    table.writerow(["time [s]", *found.joints, *root, *(f"{finger}_error [m]" for finger in found.fingers)])
    columns = found.time[:, None], motion.angles, motion.position, motion.orientation, motion.error
    # As Python's numbers: they are written with as many digits as give the same number back.
    table.writerows(np.concatenate(columns, axis=1).tolist())
    return text.getvalue().encode()
