"""Joint angles of hhsim's hand from recorded fingers: of one sample by its bones, and of a recording over time.

Of one sample the abduction is the plane nearest to the three bones: the least eigenvector of a 2 × 2 matrix, which is
defined for a fist too; the flexions are angles in that plane. Live tracking does the same. Bones of a recording are
medians.

Angles of a recording minimise the squared distances of a finger's joints and tip from the recorded ones, together with
two terms whose weight is the noise of the recording, so that exact joints come back exactly: an abduction near zero,
and small steps between samples. Where the joints leave an angle open, as the abduction of a finger that is straight and
bent at its base by 90°, the steps keep the angle of the sample before. Gauss-Newton steps solve all samples at once:
the matrix is banded, as only neighbours in time are coupled.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, Self

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion_product
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.frames import quaternions_of, turned

STRAIGHT = 0.05
"""Weight of zero abduction against three measured unit bones: it decides if they are parallel."""
EXACT = 1e-8
"""Squared distance from their plane below which bones were not measured and need no such weight."""
LEAST = 1e-15
"""Remainder of that weight for them, below an angle's resolution."""


def finger_angles(bones: FloatArray, axes: "FingerAxes") -> tuple[FloatArray, FloatArray]:
    """Compute the flexion and abduction that fit recorded bones best.

    `bones` are directions of the three bones of each finger from base to tip (thumb: metacarpal first), palm frame, any
    length, NaN where missing, shape (T, F, 3, 3), of fingers with these axes. Returns flexion, shape (T, F, 3), and
    abduction, shape (T, F) [rad]; NaN where a bone of the finger is missing.
    """
    distal, dorsal, across = axes
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    along, aside, above = (np.einsum("tfki,fi->tfk", unit, axes) for axes in (distal, across, dorsal))
    # The flexion axis is cos β · across - sin β · distal; β minimises the bones' components along it.
    pp, pq, qq = (aside**2).sum(axis=2), (aside * along).sum(axis=2), (along**2).sum(axis=2)
    off_plane = np.maximum(0.5 * (pp + qq - np.hypot(pp - qq, 2.0 * pq)), 0.0)
    qq = qq + STRAIGHT * off_plane / (off_plane + EXACT) + LEAST
    abduction = 0.5 * np.arctan2(2.0 * pq, qq - pp)
    cosine, sine = np.cos(abduction)[..., None], np.sin(abduction)[..., None]
    forward = cosine * along + sine * aside
    total = np.arctan2(-above, forward)
    # A finger that curls past straight back has turned further, not less: a joint flexes by up to 200° or hyperextends
    # by up to 90°, so it turns within (-π/2, 3π/2].
    turn = (np.diff(total, axis=2) + 0.5 * np.pi) % (2.0 * np.pi) - 0.5 * np.pi
    total[..., 1:] = total[..., :1] + np.cumsum(turn, axis=2)
    return np.diff(total, axis=2, prepend=0.0), abduction


@lru_cache
def usual_hand(side: HandSide = "right") -> HandModel:
    """Return the default hand of a side."""
    return HandModel.default("left" if side == "left" else "right")


class FingerAxes(NamedTuple):
    """Unit axes of a hand's fingers at zero abduction, palm frame, shape (5, 3) each.

    Along the straight finger, out of its back, about which it abducts, and of a positive abduction, to the thumb.
    """

    distal: FloatArray
    dorsal: FloatArray
    across: FloatArray

    @classmethod
    def of(cls, hand: HandModel) -> Self:
        """Return the axes of a hand."""
        return cls(hand.distal, hand.dorsal, hand.abduction_sign * hand.flexion_axis)


def finger_axes(side: HandSide) -> FingerAxes:
    """Return the default hand's finger axes."""
    return FingerAxes.of(usual_hand(side))


def finger_joints(
    base: FloatArray, length: FloatArray, flexion: FloatArray, abduction: FloatArray, axes: FingerAxes
) -> FloatArray:
    """Compute joints and tips of fingers of any size in a posture [m], palm frame, shape (T, 5, 4, 3).

    `base` has the fingers' first joints and `length` their bones' lengths [m], shape (5, 3) each; the angles [rad] have
    the shapes (T, 5, 3) and (T, 5).
    """
    distal, dorsal, across = axes
    turn = abduction[..., None]
    forward = np.cos(turn) * distal + np.sin(turn) * across
    total = np.cumsum(flexion, axis=2)[..., None]
    bones = np.cos(total) * forward[:, :, None] - np.sin(total) * dorsal[:, None]
    joints = np.concatenate([np.zeros((*bones.shape[:2], 1, 3)), np.cumsum(length[..., None] * bones, axis=2)], axis=2)
    return np.asarray(base[:, None] + joints)


