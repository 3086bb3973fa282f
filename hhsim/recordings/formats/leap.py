"""Recordings of a Leap Motion controller: JSON of leapjs-playback, a list of frames, or one a line; also LZ-string.

Leap's world is in millimetres with y up; `direction` points to the fingers, `palmNormal` out of the palm. The palm's
origin is where our knuckles meet the recorded ones; joint angles are those of `hhsim.recordings.finger_ik`. Leap gives
the thumb a metacarpal of length zero, and its next three bones are our three.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import DamagedFileError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import HandSide, RawChannel
from hhsim.recordings.finger_ik import misplaced_joints, palm_rotation, recorded_bones
from hhsim.recordings.frames import FileFrame, axis_flip, to_our_world, world_matrix
from hhsim.recordings.joint_positions import fitted_posture
from hhsim.recordings.json_document import keys_of, number, objects, read_json, vector
from hhsim.recordings.recording import SIDES, Recording, frames_with_hand, known_side, note, unused
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat
from hhsim.system.child_reader import read_in_child

MILLIMETRE = 1e-3
MICROSECOND = 1e-6
JOINTS = ("mcpPosition", "pipPosition", "dipPosition", "btipPosition")
WORLD = world_matrix("y")
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
    text = content.text
    document = read_json(unpack(text)) if looks_packed(text) else content.document
    frames = list(_frames(document))
    metadata = document.get("metadata") if isinstance(document, dict) else None
    metadata = metadata if isinstance(metadata, dict) else {}
    if not frames:
        held = document["frames"] if isinstance(document, dict) else document
        raise TrajectoryError(f"no frames of Leap Motion's, {keys_of(held)}; {EXPECTED}")
    sides = [{hand["type"] for hand in objects(frame.get("hands")) if hand.get("type") in SIDES} for frame in frames]
    if not any(sides):
        raise TrajectoryError(f"no hand in any of {len(frames)} frames, the first {keys_of(frames[0])}; {EXPECTED}")
    side, shown, findings = frames_with_hand(sides, options.hand)
    stated = metadata.get("frames")
    if isinstance(stated, int) and stated != len(frames):
        findings.append(note(f"{len(frames)} frames where the file says {stated}: some are lost"))
    if isinstance(document, dict):
        findings += unused(dict.fromkeys(document), ("frames", "metadata"))
    found = [(frames[k], _hand(frames[k], side)) for k in shown]
    flip = axis_flip(options.mirror)
    direction, normal, wrist = (
        flip * np.array([vector(seen.get(key)) for _, seen in found]) for key in ("direction", "palmNormal", "wrist")
    )
    joints = MILLIMETRE * flip * np.array([_joints(frame, seen) for frame, seen in found])
    if not np.isfinite(joints).any():
        raise TrajectoryError("no frame holds the joints of the fingers; expected bones, as of Leap's API from 2.0 on")
    points = np.concatenate([MILLIMETRE * wrist[:, None], joints.reshape(-1, 20, 3)], axis=1)
    known_side(points, side, findings, options.mirror, True)
    palm = palm_rotation(direction, -normal)
    posture, off = fitted_posture(joints, palm, side)
    bones = recorded_bones(joints, MILLIMETRE * wrist, posture, side)
    position, orientation = to_our_world(posture.position, palm, "y")
    stamps = np.array([number(frame.get("timestamp")) for frame, _ in found])
    first = stamps[np.isfinite(stamps)]
    confidence = np.array([number(seen.get("confidence")) for _, seen in found])
    made = metadata.get("generatedBy")
    recording = Recording(
        time=MICROSECOND * (stamps - (first[0] if first.size else 0.0)),
        position=position,
        orientation=orientation,
        flexion=posture.flexion,
        abduction=posture.abduction,
        stated=frozenset({"length", "angle"}),
        form="leap",
        name=content.name.removesuffix(".json"),
        source=f"recorded with {made}" if isinstance(made, str) else "",
        device="Leap Motion",
        hand=side,
        hand_length=bones.hand_length if 0.05 < bones.hand_length < 0.4 else None,
        bones=bones,
        first_stamp=MICROSECOND * float(first[0]) if first.size else 0.0,
        raw=(RawChannel("confidence", np.nan_to_num(confidence, nan=-1.0), "1", "Leap's confidence, -1 where none"),),
        findings=(*findings, off, *map(note, misplaced_joints(joints, MILLIMETRE * wrist))),
        joints=points @ WORLD.T,
        file_frame=FileFrame(WORLD, MILLIMETRE, flip),
        rows=np.array(shown),
    )
    text = f"confidence below {UNSURE:g}, says the device: kept"
    return recording.flagged(confidence < UNSURE, SampleFlag.INVALID, text)


def looks_packed(text: str) -> bool:
    """True if a text consists of LZ-string's base64 letters."""
    sample = text[:2000].strip()
    return len(sample) > 20 and set(sample) <= set(LETTERS + "=")


