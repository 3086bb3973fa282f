"""Hand poses as HOT3D has them, one JSON object a line: a stamp [ns], and of each hand the wrist's pose and numbers.

`{"timestamp_ns": …, "hand_poses": {"0": {"wrist_xform": {"t_xyz": […], "q_wxyz": […]}, "joint_angles": […]}}}`; hand 0
is the left one, 1 the right. UmeTrack's numbers are `joint_angles`, MANO's `pose`, with the shape in `betas`.
"""

from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.json_document import keys_of, number, objects
from hhsim.recordings.recording import Finding, frames_with_hand, note, unused

HANDS: dict[str, HandSide] = {"0": "left", "1": "right"}
MOST_NUMBERS = 256
SAME_MOMENT = 1e6
"""Largest time between stamps of one moment, of two cameras [ns]."""


class PoseLines(NamedTuple):
    """Poses of one hand; missing numbers are NaN."""

    hand: HandSide
    stamps: FloatArray  # stamps [ns], shape (T,)
    translation: FloatArray  # of the wrist [m], world, shape (T, 3)
    orientation: FloatArray  # its unit quaternion (w, x, y, z), shape (T, 4)
    numbers: FloatArray  # numbers under the key, shape (T, N)
    betas: FloatArray  # shape of the hand, of the first sample that has it; empty for none
    findings: list[Finding]
    rows: list[int]  # line of each sample, shape (T,)


def read_pose_lines(document: Any, key: str, wanted: HandSide) -> PoseLines:
    """Read the poses, under a key, of the wanted hand, or for "" of the one in more lines (of equals the right one).

    The document is as of `read_json`. Raises TrajectoryError for other content, or no such hand in it.
    """
    lines = list(objects(document if isinstance(document, list) else [document]))
    frames: list[dict[HandSide, dict[str, Any]]] = []
    for line in lines:
        poses = line["hand_poses"] if isinstance(line.get("hand_poses"), dict) else {}
        given = {side: pose for index, side in HANDS.items() if isinstance(pose := poses.get(index), dict)}
        frames.append({side: pose for side, pose in given.items() if isinstance(pose.get(key), list)})
    if not any(frames):
        raise TrajectoryError(f"no hand_poses with {key} in JSON that is {keys_of(document)}")
    side, shown, findings = frames_with_hand(frames, wanted)
    findings += unused(dict.fromkeys(key for line in lines for key in line), ("timestamp_ns", "hand_poses"))
    stamps, rows = [number(line.get("timestamp_ns")) for line in lines], shown[:1]
    for row in shown[1:]:
        if not 0.0 < stamps[row] - stamps[rows[-1]] < SAME_MOMENT:
            rows.append(row)
    if len(rows) < len(shown):
        same = f"{len(shown) - len(rows)} of {len(shown)} poses are of the moment of the one before"
        findings.append(note(f"{same}, as of a second camera: no samples"))
    kept = [frames[row][side] for row in rows]
    wide = max(len(pose[key]) for pose in kept)
    if wide > MOST_NUMBERS:
        raise TrajectoryError(f"{wide} numbers a pose; expected those of a hand")
    wrists = [pose["wrist_xform"] if isinstance(pose.get("wrist_xform"), dict) else {} for pose in kept]
    turns = _rows([wrist.get("q_wxyz") for wrist in wrists], 4)
    with np.errstate(invalid="ignore", divide="ignore"):
        turns = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    shape: list[Any] = next((pose["betas"] for pose in kept if isinstance(pose.get("betas"), list)), [])
    return PoseLines(
        hand=side,
        stamps=np.array(stamps)[rows],
        translation=_rows([wrist.get("t_xyz") for wrist in wrists], 3),
        orientation=turns,
        numbers=_rows([pose[key] for pose in kept], wide),
        betas=np.array([number(value) for value in shape[:MOST_NUMBERS]]),
        findings=findings,
        rows=rows,
    )


def _rows(values: list[Any], width: int) -> FloatArray:
    whole = [value if isinstance(value, list) and len(value) == width else [None] * width for value in values]
    return np.array([[number(item) for item in value] for value in whole])