def palm_rotation(fingers: FloatArray, back: FloatArray) -> FloatArray:
    """Compute the palm frame (w, x, y, z), shape (T, 4), from directions (T, 3) to the fingers and out of the back."""
    with np.errstate(invalid="ignore", divide="ignore"):
        y = fingers / np.linalg.norm(fingers, axis=1, keepdims=True)
        z = back - np.einsum("ti,ti->t", back, y)[:, None] * y
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        frame = np.stack([np.cross(y, z), y, z], axis=2)
    # A direction whose square is lost points nowhere.
    frame[~np.isfinite(frame).all(axis=(1, 2))] = np.nan
    return quaternions_of(frame)


def palm_from_knuckles(knuckles: FloatArray, wrist: FloatArray, side: HandSide) -> FloatArray:
    """Compute the palm frame (w, x, y, z), shape (T, 4), from the knuckles (T, 4, 3) and the wrist (T, 3), any unit."""
    return quaternion_product(_from_knuckles(knuckles, wrist, side), palm_in_knuckles(side))


@lru_cache
def palm_in_knuckles(side: HandSide) -> FloatArray:
    """Return the model's palm frame in the frame of its wrist and knuckles, a quaternion (w, x, y, z), shape (1, 4)."""
    return conjugate(_from_knuckles(usual_hand(side).base[None, 1:], usual_hand(side).wrist[None], side))


def _from_knuckles(knuckles: FloatArray, wrist: FloatArray, side: HandSide) -> FloatArray:
    """Return a frame with y from the wrist to the centre of the knuckles and z out of the back."""
    across = (knuckles[:, 3] - knuckles[:, 0]) * (-1.0 if side == "left" else 1.0)
    along = knuckles.mean(axis=1) - wrist
    return palm_rotation(along, np.cross(across, along))


def palm_origin(knuckles: FloatArray, orientation: FloatArray, side: HandSide) -> FloatArray:
    """Compute the palm origin [m], shape (T, 3), that puts the model's knuckles, in the middle, at recorded ones."""
    return np.asarray(knuckles.mean(axis=1) - turned(orientation, usual_hand(side).base[1:].mean(axis=0)))


@dataclass(frozen=True, eq=False)
class RecordedBones:
    """Sizes of the recorded hand, palm frame, and the error of its fit."""

    hand: HandSide
    hand_length: float  # length from wrist to middle fingertip [m]
    base: FloatArray  # first joint of each finger [m], shape (5, 3), from the palm's origin in the recording
    length: FloatArray  # distances between joints, the last one to the tip [m], shape (5, 3)
    radius: FloatArray | None  # radii at the joints and the tip [m], shape (5, 4); None if not recorded
    tip_on_surface: bool  # True if the tip is a point of the skin, False if it is the centre of the fingertip's sphere
    rms: FloatArray  # root mean square of the fit's error of each finger over joints, tip and samples [m], shape (5,)
    largest: FloatArray  # largest error of each finger [m], shape (5,)

    def to_json(self) -> dict[str, dict[str, object]]:
        """Return the fit finger by finger, SI units."""
        held = {"rms": self.rms, "max": self.largest, "length": self.length, "radius": self.radius}
        return {f: {key: v if v is None else v[k].tolist() for key, v in held.items()} for k, f in enumerate(FINGERS)}


