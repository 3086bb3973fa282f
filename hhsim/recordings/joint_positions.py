"""Recordings of joint centres: the palm and the angles of our hand that fit them, for every device.

The palm frame follows from wrist and knuckles (its origin where our knuckles meet the recorded ones), the fingers'
angles from the bones (`hhsim.recordings.finger_ik`). The device's own frames of palm and joints are not used: they
differ between devices, joint centres do not.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

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

SIDES: tuple[HandSide, HandSide] = ("right", "left")
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
        position: Joint centres in the order of `KEYPOINTS`, NaN where missing, shape (T, 21, 3).
        form: Name of the format.
        what: Joints that were recognised, for messages.
        time: Stamps, NaN where missing, shape (T,); None to make them from a rate.
        time_unit: Word of `TIME_UNITS`; None if the file states none.
        rate: Samples a second that the file states [Hz].
        hand: Side of the hand; "" if unknown.
        unit: Unit of `position` [m]; None if it follows from the length of the hand.
        up: Axis of the device's world that points up; None if there is no world frame: the wrist stands still.
        may_be_mirrored: True if the world may be left-handed, as Unity's, which fingers and thumb tell.
        radius: Distance from the joint to the skin, in the unit of `position`, shape (T, 21). None without any: then
            the tips are points of the skin, otherwise the centres of the fingertips.
        doubtful: Samples that the device marked as uncertain, shape (T,); None for none.
    """

    position: FloatArray
    form: str
    what: str = "21 joints"
    time: FloatArray | None = None
    time_unit: str | None = None
    rate: float | None = None
    hand: HandSide = ""
    unit: float | None = None
    up: str | None = None
    may_be_mirrored: bool = False
    radius: FloatArray | None = None
    doubtful: BoolArray | None = None
    device: str = ""
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        count, joints = len(self.position), len(KEYPOINTS)
        object.__setattr__(self, "position", readings("position", self.position, (count, joints, 3)))
        if self.time is not None:
            object.__setattr__(self, "time", readings("time", self.time, (count,)))
        if self.radius is not None:
            radius = readings("radius", self.radius, (count, joints))
            object.__setattr__(self, "radius", np.where(radius > 0.0, radius, np.nan))


