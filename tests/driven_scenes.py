"""A motion and its object carried through the world together: what a driven object is tested by."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from short_grasp import with_motion

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion
from hhsim.motion.trajectory import ObjectMotion, RigidMotion, Trajectory
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions


def swing(time: FloatArray, speed: float = 3.0, turning: float = 20.0) -> RigidMotion:
    """A rigid motion that reaches these speeds [m/s, rad/s], and begins in the world's frame."""
    slow, quick = 2.0 * np.pi * 0.7, 2.0 * np.pi * 1.1
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    angle = turning / slow * np.sin(slow * time)
    way = speed / quick * np.sin(quick * time)
    return RigidMotion(quaternion(angle[:, None] * axis), way[:, None] * np.array([0.6, 0.0, 0.8]))


def carried(motion: Trajectory, by: RigidMotion) -> Trajectory:
    """The hand and the object of a motion, both moved."""
    count = motion.sample_count
    place = np.tile(motion.object_position, (count, 1)), np.tile(motion.object_orientation, (count, 1))
    return replace(
        motion,
        position=by.points(motion.position),
        orientation=by.orientations(motion.orientation),
        object_motion=ObjectMotion(by.points(place[0]), by.orientations(place[1])),
    )


def swung_result(scene: Scene, path: Path) -> Result:
    """A scene of one thing that stands still, replayed into a file while hand and thing are swung about."""
    motion = scene.hands[0].trajectory
    replay_scene(with_motion(scene, carried(motion, swing(motion.time))), SolverOptions(), path)
    return load_result(path)
