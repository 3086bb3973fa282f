"""What a Leap Motion controller would have written of a smooth motion of our own hand."""

from typing import Any, Literal

import numpy as np
from recording_samples import smooth_recording

from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.recordings.frames import world_matrix

CLEAN = smooth_recording(30)
HAND_KEYS = ["id", "type", "direction", "palmNormal", "wrist", "confidence"]
JOINT_KEYS = ["mcpPosition", "pipPosition", "dipPosition", "btipPosition"]
FINGER_KEYS = ["handId", "type", *JOINT_KEYS]
FRAME = ["id", "timestamp", {"hands": [HAND_KEYS]}, {"pointables": [FINGER_KEYS]}]


def leap_hand(hand: HandModel, pose: Any) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Fields of a hand in a frame, and of each of its fingers."""
    back = world_matrix("y").T
    joints, palm = 1e3 * hand.joints(*pose) @ back.T, back @ rotation_matrix(pose[1])
    wrist = 1e3 * back @ pose[0] - 42.0 * palm[:, 1]
    words = {"direction": palm[:, 1], "palmNormal": -palm[:, 2], "wrist": wrist}
    fingers = [{key: joints[f, k].tolist() for k, key in enumerate(JOINT_KEYS)} for f in range(5)]
    return {name: value.tolist() for name, value in words.items()}, fingers


def keypoint_table(whole: dict[str, Any]) -> str:
    """The hands of such a document as a table of keypoints, in our world [m]; without a hand its cells are empty."""
    sides = sorted({hand["type"] for frame in whole["frames"] for hand in frame["hands"]}, reverse=True)
    header = [f"{side}_lm{k:02d}_{axis}" for side in sides for k in range(21) for axis in "xyz"]
    rows = []
    for frame in whole["frames"]:
        row = dict.fromkeys(header, "")
        for hand in frame["hands"]:
            own = [finger for finger in frame["pointables"] if finger["handId"] == hand["id"]]
            points = [hand["wrist"], *(finger[key] for finger in own for key in JOINT_KEYS)]
            places = 1e-3 * np.array(points) @ world_matrix("y").T
            names = (name for name in header if name.startswith(hand["type"]))
            row.update(zip(names, map(repr, places.ravel().tolist()), strict=True))
        rows.append(f"{1e-6 * frame['timestamp']!r},{','.join(row.values())}")
    return "\n".join(["time_s," + ",".join(header), *rows, ""])


def document(side: Literal["right", "left"] = "right", count: int = 30) -> dict[str, Any]:
    """What Leap would have written of the clean recording: y up, millimetres, microseconds."""
    frames = []
    for i in range(count):
        pose = (CLEAN.position[i], CLEAN.orientation[i], CLEAN.flexion[i], 0.0 * CLEAN.abduction[i])
        shown, joints = leap_hand(HandModel.default(side), pose)
        fingers = [{"handId": 7, "type": f, **joints[f]} for f in range(5)]
        seen = {"id": 7, "type": side, **shown, "confidence": 0.2 if i == 4 else 0.9}
        stamp = 20746785498 + round(1e6 * CLEAN.time[i])
        frames.append({"id": i, "timestamp": stamp, "hands": [seen], "pointables": fingers})
    return {"metadata": {"formatVersion": 1, "frames": count, "generatedBy": "LeapJS"}, "frames": frames}


def packed(whole: dict[str, Any]) -> dict[str, Any]:
    """The document with its frames as lists."""
    lists = [
        [
            frame["id"],
            frame["timestamp"],
            [[hand[key] for key in HAND_KEYS] for hand in frame["hands"]],
            [[finger[key] for key in FINGER_KEYS] for finger in frame["pointables"]],
        ]
        for frame in whole["frames"]
    ]
    return whole | {"frames": [FRAME, *lists]}
