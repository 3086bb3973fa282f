"""Recordings of joint centres: the palm and the angles of our hand that fit them, for every device.

The palm frame follows from wrist and knuckles (its origin where our knuckles meet the recorded ones), the fingers'
angles from the bones (`hhsim.recordings.finger_ik`). The device's own frames of palm and joints are not used: they
differ between devices, joint centres do not.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import DEFAULT_HAND_LENGTH
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import finger_angles, palm_from_knuckles, palm_origin
from hhsim.recordings.frames import in_palm, to_our_world
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.recordings.recorded_bones import recorded_bones
from hhsim.recordings.recording import Finding, Recording, note, readings
from hhsim.recordings.registry import ReadOptions
from hhsim.recordings.unit_detection import LENGTH_UNITS, TIME_UNITS
from hhsim.system.counted import counted

HAND_LENGTHS = (0.12, 0.26)
"""Range of distances from the wrist to the middle fingertip [m], children's hands included."""
LEAST_BEND = np.radians(8.0)
"""Mean flexion from which on the fingers tell the palmar side of the hand [rad]."""
THUMB_HEIGHT = 0.15
"""Distance of the thumb from the plane of wrist and knuckles from which on it tells the palmar side [palm lengths]."""
UNITY = np.array([1.0, 1.0, -1.0])
"""Factors from Unity's left-handed world to a right-handed one, y up in both."""
MOST_REPEATED = 0.2
"""Share of samples that repeat the one before from which on the device is slower than the file."""


@dataclass(frozen=True, eq=False)
class JointPositions:
    """Positions of the 21 joints of `KEYPOINTS` over time, as a device gave them.

    Attributes:
        time: Stamps [s], or in another unit if `time_stated` is false, NaN where missing, shape (T,).
        position: Joint centres in the order of `KEYPOINTS`, NaN where missing, shape (T, 21, 3).
        form: Name of the format.
        hand: Side of the hand; "" if unknown.
        unit: Unit of `position` [m]; None if it follows from the length of the hand.
        up: Axis of the device's world that points up; None if there is no world frame: the wrist stands still.
        radius: Distance from the joint to the skin, in the unit of `position`, shape (T, 21); None without any.
        doubtful: Samples that the device marked as uncertain, shape (T,); None for none.
        tip_on_surface: True if the tips are points of the skin, False if they are the centres of the fingertips.
        time_stated: True if the stamps are known to be seconds.
    """

    time: FloatArray
    position: FloatArray
    form: str
    hand: HandSide = ""
    unit: float | None = None
    up: str | None = None
    radius: FloatArray | None = None
    doubtful: BoolArray | None = None
    tip_on_surface: bool = True
    time_stated: bool = True
    device: str = ""
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        count, joints = len(self.time), len(KEYPOINTS)
        object.__setattr__(self, "time", readings("time", self.time, (count,)))
        object.__setattr__(self, "position", readings("position", self.position, (count, joints, 3)))
        if self.radius is not None:
            radius = readings("radius", self.radius, (count, joints))
            object.__setattr__(self, "radius", np.where(radius > 0.0, radius, np.nan))


