"""Recordings of joint centres: the palm and the angles of our hand that fit them, for every device.

The palm frame follows from wrist and knuckles (its origin where our knuckles meet the recorded ones): frames differ
between devices, joint centres do not.

Fingers bend to the palm's side, and the thumb stands on it: that tells a right hand from a left one, and a right-handed
world from Unity's left-handed one, in which a hand is the mirror of the other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import DEFAULT_HAND_LENGTH
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.content import Content, ReadOptions
from hhsim.recordings.finger_ik import (
    RecordedBones,
    finger_angles,
    finger_axes,
    finger_joints,
    finite,
    fit_error,
    fitted_angles,
    median_bones,
    palm_from_knuckles,
    palm_origin,
)
from hhsim.recordings.frames import FileFrame, axis_flip, in_palm, world_matrix
from hhsim.recordings.joint_names import KEYPOINTS, missing_and_doubtful
from hhsim.recordings.object_poses import ObjectPoses, placed
from hhsim.recordings.recording import OTHER, SIDES, Finding, Recording, readings
from hhsim.recordings.unit_detection import LENGTH_UNITS, TIME_UNITS
from hhsim.system.counted import counted

HAND_LENGTHS = (0.12, 0.26)
"""Range of distances from the wrist to the middle fingertip [m], children's hands included."""
TINY = 1e-300
"""Smallest divisor."""
LEAST_BEND = np.radians(8.0)
"""Mean flexion from which on the fingers tell the palmar side of the hand [rad]."""
THUMB_HEIGHT = 0.15
"""Distance of the thumb from the plane of wrist and knuckles from which on it tells the palmar side [palm lengths]."""
UNITY = np.array([1.0, 1.0, -1.0])
"""Factors from Unity's left-handed world to a right-handed one, y up in both."""


@dataclass(frozen=True, eq=False)
class JointPositions:
    """Positions of the 21 joints of `KEYPOINTS` over time, as a device gave them."""

    position: FloatArray  # joint centres in the order of `KEYPOINTS`, NaN where missing, shape (T, 21, 3)
    what: str = "21 joints"  # joints that were recognised, for messages
    time: FloatArray | None = None  # stamps, NaN where missing, shape (T,); None to make them from a rate
    time_unit: str | None = None  # word of `TIME_UNITS`; None if the file states none
    rate: float | None = None  # samples a second that the file states [Hz]
    hand: HandSide = ""  # side of the hand; "" if unknown
    unit: float | None = None  # unit of `position` [m]; None if it follows from the length of the hand
    # Axis of the device's world that points up; None if there is no world frame: the wrist stands still.
    up: str | None = None
    may_be_mirrored: bool = False  # True if the world may be left-handed, as Unity's, which fingers and thumb tell
    # Distance from the joint to the skin, in the unit of `position`, shape (T, 21). None without any: then the tips are
    # points of the skin, otherwise the centres of the fingertips.
    radius: FloatArray | None = None
    # What the file says of the joints, shape (T, 21), or of all of them, (T, 1), by its kind.
    validity: Mapping[str, FloatArray] = field(default_factory=dict)
    misfit: str = ""  # how far the bones in a stated order of joints are from a hand's; "" if they are a hand's
    # Poses of an object in the coordinates of `position`, one a sample; None without any.
    object_poses: ObjectPoses | None = None
    # Palm to the file's coordinates (w, x, y, z), shape (T, 4); None if it follows from the wrist and the knuckles.
    palm: FloatArray | None = None
    device: str = ""
    findings: Sequence[Finding] = ()
    # Row, line or frame of the file of each sample, shape (T,); empty for all in order.
    rows: Sequence[int] | IntArray = ()

    def chosen(self, rows: list[int]) -> Self:
        """Return the samples of some rows of the file, of which this has all."""
        given = {name: getattr(self, name) for name in ("position", "time", "radius", "palm")}
        some = {name: values[rows] for name, values in given.items() if values is not None}
        validity = {kind: values[rows] for kind, values in self.validity.items()}
        poses = self.object_poses and self.object_poses.at(rows)
        return replace(self, **some, validity=validity, object_poses=poses, rows=rows)

    def __post_init__(self) -> None:
        count, joints = len(self.position), len(KEYPOINTS)
        object.__setattr__(self, "position", readings("position", self.position, (count, joints, 3)))
        if self.time is not None:
            object.__setattr__(self, "time", readings("time", self.time, (count,)))
        if self.radius is not None:
            radius = readings("radius", self.radius, (count, joints))
            object.__setattr__(self, "radius", np.where(radius > 0.0, radius, np.nan))


