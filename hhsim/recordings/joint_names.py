"""What names in a file mean: joints of a hand, statements on their validity, and fields beside the samples.

A joint lies at the proximal end of the bone that it is named after: index_proximal is the knuckle (MCP),
thumb_metacarpal the saddle joint (CMC). OpenXR has 26 joints, WebXR 25 (no palm), MediaPipe and MANO 21 (no palm, and
of the metacarpals the thumb's alone): these 21 are what our hand is fitted to.

docs/recordings.md has statements on validity and fields beside the samples as tables. A field has no effect but where a
reader takes it, and what is taken is told.
"""

import math
import re
from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
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
VALIDITY_WORDS = {
    "flags": "flags", "flag": "flags", "locationflags": "flags",
    "valid": "valid", "isvalid": "valid", "active": "valid", "isactive": "valid",
    "tracked": "tracked", "istracked": "tracked", "confidence": "confidence",
}  # fmt: skip
"""Kind of a statement by a word of its name."""
POSITION_VALID, POSITION_TRACKED = 2, 8
"""XR_SPACE_LOCATION_POSITION_VALID_BIT and XR_SPACE_LOCATION_POSITION_TRACKED_BIT."""
SMALLEST_CONFIDENCE = 0.5
"""Confidence below which a joint is doubtful."""
_TRUTHS = {"true": 1.0, "yes": 1.0, "high": 1.0, "false": 0.0, "no": 0.0, "low": 0.25}

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")
_FINGER_WORDS = {finger: finger for finger in FINGERS} | {"pointer": "index", "pinky": "little", "pinkie": "little"}
_ABBREVIATIONS = {"cmc": "metacarpal", "mcp": "proximal", "pip": "intermediate", "dip": "distal", "ip": "distal"}
_SEGMENT_WORDS = {segment: segment for segment in ("metacarpal", *SEGMENTS)} | _ABBREVIATIONS
_SIDE_WORDS: dict[str, HandSide] = {"left": "left", "l": "left", "right": "right", "r": "right"}
_COORDINATES = {"x": "x", "y": "y", "z": "z", "px": "x", "py": "y", "pz": "z"}
_TURN_WORDS = {"rot", "rotation", "quat", "quaternion", "orientation", "euler", "q", "qx", "qy", "qz", "qw", "w"}
_HAND_WORDS = {"is", "has", "hand", "location", "position", "pose", "joint", "tracking"} | _SIDE_WORDS.keys()
"""Words beside those of `VALIDITY_WORDS` in the name of a statement on a whole hand."""
_UNITS = {1.0: ("m", "met"), 1e-2: ("cm", "centimet"), 1e-3: ("mm", "millimet"), 0.0254: ("inch", "inch")}
"""Word for a unit, and how a longer one begins, by its metres."""
_SIDE = re.compile(r"(r(?=ight|h|$)|l(?=eft|h|$))|(nan|none|$)")
_FIELD_NAMES = {
    "side": "hand side handedness handside isright isrhand isrighthand isleft islhand islefthand",
    "rate": "fps rate framerate frequency mocapframerate samplerate samplingrate",
    "unit": "unit units lengthunit",
    "order": "jointnames jointorder",
}
_KINDS = {name: kind for kind, names in _FIELD_NAMES.items() for name in names.split()}


def words_of(name: str) -> list[str]:
    """Return the words and the numbers in a name, in lower case, which capitals and signs part."""
    return [word.lower() for word in _WORD.findall(name)]


class JointName(NamedTuple):
    """Meaning of a name."""

    side: HandSide  # right, left, or "" if the name does not say
    joint: str  # one of `OPENXR_JOINTS`; "" if the name has none
    part: str  # "x", "y", "z", "radius", "rotation", or a kind of `VALIDITY_WORDS`; "" for the joint alone


@lru_cache(maxsize=4096)
def joint_name(text: str) -> JointName:
    """Parse a name such as left_index_tip_x, XR_HAND_JOINT_INDEX_TIP_EXT or index-finger-phalanx-proximal."""
    words = words_of(text)
    side: HandSide = next((_SIDE_WORDS[word] for word in words if word in _SIDE_WORDS), "")
    finger = next((_FINGER_WORDS[word] for word in words if word in _FINGER_WORDS), "")
    segment = next((_SEGMENT_WORDS[word] for word in words if word in _SEGMENT_WORDS), "")
    joint = f"{finger}_{segment}" if finger else next((word for word in ("wrist", "palm") if word in words), "")
    part = next((VALIDITY_WORDS[word] for word in words if word in VALIDITY_WORDS), "")
    if set(words) & _TURN_WORDS:
        # A statement on an orientation says nothing of a position.
        part = "" if part else "rotation"
    elif not part:
        part = "radius" if "radius" in words else _COORDINATES.get(words[-1], "") if words else ""
    return JointName(side, joint if joint in OPENXR_JOINTS else "", part)


@lru_cache(maxsize=4096)
def hand_statement(text: str) -> JointName | None:
    """Parse the name of a statement on a whole hand, or on what has it as a key, such as right_isActive; else None."""
    words, name = {*words_of(text)}, joint_name(text)
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
        raise TrajectoryError(f"{what}, but none that is {', '.join(missing[:4])}{more}; expected MediaPipe's 21")
    return what


def stated_value(value: Any) -> float:
    """Return a number, a truth, or a word for one such as true, high or 0x0f; NaN for anything else."""
    text = str(value).strip().lower()
    try:
        return _TRUTHS[text] if text in _TRUTHS else float(int(text, 16) if text.startswith("0x") else text)
    except (ValueError, OverflowError):
        return np.nan


