"""Hand that fits the joint centres of a recording: bones, finger axes, limits and radii, as a hand file.

The axes of a finger follow from the planes through its base and joints. All of them contain the dorsal axis, about
which the finger abducts; it minimises the distances of the joints from the planes (variable projection: Golub &
Pereyra, SIAM J. Numer. Anal. 10, 1973).
"""

from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand import model
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import (
    NOISE_FLOOR,
    USUAL_ABDUCTION,
    FingerAxes,
    finger_axes,
    finger_joints,
    fit_error,
    fitted_angles,
    noise_of,
    plane_abduction,
    spread_samples,
    straight_flexion,
    usual_hand,
)
from hhsim.recordings.frames import in_palm, turned
from hhsim.recordings.recording import Recording, note

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
BREADTHS = (0.26, 0.74)
"""Range of hand breadths that the palm model takes [hand lengths]."""
FITTED = "--fit-hand"
"""Name of the fitted hand in messages."""
SHORTEST = 0.004
"""Shortest bone, to the centre of the fingertip [m]."""


def recorded_limits(
    flexion: FloatArray, abduction: FloatArray, axes: FingerAxes, side: HandSide
) -> dict[str, FloatArray]:
    """Return the default hand's limits, widened to hold recorded angles, by the keys of a hand file [rad].

    The angles have the shapes (T, 5, 3) and (T, 5), NaN where missing.
    """
    limits = {}
    for key, angles in (("flexion", flexion), ("abduction", abduction)):
        for end, outer, sign in (("min", np.fmin, -1.0), ("max", np.fmax, 1.0)):
            usual = getattr(usual_hand(), f"{key}_{end}").copy()
            if key == "flexion":
                usual[:, 0] += straight_flexion(axes, side)
            # A hand file has six decimals: rounding never cuts a recorded angle.
            limits[f"{key}_{end}"] = sign * np.ceil(sign * 1e6 * outer(usual, outer.reduce(angles, axis=0))) * 1e-6
    return limits


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
            own = _leaning(points[spread_samples(len(points))], FingerAxes(*(part[f] for part in usual)), TILTS[f])
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
        turn = plane_abduction(along, aside, noise)
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
        noise = noise_of((off**2).sum(axis=1), 2)
    distal, dorsal, across = _tilted(usual, tilt)
    # A finger that is always far aside has its zero moved, or its abduction would meet a limit.
    mean = float(plane_abduction((points @ distal).reshape(1, -1), (points @ across).reshape(1, -1), noise)[0])
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
    usual = usual_hand().base
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
        what = f"bone {bone + 1} of the {FINGERS[finger]} is too short"
        raise TrajectoryError(f"--fit-hand: {what}; expected more than {1e3 * SHORTEST:g} mm")
    mirror = model.MIRROR if bones.hand == "left" else np.ones(3)
    own: dict[str, FloatArray] = {}
    if recording.joints is not None:
        fingers = recording.joints[:, 1:].reshape(-1, len(FINGERS), 4, 3)
        at = in_palm(fingers - recording.position[:, None, None], recording.orientation)
        axes = fitted_axes(at, bones.base, bones.hand)
        flexion, abduction = fitted_angles(at, bones.base, bones.length, axes, bones.hand)
        rms, largest = fit_error(at, finger_joints(bones.base, bones.length, flexion, abduction, axes))
        off, worst = 1e3 * np.nanmax(rms), FINGERS[int(np.nanargmax(rms))]
        said = note(f"finger axes fitted: joints {off:.1f} mm off (rms) in the {worst}, less in the others")
        bones = replace(bones, rms=rms, largest=largest)
        recording = recording.changed(flexion=flexion, abduction=abduction, bones=bones).found(said)
        own = {"distal": axes.distal * mirror, "dorsal": axes.dorsal * mirror}
        own |= recorded_limits(flexion, abduction, axes, bones.hand)
    base = bones.base * mirror
    # From the recording's palm origin to that of this hand, palm frame [m].
    shift = base[1:].mean(axis=0) - ours["base"][1:].mean(axis=0)
    sizes = {"base": base - shift, "length": length} | own | ({} if bones.radius is None else {"radius": radius})
    rows = {finger: {key: values[f] for key, values in sizes.items()} for f, finger in enumerate(FINGERS)}
    radii = "radii in proportion to its length and breadth" if bones.radius is None else "radii as recorded"
    text = model.format_hand_file(bones.hand_length, breadth, rows, f"Fitted to {source}: bones as medians, {radii}.")
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
    flexion, abduction = fitted_angles(at, hand.base, length, FingerAxes.of(hand), bones.hand)
    return recording.changed(position=position, flexion=flexion, abduction=abduction)
