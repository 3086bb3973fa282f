"""Cleaning of a recording into a trajectory: faults are mended if that is safe, flagged in each sample, and reported.

Order: units, the part to keep, stamps, quaternions, outliers, missing values, signs, scale and side, joint limits.
What is not safe to mend raises one line: what is wrong, where, and what would be right.
"""

from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.motion.resample import interpolate_orientation
from hhsim.motion.sample_flags import MENDED, SampleFlag, marked
from hhsim.motion.trajectory import MIN_QUATERNION_NORM, ObjectMotion, Phase, Trajectory, continuous_orientation
from hhsim.recordings.column_map import JOINT_NAMES
from hhsim.recordings.finger_ik import finger_axes, finger_joints, usual_fingers
from hhsim.recordings.frames import axis_flip, mirrored
from hhsim.recordings.outliers import clean_glitches
from hhsim.recordings.recorded_bones import RecordedBones
from hhsim.recordings.recording import OTHER, Finding, Recording, note
from hhsim.recordings.timestamp_cleaning import clean_stamps
from hhsim.recordings.unit_detection import clean_units, in_units, near_origin
from hhsim.table.table import number, words

NORM_TOLERANCE = 1e-3
"""Deviation from unit length of a quaternion that was only rounded."""
NORM_DAMAGE = 0.02
"""Relative deviation from the usual length of a quaternion with a wrong component."""
MOST_FILLED = 0.5
"""Largest share of samples that may be interpolated."""
LIMIT_TOLERANCE = 1e-6
"""Excess over a joint limit that is rounding [rad]."""
OFTEN = 0.3
"""Share of samples beyond a limit above which the joint's zero is probably elsewhere."""

FINDING_COLUMNS = (
    words("finding", lambda finding: finding.kind.replace("_", " ")),
    number("samples", lambda finding: finding.samples or ""),
    number("first at", "first_time", "s", 3, missing=""),
    words("what, and what was done", "text"),
)
FIT_COLUMNS = (
    words("finger", 0),
    number("fit, rms", 1, "mm", 2),
    number("fit, max", 2, "mm", 2),
    *(number(f"bone {i}", 2 + i, "mm", 1) for i in (1, 2, 3)),
)


class JointLimits(NamedTuple):
    """Range of a hand's joints [rad]: flexion (5, 3), abduction (5,)."""

    flexion_min: FloatArray
    flexion_max: FloatArray
    abduction_min: FloatArray
    abduction_max: FloatArray


def default_limits() -> JointLimits:
    """Return the limits of the default hand; they do not depend on its size."""
    return JointLimits(*(usual_fingers()[key] for key in JointLimits._fields))


@dataclass(frozen=True)
class CleaningOptions:
    """Options of the cleaning."""

    max_gap: float = 1.0  # longest gap that is interpolated [s]
    start: float | None = None  # part to keep, on the stamps' clock [s]; None for all
    end: float | None = None
    # Units of the numbers in the file; None if it states them, or to detect them.
    time_unit: str | None = None
    length_unit: str | None = None
    angle_unit: str | None = None
    # Limits, or the hand with the limits, that joint angles are clipped to; None keeps them.
    limits: JointLimits | HandModel | None = field(default_factory=default_limits)
    # Make a right hand's motion of a left hand's, or the other way round: mirrored in the world's yz-plane.
    other_hand: bool = False
    hand_length: float | None = None  # length of the recorded hand [m]; None if the recording says it or it is unknown
    # Hand length [m] that the palm's motion is scaled to, about its mean; None keeps it metric.
    scale_to: float | None = None


class CleanedRecording(NamedTuple):
    """Trajectory of a recording."""

    trajectory: Trajectory  # cleaned motion, with flags
    findings: tuple[Finding, ...]  # findings in the order of the steps
    hand_length: float | None  # length of the recorded hand [m]; None if unknown
    given: Recording  # recording in our units, before its samples were cleaned

    @property
    def mended(self) -> int:
        """Number of samples of which a number was changed."""
        flags = self.trajectory.flags
        return int(marked(flags, MENDED).sum()) if flags is not None else 0