def recording_of_joints(joints: JointPositions, name: str, options: ReadOptions) -> Recording:
    """Fit our hand to joint centres; `options` state hand, unit and the axis that points up.

    Raises:
        TrajectoryError: No sample with wrist and knuckles, a hand of unknown side, or none of a known size.
        InputError: Axes of a palm frame, which joint centres do not have.
    """
    if options.palm_axes is not None:
        raise InputError("--palm-axes: there is no palm frame here, it follows from the wrist and the knuckles")
    whole = np.isfinite(joints.position).all(axis=(1, 2))
    if not np.isfinite(joints.position[:, [0, 5, 9, 13, 17]]).all(axis=(1, 2)).any():
        raise TrajectoryError(f"no sample of {len(joints.time)} holds the wrist and the four knuckles")
    if not whole.any():
        missing = [KEYPOINTS[k] for k in range(len(KEYPOINTS)) if np.isnan(joints.position[:, k]).any(axis=1).all()]
        raise TrajectoryError(f"no sample holds all 21 joints; missing: {', '.join(missing[:4]) or 'one or another'}")
    findings = list(joints.findings)
    metre, unit_finding = _scale(joints, options)
    findings += unit_finding
    points = metre * joints.position
    seen = ~(np.ptp(points, axis=1) == 0.0).all(axis=1)
    if not seen.all():
        points[~seen] = np.nan
        unseen = counted(int((~seen).sum()), "sample")
        findings.append(note(f"{unseen} with all joints at one point: no hand was seen, so missing"))
    radius = None if joints.radius is None else metre * joints.radius
    side, side_findings = _side(points, options.hand or joints.hand)
    findings += side_findings
    fingers, wrist = points[:, 1:].reshape(-1, len(FINGERS), 4, 3), points[:, 0]
    orientation = palm_from_knuckles(fingers[:, 1:, 0], wrist, side)
    flexion, abduction, off = finger_angles(in_palm(np.diff(fingers, axis=2), orientation), side)
    position = palm_origin(fingers[:, 1:, 0], orientation, side)
    radii = None if radius is None else radius[:, 1:].reshape(-1, len(FINGERS), 4)
    posture = HandConfiguration(position, orientation, flexion, abduction)
    bones = recorded_bones(fingers, wrist, posture, side, radii, joints.tip_on_surface)
    if radius is not None and not joints.tip_on_surface:
        long = f"with that of the middle one the hand is {1e3 * bones.hand_length:.0f} mm long"
        findings.append(note(f"fingertips are balls of the recorded radii: {long}"))
    findings.append(note(f"bones are {np.degrees(np.nanmedian(off)):.1f}° off our plane fingers in the median"))
    up = options.world_up or joints.up
    if up is None:
        text = "no world frame: the wrist stands still and level; if there is one, say its up axis with --world-up"
        findings.append(note(text))
        # Where the palm is missing it stays so: that sample says nothing of the fingers either.
        lost = np.isnan(orientation).any(axis=1, keepdims=True)
        position = np.where(lost, np.nan, np.zeros_like(position))
        orientation = np.where(lost, np.nan, np.array([1.0, 0.0, 0.0, 0.0]))
    else:
        position, orientation = to_our_world(position, orientation, up)
        findings.append(note(f"world {up} up; the palm follows from the wrist and the knuckles"))
    findings += _held(joints)
    recording = Recording(
        time=joints.time,
        position=position,
        orientation=orientation,
        flexion=flexion,
        abduction=abduction,
        stated=frozenset({"length", "angle"} | ({"time"} if joints.time_stated else set())),
        scaled=True,
        form=joints.form,
        name=name,
        device=joints.device,
        hand=side,
        hand_length=bones.hand_length,
        bones=bones,
        findings=tuple(findings),
    )
    if joints.doubtful is not None:
        text = "not valid or not tracked, says the device: kept where there are numbers"
        recording = recording.flagged(joints.doubtful, SampleFlag.INVALID, text)
    return recording


