"""UmeTrack hands: a wrist's pose and 20 joint angles a sample, and the sizes of the user's hand in a profile.

The profile (--profile, or *user_profile.json beside the recording) is JSON with `hand_model`: rest positions [mm] and
axes of 22 joints, four a finger and two of the wrist, and rest positions of landmarks. It describes a left hand; a
right one is its mirror in x of the wrist's frame. A joint turns all that follows it about its axis through its rest
position. The files do not say which axis points up: on Quest it is y, on Aria z. The object that the hand moves is that
of --object-track in HOT3D's dynamic_objects.csv beside the recording, or the only one there: object_uid,
timestamp[ns], t_wo_x[m] …, q_wo_w …, each object's own frame in the same world.
"""

from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError, named
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.recordings.content import Content, ReadOptions, keys_of
from hhsim.recordings.formats.mano import SAME_MOMENT, posed_tree, read_pose_lines
from hhsim.recordings.object_poses import ObjectPoses, stamped_poses
from hhsim.recordings.registry import JointPositions, RecordingFormat

ANGLES = 20
PROFILE = "*user_profile.json"
MILLIMETRE = 1e-3
WRIST = 5
"""Landmark of the wrist, after the fingertips from thumb to little finger."""
OBJECTS = "dynamic_objects.csv"


def _read(content: Content, options: ReadOptions) -> JointPositions:
    """Read the hand of the options, else the one in more lines; raises TrajectoryError."""
    poses = read_pose_lines(content, "joint_angles", options.hand)
    if poses.numbers.shape[1] < ANGLES:
        raise TrajectoryError(f"{poses.numbers.shape[1]} joint angles of the {poses.hand} hand; expected {ANGLES}")
    path, chosen = options.profile, ""
    if path is None:
        beside = sorted(content.original.parent.glob(PROFILE)) if content.original is not None else []
        if len(beside) != 1:
            found = f"{len(beside)} files {PROFILE} beside it" if beside else "none beside it"
            raise TrajectoryError(f"UmeTrack poses need the profile of the hand, and there is {found}: say --profile")
        path, chosen = beside[0], ", which lies beside"
    local = _hand_points(path, poses.numbers[:, :ANGLES]) * ([-1.0, 1.0, 1.0] if poses.hand == "right" else 1.0)
    up = options.world_up
    if up is None:
        content.note("the file does not say which axis is up: y, as on Quest; on Aria it is z: --world-up")
        up = "y"
    moved = _object_beside(content, poses.fields["time"], options)
    return JointPositions(
        position=local @ np.swapaxes(rotation_matrix(poses.orientation), 1, 2) + poses.translation[:, None],
        what=f"{ANGLES} angles of the {poses.hand} hand, sizes from {path.name}{chosen}",
        hand=poses.hand,
        unit=1.0,
        up=up,
        object_poses=moved,
        **poses.fields,
    )


def _hand_points(path: Path, angles: FloatArray) -> FloatArray:
    """Compute the 21 joints [m] in the wrist's frame, shape (T, 21, 3), from a profile and angles [rad], (T, 20)."""
    with named(path):
        document = Content(path, what="the profile of an UmeTrack hand").document
        model = document.get("hand_model", document) if isinstance(document, dict) else {}
        keys = {"joint_rest_positions": ANGLES, "joint_rotation_axes": ANGLES, "landmark_rest_positions": 21}
        try:
            points = [np.array(model[key], dtype=np.float64)[:count].reshape(count, 3) for key, count in keys.items()]
        except (KeyError, TypeError, ValueError, IndexError):
            expected = f"the profile of an UmeTrack hand: points in {', '.join(keys)}"
            raise TrajectoryError(f"{keys_of(document)}; expected {expected}") from None
        rest, axes, landmarks = MILLIMETRE * points[0], points[1], MILLIMETRE * points[2]
        norm = np.linalg.norm(axes, axis=1, keepdims=True)
        if not (np.abs(norm - 1.0) < 0.02).all() or not np.isfinite([*rest, *landmarks]).all():
            raise TrajectoryError("joint_rotation_axes are no unit vectors, or a position is missing")
    turns = rotation_matrix(quaternion(angles[..., None] * (axes / norm)))
    rotation, shift = posed_tree([joint - 1 if joint % 4 else -1 for joint in range(ANGLES)], rest, turns)
    # The first joint of a finger turns where the second one does.
    at = np.einsum("tjik,jk->tji", rotation, rest) + shift
    tips = np.einsum("tjik,jk->tji", rotation[:, 3::4], landmarks[:5]) + shift[:, 3::4]
    fingers = np.concatenate([at.reshape(-1, 5, 4, 3)[:, :, 1:], tips[:, :, None]], axis=2)
    wrist = np.tile(landmarks[WRIST], (len(angles), 1, 1))
    return np.concatenate([wrist, fingers.reshape(-1, 20, 3)], axis=1)


def _object_beside(content: Content, stamps: FloatArray, options: ReadOptions) -> ObjectPoses | None:
    """Read the poses of an object at the stamps [ns], shape (T,), from the table beside a recording.

    Of several objects without one of the options there are none, which is told. Raises InputError for no such table.
    """
    path = None if content.original is None else content.original.parent / OBJECTS
    if path is None or not path.is_file():
        if options.object_track is not None:
            raise InputError(f"--object-track {options.object_track}: there is no {OBJECTS} beside the recording")
        return None
    try:
        with named(path):
            table = Content(path, what="poses of an object")
            poses, moments = stamped_poses(table, options)
        content.tell(*table.told())
    except TrajectoryError as error:
        if options.object_track is not None:
            raise
        content.note(str(error))
        return None
    if moments is None:
        raise TrajectoryError(f"{OBJECTS} beside the recording has no column of stamps")
    # Hand and object have stamps of the same frames.
    place = np.array([int(np.argmin(np.abs(moments - 1e-9 * stamp))) if stamp == stamp else 0 for stamp in stamps])
    is_near = (np.abs(moments[place] - 1e-9 * stamps) < 1e-9 * SAME_MOMENT)[:, None]
    position, orientation = (np.where(is_near, values, np.nan) for values in poses.at(place)[:2])
    return ObjectPoses(position, orientation, 1.0, (f"{OBJECTS} beside the recording",))


def _sniff(content: Content, options: ReadOptions) -> bool:
    text = content.beginning
    return text.lstrip().startswith("{") and '"hand_poses"' in text and '"joint_angles"' in text


FORMAT = RecordingFormat(
    "umetrack", "UmeTrack poses, one JSON object a line, with the user's profile", (".jsonl",), _sniff, _read
)
