"""Recordings of a Leap Motion controller: JSON of leapjs-playback, a list of frames, or one a line; also LZ-string.

Leap's world is in millimetres with y up; `direction` points to the fingers, `palmNormal` out of the palm. Leap gives
the thumb a metacarpal of length zero, and its next three bones are our three.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hhsim.errors import DamagedFileError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.sample_flags import SampleFlag
from hhsim.recordings.content import Content, ReadOptions, keys_of, number, objects, read_json, vector
from hhsim.recordings.finger_ik import palm_rotation
from hhsim.recordings.frames import axis_flip
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.recording import SIDES, Recording
from hhsim.recordings.registry import RecordingFormat
from hhsim.system.child_reader import read_in_child

MILLIMETRE = 1e-3
JOINTS = ("mcpPosition", "pipPosition", "dipPosition", "btipPosition")
UNSURE = 0.5
"""Confidence below which a sample is marked."""
EXPECTED = "expected a Leap Motion recording, or frames of a hand's joints, by name or as a list of 21, 25 or 26"
DEEPEST = 12
"""Deepest nesting of packed frames."""
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
LETTERS_A_SECOND = 5e4
"""Letters that lzstring has to unpack in a second of the processor's time at least."""


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the one in more frames; raises TrajectoryError."""
    document = read_json(unpack(content.text)) if _looks_packed(content.text) else content.document
    frames, found = list(_frames(document)), document if isinstance(document, dict) else {}
    metadata = found["metadata"] if isinstance(found.get("metadata"), dict) else {}
    sides = [{hand["type"] for hand in objects(frame.get("hands")) if hand.get("type") in SIDES} for frame in frames]
    if not any(sides):
        held = frames[0] if frames else found.get("frames", document)
        raise TrajectoryError(f"no hand in any of {len(frames)} frames of Leap Motion's, {keys_of(held)}; {EXPECTED}")
    side, shown = content.frames_with_hand(sides, options.hand)
    stated = metadata.get("frames")
    if isinstance(stated, int) and stated != len(frames):
        content.note(f"{len(frames)} frames where the file says {stated}: some are lost")
    content.unused(found, ("frames", "metadata"))
    # Of several hands of a side the longest visible.
    ours = ([hand for hand in objects(frames[k].get("hands")) if hand.get("type") == side] for k in shown)
    hands = [max(each, key=lambda hand: np.nan_to_num(number(hand.get("timeVisible")))) for each in ours]
    flip = axis_flip(options.mirror)
    direction, normal = (
        flip * np.array([vector(hand.get(key)) for hand in hands]) for key in ("direction", "palmNormal")
    )
    points = np.array([_joints(frames[k], hand) for k, hand in zip(shown, hands)])
    if not np.isfinite(points[:, 1:]).any():
        raise TrajectoryError("no frame holds the joints of the fingers; expected bones, as of Leap's API from 2.0 on")
    joints = JointPositions(
        position=points,
        what="",
        time=np.array([number(frames[k].get("timestamp")) for k in shown]),
        time_unit="us",
        hand=side,
        unit=MILLIMETRE,
        up="y",
        palm=palm_rotation(direction, -normal),
        device="Leap Motion",
        rows=shown,
    )
    confidence, made = np.array([number(hand.get("confidence")) for hand in hands]), metadata.get("generatedBy")
    recording = recording_of_joints(joints, content, options).changed(
        name=content.name.removesuffix(".json"), source=f"recorded with {made}" if isinstance(made, str) else ""
    )
    text = f"confidence below {UNSURE:g}, says the device: kept"
    return recording.flagged(confidence < UNSURE, SampleFlag.INVALID, text)


def _looks_packed(text: str) -> bool:
    """Return True if a text consists of LZ-string's base64 letters."""
    sample = text[:2000].strip()
    return len(sample) > 20 and set(sample) <= set(LETTERS + "=")


def unpack(text: str) -> str:
    """Decompress LZ-string's text; raise DamagedFileError for one that is damaged or cut short."""
    from lzstring import LZString

    letters, damaged = "".join(text.split()), "damaged LZ-string text"
    found: str | None = read_in_child(
        lambda: LZString.decompressFromBase64(letters), damaged, len(letters), rate=LETTERS_A_SECOND
    )
    if not found:
        raise DamagedFileError(f"{damaged}; was it cut short?")
    return found


def _frames(document: Any) -> Iterator[Mapping[str, Any]]:
    """Yield the frames as objects, plain or packed."""
    frames = document.get("frames") if isinstance(document, dict) else document
    if not isinstance(frames, list):
        raise TrajectoryError(f"JSON without frames, {keys_of(document)}; {EXPECTED}")
    packed = bool(frames) and isinstance(frames[0], list)
    for place, given in enumerate(frames[packed:], start=1):
        frame = _unpacked(frames[0], given, f"frame {place}") if packed else given
        if not isinstance(frame, dict):
            raise TrajectoryError(f"frame {place} is {str(frame)[:40]!r}; expected an object")
        # Skip the service's greeting and events.
        if packed or "hands" in frame or "timestamp" in frame:
            yield frame


def _unpacked(structure: Any, packed: Any, where: str, depth: int = 0) -> Any:
    """Unpack a list by its structure: names, or a name with the structure below it, in the list's order."""
    if depth > DEEPEST or not isinstance(structure, list) or not isinstance(packed, list):
        raise TrajectoryError(f"{where} is not packed as the first entry says")
    if len(structure) == 1 and isinstance(structure[0], list):
        return [_unpacked(structure[0], item, where, depth + 1) for item in packed]
    if len(packed) != len(structure):
        raise TrajectoryError(f"{where} holds {len(packed)} values; expected {len(structure)}, as the first entry says")
    out = {}
    for key, value in zip(structure, packed):
        if isinstance(key, dict) and len(key) == 1:
            ((name, inner),) = key.items()
            out[name] = _unpacked(inner, value, where, depth + 1)
        else:
            out[str(key)] = value
    return out


def _joints(frame: Mapping[str, Any], hand: Mapping[str, Any]) -> list[list[float]]:
    """Return the wrist, and base, two joints and tip of each finger [mm], 21 points; NaN where missing."""
    joints = [[[np.nan] * 3] * len(JOINTS)] * len(FINGERS)
    for pointable in objects(frame.get("pointables")):
        finger = pointable.get("type")
        ours = pointable.get("handId") == hand.get("id") and not pointable.get("tool")
        if ours and isinstance(finger, int) and 0 <= finger < len(FINGERS):
            # The first versions with bones wrote no end of the last one; the fingertip is near it.
            held = {"btipPosition": pointable.get("tipPosition"), **pointable}
            joints[finger] = [vector(held.get(key)) for key in JOINTS]
    return [vector(hand.get("wrist")), *(joint for finger in joints for joint in finger)]


FORMAT = RecordingFormat(
    "leap",
    "a Leap Motion recording, .json or .json.lz",
    (".json", ".lz"),
    lambda content, options: content.is_json or _looks_packed(content.beginning),
    _read,
    rank=1,
)
