"""Least-squares fit of plane fingers to recorded joint centres: constant axes of a hand, angles that follow in time.

Angles minimise the squared distances of a finger's joints and tip from the recorded ones, together with two terms whose
weight is the noise of the recording, so that exact joints come back exactly: an abduction near zero, and small steps
between samples. Where the joints leave an angle open, as the abduction of a finger that is straight and bent at its
base by 90°, the steps keep the angle of the sample before. Gauss-Newton steps solve all samples at once: the matrix is
banded, as only neighbours in time are coupled.

The axes of a finger follow from the planes through its base and joints. All of them contain the dorsal axis, about
which the finger abducts; it minimises the distances of the joints from the planes (variable projection: Golub &
Pereyra, SIAM J. Numer. Anal. 10, 1973).
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import OutputError, TrajectoryError
from hhsim.hand import model
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import FingerAxes, RecordedBones, finger_axes, finger_joints, fit_error, usual_fingers
from hhsim.recordings.frames import in_palm, turned
from hhsim.recordings.recording import Recording, note
from hhsim.system.output_path import check_output_path, holds

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
USUAL_TILT = 0.35
"""Standard deviation of a dorsal axis from the usual one [rad]."""
Bounds = tuple[tuple[float, float], tuple[float, float]]
TILTS: tuple[Bounds, ...] = ((-0.5, -0.8), (0.8, 0.8)), *(((-0.1, -0.8), (1.0, 0.8)),) * 4
"""Smallest and largest tangents of a dorsal axis' tilt, along and across the finger.

An axis that leans back points along a bent finger, whose abduction then turns it without moving it.
"""
PASSES = 3
"""Number of fits of the axes, each with the noise that the one before has left."""
TOLERANCES: Any = {"xtol": 1e-12, "ftol": 1e-14, "gtol": 1e-15}
"""Relative changes of tilt, cost and gradient at which a fit of the axes ends."""
FINEST = 1e-6
"""Smallest distance from a plane that counts as an outlier [m]."""
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
        limit[:, 0] += _straight(axes, side)
    aside = np.full((len(FINGERS), 1), np.radians(LARGEST_ABDUCTION))
    return np.column_stack([-aside, low]), np.column_stack([aside, high])


def recorded_limits(
    flexion: FloatArray, abduction: FloatArray, axes: FingerAxes, side: HandSide
) -> dict[str, FloatArray]:
    """Return the default hand's limits, widened to hold recorded angles, by the keys of a hand file [rad].

    The angles have the shapes (T, 5, 3) and (T, 5), NaN where missing.
    """
    limits = {}
    for key, angles in (("flexion", flexion), ("abduction", abduction)):
        for end, outer, sign in (("min", np.fmin, -1.0), ("max", np.fmax, 1.0)):
            usual = usual_fingers()[f"{key}_{end}"].copy()
            if key == "flexion":
                usual[:, 0] += _straight(axes, side)
            # A hand file has six decimals: rounding never cuts a recorded angle.
            limits[f"{key}_{end}"] = sign * np.ceil(sign * 1e6 * outer(usual, outer.reduce(angles, axis=0))) * 1e-6
    return limits


def _straight(axes: FingerAxes, side: HandSide) -> FloatArray:
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


def fitted_axes(joints: FloatArray, base: FloatArray, side: HandSide) -> FingerAxes:
    """Compute the finger axes whose planes through `base` fit recorded joints best; arguments as of `fitted_angles`.

    What the joints leave open stays as in the default hand: the direction of zero abduction, and a dorsal axis that no
    abduction shows.
    """
    usual = finger_axes(side)
    fitted = [part.copy() for part in usual]
    for f in range(len(FINGERS)):
        points = joints[np.isfinite(joints[:, f]).all(axis=(1, 2)), f, 1:] - base[f]
        if len(points):
            own = _leaning(points[_spread(len(points))], FingerAxes(*(part[f] for part in usual)), TILTS[f])
            for part, axis in zip(fitted, own):
                part[f] = axis
    return FingerAxes(*fitted)


def _leaning(points: FloatArray, usual: FingerAxes, bounds: Bounds) -> FingerAxes:
    """Return a finger's axes from joints and tip from its base on, shape (T, 3, 3), and usual axes, shape (3,)."""
    from scipy.optimize import least_squares

    def residuals(tilt: FloatArray, noise: float) -> FloatArray:
        """Return distances from the planes, abductions and tilt, all weighted to metres."""
        axes = _tilted(usual, tilt)
        along, aside = points @ axes.distal, points @ axes.across
        turn = _abduction(along, aside, noise)
        off = np.cos(turn)[:, None] * aside - np.sin(turn)[:, None] * along
        # The model's own error is alike in all samples: their number is no evidence against the usual axis.
        known = np.sqrt(len(points)) * tilt / USUAL_TILT
        return np.concatenate([off.ravel(), noise * np.sin(turn) / USUAL_ABDUCTION, noise * known])

    tilt, noise = np.zeros(2), NOISE_FLOOR
    for _ in range(PASSES):
        off = residuals(tilt, noise)[: 3 * len(points)]
        scale = max(3.0 * float(np.median(np.abs(off))), FINEST)
        loss: dict[str, Any] = {"loss": "soft_l1", "f_scale": scale, **TOLERANCES}
        tilt = least_squares(residuals, tilt, bounds=bounds, args=(noise,), **loss).x
        off = residuals(tilt, noise)[: 3 * len(points)].reshape(-1, 3)
        noise = _noise((off**2).sum(axis=1), 2)
    distal, dorsal, across = _tilted(usual, tilt)
    # A finger that is always far aside has its zero moved, or its abduction would meet a limit.
    mean = float(_abduction((points @ distal).reshape(1, -1), (points @ across).reshape(1, -1), noise)[0])
    turn = mean - float(np.clip(mean, -USUAL_ABDUCTION, USUAL_ABDUCTION))
    cosine, sine = np.cos(turn), np.sin(turn)
    return FingerAxes(cosine * distal + sine * across, dorsal, cosine * across - sine * distal)


