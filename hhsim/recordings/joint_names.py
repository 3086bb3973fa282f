"""Joints of a hand by the names that makers give them, mapped to the names of OpenXR.

A joint lies at the proximal end of the bone that it is named after: index_proximal is the knuckle (MCP),
thumb_metacarpal the saddle joint (CMC). OpenXR has 26 joints, WebXR 25 (no palm), MediaPipe and MANO 21 (no palm, and
of the metacarpals the thumb's alone): these 21 are what our hand is fitted to.
"""

import re
from collections.abc import Collection
from functools import lru_cache
from typing import NamedTuple

from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.stated_validity import VALIDITY_WORDS
from hhsim.system.counted import counted

SEGMENTS = ("proximal", "intermediate", "distal", "tip")
THUMB_SEGMENTS = ("metacarpal", "proximal", "distal", "tip")

_SEGMENTS_OF = {finger: THUMB_SEGMENTS if finger == "thumb" else SEGMENTS for finger in FINGERS}
KEYPOINTS = ("wrist", *(f"{finger}_{segment}" for finger in FINGERS for segment in _SEGMENTS_OF[finger]))
"""21 joints in MediaPipe's order: the wrist, then thumb to little finger, each from its base to its tip."""
_WEBXR = (f"{finger}_{segment}" for finger in FINGERS for segment in ("metacarpal", *_SEGMENTS_OF[finger]))
WEBXR_JOINTS = ("wrist", *dict.fromkeys(_WEBXR))
"""25 joints of WebXR in its order."""
OPENXR_JOINTS = ("palm", *WEBXR_JOINTS)
"""26 joints of OpenXR in its order."""
UNITY_JOINTS = ("wrist", "palm", *WEBXR_JOINTS[1:])
"""The same in the order of Unity's XR Hands: the wrist is before the palm."""
MANO_JOINTS = (
    "wrist",
    *(f"{f}_{segment}" for f in ("index", "middle", "little", "ring", "thumb") for segment in _SEGMENTS_OF[f][:3]),
    *(f"{finger}_tip" for finger in FINGERS),
)
"""21 joints of the MANO hand in its order, and then the tips, as smplx, manopth and HO-3D have them."""
JOINT_ORDERS = {
    "mediapipe": KEYPOINTS, "mano": MANO_JOINTS, "smplx": MANO_JOINTS, "openxr": OPENXR_JOINTS, "unity": UNITY_JOINTS,
}  # fmt: skip
"""Orders of joints in rows without names; WebXR's is that of OpenXR without the palm."""

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")
_FINGER_WORDS = {finger: finger for finger in FINGERS} | {"pointer": "index", "pinky": "little", "pinkie": "little"}
_ABBREVIATIONS = {"cmc": "metacarpal", "mcp": "proximal", "pip": "intermediate", "dip": "distal", "ip": "distal"}
_SEGMENT_WORDS = {segment: segment for segment in ("metacarpal", *SEGMENTS)} | _ABBREVIATIONS
_SIDE_WORDS: dict[str, HandSide] = {"left": "left", "l": "left", "right": "right", "r": "right"}
_COORDINATES = {"x": "x", "y": "y", "z": "z", "px": "x", "py": "y", "pz": "z"}
_TURN_WORDS = {"rot", "rotation", "quat", "quaternion", "orientation", "euler", "q", "qx", "qy", "qz", "qw", "w"}
_HAND_WORDS = {"is", "has", "hand", "location", "position", "pose", "joint", "tracking"} | _SIDE_WORDS.keys()
"""Words beside those of `VALIDITY_WORDS` in the name of a statement on a whole hand."""


class JointName(NamedTuple):
    """Meaning of a name."""

    side: HandSide  # right, left, or "" if the name does not say
    joint: str  # one of `OPENXR_JOINTS`; "" if the name has none
    # "x", "y", "z", "radius", "rotation", or a kind of `hhsim.recordings.stated_validity`; "" for the joint alone.
    part: str


@lru_cache(maxsize=4096)
def joint_name(text: str) -> JointName:
    """Parse a name such as left_index_tip_x, XR_HAND_JOINT_INDEX_TIP_EXT or index-finger-phalanx-proximal."""
    words = [word.lower() for word in _WORD.findall(text)]
    side: HandSide = next((_SIDE_WORDS[word] for word in words if word in _SIDE_WORDS), "")
    finger = next((_FINGER_WORDS[word] for word in words if word in _FINGER_WORDS), "")
    segment = next((_SEGMENT_WORDS[word] for word in words if word in _SEGMENT_WORDS), "")
    joint = f"{finger}_{segment}" if finger else next((word for word in ("wrist", "palm") if word in words), "")
    part = next((VALIDITY_WORDS[word] for word in words if word in VALIDITY_WORDS), "")
    if set(words) & _TURN_WORDS:
        # A statement on an orientation says nothing of a position.
        part = "" if part else "rotation"
    elif part:
        pass
    elif "radius" in words:
        part = "radius"
    elif words and words[-1] in _COORDINATES:
        part = _COORDINATES[words[-1]]
    return JointName(side, joint if joint in OPENXR_JOINTS else "", part)


@lru_cache(maxsize=4096)
def hand_statement(text: str) -> JointName | None:
    """Parse the name of a statement on a whole hand, or on what has it as a key, such as right_isActive; else None."""
    words = {word.lower() for word in _WORD.findall(text)}
    name = joint_name(text)
    return name if name.part in VALIDITY_WORDS.values() and words <= _HAND_WORDS | VALIDITY_WORDS.keys() else None


def recognised(joints: Collection[str], side: HandSide = "") -> str:
    """Describe joints, such as "26 OpenXR joints of the right hand named"; TrajectoryError without one of the 21."""
    known = set(joints) & set(OPENXR_JOINTS)
    sets = {"OpenXR joints": OPENXR_JOINTS, "WebXR joints": WEBXR_JOINTS, "joints in MediaPipe's set": KEYPOINTS}
    convention = next((text for text, names in sets.items() if known == set(names)), "")
    what = f"{len(known)} {convention}" if convention else counted(len(known), "joint")
    what = f"{what}{f' of the {side} hand' if side else ''} named"
    missing = [joint for joint in KEYPOINTS if joint not in known]
    if missing:
        more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
        raise TrajectoryError(
            f"{what}, but none that is {', '.join(missing[:4])}{more}; expected at least MediaPipe's 21"
        )
    return what
