"""Least-squares fit of plane fingers to recorded joint centres: angles that follow in time.

Angles minimise the squared distances of a finger's joints and tip from the recorded ones, together with two terms whose
weight is the noise of the recording, so that exact joints come back exactly: an abduction near zero, and small steps
between samples. Where the joints leave an angle open, as the abduction of a finger that is straight and bent at its
base by 90°, the steps keep the angle of the sample before. Gauss-Newton steps solve all samples at once: the matrix is
banded, as only neighbours in time are coupled.
"""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import FingerAxes, usual_fingers

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
    usual, clinical = usual_fingers(), np.array(FLEXION_DEGREES)
    low = np.minimum(np.radians(clinical[..., 0] - PASSIVE_DEGREES), usual["flexion_min"])
    high = np.maximum(np.radians(clinical[..., 1] + PASSIVE_DEGREES), usual["flexion_max"])
    for limit in (low, high):
        limit[:, 0] += straight_flexion(axes, side)
    aside = np.full((len(FINGERS), 1), np.radians(LARGEST_ABDUCTION))
    return np.column_stack([-aside, low]), np.column_stack([aside, high])


def straight_flexion(axes: FingerAxes, side: HandSide) -> FloatArray:
    """Return the flexion of each finger's first joint [rad] at which it points as the default hand's straight one."""
    usual = usual_fingers(side)["distal"]
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
            own = [part[f] for part in axes]
            chain = _Finger(joints[whole, f, 1:] - base[f], length[f], FingerAxes(*own), low[f], high[f])
            angles[whole, f] = chain.followed()
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
        angles = self._solved(chosen, self._start(chosen, NOISE_FLOOR), NOISE_FLOOR, None)
        noise = noise_of(self._squares(chosen, angles), FREE)
        blocks: list[FloatArray] = []
        for first in range(0, len(self.points), BLOCK):
            points = self.points[first : first + BLOCK]
            before = blocks[-1][-1] if blocks else None
            angles = self._solved(points, self._start(points, noise), noise, before)
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

    def _start(self, points: FloatArray, noise: float) -> FloatArray:
        """Return angles in the plane of the joints or in that of the bones, whichever is nearer, of each sample."""
        planes = (points, np.diff(points, axis=1, prepend=0.0))
        found = [self._in_plane(points, vectors, noise) for vectors in planes]
        squares = [self._squares(points, angles) for angles in found]
        return np.where((squares[1] < squares[0])[:, None], found[1], found[0])

    def _in_plane(self, points: FloatArray, vectors: FloatArray, noise: float) -> FloatArray:
        """Return angles of joints in the plane nearest to vectors of each sample, shape (T, 3, 3)."""
        turn = plane_abduction(vectors @ self.distal, vectors @ self.across, noise)
        along, aside, above = (points @ axis for axis in (self.distal, self.across, self.dorsal))
        onward = np.cos(turn)[:, None] * along + np.sin(turn)[:, None] * aside
        steps = [np.diff(part, axis=1, prepend=0.0) for part in (-above, onward)]
        flexion = np.diff(np.arctan2(*steps), axis=1, prepend=0.0)
        middle = 0.5 * (self.low + self.high)[1:]
        flexion = middle + (flexion - middle + np.pi) % (2.0 * np.pi) - np.pi
        return np.clip(np.column_stack([turn, flexion]), self.low, self.high)

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
