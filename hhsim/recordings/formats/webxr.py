"""Joints of a hand in JSON: frames of named joints with position, orientation and radius, or a recording of iwer.

A frame is an object with a stamp and, anywhere in it, hands: objects whose keys are joints, lists of objects that name
their joint, or lists of 25 (WebXR's order) or 26 (OpenXR's). A joint has a position [m], three numbers or x, y and z,
in itself or in its pose or transform. iwer's recorder (`schema` and `frames`) gives joints relative to the pointing ray
of their hand. y is up; the bend of the fingers tells a right-handed world from Unity's left-handed one.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.frames import turned
from hhsim.recordings.joint_names import (
    KEYPOINTS,
    OPENXR_JOINTS,
    WEBXR_JOINTS,
    joint_name,
    joints_found,
    joints_missing,
)
from hhsim.recordings.joint_positions import (
    JointPositions,
    chosen_side,
    in_right_handed_world,
    recording_of_joints,
    sample_times,
)
from hhsim.recordings.json_document import keys_of, number, objects, read_json, vector
from hhsim.recordings.recording import Finding, Recording, note
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat
from hhsim.recordings.unit_detection import time_column

NAMED = re.compile(r"(thumb|index|middle)[-_ ]?(finger)?[-_ ]?(phalanx)?[-_ ]?(tip|metacarpal|proximal)", re.IGNORECASE)
DEEPEST = 8
"""Deepest nesting of a hand in a frame."""
FEWEST = 8
"""Number of joints among an object's keys that make it a hand."""
IWER_HAND = 8
"""Numbers of a joint in iwer's frames: position, quaternion (x, y, z, w), radius."""
MILLISECOND = 1e-3


class _Joint(NamedTuple):
    position: list[float]
    radius: float
    valid: bool


