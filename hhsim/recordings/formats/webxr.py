"""Joints of a hand in JSON: frames of named joints with position, orientation and radius, or a recording of iwer.

A frame is an object with a stamp, or a list, and has hands anywhere in it: objects whose keys are joints, lists of
objects that name their joint, lists of 25 (WebXR's) or 26 joints (OpenXR's or Unity's). A joint is three numbers, x, y
and z, or a matrix, in itself or below it. iwer's recorder (`schema` and `frames`) gives joints relative to the pointing
ray of their hand. y is up; the bend of the fingers tells a right-handed world from Unity's left-handed one.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hhsim.errors import TrajectoryError
from hhsim.recordings.content import Content, ReadOptions, number
from hhsim.recordings.frames import turned
from hhsim.recordings.joint_arrays import frames_in, joints_of_frames, listed_joints
from hhsim.recordings.joint_names import KEYPOINTS, WEBXR_JOINTS
from hhsim.recordings.registry import JointPositions, RecordingFormat

NAMED = re.compile(r"(thumb|index|middle)[-_ ]?(finger)?[-_ ]?(phalanx)?[-_ ]?(tip|metacarpal|proximal)", re.IGNORECASE)
IWER_HAND = 8
"""Numbers of a joint in iwer's frames: position, quaternion (x, y, z, w), radius."""


def _read(content: Content, options: ReadOptions) -> JointPositions:
    document, device = content.document, ""
    if isinstance(document, dict) and isinstance(document.get("schema"), list):
        device, frames = "WebXR through iwer", list(_iwer_frames(document))
        beside = {key: value for key, value in document.items() if key not in ("schema", "frames")}
    else:
        frames, beside = frames_in(document)
    return joints_of_frames(content, options, frames, beside, up="y", may_be_mirrored=True, device=device)


def _iwer_frames(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the frames of iwer's recorder as those of named joints."""
    entries = [entry for entry in document["schema"] if isinstance(entry, list) and len(entry) == 2]
    schemas = {entry[0]: entry[1] for entry in entries if isinstance(entry[0], int) and isinstance(entry[1], dict)}
    frames = document.get("frames")
    for frame in frames if isinstance(frames, list) else []:
        if not isinstance(frame, list) or not frame:
            raise TrajectoryError(f"a frame of iwer's recorder is {str(frame)[:40]!r}; expected a list of numbers")
        hands = {}
        for source in frame[8:]:
            if not isinstance(source, list) or len(source) < 9 or not isinstance(source[0], int):
                continue
            schema = schemas.get(source[0], {})
            order = schema.get("jointSequence")
            order = [str(name) for name in order] if isinstance(order, list) else list(WEBXR_JOINTS)
            lists = (part for part in source[8:] if isinstance(part, list))
            flat = next((part for part in lists if len(part) == IWER_HAND * len(order)), None)
            if flat and schema.get("handedness") in ("right", "left"):
                numbers = np.array([number(each) for each in flat]).reshape(-1, IWER_HAND)
                ray = np.array([number(each) for each in source[1:8]])
                world = ray[:3] + turned(np.tile(ray[[6, 3, 4, 5]], (len(numbers), 1)), numbers[:, :3])
                joints = zip(order, world.tolist(), numbers[:, 7].tolist())
                hands[schema["handedness"]] = {name: {"position": at, "radius": radius} for name, at, radius in joints}
        yield {"time_ms": number(frame[0]), "hands": hands}


def _sniff(content: Content, options: ReadOptions) -> bool:
    text = content.beginning
    named = NAMED.search(text) is not None or ('"schema"' in text and "jointSequence" in text)
    return content.is_json and (named or listed_joints(content) > len(KEYPOINTS))


FORMAT = RecordingFormat(
    "webxr", "JSON frames of joints by name: WebXR, OpenXR, iwer", (".json", ".jsonl"), _sniff, _read
)
