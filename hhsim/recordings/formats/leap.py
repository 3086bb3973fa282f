"""Recordings of a Leap Motion controller: JSON of leapjs-playback, a list of frames, or one a line; also LZ-string.

Leap's world is in millimetres with y up; `direction` points to the fingers, `palmNormal` out of the palm. The palm's
origin is where our knuckles meet the recorded ones; joint angles are those of `hhsim.recordings.finger_ik`. Leap gives
the thumb a metacarpal of length zero, and its next three bones are our three.

LZ-string is an LZ78 whose codes are as wide as the dictionary needs, least bit first; codes 0 and 1 announce a new
letter of 8 or 16 bits, code 2 the end.
"""

import base64
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import HandSide, RawChannel
from hhsim.recordings.finger_ik import palm_rotation
from hhsim.recordings.frames import FileFrame, axis_flip, to_our_world, world_matrix
from hhsim.recordings.joint_positions import fitted_posture
from hhsim.recordings.json_document import keys_of, number, objects, read_json, vector
from hhsim.recordings.recorded_bones import misplaced_joints, recorded_bones
from hhsim.recordings.recording import SIDES, Recording, frames_with_hand, known_side, note, unused
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat

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
MOST_LETTERS = 1 << 28
"""Longest text; a damaged file may grow for ever."""


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
    side, shown, findings = frames_with_hand(_sides(frames), options.hand)
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
    known_side(points, side, findings, options.mirror, structural=True)
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


def _sides(frames: list[Mapping[str, Any]]) -> list[set[HandSide]]:
    """Return the hands in each frame; raise TrajectoryError if there are none."""
    sides = [{hand["type"] for hand in objects(frame.get("hands")) if hand.get("type") in SIDES} for frame in frames]
    if not any(sides):
        raise TrajectoryError(f"no hand in any of {len(frames)} frames, the first {keys_of(frames[0])}; {EXPECTED}")
    return sides


def looks_packed(text: str) -> bool:
    """True if a text consists of LZ-string's base64 letters."""
    sample = text[:2000].strip()
    return len(sample) > 20 and set(sample) <= set(LETTERS + "=")


def unpack(text: str) -> str:
    """Decompress LZ-string's text; raise TrajectoryError for other letters, or for one that is damaged or cut short."""
    letters = "".join(text.split()).rstrip("=")
    if other := set(letters) - set(LETTERS):
        raise TrajectoryError(f"not LZ-string text: it holds {min(other)!r}; expected base64 letters")
    six = {letter: f"{value:06b}" for value, letter in enumerate(LETTERS)}
    bits, place = "".join(map(six.__getitem__, letters)), 0

    def number(width: int) -> int:
        nonlocal place
        place += width
        if place > len(bits):
            raise TrajectoryError("LZ-string text that ends too early; was it cut short?")
        return int(bits[place - width : place][::-1], 2)

    code = number(2)
    if code == 2:
        return ""
    if code == 3:
        raise TrajectoryError("damaged LZ-string text at its first letter")
    word = chr(number(8 if code == 0 else 16))
    # Codes 0 to 2 are no words.
    words: list[str] = ["", "", "", word]
    out = [word]
    length = 1
    while True:
        code = number(len(words).bit_length())
        if code == 2:
            return "".join(out)
        if code < 2:
            words.append(chr(number(8 if code == 0 else 16)))
            code = len(words) - 1
        if code > len(words):
            raise TrajectoryError(f"damaged LZ-string text: code {code} of {len(words)} words")
        entry = words[code] if code < len(words) else word + word[0]
        out.append(entry)
        length += len(entry)
        if length > MOST_LETTERS:
            raise TrajectoryError("damaged LZ-string text: it grows beyond 250 million letters")
        words.append(word + entry[0])
        word = entry


def pack(text: str) -> str:
    """Compress a text as LZ-string does, to base64 letters."""
    bits: list[int] = []

    def put(value: int, width: int) -> None:
        bits.extend(value >> place & 1 for place in range(width))

    codes: dict[str, int] = {}
    size, place, word = 3, 0, ""
    while place < len(text):
        letter, width = text[place], size.bit_length()
        fresh = letter not in codes
        # The reader learns a new letter first, and then the word before with this one's first letter.
        for entry in (*((letter,) if fresh else ()), *((word + letter,) if word else ())):
            codes[entry], size = size, size + 1
        if fresh:
            word, wide = letter, ord(letter) > 0xFF
            put(int(wide), width)
            put(ord(letter), 16 if wide else 8)
        else:
            end = place + 1
            while end < len(text) and text[place : end + 1] in codes:
                end += 1
            word = text[place:end]
            put(codes[word], width)
        place += len(word)
    put(2, size.bit_length())
    bits.extend([0] * (-len(bits) % 16 or 16))
    return base64.b64encode(int("".join(map(str, bits)), 2).to_bytes(len(bits) // 8)).decode()


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
    for finger, pointable in _fingers(frame, hand).items():
        # The first versions with bones wrote no end of the last one; the fingertip is near it.
        held = {"btipPosition": pointable.get("tipPosition"), **pointable}
        joints[finger] = [vector(held.get(key)) for key in JOINTS]
    return joints


def _fingers(frame: Mapping[str, Any], hand: Mapping[str, Any]) -> dict[int, Mapping[str, Any]]:
    """Return the fingers of a hand by their number."""
    found: dict[int, Mapping[str, Any]] = {}
    for pointable in objects(frame.get("pointables")):
        finger = pointable.get("type")
        ours = pointable.get("handId") == hand.get("id") and not pointable.get("tool")
        if ours and isinstance(finger, int) and 0 <= finger < len(FINGERS):
            found[int(finger)] = pointable
    return found


def _sniff(content: Content, options: ReadOptions) -> bool:
    return content.beginning.lstrip()[:1] in ("{", "[") or looks_packed(content.beginning)


FORMAT = RecordingFormat("leap", "a Leap Motion recording, .json or .json.lz", (".json", ".lz"), _sniff, _read, rank=1)