def clean_recording(recording: Recording, options: CleaningOptions | None = None) -> CleanedRecording:
    """Make a trajectory of a recording, which itself stays unchanged.

    Raises TrajectoryError for nothing in it, or a fault that cannot be mended safely; InputError for options that
    contradict each other or the recording.
    """
    options = options or CleaningOptions()
    if recording.sample_count == 0:
        raise TrajectoryError("no samples; expected at least 2")
    if recording.object_motion is not None and (options.other_hand or options.scale_to is not None):
        option = "--other-hand" if options.other_hand else "--scale-to"
        raise InputError(f"{option} would part the hand from the object, which moves as the recording has it")
    recording = recording.chosen(np.arange(recording.sample_count))
    recording = in_units(recording, time=options.time_unit, length=options.length_unit, angle=options.angle_unit)
    (recording,) = near_origin(clean_units(recording))
    given = _cut(recording, options.start, options.end)
    recording = clean_stamps(given, options.max_gap)
    recording = _unit_quaternions(recording)
    recording = clean_glitches(recording)
    recording = _object_filled(_filled(recording, options.max_gap), options.max_gap)
    recording = _steady_signs(recording)
    recording = _mirrored(_scaled(recording, options), options.other_hand)
    recording = _limited(recording, options.limits)
    return CleanedRecording(_trajectory(recording), recording.findings, recording.hand_length, given)


def _cut(recording: Recording, start: float | None, end: float | None) -> Recording:
    if start is None and end is None:
        return recording
    low, high = -np.inf if start is None else start, np.inf if end is None else end
    inside = (recording.time >= low) & (recording.time <= high)
    if not inside.any():
        span = f"{np.nanmin(recording.time):.6g} to {np.nanmax(recording.time):.6g} s"
        raise InputError(f"no sample from {low:g} to {high:g} s; the recording has stamps from {span}")
    return recording.chosen(inside).found(note(f"cut to the samples from {low:g} to {high:g} s, as asked"))


def _unit_quaternions(recording: Recording) -> Recording:
    norm = np.linalg.norm(recording.orientation, axis=1)
    given = np.isfinite(norm)
    if not given.any():
        return recording
    usual = float(np.median(norm[given]))
    damaged = given & (norm < MIN_QUATERNION_NORM) | given & (np.abs(norm - usual) > NORM_DAMAGE * usual)
    if usual < MIN_QUATERNION_NORM or damaged.sum() > MOST_FILLED * recording.sample_count:
        raise TrajectoryError(
            f"orientation is no unit quaternion in {int((damaged | (given & (norm < MIN_QUATERNION_NORM))).sum())} of "
            f"{recording.sample_count} samples (median length {usual:.3g}); expected (w, x, y, z) of length 1"
        )
    zero = int((norm[damaged] < MIN_QUATERNION_NORM).sum())
    text = f"quaternions that are none ({zero} of length zero, the rest off unit length): interpolated"
    recording = recording.changed(orientation=np.where(damaged[:, None], np.nan, recording.orientation))
    recording = recording.flagged(damaged, SampleFlag.PALM_FILLED, text)
    scaled = given & ~damaged & (np.abs(norm - 1.0) > NORM_TOLERANCE)
    text = f"quaternions not of unit length (median {usual:.4g}): scaled"
    return recording.flagged(scaled, SampleFlag.RENORMALISED, text)


def _filled(recording: Recording, max_gap: float) -> Recording:
    time, angles = recording.time, recording.angles
    position, orientation, lost = _pose_filled(time, recording.position, recording.orientation, max_gap, "palm")
    missing = np.isnan(angles)
    for column, joint in enumerate(JOINT_NAMES):
        if missing[:, column].any():
            angles[:, column : column + 1], _ = _holes_filled(time, angles[:, column : column + 1], max_gap, joint)
    filled = recording.with_angles(angles).changed(position=position, orientation=orientation)
    # Gaps that another finding explains are not reported again.
    new = lost & ~marked(filled.flags, SampleFlag.PALM_FILLED | SampleFlag.PALM_OUTLIER)
    filled = filled.flagged(new, SampleFlag.PALM_FILLED, f"palm pose missing: {_way_filled(lost)}")
    new = missing.any(axis=1) & ~marked(filled.flags, SampleFlag.FINGERS_OUTLIER)
    return filled.flagged(new, SampleFlag.FINGERS_FILLED, f"joint angles missing: {_way_filled(missing)}")


