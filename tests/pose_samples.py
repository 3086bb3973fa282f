"""Recordings of poses that test modules share: our own hand's motion as MANO, UmeTrack and LeRobot would keep it.

The models are made from our own hand too: a MANO file whose joints are ours, and the profile of an UmeTrack hand.
"""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from joint_samples import Y_UP, JointSample, Side, joint_sample
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.recordings.formats.mano import KEYPOINT_JOINTS, TIPS
from hhsim.recordings.joint_names import WEBXR_JOINTS


def _flat_joints(hand: HandModel) -> FloatArray:
    """Joints of the straight hand, palm frame, shape (5, 4, 3)."""
    return hand.joints(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros((5, 3)), np.zeros(5))


def _axes(hand: HandModel) -> tuple[FloatArray, FloatArray]:
    """Axes of abduction and of flexion of each finger, shapes (5, 3)."""
    sign = 1.0 if hand.side == "right" else -1.0
    return sign * hand.dorsal, np.cross(hand.dorsal, hand.distal)


def mano_fields(hand: HandModel, seed: int = 0) -> dict[str, Any]:
    """A MANO model whose 16 joints and 5 tips are those of our hand, with any shapes, components and mean."""
    random = np.random.default_rng(seed)
    flat = _flat_joints(hand)
    mirror = 1.0 if hand.side == "right" else -1.0
    wrist = np.array([-0.070 * hand.hand_breadth * mirror, -0.223 * hand.hand_length, 0.0])
    template = random.normal(0.0, 0.02, (778, 3))
    joints = np.empty((16, 3))
    joints[0] = wrist
    for place, joint in enumerate(KEYPOINT_JOINTS[1:]):
        joints[joint] = flat[place // 3, place % 3]
    regressor = np.zeros((16, 778))
    regressor[np.arange(16), np.arange(16)] = 1.0
    template[:16] = joints
    weights = np.zeros((778, 16))
    weights[:, 0] = 1.0
    for finger, tip in enumerate(TIPS):
        template[tip] = flat[finger, 3]
        weights[tip] = np.eye(16)[KEYPOINT_JOINTS[3 + 3 * finger]]
    tree = np.array([[2**32 - 1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14], np.arange(16)], dtype=np.int64)
    return {
        "v_template": template,
        "shapedirs": np.zeros((778, 3, 10)),
        "posedirs": np.zeros((778, 3, 135)),
        "J_regressor": regressor,
        "weights": weights,
        "kintree_table": tree,
        "hands_components": np.linalg.qr(random.normal(size=(45, 45)))[0],
        "hands_mean": random.normal(0.0, 0.1, 45),
    }


def mano_poses(sample: JointSample) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Turn of the wrist (T, 3), angles from the flat hand (T, 45), translation (T, 3), in a world with y up."""
    abduct, flex = _axes(sample.hand)
    motion = sample.motion
    turns = Y_UP @ rotation_matrix(motion.orientation)
    pose = np.zeros((len(turns), 16, 3))
    for finger in range(5):
        for k in range(3):
            turn = Rotation.from_rotvec(motion.flexion[:, finger, k, None] * flex[finger])
            if k == 0:
                turn = Rotation.from_rotvec(motion.abduction[:, finger, None] * abduct[finger]) * turn
            pose[:, KEYPOINT_JOINTS[1 + 3 * finger + k]] = turn.as_rotvec()
    wrist = mano_fields(sample.hand)["v_template"][0]
    place = motion.position @ Y_UP.T + turns @ wrist - wrist
    return Rotation.from_matrix(turns).as_rotvec(), pose[:, 1:].reshape(-1, 45), place


def umetrack_profile() -> str:
    """The profile of an UmeTrack hand, a left one, whose joints are those of our left hand [mm]."""
    hand = HandModel.default("left")
    abduct, flex = _axes(hand)
    flat = _flat_joints(hand)
    wrist = np.array([0.070 * hand.hand_breadth, -0.223 * hand.hand_length, 0.0])
    rest = np.concatenate([flat[:, [0, 0, 1, 2]].reshape(20, 3) - wrist, np.zeros((2, 3))])
    axes = np.concatenate([np.stack([abduct, flex, flex, flex], axis=1).reshape(20, 3), np.eye(3)[1:]])
    landmarks = np.concatenate([flat[:, 3] - wrist, np.zeros((16, 3))])
    model = {
        "joint_rest_positions": (1e3 * rest).tolist(),
        "joint_rotation_axes": axes.tolist(),
        "landmark_rest_positions": (1e3 * landmarks).tolist(),
    }
    return json.dumps({"hand_model": model})


def umetrack_lines(sample: JointSample) -> str:
    """Poses of one hand, a line each, in a world with y up."""
    side = sample.motion.hand
    mirror = 1.0 if side == "right" else -1.0
    wrist = np.array([-0.070 * 0.085 * mirror, -0.223 * 0.19, 0.0])
    turns = Y_UP @ rotation_matrix(sample.motion.orientation)
    places = sample.motion.position @ Y_UP.T + turns @ wrist
    quaternions = Rotation.from_matrix(turns).as_quat(scalar_first=True)
    lines = []
    for k, stamp in enumerate(sample.motion.time):
        flexion, abduction = sample.motion.flexion[k], sample.motion.abduction[k]
        angles = np.concatenate([abduction[:, None], flexion], axis=1).ravel()
        pose = {
            "wrist_xform": {"t_xyz": places[k].tolist(), "q_wxyz": quaternions[k].tolist()},
            "joint_angles": [*angles.tolist(), 0.0, 0.0],
            "hand_confidence": 1.0,
        }
        stamp_ns = 43_124_400_000_000 + round(1e9 * float(stamp))
        lines.append(json.dumps({"timestamp_ns": stamp_ns, "hand_poses": {"1" if side == "right" else "0": pose}}))
    return "\n".join(lines) + "\n"


def lerobot_set(folder: Path, *, episodes: int = 1) -> Path:
    """A data set of hand_joints and of angles in v2.1's layout; gives its Parquet file."""
    data = lerobot_bytes(episodes=episodes)
    path = folder / "data" / "chunk-000" / "episode_000000.parquet"
    path.parent.mkdir(parents=True)
    path.write_bytes(data)
    features = {
        "observation.hand_joints": {"dtype": "float32", "shape": [2, 25, 3], "names": None},
        "observation.state": {"dtype": "float32", "shape": [2], "names": ["index_mcp", "index_pip"]},
    }
    (folder / "meta").mkdir()
    info = {"codebase_version": "v2.1", "robot_type": "glove", "fps": 100, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return path


def lerobot_bytes(
    sample: JointSample | None = None, *, side: Side = "right", episodes: int = 1, checksums: bool = False
) -> bytes:
    """The Parquet file: the joints of one hand, the other's all at the origin; pages usually have no checksums."""
    import pyarrow
    from pyarrow import parquet

    sample = sample or joint_sample(side)
    joints = sample.named(WEBXR_JOINTS)
    both = np.stack([joints, 0.0 * joints] if side == "left" else [0.0 * joints, joints], axis=1)
    count = len(joints)
    table = pyarrow.table(
        {
            "observation.hand_joints": both.reshape(count, 2, 25, 3).tolist() * episodes,
            "observation.state": np.degrees(sample.motion.flexion[:, 1, :2]).tolist() * episodes,
            "timestamp": sample.motion.time.tolist() * episodes,
            "episode_index": np.repeat(np.arange(episodes), count).tolist(),
        }
    )
    stream = io.BytesIO()
    parquet.write_table(table, stream, write_page_checksum=checksums)
    return stream.getvalue()
