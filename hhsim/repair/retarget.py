"""A person's hand as a robot's: joint angles and a wrist whose fingertips are where the person's are.

At each frame the sum of squares is least of the fingertips' distances, of the change of the joints since the frame
before, and, with a small weight, of the distances of the fingers' bases, which decides what the tips leave open. Terms
of tips and change as in AnyTeleop (Qin et al. 2023, arXiv 2307.04577, eq. 1) and the position optimiser of its library
dex-retargeting; the wrist is free here, since tips in the world have to stay where the object is. Solved by
Levenberg's method with the joints' ranges as bounds.
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix
from hhsim.repair.robot_hand import RobotHand
from hhsim.system.progress import Progress, silent

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