def unpack(text: str) -> str:
    """Decompress LZ-string's text; raise TrajectoryError for one that is damaged or cut short, or without lzstring."""
    try:
        from lzstring import LZString
    except ImportError:
        raise TrajectoryError("LZ-string text needs lzstring: pip install 'hhsim[recordings]'") from None
    letters, damaged = "".join(text.split()), "damaged LZ-string text"
    try:
        found: str | None = read_in_child(
            lambda: LZString.decompressFromBase64(letters), damaged, len(letters), rate=LETTERS_A_SECOND
        )
    except DamagedFileError as error:
        raise TrajectoryError(str(error)) from None
    if not found:
        raise TrajectoryError(f"{damaged}; was it cut short?")
    return found


def _frames(document: Any) -> Iterator[Mapping[str, Any]]:
    """Yield the frames as objects, plain or packed."""
    frames = document.get("frames") if isinstance(document, dict) else document
    if not isinstance(frames, list):
        raise TrajectoryError(f"JSON without frames, {keys_of(document)}; {EXPECTED}")
    if frames and isinstance(frames[0], list):
        for number, packed in enumerate(frames[1:], start=1):
            yield _unpacked(frames[0], packed, f"frame {number}")
        return
    for number, frame in enumerate(frames, start=1):
        if not isinstance(frame, dict):
            raise TrajectoryError(f"frame {number} is {str(frame)[:40]!r}; expected an object")
        # Skip the service's greeting and events.
        if "hands" in frame or "timestamp" in frame:
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
        if isinstance(key, str):
            out[key] = value
        elif isinstance(key, dict) and len(key) == 1:
            ((below, inner),) = key.items()
            out[below] = _unpacked(inner, value, where, depth + 1)
        else:
            raise TrajectoryError(f"the first entry of the frames holds {str(key)[:40]!r}; expected names")
    return out


def _hand(frame: Mapping[str, Any], side: HandSide) -> Mapping[str, Any]:
    """Return the hand of this side, of several the longest visible."""
    hands = [hand for hand in objects(frame.get("hands")) if hand.get("type") == side]
    return max(hands, key=lambda hand: float(np.nan_to_num(number(hand.get("timeVisible")), nan=0.0)))


def _joints(frame: Mapping[str, Any], hand: Mapping[str, Any]) -> FloatArray:
    """Return base, two joints and tip of each finger [mm], shape (5, 4, 3); NaN where missing."""
    joints = np.full((len(FINGERS), len(JOINTS), 3), np.nan)
    for pointable in objects(frame.get("pointables")):
        finger = pointable.get("type")
        ours = pointable.get("handId") == hand.get("id") and not pointable.get("tool")
        if ours and isinstance(finger, int) and 0 <= finger < len(FINGERS):
            # The first versions with bones wrote no end of the last one; the fingertip is near it.
            held = {"btipPosition": pointable.get("tipPosition"), **pointable}
            joints[finger] = [vector(held.get(key)) for key in JOINTS]
    return joints


FORMAT = RecordingFormat(
    "leap",
    "a Leap Motion recording, .json or .json.lz",
    (".json", ".lz"),
    lambda content, options: content.is_json or looks_packed(content.beginning),
    _read,
    rank=1,
)