def recording_of_joints(joints: JointPositions, name: str, options: ReadOptions) -> Recording:
    """Fit our hand to joint centres; `options` state hand, unit, rate and the axis that points up.

    Raises:
        TrajectoryError: No stamps, no sample with wrist and knuckles, a hand of unknown side, or none of a known size.
        InputError: Axes of a palm frame, which joint centres do not have.
    """
    if options.palm_axes is not None:
        raise InputError("--palm-axes: there is no palm frame here, it follows from the wrist and the knuckles")
    whole = np.asarray(np.isfinite(joints.position).all(axis=(1, 2)))
    if not np.isfinite(joints.position[:, [0, 5, 9, 13, 17]]).all(axis=(1, 2)).any():
        raise TrajectoryError(f"no sample of {len(whole)} holds the wrist and the four knuckles")
    if not whole.any():
        missing = [KEYPOINTS[k] for k in range(len(KEYPOINTS)) if np.isnan(joints.position[:, k]).any(axis=1).all()]
        raise TrajectoryError(f"no sample holds all 21 joints; missing: {', '.join(missing[:4]) or 'one or another'}")
    findings = [*joints.findings, note(joints.what)]
    time, stated = _times(joints, options, findings)
    metre = _scale(joints, options, findings)
    points = metre * joints.position
    seen = ~(np.ptp(points, axis=1) == 0.0).all(axis=1)
    if not seen.all():
        points[~seen] = np.nan
        unseen = counted(int((~seen).sum()), "sample")
        findings.append(note(f"{unseen} with all joints at one point: no hand was seen, so missing"))
    side = options.hand or joints.hand
    if joints.may_be_mirrored:
        points = _in_right_handed_world(points, side, findings)
    side = _side(points, side, findings)
    fingers, wrist = points[:, 1:].reshape(-1, len(FINGERS), 4, 3), points[:, 0]
    posture, off = fitted_posture(fingers, palm_from_knuckles(fingers[:, 1:, 0], wrist, side), side)
    radii = None if joints.radius is None else metre * joints.radius[:, 1:].reshape(-1, len(FINGERS), 4)
    bones = recorded_bones(fingers, wrist, posture, side, radii)
    if radii is not None:
        long = f"with that of the middle one the hand is {1e3 * bones.hand_length:.0f} mm long"
        findings.append(note(f"fingertips are balls of the recorded radii: {long}"))
    findings.append(off)
    up = options.world_up or joints.up
    if up is None:
        text = "no world frame: the wrist stands still and level; if there is one, say its up axis with --world-up"
        # Where the palm is missing it stays so: that sample says nothing of the fingers either.
        lost = np.isnan(posture.orientation).any(axis=1, keepdims=True)
        position = np.where(lost, np.nan, np.zeros(3))
        orientation = np.where(lost, np.nan, np.array([1.0, 0.0, 0.0, 0.0]))
    else:
        text = f"world {up} up; the palm follows from the wrist and the knuckles"
        position, orientation = to_our_world(posture.position, posture.orientation, up)
    findings += [note(text), *_held(joints.position)]
    recording = Recording(
        time=time,
        position=position,
        orientation=orientation,
        flexion=posture.flexion,
        abduction=posture.abduction,
        stated=frozenset({"length", "angle"} | ({"time"} if stated else set())),
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


def fitted_posture(fingers: FloatArray, palm: FloatArray, side: HandSide) -> tuple[HandConfiguration, Finding]:
    """Compute our hand's posture in a recorded palm frame, with our knuckles on the recorded ones.

    Args:
        fingers: Joints and tip of each finger from its base on [m], world, shape (T, 5, 4, 3).
        palm: Palm to world, unit (w, x, y, z), shape (T, 4).

    Returns:
        The posture, NaN where a joint is missing, and the finding about the bones' angle to it.

    Raises:
        TrajectoryError: No finger is whole in any sample.
    """
    flexion, abduction, off = finger_angles(in_palm(np.diff(fingers, axis=2), palm), side)
    if not np.isfinite(off).any():
        raise TrajectoryError("no sample holds the joints of a whole finger")
    posture = HandConfiguration(palm_origin(fingers[:, 1:, 0], palm, side), palm, flexion, abduction)
    return posture, note(f"bones are {np.degrees(np.nanmedian(off)):.1f}° off our plane fingers in the median")


def _times(joints: JointPositions, options: ReadOptions, findings: list[Finding]) -> tuple[FloatArray, bool]:
    """Return stamps from the first one on [s], or those of the file if it states no unit, and whether it does."""
    count = len(joints.position)
    if joints.time is None:
        rate = options.rate or joints.rate
        if rate is None:
            raise TrajectoryError(
                f"{joints.what}, but no stamps of the samples; say how many there are a second: --rate"
            )
        findings.append(note(f"no stamps: made from the rate, {rate:g} Hz"))
        return np.arange(count) / rate, True
    if joints.time_unit is None:
        return joints.time, False
    # Whole ns since 1970 keep their steps only if the first is subtracted before they are scaled.
    finite = joints.time[np.isfinite(joints.time)]
    return (joints.time - (finite[0] if finite.size else 0.0)) * TIME_UNITS[joints.time_unit], True


def _scale(joints: JointPositions, options: ReadOptions, findings: list[Finding]) -> float:
    """Return the unit of the positions [m], as stated or by the length of the hand."""
    wrist, middle = joints.position[:, 0], joints.position[:, 9:13]
    bones = np.linalg.norm(np.diff(middle, axis=1), axis=2).sum(axis=1)
    lengths = np.linalg.norm(middle[:, 0] - wrist, axis=1) + bones
    length = float(np.median(lengths[np.isfinite(lengths)]))
    low, high = HAND_LENGTHS
    said = f"the hand is {length:.4g} long from wrist to middle fingertip"
    metre = joints.unit if options.length_unit is None else LENGTH_UNITS[options.length_unit]
    if metre is not None:
        if not low <= metre * length <= high:
            raise TrajectoryError(
                f"the hand is {metre * length:.4g} m long from wrist to middle fingertip; expected {low:g} to "
                f"{high:g} m: say --length-unit"
            )
        return metre
    for word, metre in LENGTH_UNITS.items():
        if low <= metre * length <= high:
            findings.append(note(f"no unit named: {said}, taken for {word}; if it is not, say --length-unit"))
            return metre
    if not length > 0.0:
        raise TrajectoryError(f"{said}; expected the joints of a hand")
    wanted = options.hand_length or DEFAULT_HAND_LENGTH
    text = (
        f"no scale: {said}, which is no hand in m, cm, mm or inch: taken for a hand of {1e3 * wanted:.0f} mm "
        f"({'as --hand-length says' if options.hand_length else 'the usual one, else say --hand-length'}); angles are "
        "right if x, y and z have one scale"
    )
    findings.append(note(text))
    return wanted / length


def _side(points: FloatArray, hand: HandSide, findings: list[Finding]) -> HandSide:
    """Return the side of the hand, as stated or by the bend of its fingers."""
    if not hand:
        side = bends_as(points)
        if not side:
            raise TrajectoryError("the file names no hand, and its fingers are too straight to tell: say --hand")
        text = f"the file does not say which hand it is: a {side} one by the bend of its fingers; else say --hand"
        findings.append(note(text))
        return side
    bend = _bend(points, hand)
    if bend < -LEAST_BEND or looks_as(points) not in ("", hand):
        bent = f"fingers bend backwards by {np.degrees(-bend):.0f}° on average"
        wrong = bent if bend < -LEAST_BEND else "thumb is behind its palm"
        findings.append(note(f"as a {hand} hand its {wrong}: is it the other hand, or mirrored?"))
    return hand


def bends_as(points: FloatArray) -> HandSide:
    """Return the side of a hand in a right-handed world by the bend of its fingers; "" if they are too straight.

    Args:
        points: Joints in the order of `KEYPOINTS`, any unit, shape (T, 21, 3).
    """
    bend = {side: _bend(points, side) for side in SIDES}
    side = max(SIDES, key=lambda each: bend[each])
    return side if bend[side] >= LEAST_BEND else ""


def looks_as(points: FloatArray) -> HandSide:
    """Return the side of a hand by the bend of its fingers, else by its thumb; arguments as of `bends_as`."""
    side = bends_as(points)
    if side:
        return side
    above = {side: _thumb_above(points, side) for side in SIDES}
    side = min(SIDES, key=lambda each: above[each])
    return side if above[side] <= -THUMB_HEIGHT else ""


def _in_right_handed_world(points: FloatArray, hand: HandSide, findings: list[Finding]) -> FloatArray:
    """Return joint centres in a right-handed world, y up; a hand of no stated side, "", is not mirrored.

    In Unity's world z points the other way: there a right hand is a left one's mirror, which its fingers and its thumb
    tell.
    """
    seen = looks_as(points)
    if not hand or seen == hand:
        return points
    if not seen:
        text = (
            "its fingers are too straight, and its thumb too level with them, to tell whether its coordinates are "
            "left-handed, as Unity's: taken for right-handed"
        )
        findings.append(note(text))
        return points
    text = (
        f"the {hand} hand of the file is the mirror of one: its coordinates are left-handed, as Unity's, and z is "
        "turned round; if it is the other hand, say --mirror"
    )
    findings.append(note(text))
    return np.asarray(points * UNITY)


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


def _held(position: FloatArray) -> list[Finding]:
    """Return a finding about samples that repeat the one before."""
    same = (position[1:] == position[:-1]).all(axis=(1, 2))
    if not same.size or same.mean() <= MOST_REPEATED:
        return []
    device = f"the device gives {100 * (1 - same.mean()):.0f} of 100 anew and holds the others"
    return [note(f"{int(same.sum())} of {len(position)} samples repeat the one before: {device}; left as they are")]


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


def frames_with_hand(
    frames: Sequence[Collection[HandSide]], wanted: HandSide
) -> tuple[HandSide, list[int], list[Finding]]:
    """Return a hand as `chosen_side`, the indices of the frames that show it, and findings about both.

    Args:
        frames: Sides of the hands in each frame.

    Raises:
        TrajectoryError: The wanted hand is in no frame, or no frame has a hand.
    """
    seen = Counter(side for sides in frames for side in sides)
    if not seen:
        raise TrajectoryError(f"{len(frames)} frames, but no hand in any")
    side, findings = chosen_side(seen, wanted)
    shown = [k for k, sides in enumerate(frames) if side in sides]
    if len(shown) < len(frames):
        findings.append(note(f"{len(frames) - len(shown)} of {len(frames)} frames show no such hand: no samples"))
    return side, shown, findings