def _scale(joints: JointPositions, options: ReadOptions) -> tuple[float, list[Finding]]:
    """Return the unit of the positions [m], and findings about it."""
    wrist, middle = joints.position[:, 0], joints.position[:, 9:13]
    bones = np.linalg.norm(np.diff(middle, axis=1), axis=2).sum(axis=1)
    lengths = np.linalg.norm(middle[:, 0] - wrist, axis=1) + bones
    length = float(np.median(lengths[np.isfinite(lengths)]))
    low, high = HAND_LENGTHS
    said = f"the hand is {length:.4g} long from wrist to middle fingertip"
    if options.length_unit is not None or joints.unit is not None:
        metre = LENGTH_UNITS[options.length_unit] if options.length_unit is not None else joints.unit
        assert metre is not None
        if not low <= metre * length <= high:
            raise TrajectoryError(
                f"the hand is {metre * length:.4g} m long from wrist to middle fingertip; expected {low:g} to "
                f"{high:g} m: say --length-unit"
            )
        return metre, []
    fitting = [(word, metre) for word, metre in LENGTH_UNITS.items() if low <= metre * length <= high]
    if fitting:
        word, metre = fitting[0]
        return metre, [note(f"no unit named: {said}, taken for {word}; if it is not, say --length-unit")]
    if not length > 0.0:
        raise TrajectoryError(f"{said}; expected the joints of a hand")
    wanted = options.hand_length or DEFAULT_HAND_LENGTH
    text = (
        f"no scale: {said}, which is no hand in m, cm, mm or inch: taken for a hand of {1e3 * wanted:.0f} mm "
        f"({'as --hand-length says' if options.hand_length else 'the usual one, else say --hand-length'}); angles are "
        "right if x, y and z have one scale"
    )
    return wanted / length, [note(text)]


def _side(points: FloatArray, hand: HandSide) -> tuple[HandSide, list[Finding]]:
    """Return the side of the hand, as stated or by the bend of its fingers, and findings about it."""
    if not hand:
        side = bends_as(points)
        if not side:
            raise TrajectoryError("the file names no hand, and its fingers are too straight to tell: say --hand")
        text = f"the file does not say which hand it is: a {side} one by the bend of its fingers; else say --hand"
        return side, [note(text)]
    bend = _bend(points, hand)
    if bend >= -LEAST_BEND and looks_as(points) in ("", hand):
        return hand, []
    bent = f"fingers bend backwards by {np.degrees(-bend):.0f}° on average"
    wrong = bent if bend < -LEAST_BEND else "thumb is behind its palm"
    return hand, [note(f"as a {hand} hand its {wrong}: is it the other hand, or mirrored?")]


def bends_as(points: FloatArray) -> HandSide:
    """Return the side of a hand in a right-handed world by the bend of its fingers; "" if they are too straight.

    Args:
        points: Joints in the order of `KEYPOINTS`, any unit, shape (T, 21, 3).
    """
    bend = {side: _bend(points, side) for side in _SIDES}
    side = max(_SIDES, key=lambda each: bend[each])
    return side if bend[side] >= LEAST_BEND else ""


def looks_as(points: FloatArray) -> HandSide:
    """Return the side of a hand by the bend of its fingers, else by its thumb; arguments as of `bends_as`."""
    side = bends_as(points)
    if side:
        return side
    above = {side: _thumb_above(points, side) for side in _SIDES}
    side = min(_SIDES, key=lambda each: above[each])
    return side if above[side] <= -THUMB_HEIGHT else ""


def in_right_handed_world(points: FloatArray, hand: HandSide) -> tuple[FloatArray, list[Finding]]:
    """Return joint centres in a right-handed world, y up, and findings about it.

    In Unity's world z points the other way: there a right hand is a left one's mirror, which its fingers and its thumb
    tell.

    Args:
        points: Joints in the order of `KEYPOINTS`, any unit, shape (T, 21, 3).
        hand: Side that the file or the user states; if "", nothing is mirrored.
    """
    seen = looks_as(points)
    if not hand or seen == hand:
        return points, []
    if not seen:
        return points, [
            note(
                "its fingers are too straight, and its thumb too level with them, to tell whether its coordinates are "
                "left-handed, as Unity's: taken for right-handed"
            )
        ]
    text = (
        f"the {hand} hand of the file is the mirror of one: its coordinates are left-handed, as Unity's, and z is "
        "turned round; if it is the other hand, say --mirror"
    )
    return points * UNITY, [note(text)]


_SIDES: tuple[HandSide, HandSide] = ("right", "left")


