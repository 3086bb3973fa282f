"""Joints of a hand in JSON: frames of named joints with position, orientation and radius, or a recording of iwer.

`hhsim.recordings.joint_frames` has the shapes of such frames. iwer's recorder (`schema` and `frames`) gives joints
relative to the pointing ray of their hand. y is up; the bend of the fingers tells a right-handed world from Unity's
left-handed one.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.frames import turned
from hhsim.recordings.joint_frames import Frame, Joint, joints_of_frames, listed_joints, read_frames
from hhsim.recordings.joint_names import KEYPOINTS, WEBXR_JOINTS, joint_name
from hhsim.recordings.joint_positions import recording_of_joints
from hhsim.recordings.json_document import number
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat

NAMED = re.compile(r"(thumb|index|middle)[-_ ]?(finger)?[-_ ]?(phalanx)?[-_ ]?(tip|metacarpal|proximal)", re.IGNORECASE)
IWER_HAND = 8
"""Numbers of a joint in iwer's frames: position, quaternion (x, y, z, w), radius."""


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the one in more frames; raises TrajectoryError."""
    document, device = content.document, ""
    if isinstance(document, dict) and isinstance(document.get("schema"), list):
        device, frames = "WebXR through iwer", list(_iwer_frames(document))
        beside = {key: value for key, value in document.items() if key not in ("schema", "frames")}
    else:
        frames, beside = read_frames(document)
    joints = joints_of_frames(frames, beside, "webxr", options, up="y", may_be_mirrored=True, device=device)
    return recording_of_joints(joints, content, options)


def _iwer_frames(document: Mapping[str, Any]) -> Iterator[Frame]:
    """Yield the frames of iwer's recorder."""
    schemas: dict[int, Mapping[str, Any]] = {
        entry[0]: entry[1]
        for entry in document["schema"]
        if isinstance(entry, list) and len(entry) == 2 and isinstance(entry[0], int) and isinstance(entry[1], dict)
    }
    frames = document.get("frames")
    for frame in frames if isinstance(frames, list) else []:
        if not isinstance(frame, list) or not frame:
            raise TrajectoryError(f"a frame of iwer's recorder is {str(frame)[:40]!r}; expected a list of numbers")
        hands: dict[HandSide, Mapping[str, Joint]] = {}
        for source in frame[8:]:
            if not isinstance(source, list) or len(source) < 9 or not isinstance(source[0], int):
                continue
            schema = schemas.get(source[0], {})
            joints = schema.get("jointSequence")
            places = [part for part in source[8:] if isinstance(part, list)]
            order = [str(name) for name in joints] if isinstance(joints, list) else list(WEBXR_JOINTS)
            flat = next((part for part in places if len(part) == IWER_HAND * len(order)), None)
            side = schema.get("handedness")
            if flat is not None and side in ("right", "left"):
                hands[side] = _iwer_hand([number(each) for each in source[1:8]], flat, order)
        yield Frame(hands, number(frame[0]), "ms")


def _iwer_hand(ray: list[float], flat: list[Any], order: list[str]) -> dict[str, Joint]:
    """Return the joints of one hand in the world from those relative to its ray."""
    numbers = np.array([number(each) for each in flat]).reshape(-1, IWER_HAND)
    turn = np.array([ray[6], *ray[3:6]])
    with np.errstate(invalid="ignore", divide="ignore"):
        turn /= np.linalg.norm(turn)
    world = np.array(ray[:3]) + turned(np.tile(turn, (len(numbers), 1)), numbers[:, :3])
    return {
        joint: Joint(world[k].tolist(), float(numbers[k, 7]))
        for k, name in enumerate(order)
        if (joint := joint_name(name).joint)
    }


def _sniff(content: Content, options: ReadOptions) -> bool:
    text = content.beginning
    named = NAMED.search(text) is not None or ('"schema"' in text and "jointSequence" in text)
    return content.is_json and (named or listed_joints(content) > len(KEYPOINTS))


FORMAT = RecordingFormat(
    "webxr", "JSON frames of joints by name: WebXR, OpenXR, iwer", (".json", ".jsonl"), _sniff, _read
)