def recording_of_joints(joints: JointPositions, content: Content, options: ReadOptions) -> Recording:
    """Fit our hand to joint centres; `options` state hand, unit, rate and the axis that points up, else `content` may.

    Raises TrajectoryError for no stamps, no sample with wrist and knuckles, a hand of unknown side, or not of
    the named one, or none of a known size; InputError for axes of a palm frame, which joint centres do not have.
    """
    if options.palm_axes is not None:
        raise InputError("--palm-axes: there is no palm frame here, it follows from the wrist and the knuckles")
    side = content.stated_hand(options.hand or joints.hand)
    invalid, doubtful = missing_and_doubtful(joints.validity, joints.position.shape[:2])
    if invalid.size and invalid.all():
        kinds = ", ".join(joints.validity)
        raise TrajectoryError(f"no joint has a valid position in any sample, says the file ({kinds})")
    joints = replace(joints, position=np.where(invalid[:, :, None], np.nan, joints.position))
    known = np.asarray(np.isfinite(joints.position).all(axis=2))
    if not known[:, [0, 5, 9, 13, 17]].all(axis=1).any():
        raise TrajectoryError(f"no sample of {len(known)} holds the wrist and the four knuckles")
    if not known.all(axis=1).any():
        missing = [joint for k, joint in enumerate(KEYPOINTS) if not known[:, k].any()]
        raise TrajectoryError(f"no sample holds all 21 joints; missing: {', '.join(missing[:4]) or 'one or another'}")
    if joints.what:
        content.note(joints.what + (joints.misfit and f", though {joints.misfit}"))
    time, stated, first = _times(joints, content, options)
    metre = _scale(joints, content, options)
    frame = FileFrame(np.eye(3), metre, axis_flip(options.mirror))
    points = metre * joints.position * frame.flip
    seen = ~(np.ptp(points, axis=1) == 0.0).all(axis=1)
    if not seen.all():
        points[~seen] = np.nan
        unseen = counted(int((~seen).sum()), "sample")
        content.note(f"{unseen} with all joints at one point: no hand was seen, so missing")
    if joints.may_be_mirrored and options.mirror is None:
        given = points
        points = _in_right_handed_world(points, side, content)
        frame = frame if points is given else frame._replace(flip=UNITY)
    side = _known_side(points, side, content, options.mirror, joints)
    fingers, wrist = points[:, 1:].reshape(-1, len(FINGERS), 4, 3), points[:, 0]
    palm = palm_from_knuckles(fingers[:, 1:, 0], wrist, side) if joints.palm is None else joints.palm
    origin = palm_origin(fingers[:, 1:, 0], palm, side)
    joints_in_palm = in_palm(fingers - origin[:, None, None], palm)
    base, length = median_bones(joints_in_palm)
    flexion, abduction = np.zeros((len(palm), 5, 3)), np.zeros((len(palm), 5))
    if options.fits_angles:
        flexion, abduction = fitted_angles(joints_in_palm, base, length, finger_axes(side), side)
    if not np.isfinite(abduction).any():
        raise TrajectoryError("no sample holds the joints of a whole finger")
    fitted = finger_joints(base, length, flexion, abduction, finger_axes(side))
    rms, largest = fit_error(joints_in_palm, fitted)
    radii = None if joints.radius is None else metre * joints.radius[:, 1:].reshape(-1, len(FINGERS), 4)
    radius = None if radii is None else finite(np.median, radii)
    tip = 0.0 if radius is None else float(radius[2, 3])
    palm_length = finite(np.median, np.linalg.norm(fingers[:, 2, 0] - wrist, axis=1))
    bones = RecordedBones(
        hand=side,
        hand_length=float(palm_length + length[2].sum() + tip),
        base=base,
        length=length,
        radius=radius if radius is not None and np.isfinite(radius).all() else None,
        # Without radii the tips are points of the skin.
        tip_on_surface=radius is None,
        rms=rms,
        largest=largest,
    )
    up = options.world_up or joints.up or options.usual_up
    if up is None and joints.object_poses is not None:
        up = "z"
        content.note("an object moves with the hand, so its axes are the world's; --world-up says which is up")
    if up is None:
        text = "no world frame: the wrist stands still and level; if there is one, say its up axis with --world-up"
        # Where the palm is missing it stays so: that sample says nothing of the fingers either.
        lost = np.isnan(palm).any(axis=1, keepdims=True)
        position, orientation = (np.where(lost, np.nan, still) for still in ([0.0] * 3, [1.0, 0.0, 0.0, 0.0]))
    else:
        text = f"world {up} up; the palm follows from the wrist and the knuckles"
        position, orientation = FileFrame.of(up, None).poses(origin, palm)
        frame = frame._replace(turn=world_matrix(up))
    if joints.palm is None:
        content.note(text)
    recording = Recording(
        time=time,
        position=position,
        orientation=orientation,
        flexion=flexion,
        abduction=abduction,
        stated=frozenset({"length", "angle", "time"} if stated else {"length", "angle"}),
        device=joints.device,
        hand=side,
        hand_length=bones.hand_length,
        bones=bones,
        findings=(*joints.findings, *content.told()),
        joints=None if up is None else points @ world_matrix(up).T,
        file_frame=frame,
        rows=np.asarray(joints.rows, dtype=np.int64),
        first_stamp=first,
    )
    text = "joints without a valid position, says the device: missing"
    recording = recording.flagged(np.asarray(invalid.any(axis=1)), SampleFlag.INVALID, text)
    text = "joints not tracked, or of little confidence, says the device: kept"
    recording = recording.flagged(np.asarray(doubtful.any(axis=1)), SampleFlag.INVALID, text)
    return placed(recording, joints.object_poses)