def _way_filled(missing: BoolArray) -> str:
    """Say how gaps were filled that are missing in rows of a mask, shape (T, …)."""
    known = ~missing
    between = missing & np.logical_or.accumulate(known) & np.logical_or.accumulate(known[::-1])[::-1]
    if (between == missing).all():
        return "interpolated"
    held = "the nearest one is held at the beginning or the end"
    return f"interpolated; {held}" if between.any() else held


def _object_filled(recording: Recording, max_gap: float) -> Recording:
    """Return the recording with the gaps in its object's motion filled as the palm's are."""
    moved = recording.object_motion
    if moved is None:
        return recording
    none = np.linalg.norm(moved.orientation, axis=1) < MIN_QUATERNION_NORM
    whole = np.where(none[:, None], np.nan, moved.orientation)
    position, orientation, lost = _pose_filled(recording.time, moved.position, whole, max_gap, "object")
    filled = recording.changed(object_motion=ObjectMotion(position, orientation))
    if not lost.any():
        return filled
    text = f"object pose missing: {_way_filled(lost)}"
    return filled.found(Finding("object", text, int(lost.sum()), float(recording.time[np.argmax(lost)])))


def _pose_filled(
    time: FloatArray, position: FloatArray, orientation: FloatArray, max_gap: float, what: str
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return positions and quaternions with their gaps interpolated, and a mask of the gaps, shape (T,)."""
    position, first = _holes_filled(time, position, max_gap, f"{what} position")
    orientation, second = _holes_filled(time, orientation, max_gap, f"{what} orientation", turns=True)
    return position, orientation, first | second


def _holes_filled(
    time: FloatArray, values: FloatArray, max_gap: float, what: str, *, turns: bool = False
) -> tuple[FloatArray, BoolArray]:
    """Return values, or quaternions (`turns`), with their gaps interpolated, shape (T, C), and a mask of the gaps."""
    lost = np.asarray(np.isnan(values).any(axis=1))
    if not lost.any():
        return values, lost
    if lost.all():
        raise TrajectoryError(f"{what} is missing in every sample; if there is none, leave it out of the mapping")
    if lost.mean() > MOST_FILLED:
        raise TrajectoryError(f"{what} is missing in {int(lost.sum())} of {lost.size} samples; too many to make up")
    good = np.flatnonzero(~lost)
    first, last = good[0], good[-1]
    ends = [(time[first] - time[0], time[0]), (time[-1] - time[last], time[last])]
    inside = np.flatnonzero(np.diff(good) > 1)
    length, place = max(*ends, *zip(np.diff(time[good])[inside], time[good][inside]))
    if length > max_gap:
        raise TrajectoryError(
            f"{what} is missing for {length:.3g} s after {place:.6g} s: too long to bridge; cut a part out with --from "
            "and --to, or allow it with --max-gap"
        )
    if turns:
        within = np.clip(time, time[first], time[last])
        sound = continuous_orientation(values[good], time[good])
        made = interpolate_orientation(time[good] - time[0], sound, within - time[0])
    else:
        made = np.stack([np.interp(time, time[good], column[good]) for column in values.T], axis=1)
    return np.where(lost[:, None], made, values), lost


def _steady_signs(recording: Recording) -> Recording:
    steady = continuous_orientation(recording.orientation, recording.time)
    flipped = (steady * recording.orientation).sum(axis=1) < 0.0
    text = "quaternions of the other sign than the one before: turned, the rotation is the same"
    return recording.changed(orientation=steady).flagged(flipped, SampleFlag.FLIPPED, text)


def _scaled(recording: Recording, options: CleaningOptions) -> Recording:
    length = options.hand_length if options.hand_length is not None else recording.hand_length
    if options.scale_to is None:
        return recording.changed(hand_length=length)
    if length is None:
        raise InputError("--scale-to needs the length of the recorded hand: say it with --hand-length")
    factor = options.scale_to / length
    middle = recording.position.mean(axis=0)
    lengths = f"from a hand of {1e3 * length:.0f} mm to one of {1e3 * options.scale_to:.0f} mm"
    text = f"palm's way scaled by {factor:.3f}, {lengths}"
    scaled = recording.changed(position=middle + factor * (recording.position - middle), hand_length=length)
    return scaled.found(note(text))


def _mirrored(recording: Recording, wanted: bool) -> Recording:
    if not wanted:
        return recording
    other = OTHER[recording.hand]
    position, orientation = mirrored(recording.position, recording.orientation, axis_flip("x"))
    changed = recording.changed(position=position, orientation=orientation, hand=other)
    return changed.found(note(f"mirrored: x became -x{f', a {other} hand' if other else ''}"))


def _limited(recording: Recording, limits: JointLimits | HandModel | None) -> Recording:
    if limits is None:
        return recording
    angles = recording.angles
    least = np.concatenate([limits.flexion_min.ravel(), limits.abduction_min])
    most = np.concatenate([limits.flexion_max.ravel(), limits.abduction_max])
    clipped = np.clip(angles, least, most)
    excess = np.abs(angles - clipped)
    beyond = excess > LIMIT_TOLERANCE
    changed = recording.with_angles(clipped)
    limited = np.asarray(beyond.any(axis=1))
    if not limited.any():
        return changed
    share = beyond.mean(axis=0)
    worst = [column for column in np.argsort(-share, kind="stable")[:3] if share[column] > 0.0]
    names = ", ".join(f"{JOINT_NAMES[c]} {100.0 * share[c]:.0f} %" for c in worst)
    more = int((share > 0.0).sum()) - len(worst)
    hint = "; is a zero elsewhere? A mapping can shift it" if share.max() > OFTEN else ""
    text = (
        f"joints beyond the hand's limits by up to {np.degrees(excess.max()):.0f}° ({names}"
        f"{f' and {more} more' if more else ''}): set to the limit, which moves a fingertip by up to "
        f"{1e3 * _tips_moved(recording, changed):.0f} mm{hint}"
    )
    return changed.flagged(limited, SampleFlag.LIMITED, text)


def _tips_moved(first: Recording, second: Recording) -> float:
    """Compute the largest distance between the fingertips of two recordings of one hand, palm frame [m]."""
    length = usual_fingers()["length"] if first.bones is None else first.bones.length
    origin, axes = np.zeros((len(FINGERS), 3)), finger_axes(first.hand)
    tips = [finger_joints(origin, length, r.flexion, r.abduction, axes)[:, :, 3] for r in (first, second)]
    return float(np.linalg.norm(tips[1] - tips[0], axis=2).max())


def _trajectory(recording: Recording) -> Trajectory:
    first, last = float(recording.time[0]), float(recording.time[-1])
    phases = tuple(
        Phase(phase.name, max(phase.start_time, first), min(phase.end_time, last))
        for phase in recording.phases
        if phase.end_time > first and phase.start_time < last
    )
    given = {field.name: getattr(recording, field.name) for field in fields(Trajectory)}
    return Trajectory(**{key: value for key, value in given.items() if value is not None} | {"phases": phases})


def fit_rows(fit: RecordedBones) -> list[tuple[Any, ...]]:
    """Return rows of finger, RMS and largest error of the fit [m], and its bones [m], for `FIT_COLUMNS`."""
    return list(zip(FINGERS, fit.rms, fit.largest, *fit.length.T))


def import_document(recording: Recording, cleaned: CleanedRecording) -> dict[str, Any]:
    """Return format, samples, times [s], rate [Hz], hand, findings and flags of an import as a document, SI units."""
    motion = cleaned.trajectory
    flags = motion.flags if motion.flags is not None else np.zeros(motion.sample_count, dtype=np.uint32)
    counts = {flag: count for flag in SampleFlag if (count := int(marked(flags, flag).sum()))}
    return {
        "format": recording.form,
        "samples_in": recording.sample_count,
        "samples_out": motion.sample_count,
        "duration": motion.duration,
        "mean_rate": motion.mean_rate,
        "longest_step": float(np.diff(motion.time).max(initial=0.0)),
        "hand": motion.hand,
        "hand_length": cleaned.hand_length,
        "mended": cleaned.mended,
        "flags": {flag.word: count for flag, count in counts.items()},
        "checksums": motion.checksums,
        "fit": None if recording.bones is None else recording.bones.to_json(),
        "flag_meanings": {flag.word: flag.meaning for flag in counts},
        "findings": [vars(finding) for finding in cleaned.findings],
    }
