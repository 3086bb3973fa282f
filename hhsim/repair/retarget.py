"""A person's hand as a robot's: joint angles and a wrist whose fingertips are where the person's are.

At each frame the sum of squares is least of the fingertips' distances, of the change of the joints since the frame
before, and, with a small weight, of the distances of the fingers' bases, which decides what the tips leave open. Terms
of tips and change as in AnyTeleop (Qin et al. 2023, arXiv 2307.04577, eq. 1) and the position optimiser of its library
dex-retargeting; the wrist is free here, since tips in the world have to stay where the object is. Solved by
Levenberg's method with the joints' ranges as bounds. Of a result, the motion, its depth and its file are made.
"""

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import OutputError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import object_bvh
from hhsim.metrics.moving_parts import bodies_mesh
from hhsim.repair.robot_hand import RobotHand
from hhsim.result.reader import Result
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent
from hhsim.table.table import csv_text
from hhsim.trees.contact_surface import encloses

BASE_WEIGHT = 0.05
"""Weight of a finger base's distance, relative to a fingertip's: robots' palms are larger than people's."""
CHANGE_WEIGHT = 2e-4
"""Weight of a joint's change since the frame before [m/rad], relative to a fingertip's distance."""
STEPS = 60
"""Most steps of a frame."""
ENOUGH = 1e-8
"""Largest change of an unknown that ends a frame [rad or m], and smallest share by which the sum has to fall."""
ROUNDS = 6
"""Times that the first frame is solved anew from where it ended, for it has none before it."""
FIRST_WEIGHT = 1e-4
"""`CHANGE_WEIGHT` there [m/rad]."""
SUFFIXES = (".npz", ".csv")
DEPTH_FRAMES = 500
"""Most frames whose depth is measured, spread evenly."""


class Retargeted(NamedTuple):
    """Motion of a robot's hand, T frames."""

    angles: FloatArray  # joints [rad, or m of a sliding joint], shape (T, J)
    position: FloatArray  # origin of the robot's root [m], in the frame of the targets, shape (T, 3)
    orientation: FloatArray  # root to that frame, (w, x, y, z), shape (T, 4)
    error: FloatArray  # distance of each fingertip from its target [m], shape (T, F)


class _Wrist(NamedTuple):
    """Pose of the root: rotation (3, 3), and position (3,) [m]."""

    rotation: FloatArray
    position: FloatArray


def retarget(robot: RobotHand, tips: FloatArray, bases: FloatArray, progress: Progress = silent) -> Retargeted:
    """Compute the motion of a robot's hand by a person's fingertips and finger bases, shapes (T, F, 3) [m].

    F are the fingers of `robot`; a base is the first joint of a finger.
    """
    count, joints = len(tips), len(robot.joints)
    angles, position = np.empty((count, joints)), np.empty((count, 3))
    rotation, error = np.empty((count, 3, 3)), np.empty(tips.shape[:2])
    middle = np.where(np.isfinite(robot.lower + robot.upper), 0.5 * (robot.lower + robot.upper), 0.0)
    now, wrist = _first(robot, middle, tips[0], bases[0])
    for frame in range(count):
        progress("frames", frame, count)
        now, wrist, _ = _solved(robot, now, wrist, tips[frame], bases[frame], CHANGE_WEIGHT)
        angles[frame], rotation[frame], position[frame] = now, wrist.rotation, wrist.position
        reached = robot.points(now).tips @ wrist.rotation.T + wrist.position
        error[frame] = np.linalg.norm(reached - tips[frame], axis=1)
    return Retargeted(angles, position, quaternion_from_matrix(rotation), error)


def _first(robot: RobotHand, middle: FloatArray, tips: FloatArray, bases: FloatArray) -> tuple[FloatArray, _Wrist]:
    """Solve the first frame from each way that the palm may face, and return the best."""
    own = robot.points(middle)
    found: list[tuple[float, int, FloatArray, _Wrist]] = []
    for mirror in np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], dtype=np.float64):
        angles = middle
        wrist = _fitted(np.concatenate([own.tips, own.bases]), np.concatenate([tips, bases]), mirror)
        cost = np.inf
        for _ in range(ROUNDS):
            angles, wrist, cost = _solved(robot, angles, wrist, tips, bases, FIRST_WEIGHT)
        found.append((cost, len(found), angles, wrist))
    _, _, angles, wrist = min(found, key=lambda one: one[:2])
    return angles, wrist