def _times(joints: JointPositions, content: Content, options: ReadOptions) -> tuple[FloatArray, bool, float]:
    """Return stamps since the first one, or those of the file if it states no unit, if they are in s, and the first."""
    if joints.time is None:
        rate = options.rate or content.stated.take("rate") or joints.rate
        if rate is None:
            raise TrajectoryError(
                f"{joints.what}, but no stamps of the samples; say how many there are a second: --rate"
            )
        content.note(f"no stamps: made from the rate, {rate:g} Hz")
        return np.arange(len(joints.position)) / rate, True, 0.0
    if joints.time_unit is None:
        return joints.time, False, 0.0
    # Whole ns since 1970 keep their steps only if the first is subtracted before they are scaled.
    finite = joints.time[np.isfinite(joints.time)]
    first, unit = (float(finite[0]) if finite.size else 0.0), TIME_UNITS[joints.time_unit]
    return (joints.time - first) * unit, True, first * unit


def _scale(joints: JointPositions, content: Content, options: ReadOptions) -> float:
    """Return the unit of the positions [m], stated or by the length of the hand, and tell what is assumed."""
    bones = np.linalg.norm(np.diff(joints.position[:, [0, 9, 10, 11, 12]], axis=1), axis=2)
    lengths = bones[:, 0] + bones[:, 1:].sum(axis=1)
    length = float(np.median(lengths[np.isfinite(lengths)]))
    low, high = HAND_LENGTHS
    said = f"the hand is {length:.4g} long from wrist to middle fingertip"
    metre = joints.unit if options.length_unit is None else LENGTH_UNITS[options.length_unit]
    if metre is None:
        metre = content.stated.take("unit")
    if metre is not None:
        if not low <= metre * length <= high:
            far = f"the hand is {metre * length:.4g} m long from wrist to middle fingertip"
            raise TrajectoryError(f"{far}; expected {low:g} to {high:g} m: say --length-unit")
        return metre
    for word, metre in LENGTH_UNITS.items():
        if low <= metre * length <= high:
            content.note(f"no unit named: {said}, taken for {word}; if it is not, say --length-unit")
            return metre
    if not length > 0.0:
        raise TrajectoryError(f"{said}; expected the joints of a hand")
    wanted, why = options.hand_length, "as --hand-length says"
    if not wanted:
        wanted, why = DEFAULT_HAND_LENGTH, "the usual one, else say --hand-length"
    taken = f"which is no hand in m, cm, mm or inch: taken for a hand of {1e3 * wanted:.0f} mm ({why})"
    content.note(f"no scale: {said}, {taken}; angles are right if x, y and z have one scale")
    return wanted / length


