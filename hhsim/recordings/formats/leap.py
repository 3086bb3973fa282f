"""Recordings of a Leap Motion controller.

They are JSON of leapjs-playback (packed frames or plain ones), a bare list of frames, or one frame a line; also packed
by LZ-string (`.json.lz`).

Leap's world is in millimetres, y up, z towards the user; the palm's `direction` points to the fingers, `palmNormal` out
of the palm. Ours: y = direction, z = -palmNormal, world z up, metres; the palm's origin is where our knuckles meet the
recorded ones. Joint angles are those of our hand that come nearest to the bones (`hhsim.recordings.finger_ik`), mcp to
pip to dip to tip; Leap gives the thumb a metacarpal of length zero, and its next three bones are our three.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Literal, cast

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import HandSide, RawChannel
from hhsim.recordings.finger_ik import finger_angles, palm_origin, palm_rotation
from hhsim.recordings.frames import in_palm, to_our_world
from hhsim.recordings.json_document import keys_of, number, read_json, vector
from hhsim.recordings.lz_string import LETTERS, unpack
from hhsim.recordings.recorded_bones import FingerChains, Posture, recorded_bones
from hhsim.recordings.recording import Finding, Recording, note
from hhsim.recordings.recording_format import Content, ReadOptions, RecordingFormat

MILLIMETRE = 1e-3
MICROSECOND = 1e-6
JOINTS = ("mcpPosition", "pipPosition", "dipPosition", "btipPosition")
UNSURE = 0.5
"""Leap's own confidence below this marks a sample."""
EXPECTED = "expected a Leap Motion recording, or the joints of a hand by name"
DEEPEST = 12
"""Nesting of packed frames deeper than this is damage."""


def _read(content: Content, options: ReadOptions) -> Recording:
    """The recording of the hand that is asked for, else of the one that is seen in more frames.

    Raises:
        TrajectoryError: No JSON, no frames, or no hand in them.
    """
    text = content.text
    if looks_packed(text):
        text = unpack(text)
    document = read_json(text)
    metadata = document.get("metadata") if isinstance(document, dict) else None
    metadata = metadata if isinstance(metadata, dict) else {}
    frames = list(_frames(document))
    if not frames:
        held = document["frames"] if isinstance(document, dict) else document
        raise TrajectoryError(f"no frames of Leap Motion's, {keys_of(held)}; {EXPECTED}")
    findings: list[Finding] = []
    stated = metadata.get("frames")
    if isinstance(stated, int) and stated != len(frames):
        findings.append(note(f"{len(frames)} frames where the file says {stated}: some are lost"))
    side = options.hand or _usual_side(frames)
    if not side:
        raise TrajectoryError(f"no hand in any of {len(frames)} frames, the first {keys_of(frames[0])}; {EXPECTED}")
    found = [(frame, seen) for frame in frames if (seen := _hand(frame, side)) is not None]
    if not found:
        raise TrajectoryError(f"no {side} hand in any of {len(frames)} frames")
    if len(found) < len(frames):
        findings.append(note(f"{len(frames) - len(found)} of {len(frames)} frames show no {side} hand: no samples"))
    stamps = np.array([number(frame.get("timestamp")) for frame, _ in found])
    direction, normal, wrist = (
        np.array([vector(seen.get(key)) for _, seen in found]) for key in ("direction", "palmNormal", "wrist")
    )
    joints = np.array([_joints(frame, seen) for frame, seen in found])
    orientation = palm_rotation(direction, -normal)
    bones = np.diff(joints, axis=2)
    flexion, abduction, off = finger_angles(in_palm(bones, orientation), side)
    if np.isnan(flexion).all():
        raise TrajectoryError(
            "no frame holds the joints of the fingers; expected bones, as Leap's API has them since 2.0"
        )
    findings.append(note(f"bones are {np.degrees(np.nanmedian(off)):.1f}° off our plane fingers in the median"))
    length = float(
        np.nanmedian(np.linalg.norm(joints[:, 2, 0] - wrist, axis=1) + np.linalg.norm(bones[:, 2], axis=2).sum(axis=1))
        if np.isfinite(wrist).any()
        else np.nan
    )
    place = palm_origin(MILLIMETRE * joints[:, 1:, 0], orientation, side)
    fit = recorded_bones(
        FingerChains(MILLIMETRE * joints, MILLIMETRE * wrist),
        Posture(place, orientation, flexion, abduction),
        side,
    )
    position, orientation = to_our_world(place, orientation, "y")
    first = stamps[np.isfinite(stamps)]
    confidence = np.array([number(seen.get("confidence")) for _, seen in found])
    made = metadata.get("generatedBy")
    recording = Recording(
        time=MICROSECOND * (stamps - (first[0] if first.size else 0.0)),
        position=position,
        orientation=orientation,
        flexion=flexion,
        abduction=abduction,
        stated=frozenset({"length", "angle"}),
        form="leap",
        name=content.name.removesuffix(".json"),
        source=f"recorded with {made}" if isinstance(made, str) else "",
        device="Leap Motion",
        hand=side,
        hand_length=MILLIMETRE * length if 50.0 < length < 400.0 else None,
        bones=fit,
        raw=(RawChannel("confidence", np.nan_to_num(confidence, nan=-1.0), "1", "Leap's confidence, -1 where none"),),
        findings=tuple(findings),
    )
    unsure = confidence < UNSURE
    if unsure.any():
        words = f"confidence below {UNSURE:g}, says the device: kept"
        recording = recording.flagged(unsure, SampleFlag.INVALID, words)
    return recording