def _fitted(own: FloatArray, wanted: FloatArray, mirror: FloatArray) -> _Wrist:
    """Fit points to others rigidly (Kabsch), then turn them by half a turn about a principal axis, or not."""
    center, goal = own.mean(axis=0), wanted.mean(axis=0)
    left, _, right = np.linalg.svd((wanted - goal).T @ (own - center))
    handed = np.array([1.0, 1.0, np.linalg.det(left) * np.linalg.det(right)])
    rotation = left * (handed * mirror) @ right
    return _Wrist(rotation, goal - rotation @ center)


def _solved(
    robot: RobotHand, before: FloatArray, wrist: _Wrist, tips: FloatArray, bases: FloatArray, weight: float
) -> tuple[FloatArray, _Wrist, float]:
    """Solve a frame from the joints and the wrist before; also return the sum of squares without the change."""

    def equations(angles: FloatArray, wrist: _Wrist) -> tuple[FloatArray, FloatArray]:
        residual, derivative = _equations(robot, angles, wrist, tips, bases)
        change = np.eye(len(angles), derivative.shape[1], 6)
        return np.append(residual, weight * (angles - before)), np.concatenate([derivative, weight * change])

    angles = before
    residual, derivative = equations(angles, wrist)
    damping = 1e-6
    for _ in range(STEPS):
        gradient = derivative.T @ residual
        held = np.zeros(len(gradient), dtype=bool)
        held[6:] = _held(angles, gradient[6:], robot)
        free = ~held
        matrix = derivative[:, free].T @ derivative[:, free]
        step = np.zeros(len(gradient))
        step[free] = np.linalg.solve(matrix + damping * np.eye(len(matrix)), -gradient[free])
        tried = np.clip(angles + step[6:], robot.lower, robot.upper)
        turned = _Wrist(rotation_matrix(quaternion(step[:3])) @ wrist.rotation, wrist.position + step[3:6])
        new_residual, new_derivative = equations(tried, turned)
        fallen = 1.0 - float(new_residual @ new_residual) / max(float(residual @ residual), 1e-300)
        if fallen >= 0.0:
            angles, wrist, residual, derivative = tried, turned, new_residual, new_derivative
        damping = max(0.1 * damping, 1e-12) if fallen >= 0.0 else 10.0 * damping
        if np.abs(step).max() < ENOUGH or 0.0 <= fallen < ENOUGH:
            break
    own = residual[: -len(angles)]
    return angles, wrist, float(own @ own)


def _held(angles: FloatArray, gradient: FloatArray, robot: RobotHand) -> BoolArray:
    """Mark joints at an end of their range that would leave it."""
    return ((angles <= robot.lower) & (gradient > 0.0)) | ((angles >= robot.upper) & (gradient < 0.0))


def _equations(
    robot: RobotHand, angles: FloatArray, wrist: _Wrist, tips: FloatArray, bases: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return weighed distances of tips and bases, and their derivatives by the wrist's turn, place and the joints."""
    found = robot.points(angles)
    residual, rows = [], []
    for own, by_joint, wanted, weight in (
        (found.tips, found.tips_by_joint, tips, 1.0),
        (found.bases, found.bases_by_joint, bases, BASE_WEIGHT),
    ):
        turned = own @ wrist.rotation.T
        x, y, z = turned.T
        zero = np.zeros(len(turned))
        by_turn = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
        by_shift = np.broadcast_to(np.eye(3), by_turn.shape)
        residual.append(weight * (turned + wrist.position - wanted).ravel())
        rows.append(
            weight * np.concatenate([by_turn, by_shift, wrist.rotation @ by_joint], axis=2).reshape(-1, 6 + len(angles))
        )
    return np.concatenate(residual), np.concatenate(rows)


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
    mesh = bodies_mesh(result)
    depth = link_depths(robot, motion, mesh, progress) if encloses(mesh) else None
    if result.frame:
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
    table.writerow(
        ["time [s]", *map(csv_text, found.joints), *root, *(f"{finger}_error [m]" for finger in found.fingers)]
    )
    columns = found.time[:, None], motion.angles, motion.position, motion.orientation, motion.error
    # As Python's numbers: they are written with as many digits as give the same number back.
    table.writerows(np.concatenate(columns, axis=1).tolist())
    return text.getvalue().encode()