def _tilted(usual: FingerAxes, tilt: FloatArray) -> FingerAxes:
    """Return a finger's axes with a dorsal axis that leans by tangents along and across it."""
    leaning = usual.dorsal + tilt[0] * usual.distal + tilt[1] * usual.across
    leaning = leaning / np.linalg.norm(leaning)
    onward = usual.distal - (usual.distal @ leaning) * leaning
    onward = onward / np.linalg.norm(onward)
    # As `np.cross` computes it, which takes longer than all else here.
    (a, b, c), (d, e, f) = leaning, onward
    aside = np.array([b * f - c * e, c * d - a * f, a * e - b * d])
    return FingerAxes(onward, leaning, aside * np.sign(aside @ usual.across))


def _abduction(along: FloatArray, aside: FloatArray, noise: float) -> FloatArray:
    """Compute the abduction of the plane nearest to points, with coordinates (N, 3) each, in (-π/2, π/2]."""
    pp, pq, qq = (aside**2).sum(axis=1), (aside * along).sum(axis=1), (along**2).sum(axis=1)
    return np.asarray(0.5 * np.arctan2(2.0 * pq, qq + (noise / USUAL_ABDUCTION) ** 2 - pp))


def _noise(squares: FloatArray, free: int) -> float:
    """Return the noise of a coordinate [m] from sums of squares with so many degrees of freedom."""
    return max(float(np.sqrt(np.median(squares) / free)), NOISE_FLOOR) if squares.size else NOISE_FLOOR


def _spread(count: int) -> IntArray:
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
        chosen = self.points[_spread(len(self.points))]
        angles = self._solved(chosen, self._start(chosen, NOISE_FLOOR), NOISE_FLOOR, None)
        noise = _noise(self._squares(chosen, angles), FREE)
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
        turn = _abduction(vectors @ self.distal, vectors @ self.across, noise)
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


BREADTHS = (0.26, 0.74)
"""Range of hand breadths that the palm model takes [hand lengths]."""
FITTED = "--fit-hand"
"""Name of the fitted hand in messages."""
SHORTEST = 0.004
"""Shortest bone, to the centre of the fingertip [m]."""