_Hand = dict[str, _Joint]


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the one in more frames; raises TrajectoryError."""
    document = read_json(content.text)
    packed = isinstance(document, dict) and isinstance(document.get("schema"), list)
    frames = list(_iwer_frames(document) if packed else _plain_frames(document))
    if not frames:
        raise TrajectoryError(f"no frames in JSON that is {keys_of(document)}; expected a list of frames with joints")
    seen = Counter(side for _, hands in frames for side in hands)
    if not seen:
        raise TrajectoryError(f"{len(frames)} frames, but no hand in any: no joints by name")
    side, findings = chosen_side(seen, options.hand)
    found = {joint for _, hands in frames if side in hands for joint in hands[side]}
    what = f"{joints_found(found)}{f' of the {side} hand' if side else ''} named"
    missing = joints_missing(found)
    if missing:
        raise TrajectoryError(f"{what}, but none that is {missing}; expected at least MediaPipe's 21")
    findings.append(note(what))
    shown = [(stamp, hands[side]) for stamp, hands in frames if side in hands]
    if len(shown) < len(frames):
        findings.append(note(f"{len(frames) - len(shown)} of {len(frames)} frames show no such hand: no samples"))
    none = _Joint([np.nan] * 3, np.nan, True)
    joints = [[hand.get(joint, none) for joint in KEYPOINTS] for _, hand in shown]
    position = np.array([[joint.position for joint in hand] for hand in joints])
    radius = np.array([[joint.radius for joint in hand] for hand in joints])
    position, mirrored = in_right_handed_world(position, side or options.hand)
    findings += mirrored
    time, stated = _stamps([stamp for stamp, _ in shown], what, options, findings)
    has_radii = bool(np.isfinite(radius).any(axis=0).all())
    positions = JointPositions(
        time=time,
        position=position,
        form="webxr",
        hand=side or options.hand,
        up="y",
        radius=radius if has_radii else None,
        doubtful=np.array([not all(joint.valid for joint in hand) for hand in joints]),
        tip_on_surface=not has_radii,
        time_stated=stated,
        device="WebXR through iwer" if packed else "",
        findings=tuple(findings),
    )
    return recording_of_joints(positions, content.name, options)


class _Stamp(NamedTuple):
    value: float
    unit: str | None


def _stamps(stamps: list[_Stamp], what: str, options: ReadOptions, findings: list[Finding]) -> tuple[FloatArray, bool]:
    """Return the stamps, and whether they are seconds."""
    values = np.array([stamp.value for stamp in stamps])
    stamped = np.isfinite(values).any()
    if not stamped and options.rate is None:
        raise TrajectoryError(f"{what}, but no frame has a stamp, such as time or timestamp; say --rate")
    unit = next((stamp.unit for stamp in stamps if stamp.unit is not None), None)
    time, in_seconds, remarks = sample_times(values if stamped else None, unit, len(values), options)
    findings += remarks
    return time, in_seconds


def _plain_frames(document: Any) -> Iterator[tuple[_Stamp, dict[HandSide, _Hand]]]:
    """Yield stamp and hands of each frame."""
    frames = document
    if isinstance(document, dict):
        lists = [v for v in document.values() if isinstance(v, list) and v and isinstance(v[0], dict)]
        frames = max(lists, key=len, default=[])
    # The side of the file holds for all its frames.
    usual = _said(document, "") if isinstance(document, dict) else ""
    for frame in objects(frames):
        hands: dict[HandSide, _Hand] = {}
        for side, hand in _hands(frame, usual, 0):
            hands.setdefault(side, hand)
        name = time_column(frame)
        value = number(frame.get(name.name)) if name is not None else float("nan")
        yield _Stamp(value, name.unit if name is not None else None), hands


def _hands(node: Any, side: HandSide, depth: int) -> Iterator[tuple[HandSide, _Hand]]:
    """Yield hands anywhere in a node, each with the side of the nearest key or value around it."""
    if depth > DEEPEST:
        return
    if isinstance(node, dict):
        side = _said(node, side)
        hand = {joint: _joint(value) for key, value in node.items() if (joint := joint_name(str(key)).joint)}
        if len(hand) >= FEWEST:
            sides = [joint_name(str(key)).side for key in node]
            yield next((each for each in sides if each), side), hand
            return
        for key, value in node.items():
            if isinstance(value, dict | list):
                yield from _hands(value, joint_name(str(key)).side or side, depth + 1)
    elif isinstance(node, list) and node:
        entries = list(objects(node))
        names = [joint_name(_label(entry)).joint for entry in entries]
        if sum(bool(name) for name in names) >= FEWEST:
            yield side, {name: _joint(entry) for name, entry in zip(names, entries, strict=True) if name}
            return
        order = {len(WEBXR_JOINTS): WEBXR_JOINTS, len(OPENXR_JOINTS): OPENXR_JOINTS}.get(len(node), ())
        joints = [_joint(entry) for entry in entries]
        if len(order) == len(joints) and any(np.isfinite(joint.position).all() for joint in joints):
            yield side, dict(zip(order, joints))
            return
        for entry in entries:
            yield from _hands(entry, side, depth + 1)


def _label(entry: Mapping[str, Any]) -> str:
    return next((str(entry[key]) for key in ("name", "joint", "jointName", "joint_name", "id") if key in entry), "")


def _said(node: Mapping[str, Any], side: HandSide) -> HandSide:
    for key in ("handedness", "hand", "side", "handSide"):
        value = node.get(key)
        if isinstance(value, str) and value.lower() in ("right", "left"):
            return "right" if value.lower() == "right" else "left"
    return side


def _joint(value: Any) -> _Joint:
    """Return position, radius and validity of a joint."""
    if not isinstance(value, dict):
        return _Joint(vector(value), float("nan"), True)
    inner = next((value[key] for key in ("pose", "transform") if isinstance(value.get(key), dict)), value)
    place = next(
        (inner[key] for key in ("position", "translation", "pos") if key in inner), inner if "x" in inner else None
    )
    valid = next((value[key] for key in ("valid", "isValid", "is_valid", "tracked", "isTracked") if key in value), True)
    return _Joint(vector(place), number(value.get("radius")), bool(valid))


def _iwer_frames(document: Mapping[str, Any]) -> Iterator[tuple[_Stamp, dict[HandSide, _Hand]]]:
    """Yield stamp and hands of each frame of iwer's recorder."""
    schemas: dict[int, Mapping[str, Any]] = {
        entry[0]: entry[1]
        for entry in document["schema"]
        if isinstance(entry, list) and len(entry) == 2 and isinstance(entry[0], int) and isinstance(entry[1], dict)
    }
    frames = document.get("frames")
    for frame in frames if isinstance(frames, list) else []:
        if not isinstance(frame, list) or not frame:
            raise TrajectoryError(f"a frame of iwer's recorder is {str(frame)[:40]!r}; expected a list of numbers")
        hands: dict[HandSide, _Hand] = {}
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
                hands[side] = _iwer_hand([number(each) for each in source[1:8]], [number(each) for each in flat], order)
        yield _Stamp(MILLISECOND * number(frame[0]), "s"), hands


def _iwer_hand(ray: list[float], flat: list[float], order: list[str]) -> _Hand:
    """Return the joints of one hand in the world from those relative to its ray."""
    numbers = np.array(flat).reshape(-1, IWER_HAND)
    turn = np.tile(np.array([ray[6], *ray[3:6]]), (len(numbers), 1))
    world = np.array(ray[:3]) + turned(turn, numbers[:, :3])
    return {
        joint: _Joint(place.tolist(), float(row[7]), True)
        for name, place, row in zip(order, world, numbers)
        if (joint := joint_name(name).joint)
    }


def _sniff(content: Content, options: ReadOptions) -> bool:
    text = content.beginning
    if text.lstrip()[:1] not in ("{", "["):
        return False
    return NAMED.search(text) is not None or ('"schema"' in text and "jointSequence" in text)


FORMAT = RecordingFormat(
    "webxr", "JSON frames of joints by name: WebXR, OpenXR, iwer", (".json", ".jsonl"), _sniff, _read
)
