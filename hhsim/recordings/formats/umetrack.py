"""UmeTrack hands: a wrist's pose and 20 joint angles a sample, and the sizes of the user's hand in a profile.

The profile (--profile, or *user_profile.json beside the recording) is JSON with `hand_model`: rest positions [mm] and
axes of 22 joints, four a finger and two of the wrist, and rest positions of landmarks. It describes a left hand; a
right one is its mirror in x of the wrist's frame. A joint turns all that follows it about its axis through its rest
position. The files do not say which axis points up: on Quest it is y, on Aria z. The object that the hand moves is that
of --object-track in HOT3D's dynamic_objects.csv beside the recording, or the only one there.
"""

from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, named
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.motion.trajectory import ObjectMotion
from hhsim.recordings.frames import posed_tree, to_our_frames
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.json_document import keys_of, read_json
from hhsim.recordings.pose_lines import object_beside, read_pose_lines
from hhsim.recordings.recording import Recording, note
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat

ANGLES = 20
PROFILE = "*user_profile.json"
MILLIMETRE = 1e-3
WRIST = 5
"""Landmark of the wrist, after the fingertips from thumb to little finger."""


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the one in more lines; raises TrajectoryError."""
    poses = read_pose_lines(content.document, "joint_angles", options.hand)
    if poses.numbers.shape[1] < ANGLES:
        raise TrajectoryError(f"{poses.numbers.shape[1]} joint angles of the {poses.hand} hand; expected {ANGLES}")
    path, chosen = options.profile, ""
    if path is None:
        beside = sorted(content.original.parent.glob(PROFILE)) if content.original is not None else []
        if len(beside) != 1:
            found = f"{len(beside)} files {PROFILE} beside it" if beside else "none beside it"
            raise TrajectoryError(f"UmeTrack poses need the profile of the hand, and there is {found}: say --profile")
        path, chosen = beside[0], ", which lies beside"
    rest, axes, landmarks = _profile(path)
    local = _hand_points(rest, axes, landmarks, poses.numbers[:, :ANGLES])
    if poses.hand == "right":
        local = local * [-1.0, 1.0, 1.0]
    points = local @ np.swapaxes(rotation_matrix(poses.orientation), 1, 2) + poses.translation[:, None]
    findings = list(poses.findings)
    up = options.world_up
    if up is None:
        findings.append(note("the file does not say which axis is up: y, as on Quest; on Aria it is z: --world-up"))
        up = "y"
    moved, remark = object_beside(content.original, poses.stamps, options.object_track)
    if remark is not None:
        findings.append(remark)
    joints = JointPositions(
        position=points,
        form="umetrack",
        what=f"{ANGLES} angles of the {poses.hand} hand, sizes from {path.name}{chosen}",
        time=poses.stamps,
        time_unit="ns",
        hand=poses.hand,
        unit=1.0,
        up=up,
        findings=tuple(findings),
        rows=poses.rows,
    )
    recording = recording_of_joints(joints, content, options)
    if moved is None:
        return recording
    return recording.changed(object_motion=ObjectMotion(*to_our_frames(*moved, None, up, options.mirror)))


def _hand_points(rest: FloatArray, axes: FloatArray, landmarks: FloatArray, angles: FloatArray) -> FloatArray:
    """Compute the 21 joints in the wrist's frame, shape (T, 21, 3), from angles [rad], shape (T, 20).

    The profile gives rest positions and unit axes of 20 joints, and rest positions of 21 landmarks, in its unit.
    """
    turns = rotation_matrix(quaternion(angles[..., None] * axes))
    rotation, shift = posed_tree([joint - 1 if joint % 4 else -1 for joint in range(ANGLES)], rest, turns)
    # The first joint of a finger turns where the second one does.
    at = np.einsum("tjik,jk->tji", rotation, rest) + shift
    tips = np.einsum("tjik,jk->tji", rotation[:, 3::4], landmarks[:5]) + shift[:, 3::4]
    fingers = np.concatenate([at.reshape(-1, 5, 4, 3)[:, :, 1:], tips[:, :, None]], axis=2)
    wrist = np.tile(landmarks[WRIST], (len(angles), 1, 1))
    return np.concatenate([wrist, fingers.reshape(-1, 20, 3)], axis=1)


def _profile(path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Read rest positions [m] and unit axes of the joints, and the landmarks [m]."""
    with named(path):
        document = read_json(Content(path, what="the profile of an UmeTrack hand").text)
        model = document.get("hand_model", document) if isinstance(document, dict) else None
        if not isinstance(model, dict):
            raise TrajectoryError(f"{keys_of(document)}; expected the profile of an UmeTrack hand")
        rest = MILLIMETRE * _numbers(model, "joint_rest_positions", ANGLES)
        axes = _numbers(model, "joint_rotation_axes", ANGLES)
        norm = np.linalg.norm(axes, axis=1, keepdims=True)
        if not (np.abs(norm - 1.0) < 0.02).all():
            raise TrajectoryError("joint_rotation_axes are no unit vectors")
        return rest, axes / norm, MILLIMETRE * _numbers(model, "landmark_rest_positions", 21)


def _numbers(model: dict[str, Any], key: str, count: int) -> FloatArray:
    try:
        values = np.array(model.get(key), dtype=np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.ndim != 2 or values.shape[0] < count or values.shape[1] != 3 or not np.isfinite(values).all():
        raise TrajectoryError(f"{key} is not at least {count} points; expected the profile of an UmeTrack hand")
    return values[:count]


def _sniff(content: Content, options: ReadOptions) -> bool:
    text = content.beginning
    return text.lstrip().startswith("{") and '"hand_poses"' in text and '"joint_angles"' in text


FORMAT = RecordingFormat(
    "umetrack", "UmeTrack poses, one JSON object a line, with the user's profile", (".jsonl",), _sniff, _read
)