def fitted_hand(recording: Recording, source: str) -> tuple[Recording, str]:
    """Fit a hand to the joint centres of a recording: bones, finger axes, limits, and radii or radii in proportion.

    Limits are the default hand's, widened to hold the recorded motion. A recording without a world frame holds no joint
    centres any more: its fingers keep the default hand's axes and limits.

    Returns the recording with the angles of this hand and its palm moved so that the hand's knuckles are the recorded
    ones, and the text of a hand file with a right hand, or the mirror of a left one, whose first line names the source.
    Raises TrajectoryError for no joint centres, or bones that are no hand's, InputError for sizes that `hhsim replay
    --hand-file` refuses.
    """
    bones = recording.bones
    if bones is None:
        form = recording.form or "it"
        raise TrajectoryError(f"--fit-hand needs the centres of the joints, and {form} holds angles only")
    low, high = model.HAND_LENGTH_RANGE
    if not low <= bones.hand_length <= high:
        raise TrajectoryError(f"--fit-hand: the hand is {bones.hand_length:.3g} m long; expected {low:g} to {high:g} m")
    usual = usual_fingers()["base"]
    width = np.linalg.norm(bones.base[1] - bones.base[4]) / np.linalg.norm(usual[1] - usual[4])
    share = float(np.clip(width * model.BREADTH_PER_LENGTH * model.DEFAULT_HAND_LENGTH / bones.hand_length, *BREADTHS))
    breadth = share * bones.hand_length
    ours = model.default_fingers(bones.hand_length, breadth)
    radius = ours["radius"] if bones.radius is None else np.minimum.accumulate(bones.radius, axis=1)
    length = bones.length.copy()
    if bones.tip_on_surface:
        # A hand file's last bone ends in the centre of the fingertip's sphere.
        length[:, 2] -= radius[:, 3]
    short = np.argwhere(~(length > SHORTEST))
    if len(short):
        finger, bone = short[0]
        what = f"bone {bone + 1} of the {FINGERS[finger]} is {1e3 * length[finger, bone]:.1f} mm long"
        raise TrajectoryError(f"--fit-hand: {what}; expected more than {1e3 * SHORTEST:g} mm")
    mirror = model.MIRROR if bones.hand == "left" else np.ones(3)
    axes: dict[str, FloatArray] = {}
    if recording.joints is not None:
        recording, axes = _fitted(recording, recording.joints, bones, mirror)
    base = bones.base * mirror
    # From the recording's palm origin to that of this hand, palm frame [m].
    shift = base[1:].mean(axis=0) - ours["base"][1:].mean(axis=0)
    sizes = {"base": base - shift, "length": length} | axes | ({} if bones.radius is None else {"radius": radius})
    fingers = {finger: {key: rows[f] for key, rows in sizes.items()} for f, finger in enumerate(FINGERS)}
    radii = "radii in proportion to its length and breadth" if bones.radius is None else "radii as recorded"
    said = f"Fitted to {source}: bones as medians, {radii}."
    text = model.format_hand_file(bones.hand_length, breadth, fingers, said)
    # What no hand file may hold is refused before it is written.
    HandModel.of_text(text, FITTED)
    moved = recording.changed(position=recording.position + turned(recording.orientation, shift * mirror))
    by = f"palm moved by {1e3 * np.linalg.norm(shift):.1f} mm in the hand: its knuckles are the fitted hand's"
    return moved.found(note(by)), text


def in_angles_of(recording: Recording, hand: HandModel) -> Recording:
    """Return a recording of joint centres in the angles of a hand that was fitted to other samples of the same hand.

    Raises TrajectoryError for no joint centres.
    """
    bones, joints = recording.bones, recording.joints
    if bones is None or joints is None:
        raise TrajectoryError(f"{recording.form or 'it'} holds angles only; expected the centres of joints")
    fingers = joints[:, 1:].reshape(-1, len(FINGERS), 4, 3)
    position = fingers[:, 1:, 0].mean(axis=1) - turned(recording.orientation, hand.base[1:].mean(axis=0))
    at = in_palm(fingers - position[:, None, None], recording.orientation)
    length = hand.length.copy()
    if bones.tip_on_surface:
        length[:, 2] += hand.radius[:, 3]
    axes = FingerAxes(hand.distal, hand.dorsal, hand.abduction_sign * hand.flexion_axis)
    flexion, abduction = fitted_angles(at, hand.base, length, axes, bones.hand)
    return recording.changed(position=position, flexion=flexion, abduction=abduction)


def _fitted(
    recording: Recording, joints: FloatArray, bones: RecordedBones, mirror: FloatArray
) -> tuple[Recording, dict[str, FloatArray]]:
    """Return the recording in the angles of a hand with its own finger axes, and these axes and limits by file keys."""
    fingers = joints[:, 1:].reshape(-1, len(FINGERS), 4, 3)
    at = in_palm(fingers - recording.position[:, None, None], recording.orientation)
    axes = fitted_axes(at, bones.base, bones.hand)
    flexion, abduction = fitted_angles(at, bones.base, bones.length, axes, bones.hand)
    rms, largest = fit_error(at, finger_joints(bones.base, bones.length, flexion, abduction, axes))
    bones = replace(bones, rms=rms, largest=largest)
    fitted = recording.changed(flexion=flexion, abduction=abduction, bones=bones)
    worst = int(np.nanargmax(rms))
    text = f"finger axes fitted: joints {1e3 * rms[worst]:.1f} mm off (rms) in the {FINGERS[worst]}, less in the others"
    keys = {"distal": axes.distal * mirror, "dorsal": axes.dorsal * mirror}
    return fitted.found(note(text)), keys | recorded_limits(flexion, abduction, axes, bones.hand)


def check_hand_path(path: Path) -> None:
    """Raise OutputError if no hand file can be written: a wrong suffix, another kind of file, or no permission."""
    if path.suffix.lower() != ".toml":
        raise OutputError(f"{path} is no name for a hand file: it has to end in .toml")
    check_output_path(path, "hand file", holds(b"hand_length"))