def _bend(points: FloatArray, side: HandSide) -> float:
    """Compute the mean flexion of the joints of index to little finger, if it is a hand of this side [rad]."""
    fingers = points[:, 5:].reshape(-1, 4, 4, 3)
    orientation = palm_from_knuckles(fingers[:, :, 0], points[:, 0], side)
    chains = np.concatenate([fingers[:, :1], fingers], axis=1)
    flexion, _, _ = finger_angles(in_palm(np.diff(chains, axis=2), orientation), side)
    values = flexion[:, 1:][np.isfinite(flexion[:, 1:])]
    return float(values.mean()) if values.size else 0.0


def _thumb_above(points: FloatArray, side: HandSide) -> float:
    """Compute the thumb's mean height above the back of a hand of this side [palm lengths]; palmar is negative."""
    orientation = palm_from_knuckles(points[:, 5::4], points[:, 0], side)
    from_wrist = in_palm(points - points[:, :1], orientation)
    with np.errstate(invalid="ignore", divide="ignore"):
        above = from_wrist[:, 2:5, 2] / np.linalg.norm(from_wrist[:, 9:10], axis=2)
    values = above[np.isfinite(above)]
    return float(values.mean()) if values.size else 0.0


def _held(joints: JointPositions) -> list[Finding]:
    """Return a finding about samples that repeat the one before."""
    flat = joints.position.reshape(len(joints.time), -1)
    same = (flat[1:] == flat[:-1]).all(axis=1)
    if not same.size or same.mean() <= MOST_REPEATED:
        return []
    device = f"the device gives {100 * (1 - same.mean()):.0f} of 100 anew and holds the others"
    return [note(f"{int(same.sum())} of {len(flat)} samples repeat the one before: {device}; left as they are")]


def chosen_side(samples: Mapping[HandSide, int], wanted: HandSide) -> tuple[HandSide, list[Finding]]:
    """Return the wanted hand, else the one of more samples (of equals the right one), and findings about it.

    Args:
        samples: Number of samples of each hand in the file; "" is a hand of no stated side.

    Raises:
        TrajectoryError: The wanted hand is not in the file.
    """
    if wanted and wanted not in samples and "" not in samples:
        raise TrajectoryError(f"no {wanted} hand; the file has {' and '.join(f'a {s} one' for s in samples)}")
    if wanted:
        return (wanted if wanted in samples else ""), []
    side = max(samples, key=lambda each: (samples[each], each))
    other = [each for each, count in samples.items() if count and each not in ("", side)]
    return side, [note(f"{side} hand; the {other[0]} one is there too: --hand")] if other else []


def sample_times(
    stamps: FloatArray | None, unit: str | None, count: int, options: ReadOptions
) -> tuple[FloatArray, bool, list[Finding]]:
    """Return stamps from the first one on [s], whether their unit is known, and findings about them.

    Args:
        stamps: Stamps in the file, returned as they are if the unit is unknown; None makes them from the stated rate.

    Raises:
        TrajectoryError: There is neither a stamp nor a rate.
    """
    if stamps is None:
        if options.rate is None:
            raise TrajectoryError(f"{count} samples without a stamp; say how many there are a second: --rate")
        made = np.arange(count) / options.rate
        return made, True, [note(f"no stamps: made from the rate, {options.rate:g} Hz")]
    if unit is None:
        return stamps, False, []
    # Whole ns since 1970 keep their steps only if the first is subtracted before they are scaled.
    finite = stamps[np.isfinite(stamps)]
    return (stamps - (finite[0] if finite.size else 0.0)) * TIME_UNITS[unit], True, []


def joints_by_name(positions: dict[str, Any], count: int) -> FloatArray:
    """Stack the joints of `KEYPOINTS` from arrays of shape (T, 3) by name, shape (T, 21, 3), NaN for missing joints."""
    missing = np.full((count, 3), np.nan)
    return np.stack([np.asarray(positions.get(joint, missing), dtype=np.float64) for joint in KEYPOINTS], axis=1)