def missing_and_doubtful(stated: Mapping[str, FloatArray], shape: tuple[int, int]) -> tuple[BoolArray, BoolArray]:
    """Return which joints are missing and which are doubtful, shape (T, J), by statements of shapes (T, J) or (T, 1).

    NaN states nothing.
    """
    kinds = ("flags", "valid", "tracked", "confidence")
    flags, valid, tracked, sure = (np.broadcast_to(stated.get(kind, np.nan), shape) for kind in kinds)
    known = np.isfinite(flags) | np.isfinite(valid)
    bits = np.nan_to_num(flags, nan=POSITION_VALID | POSITION_TRACKED, posinf=0.0, neginf=0.0).astype(np.int64)
    missing = (bits & POSITION_VALID == 0) | (valid == 0.0) | (((tracked == 0.0) | (sure <= 0.0)) & ~known)
    doubtful = (bits & POSITION_TRACKED == 0) | (tracked == 0.0) | (sure < SMALLEST_CONFIDENCE)
    return missing, doubtful & ~missing


class StatedFields:
    """Fields of a file by their kind: "side", "rate", "unit" or "order"; of two of a kind the first."""

    def __init__(self, held: Mapping[str, Any]) -> None:
        # Of each kind the value, and a sentence for when it is taken.
        self._fields: dict[str, tuple[Any, str]] = {}
        self._names: dict[str, str] = {}
        self._taken: set[str] = set()
        for name, values in held.items():
            if kind := kind_of(name):
                found = _parsed(kind, _key(name), _words(values)) if kind not in self._fields else None
                self._names[name] = "" if found is None else kind
                if found is not None:
                    self._fields[kind] = found[0], f"{found[1]}, as '{name}' says"

    def seen(self, kind: str) -> Any:
        """Return the value of a kind without taking it, None without any."""
        return self._fields.get(kind, (None, ""))[0]

    def take(self, kind: str) -> Any:
        """Return the value of a kind, None without any, and tell of it from now on."""
        self._taken.add(kind)
        return self.seen(kind)

    def hide(self, kind: str) -> None:
        """Leave out a kind that the format reads by itself: it is neither used nor told."""
        self._fields.pop(kind, None)
        self._names = {name: of for name, of in self._names.items() if of != kind}

    def told(self) -> list[str]:
        """Return a sentence on each field that was taken, and one that names the others."""
        left = [name for name, kind in self._names.items() if kind not in self._taken]
        said = [text for kind, (_, text) in self._fields.items() if kind in self._taken]
        return said + ([f"not used: {', '.join(left)}"] if left else [])


def kind_of(name: str) -> str:
    """Return the kind of the field of a name: "side", "rate", "unit" or "order"; "" for any other."""
    return _KINDS.get(_key(name), "")


def side_in(node: Mapping[str, Any]) -> HandSide:
    """Return the side that an object's own keys state, "" where they do not."""
    side = StatedFields({key: node[key] for key in node if kind_of(key)}).seen("side")
    return side if side in ("right", "left") else ""


@lru_cache(maxsize=4096)
def _key(name: str) -> str:
    return re.sub("[^a-z]", "", re.split(r"[/.]", name)[-1].lower())


def _words(value: Any) -> list[str]:
    """Return a value, or those of a list, as words; none of anything nested."""
    try:
        array = np.asarray(value)
    except ValueError:
        return []
    is_list = array.size == max(array.shape, default=1) and array.dtype.kind != "O"
    entries = array.ravel().tolist() if is_list else []
    return [(each.decode("latin1") if isinstance(each, bytes) else str(each)).strip() for each in entries]


def _parsed(kind: str, key: str, words: list[str]) -> tuple[Any, str] | None:
    """Return the value of a field and what it says; None where it says nothing."""
    if kind == "side":
        return _side(key, words)
    if kind == "order":
        # "" for what is none of OpenXR's joints; each of the 21 is there once.
        names = re.split(r"[,;\s]+", words[0]) if len(words) == 1 else words
        joints = JOINT_ORDERS.get(names[0].lower() if names else "") or tuple(joint_name(name).joint for name in names)
        once = all(joints.count(joint) == 1 for joint in KEYPOINTS)
        return (joints, "joints in the order of the file") if once else None
    try:
        value = float(words[0]) if len(words) == 1 else math.nan
    except ValueError:
        value = math.nan
    if kind == "rate":
        return (value, f"{value:g} samples a second") if 0.1 <= value <= 1e5 else None
    word = "".join(words).lower()
    value = next((metre for metre, (unit, long) in _UNITS.items() if word == unit or word.startswith(long)), value)
    unit = _UNITS[value][0] if value in _UNITS else f"{value:g} m"
    return (value, f"positions in {unit}") if 0.0 < value < math.inf else None


def _side(key: str, words: list[str]) -> tuple[str, str] | None:
    """Return the side of all samples, or "both"."""
    if key.startswith("is"):
        right, left = ("r", "l") if key[2] == "r" else ("l", "r")
        truths = dict.fromkeys(("1", "1.0", "true"), right) | dict.fromkeys(("0", "0.0", "false"), left)
        words = [truths.get(word.lower(), word) for word in words]
    found = [_SIDE.match(re.sub("[^a-z]", "", word.lower())) for word in words]
    known = {each[1] for each in found if each and each[1]}
    if not all(found) or not known:
        return None
    side = "both" if len(known) == 2 else "right" if "r" in known else "left"
    return side, f"{side} hand"