def fit_error(joints: FloatArray, ours: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute each finger's root mean square and largest distance between joints (T, 5, 4, 3) [m], shape (5,) each."""
    off = np.linalg.norm(joints - ours, axis=3).swapaxes(1, 2).reshape(-1, len(FINGERS))
    return np.sqrt(finite(np.mean, off**2)), np.nan_to_num(finite(np.max, off))


def median_bones(joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return median first joints and bone lengths [m], (5, 3), of joints (T, 5, 4, 3), palm frame, NaN if missing."""
    lengths = np.linalg.norm(np.diff(joints, axis=2), axis=3)
    return finite(np.median, joints[:, :, 0]), finite(np.median, lengths)


def finite(statistic: Callable[[FloatArray], Any], rows: FloatArray) -> FloatArray:
    """Return a statistic of each column's finite values, NaN if it has none."""
    columns = [column[np.isfinite(column)] for column in rows.reshape(len(rows), -1).T]
    values = [statistic(column) if column.size else np.nan for column in columns]
    return np.array(values).reshape(rows.shape[1:])


FLEXION_DEGREES = (((-20.0, 15.0), (0.0, 50.0), (-20.0, 80.0)), *(((-45.0, 90.0), (0.0, 100.0), (0.0, 90.0)),) * 4)
"""Active ranges of the American Academy of Orthopaedic Surgeons (Joint Motion, 1965)."""
PASSIVE_DEGREES = 35.0
"""Excess of passive and hypermobile joints over active ranges, and of a recording's zero over a goniometer's."""
LARGEST_ABDUCTION = 80.0
"""Largest abduction [degrees]: its axis stays in the palm, so that a bent finger turns further than it moves aside."""
USUAL_ABDUCTION = 0.35
"""Standard deviation of an abduction [rad]."""
USUAL_STEP = 0.1
"""Standard deviation of an angle's step from a sample to the next [rad]."""
MEMORY = 1000.0
"""Number of samples over which an abduction that the joints leave open goes back to zero."""
LARGEST_STEP = 0.8
"""Largest step of an angle between samples whose joints hardly move [rad]; a larger one is a flip."""
NOISE_FLOOR = 1e-8
"""Smallest noise of recorded joints [m]: its weights decide only what the joints leave open."""
FREE = 5
"""Coordinates of a finger's three joints, less its four angles."""
SUBSAMPLE = 400
"""Number of samples that noise and axes are estimated from."""
BLOCK = 8192
"""Number of samples that are solved at once; a block's first sample is coupled to the last one of the block before."""
ANCHORS = 4
"""Number of runs without flips that are tried as the right ones."""
ITERATIONS = 40
CONVERGED = 1e-11
"""Largest change of an angle in the last step [rad]."""
SETTLED = 1e-5
"""Share of each sample's cost that a last step changes."""
DAMPING = 1e-6
"""First damping of a sample that a step made worse [m² / rad²]."""


def anatomic_limits(axes: FingerAxes, side: HandSide) -> tuple[FloatArray, FloatArray]:
    """Return the widest ranges of a hand's joints [rad], abduction then flexions, shape (5, 4) each.

    Flexions have the clinical active range widened by `PASSIVE_DEGREES`, or our hand's where this is wider.
    """
    usual, clinical = usual_hand(), np.array(FLEXION_DEGREES)
    low = np.minimum(np.radians(clinical[..., 0] - PASSIVE_DEGREES), usual.flexion_min)
    high = np.maximum(np.radians(clinical[..., 1] + PASSIVE_DEGREES), usual.flexion_max)
    for limit in (low, high):
        limit[:, 0] += straight_flexion(axes, side)
    aside = np.full((len(FINGERS), 1), np.radians(LARGEST_ABDUCTION))
    return np.column_stack([-aside, low]), np.column_stack([aside, high])


def straight_flexion(axes: FingerAxes, side: HandSide) -> FloatArray:
    """Return the flexion of each finger's first joint [rad] at which it points as the default hand's straight one."""
    usual = usual_hand(side).distal
    return np.asarray(np.arctan2(-(usual * axes.dorsal).sum(axis=1), (usual * axes.distal).sum(axis=1)))


def fitted_angles(
    joints: FloatArray, base: FloatArray, length: FloatArray, axes: FingerAxes, side: HandSide
) -> tuple[FloatArray, FloatArray]:
    """Compute flexion and abduction of a hand nearest to recorded joints, within anatomic limits.

    `joints` are first to last joint and tip of each finger [m], palm frame, shape (T, 5, 4, 3), NaN where missing;
    `base` the first joints [m], palm frame, and `length` the lengths of the bones [m], shape (5, 3). Returns flexion,
    shape (T, 5, 3), and abduction, shape (T, 5) [rad]; NaN where a joint of the finger is missing.
    """
    angles = np.full((len(joints), len(FINGERS), 4), np.nan)
    low, high = anatomic_limits(axes, side)
    for f in range(len(FINGERS)):
        whole = np.isfinite(joints[:, f]).all(axis=(1, 2))
        # A bone of no length has no direction.
        whole &= (np.diff(joints[:, f], axis=1) != 0.0).any(axis=2).all(axis=1)
        if whole.any():
            own = FingerAxes(*(part[f] for part in axes))
            angles[whole, f] = _Finger(joints[whole, f, 1:] - base[f], length[f], own, low[f], high[f]).followed()
    return angles[..., 1:], angles[..., 0]


def plane_abduction(along: FloatArray, aside: FloatArray, noise: float) -> FloatArray:
    """Compute the abduction of the plane nearest to points, with coordinates (N, 3) each, in (-π/2, π/2]."""
    pp, pq, qq = (aside**2).sum(axis=1), (aside * along).sum(axis=1), (along**2).sum(axis=1)
    return np.asarray(0.5 * np.arctan2(2.0 * pq, qq + (noise / USUAL_ABDUCTION) ** 2 - pp))


def noise_of(squares: FloatArray, free: int) -> float:
    """Return the noise of a coordinate [m] from sums of squares with so many degrees of freedom."""
    return max(float(np.sqrt(np.median(squares) / free)), NOISE_FLOOR) if squares.size else NOISE_FLOOR


def spread_samples(count: int) -> IntArray:
    """Return at most `SUBSAMPLE` indices, evenly spread."""
    return np.asarray(np.unique(np.linspace(0, count - 1, min(count, SUBSAMPLE)).round().astype(np.int64)))


class _Finger:
    """Fit of one finger's angles: abduction, then three flexions."""

    def __init__(
        self, points: FloatArray, length: FloatArray, axes: FingerAxes, low: FloatArray, high: FloatArray
    ) -> None:
        """Take joints and tip from the base on [m], shape (T, 3, 3), lengths (3,), axes (3,), and limits (4,)."""
        self.points, self.length, self.low, self.high = points, length, low, high
        self.distal, self.dorsal, self.across = axes

    def followed(self) -> FloatArray:
        """Return the angles of all samples, shape (T, 4)."""
        chosen = self.points[spread_samples(len(self.points))]
        angles = self._solved(chosen, self._start(chosen), NOISE_FLOOR, None)
        noise = noise_of(self._squares(chosen, angles), FREE)
        blocks: list[FloatArray] = []
        for first in range(0, len(self.points), BLOCK):
            points = self.points[first : first + BLOCK]
            before = blocks[-1][-1] if blocks else None
            angles = self._solved(points, self._start(points), noise, before)
            steady = self._unbroken(points, angles, noise)
            blocks.append(angles if steady is angles else self._solved(points, steady, noise, before))
        return np.concatenate(blocks)

    def _unbroken(self, points: FloatArray, angles: FloatArray, noise: float) -> FloatArray:
        """Return angles without flips to another minimum, the nearest of those followed from the longest runs."""
        edges = np.flatnonzero(self._flips(points[:-1], angles[:-1], points[1:], angles[1:])) + 1
        if not edges.size:
            return angles
        runs = sorted(np.split(np.arange(len(angles)), edges), key=len, reverse=True)[:ANCHORS]
        found = [self._outward(points, angles, run, noise) for run in runs]
        return min(found, key=lambda each: float(self._squares(points, each).sum()))

    def _flips(self, start: FloatArray, first: FloatArray, end: FloatArray, second: FloatArray) -> BoolArray:
        """Return True where angles step by more than `LARGEST_STEP`, and joints by less than such a step moves."""
        moved = np.linalg.norm(end - start, axis=-1).max(axis=-1)
        large = (np.abs(second - first) > LARGEST_STEP).any(axis=-1)
        return np.asarray(large & (moved < LARGEST_STEP * self.length[-1]))

    def _outward(self, points: FloatArray, angles: FloatArray, run: IntArray, noise: float) -> FloatArray:
        """Return angles followed sample by sample from a run on, where those given flip."""
        angles = angles.copy()
        for onward in (range(run[-1] + 1, len(angles)), range(run[0] - 1, -1, -1)):
            for k in onward:
                near, at = angles[k - onward.step], points[k - onward.step]
                if self._flips(at, near, points[k], angles[k]):
                    angles[k] = self._solved(points[k : k + 1], near[None], noise, near)[0]
        return angles

    def _start(self, points: FloatArray) -> FloatArray:
        """Return angles in the plane of the bones of each sample."""
        axes = FingerAxes(*(axis[None] for axis in (self.distal, self.dorsal, self.across)))
        flexion, abduction = finger_angles(np.diff(points, axis=1, prepend=0.0)[:, None], axes)
        return np.clip(np.column_stack([abduction, flexion[:, 0]]), self.low, self.high)

    def jacobian(self, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute joints from the base, shape (T, 3, 3), and their derivatives by the angles, shape (T, 3, 3, 4)."""
        cosine, sine = np.cos(angles[:, :1]), np.sin(angles[:, :1])
        onward = (cosine * self.distal + sine * self.across)[:, None]
        aside = (cosine * self.across - sine * self.distal)[:, None]
        total = np.cumsum(angles[:, 1:], axis=1)[..., None]
        length = self.length[:, None]
        joints = np.cumsum(length * (np.cos(total) * onward - np.sin(total) * self.dorsal), axis=1)
        slope = np.zeros((*joints.shape, 4))
        slope[..., 0] = np.cumsum(length * np.cos(total) * aside, axis=1)
        bent = -length * (np.sin(total) * onward + np.cos(total) * self.dorsal)
        for joint in range(3):
            slope[:, joint:, :, 1 + joint] = np.cumsum(bent[:, joint:], axis=1)
        return joints, slope

    def _squares(self, points: FloatArray, angles: FloatArray) -> FloatArray:
        return np.asarray(((self.jacobian(angles)[0] - points) ** 2).sum(axis=(1, 2)))

    def _solved(self, points: FloatArray, angles: FloatArray, noise: float, before: FloatArray | None) -> FloatArray:
        """Minimise distances, abduction and steps from `angles` on by damped, projected Gauss-Newton steps."""
        from scipy.linalg import solveh_banded

        count = len(points)
        step = (noise / USUAL_STEP) ** 2
        still = step / MEMORY**2
        damping = np.zeros((count, 1))

        def costs(trial: FloatArray) -> FloatArray:
            """Return the cost of each sample, with that of the step to it."""
            chain = trial if before is None else np.concatenate([before[None], trial])
            steps = step * (np.diff(chain, axis=0) ** 2).sum(axis=1)
            own = self._squares(points, trial) + still * trial[:, 0] ** 2
            own[len(own) - len(steps) :] += steps
            return own

        # A sample is coupled to the one before and the one after.
        ties = np.full((count, 1), 2.0)
        ties[-1] -= 1.0
        ties[0] -= before is None
        cost = costs(angles)
        for _ in range(ITERATIONS):
            joints, slope = self.jacobian(angles)
            matrix = np.einsum("tjia,tjib->tab", slope, slope)
            pull = np.einsum("tjia,tji->ta", slope, points - joints)
            chain = np.concatenate([angles[:1] if before is None else before[None], angles, angles[-1:]])
            pull += step * (chain[2:] - 2.0 * angles + chain[:-2])
            pull[:, 0] -= still * angles[:, 0]
            held = ((angles <= self.low) & (pull < 0.0)) | ((angles >= self.high) & (pull > 0.0))
            matrix[held[:, :, None] | held[:, None, :]] = 0.0
            diagonal = np.einsum("taa->ta", matrix)
            diagonal += step * ties + damping
            diagonal[:, 0] += still
            diagonal[held] = 1.0
            pull[held] = 0.0
            bands = np.zeros((5, count, 4))
            for offset in range(4):
                rows = np.arange(4 - offset)
                bands[offset, :, : 4 - offset] = matrix[:, rows + offset, rows]
            bands[4, :-1] = np.where(held[1:] | held[:-1], 0.0, -step)
            move = solveh_banded(bands.reshape(5, -1), pull.ravel(), lower=True).reshape(count, 4)
            trial = np.clip(angles + move, self.low, self.high)
            change = np.abs(trial - angles).max()
            now = costs(trial)
            settled = bool((np.abs(cost - now) <= SETTLED * (now + noise**2)).all())
            if now.sum() <= cost.sum():
                angles, cost, damping = trial, now, 0.1 * damping
            else:
                worse = (now > cost)[:, None]
                damping = np.where(worse, 100.0 * damping + DAMPING, damping)
            if change < CONVERGED or settled:
                break
        return angles
