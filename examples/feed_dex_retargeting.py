"""Feed dex-retargeting with a recording whose hand is out of the object: a robot hand's joint angles in each frame.

python feed_dex_retargeting.py RECORDING OBJECT CONFIG.yml FOLDER_OF_URDFS OUT.npz [right|left]

Recordings and objects are those of `hhsim repair`; the configuration of a robot hand is one of dex-retargeting.
Needs dex_retargeting (0.5), and torch, which that does not ask for.
"""

import sys
from pathlib import Path

import numpy as np

import hhsim
from hhsim.arrays import FloatArray, IntArray
from hhsim.motion.trajectory import HandSide

WRIST, INDEX, MIDDLE = 0, 5, 9


def in_wrist_frame(joints: FloatArray, hand: HandSide) -> FloatArray:
    """Return joints, shape (T, 21, 3), from the wrist on in dex-retargeting's axes of a hand.

    z points to the knuckle of the middle finger, and x to where the palm looks.
    """
    seen = joints - joints[:, WRIST, None]
    up = seen[:, MIDDLE] / np.linalg.norm(seen[:, MIDDLE], axis=1, keepdims=True)
    aside = seen[:, INDEX] - (seen[:, INDEX] * up).sum(axis=1, keepdims=True) * up
    aside *= (-1.0 if hand == "left" else 1.0) / np.linalg.norm(aside, axis=1, keepdims=True)
    return seen @ np.stack([np.cross(aside, up), aside, up], axis=2)


def references(joints: FloatArray, hand: HandSide, kind: str, indices: IntArray) -> FloatArray:
    """Return what a frame's retargeting takes: joints of shape (T, n, 3), or vectors from joints (n,) to others."""
    if kind == "POSITION":
        return joints[:, indices]
    seen = in_wrist_frame(joints, hand)
    return seen[:, indices[1]] - seen[:, indices[0]]


def retarget(recording: str, thing: str, config: Path, robots: Path, out: Path, hand: HandSide = "") -> None:
    """Repair a recording, and write stamps, joint names and angles of the robot for its samples with a hand."""
    from dex_retargeting.retargeting_config import RetargetingConfig

    RetargetingConfig.set_default_urdf_dir(str(robots))
    robot = RetargetingConfig.load_from_file(config).build()
    motion = hhsim.repair(recording, thing, hand=hand)
    known = np.isfinite(motion.joints).all(axis=(1, 2))
    kind, indices = robot.optimizer.retargeting_type, robot.optimizer.target_link_human_indices
    given = references(motion.joints[known], motion.hand.side, kind, indices)
    angles = np.array([robot.retarget(frame) for frame in given])
    np.savez(out, time=motion.time[known], qpos=angles, joint_names=robot.joint_names)
    depth = [1e3 * np.nanmax(of) for of in (motion.depth_before, motion.depth_after)]
    print(f"{len(angles)} frames, {depth[0]:.2f} mm deep, {depth[1]:.3f} mm repaired, {angles.shape[1]} robot joints")


if __name__ == "__main__":
    source, thing, config, robots, out, *side = sys.argv[1:]
    retarget(source, thing, Path(config), Path(robots), Path(out), side[0] if side else "")