def _known_side(
    points: FloatArray, hand: HandSide, content: Content, mirror: str | None, joints: JointPositions
) -> HandSide:
    """Return the side of the hand, as named or by the bend of its fingers."""
    seen, misfit = _palmar_side(points), joints.misfit
    side = seen.bends_as
    if not hand:
        if not side:
            raise TrajectoryError("the file names no hand, and its fingers are too straight to tell: say --hand")
        text = f"the file does not say which hand it is: a {side} one by the bend of its fingers"
        if not mirror and not misfit:
            text += f", a {OTHER[side]} one in left-handed coordinates, as Unity's: --mirror x|y|z"
        content.note(f"{text}; else say --hand")
        return side
    back = -np.degrees(seen.bend[hand])
    # A hand that is bent backwards has its thumb before the palm all the same.
    if side == OTHER[hand] and seen.above[hand] > -THUMB_HEIGHT:
        way = f"leave out --mirror {mirror}" if mirror else "say --mirror x|y|z if its coordinates are left-handed"
        # --hand does not replace a side that the file's structure states.
        other = "--mirror x --other-hand" if joints.hand else f"--hand {side}"
        remedy = misfit or f"{way}, {other} if it is the {side} hand"
        raise TrajectoryError(f"named a {hand} hand, but its fingers bend as a {side} one's: {remedy}")
    bent = f"fingers bend backwards by {back:.0f}° on average" if back > np.degrees(LEAST_BEND) else ""
    if bent or seen.looks_as not in ("", hand):
        wrong = bent or "thumb is behind its palm"
        content.note(f"as a {hand} hand its {wrong}: is it the other hand, or mirrored?")
    return hand


def _in_right_handed_world(points: FloatArray, hand: HandSide, content: Content) -> FloatArray:
    """Return joint centres in a right-handed world: in Unity's, y up, z points the other way."""
    seen = _palmar_side(points).looks_as
    if not hand or seen == hand:
        return points
    if not seen:
        text = "its fingers are too straight, and its thumb too level with them, to tell whether its coordinates are"
        content.note(f"{text} left-handed, as Unity's: taken for right-handed")
        return points
    text = f"the {hand} hand of the file is the mirror of one: its coordinates are left-handed, as Unity's, and z is"
    content.note(f"{text} turned round; if it is the other hand, say --other-hand")
    return np.asarray(points * UNITY)


class _Palmar(NamedTuple):
    """Palmar side by fingers and thumb, joints taken for those of each hand in a right-handed world."""

    bend: dict[HandSide, float]  # mean flexion of the joints of index to little finger [rad]
    above: dict[HandSide, float]  # mean height of the thumb above the back of the hand [palm lengths], palmar negative
    bends_as: HandSide  # side by the bend of the fingers; "" if they are too straight
    looks_as: HandSide  # side by the bend, else by the thumb; "" if neither tells it


def _palmar_side(points: FloatArray) -> _Palmar:
    bend: dict[HandSide, float] = {}
    above: dict[HandSide, float] = {}
    for side in SIDES:
        palm = palm_from_knuckles(points[:, 5::4], points[:, 0], side)
        own = in_palm(points - points[:, :1], palm)
        fingers = own[:, 5:].reshape(-1, 4, 4, 3)
        # The index finger stands for the thumb, which does not count.
        bones = np.diff(np.concatenate([fingers[:, :1], fingers], axis=1), axis=2)
        bend[side] = _mean(finger_angles(bones, finger_axes(side))[0][:, 1:])
        with np.errstate(invalid="ignore", divide="ignore"):
            above[side] = _mean(own[:, 2:5, 2] / np.linalg.norm(own[:, 9:10], axis=2))
    most = max(SIDES, key=bend.__getitem__)
    bends_as: HandSide = most if bend[most] >= LEAST_BEND else ""
    return _Palmar(bend, above, bends_as, bends_as or next((s for s in SIDES if above[s] <= -THUMB_HEIGHT), ""))


def _mean(values: FloatArray) -> float:
    """Return the mean of the finite values, 0 without any."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else 0.0
