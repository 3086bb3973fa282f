"""Sides of hands: which one a file is read for, and what joint centres tell of it.

Fingers bend to the palm's side, and the thumb stands on it: that tells a right hand from a left one, and a right-handed
world from Unity's left-handed one, in which a hand is the mirror of the other.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import finger_angles, palm_from_knuckles
from hhsim.recordings.frames import in_palm
from hhsim.recordings.recording import Finding, note

SIDES: tuple[HandSide, HandSide] = ("right", "left")
LEAST_BEND = np.radians(8.0)
"""Mean flexion from which on the fingers tell the palmar side of the hand [rad]."""
THUMB_HEIGHT = 0.15
"""Distance of the thumb from the plane of wrist and knuckles from which on it tells the palmar side [palm lengths]."""
UNITY = np.array([1.0, 1.0, -1.0])
"""Factors from Unity's left-handed world to a right-handed one, y up in both."""


def chosen_side(samples: Mapping[HandSide, int], wanted: HandSide) -> tuple[HandSide, list[Finding]]:
    """Return the wanted hand, else the one of more samples (of equals the right one), and findings about it.

    `samples` has the number of samples of each hand in the file; "" is a hand of no stated side. Raises TrajectoryError
    where the wanted hand is not in the file.
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
    """Return a hand as `chosen_side`, the indices of the frames, by their hands, that show it, and findings about both.

    Raises TrajectoryError where the wanted hand is in no frame, or no frame has a hand.
    """
    seen = Counter(side for sides in frames for side in sides)
    if not seen:
        raise TrajectoryError(f"{len(frames)} frames, but no hand in any")
    side, findings = chosen_side(seen, wanted)
    shown = [k for k, sides in enumerate(frames) if side in sides]
    if len(shown) < len(frames):
        findings.append(note(f"{len(frames) - len(shown)} of {len(frames)} frames show no such hand: no samples"))
    return side, shown, findings


def known_side(points: FloatArray, hand: HandSide, findings: list[Finding]) -> HandSide:
    """Return the side of the hand, as stated or by the bend of its fingers; add what is doubtful to `findings`."""
    if not hand:
        if not (side := bends_as(points)):
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

    The points are joints in the order of `KEYPOINTS`, any unit, shape (T, 21, 3).
    """
    bend = {side: _bend(points, side) for side in SIDES}
    side = max(SIDES, key=lambda each: bend[each])
    return side if bend[side] >= LEAST_BEND else ""


def looks_as(points: FloatArray) -> HandSide:
    """Return the side of a hand by the bend of its fingers, else by its thumb; arguments as of `bends_as`."""
    if side := bends_as(points):
        return side
    above = {side: _thumb_above(points, side) for side in SIDES}
    side = min(SIDES, key=lambda each: above[each])
    return side if above[side] <= -THUMB_HEIGHT else ""


def in_right_handed_world(points: FloatArray, hand: HandSide, findings: list[Finding]) -> FloatArray:
    """Return joint centres in a right-handed world, y up, and add what was mirrored to `findings`.

    In Unity's world z points the other way: there a right hand is a left one's mirror, which its fingers and its thumb
    tell. A hand of no stated side, "", is left as it is.
    """
    seen = looks_as(points)
    if not hand or seen == hand:
        return points
    if seen:
        text = (
            f"the {hand} hand of the file is the mirror of one: its coordinates are left-handed, as Unity's, and z is "
            "turned round; if it is the other hand, say --mirror"
        )
    else:
        text = (
            "its fingers are too straight, and its thumb too level with them, to tell whether its coordinates are "
            "left-handed, as Unity's: taken for right-handed"
        )
    findings.append(note(text))
    return np.asarray(points * UNITY) if seen else points


def _bend(points: FloatArray, side: HandSide) -> float:
    """Compute the mean flexion of the joints of index to little finger, if it is a hand of this side [rad]."""
    fingers = points[:, 5:].reshape(-1, 4, 4, 3)
    orientation = palm_from_knuckles(fingers[:, :, 0], points[:, 0], side)
    chains = np.concatenate([fingers[:, :1], fingers], axis=1)
    return _mean(finger_angles(in_palm(np.diff(chains, axis=2), orientation), side)[0][:, 1:])


def _thumb_above(points: FloatArray, side: HandSide) -> float:
    """Compute the thumb's mean height above the back of a hand of this side [palm lengths]; palmar is negative."""
    orientation = palm_from_knuckles(points[:, 5::4], points[:, 0], side)
    from_wrist = in_palm(points - points[:, :1], orientation)
    with np.errstate(invalid="ignore", divide="ignore"):
        above = from_wrist[:, 2:5, 2] / np.linalg.norm(from_wrist[:, 9:10], axis=2)
    return _mean(above)


def _mean(values: FloatArray) -> float:
    """Return the mean of the finite values, 0 without any."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else 0.0