def looks_packed(text: str) -> bool:
    """Whether a text is LZ-string's base64 letters and nothing else."""
    sample = text[:2000].strip()
    return len(sample) > 20 and set(sample) <= set(LETTERS + "=")


def looks_like_leap(text: str) -> bool:
    """Whether a text is JSON, or JSON packed by LZ-string."""
    return text.lstrip()[:1] in ("{", "[") or looks_packed(text)


def _frames(document: Any) -> Iterator[Mapping[str, Any]]:
    """The frames as objects, whatever they are packed in."""
    frames = document.get("frames") if isinstance(document, dict) else document
    if not isinstance(frames, list):
        raise TrajectoryError(f"JSON without frames, {keys_of(document)}; {EXPECTED}")
    if frames and isinstance(frames[0], list):
        structure = frames[0]
        for number, packed in enumerate(frames[1:], start=1):
            yield _unpacked(structure, packed, f"frame {number}")
        return
    for number, frame in enumerate(frames, start=1):
        if isinstance(frame, dict):
            # The service's greeting and its events are no frames.
            if "hands" in frame or "timestamp" in frame:
                yield frame
        else:
            raise TrajectoryError(f"frame {number} is {str(frame)[:40]!r}; expected an object")


def _unpacked(structure: Any, packed: Any, where: str, depth: int = 0) -> Any:
    """An object of a packed list.

    The structure holds names, or a name with the structure below it, in the list's order.
    """
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


def _usual_side(frames: list[Mapping[str, Any]]) -> HandSide:
    seen: Counter[str] = Counter()
    for frame in frames:
        seen.update({str(hand.get("type")) for hand in _objects(frame, "hands")} & {"right", "left"})
    if not seen:
        return ""
    return cast(HandSide, max(sorted(seen, reverse=True), key=lambda side: seen[side]))


def _hand(frame: Mapping[str, Any], side: Literal["right", "left"] | str) -> Mapping[str, Any] | None:
    """The hand of this side that is seen longest, of several."""
    hands = [hand for hand in _objects(frame, "hands") if hand.get("type") == side]
    return max(hands, key=lambda hand: float(np.nan_to_num(number(hand.get("timeVisible")), nan=0.0)), default=None)


def _joints(frame: Mapping[str, Any], hand: Mapping[str, Any]) -> FloatArray:
    """Base, two joints and tip of each finger [mm], shape (5, 4, 3); NaN where missing."""
    joints = np.full((len(FINGERS), len(JOINTS), 3), np.nan)
    for pointable in _objects(frame, "pointables"):
        finger = pointable.get("type")
        ours = pointable.get("handId") == hand.get("id") and not pointable.get("tool")
        if ours and isinstance(finger, int) and 0 <= finger < len(FINGERS):
            joints[finger] = [vector(pointable.get(key)) for key in JOINTS]
    return joints


def _objects(frame: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    items = frame.get(key)
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


def _sniff(content: Content, options: ReadOptions) -> bool:
    return looks_like_leap(content.beginning)


FORMAT = RecordingFormat("leap", "a Leap Motion recording, .json or .json.lz", (".json", ".lz"), _sniff, _read, rank=1)
