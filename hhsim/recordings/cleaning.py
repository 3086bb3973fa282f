"""Cleaning of a recording into a trajectory: faults are mended if that is safe, flagged in each sample, and reported.

Order: the part to keep, stamps, quaternions, outliers, missing values, signs, side, joint limits.
What is not safe to mend raises one line: what is wrong, where, and what would be right.

A step is impossible if it is faster than a hand (`Kind.speed`, above what is known of punches, flicks and pianists), a
sample if going there and back takes more than `Kind.force`. Runs of samples between two impossible steps are outliers:
their numbers become NaN, to be interpolated. What a hand could have done stays; suspect samples are flagged.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.motion.resample import interpolate_orientation
from hhsim.motion.sample_flags import MENDED, SampleFlag, mark, marked
from hhsim.motion.trajectory import MIN_QUATERNION_NORM, ObjectMotion, Phase, Trajectory, continuous_orientation
from hhsim.recordings.column_map import JOINT_NAMES
from hhsim.recordings.frames import FileFrame
from hhsim.recordings.recording import (
    FINGER_ARM,
    MOTION,
    OTHER,
    PALM_ARM,
    Finding,
    Recording,
    change,
    finding_of,
    note,
    turn,
)
from hhsim.recordings.unit_detection import near_origin
from hhsim.system.counted import counted
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

SAME_STAMP = 1e-6
"""Smallest time between different stamps [s]: no glove samples at 1 MHz."""
GAP_STEPS = 3.0 - 1e-6
"""Least length of a gap [median steps]: three, but for rounding."""
MOST_DROPPED = 0.25
"""Largest share of samples that may be left out."""
MAIN_PIECE_SHARE = 0.9
"""Share of the samples from which on a piece far from the others is the recording."""
PATH_RATIO = 1.02
"""Ratio of the hand's path sorted by stamps to its path in the file above which some stamps are wrong."""
TOO_LONG = "too long to bridge; cut a part out with --from and --to, or allow it with --max-gap"
FILLED = "interpolated, and at the ends the nearest one is held"

Way = Callable[[FloatArray, FloatArray], FloatArray]
"""Vectors from samples to others, shape (N, …); of quaternions rotation vectors [rad]."""


def _difference(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(second - first)


class Kind(NamedTuple):
    """Limits of a hand's motion in one kind of coordinate."""

    key: str  # field of a `Recording` that holds it; of joints, "angles"
    name: str  # name in messages
    unit: str
    speed: float  # fastest change [unit/s]
    force: float  # largest second derivative [unit/s²]
    noise: float  # largest change that is noise of the tracker [unit]
    outlier: SampleFlag  # flag of a sample that is replaced
    way: Way = _difference


POSITION = Kind("position", "palm position", "m", 10.0, 500.0, 0.01, SampleFlag.PALM_OUTLIER)
ORIENTATION = Kind("orientation", "palm orientation", "rad", 50.0, 4000.0, 0.15, SampleFlag.PALM_OUTLIER, turn)
JOINT = Kind("angles", "joint angle", "rad", 60.0, 5000.0, 0.25, SampleFlag.FINGERS_OUTLIER)

LONGEST_RUN = 0.25
"""Longest duration of an outlier [s]; a longer run is another place of the hand."""
LONGEST_COUNT = 25
MOST_JUMPS = 0.1
"""Largest share of jumps among the steps of a motion."""
SUSPECT_RATIO = 8.0
"""Ratio of a suspect sample's deviation to the usual one around it."""
SUSPECT_FLOOR = 0.008
"""Smallest deviation that is not noise [m of a fingertip]."""
JOINT_FLOOR = 1e-3
"""Smallest deviation of a recorded joint that is told [m]."""
WINDOW = 7
"""Samples on either side that the local deviation is taken from."""
MOST_DISORDER = 0.9
"""Largest ratio of one-step to two-step distances: 0.5 for a smooth motion, 0.71 for a random walk, 1 for no order."""
DISORDER_FLOOR = 0.02
"""Smallest mean step whose order matters [m of a fingertip]."""
FROZEN_RUN = 5
"""Number of equal samples in a row of a tracker that repeats itself."""

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


@dataclass(frozen=True)
class CleaningOptions:
    """Options of the cleaning."""

    max_gap: float = 1.0  # longest gap that is interpolated [s]
    start: float | None = None  # part to keep, on the stamps' clock [s]; None for all
    end: float | None = None
    # Hand whose limits the joint angles are clipped to, by default the usual one; None keeps them.
    limits: HandModel | None = field(default_factory=HandModel.default)
    # Make a right hand's motion of a left hand's, or the other way round: mirrored in the world's yz-plane.
    other_hand: bool = False


class CleanedRecording(NamedTuple):
    """Trajectory of a recording."""

    trajectory: Trajectory  # cleaned motion, with flags
    findings: tuple[Finding, ...]  # findings in the order of the steps

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
    if recording.object_motion is not None and options.other_hand:
        raise InputError("--other-hand would part the hand from the object, which moves as the recording has it")
    (recording,) = near_origin(recording.chosen(np.arange(recording.sample_count)))
    recording = _clean_stamps(_cut(recording, options.start, options.end), options.max_gap)
    recording = _unit_quaternions(recording)
    if recording.sample_count >= 8:
        # Medians: a few spikes are no disorder.
        one, two = (float(np.median(way)) for way in _ways(recording))
        if one > DISORDER_FLOOR and one > MOST_DISORDER * two:
            reason = f"neighbouring samples are as far apart ({1e3 * one:.0f} mm) as others"
            raise TrajectoryError(f"{reason}: the rows are no motion; are they out of order?")
    for kind in (POSITION, ORIENTATION, JOINT):
        recording = _without_outliers(recording, kind)
    recording = suspect_joints(_suspects(_frozen(recording)))
    recording = _filled(recording, options.max_gap)
    steady = continuous_orientation(recording.orientation, recording.time)
    flipped = (steady * recording.orientation).sum(axis=1) < 0.0
    text = "quaternions of the other sign than the one before: turned, the rotation is the same"
    recording = recording.changed(orientation=steady).flagged(flipped, SampleFlag.FLIPPED, text)
    if options.other_hand:
        other = OTHER[recording.hand]
        position, orientation = FileFrame.of("z", "x").poses(recording.position, recording.orientation)
        recording = recording.changed(position=position, orientation=orientation, hand=other)
        recording = recording.found(note(f"mirrored: x became -x{f', a {other} hand' if other else ''}"))
    if options.limits is not None:
        recording = _limited(recording, options.limits)
    first, last = float(recording.time[0]), float(recording.time[-1])
    phases = tuple(
        Phase(phase.name, max(phase.start_time, first), min(phase.end_time, last))
        for phase in recording.phases
        if phase.end_time > first and phase.start_time < last
    )
    held = {each.name: getattr(recording, each.name) for each in fields(Trajectory)}
    motion = Trajectory(**{key: value for key, value in held.items() if value is not None} | {"phases": phases})
    return CleanedRecording(motion, recording.findings)


def _cut(recording: Recording, start: float | None, end: float | None) -> Recording:
    if start is None and end is None:
        return recording
    low, high = -np.inf if start is None else start, np.inf if end is None else end
    inside = (recording.time >= low) & (recording.time <= high)
    if not inside.any():
        span = f"{np.nanmin(recording.time):.6g} to {np.nanmax(recording.time):.6g} s"
        raise InputError(f"no sample from {low:g} to {high:g} s; the recording has stamps from {span}")
    return recording.chosen(inside).found(note(f"cut to the samples from {low:g} to {high:g} s, as asked"))


def _clean_stamps(recording: Recording, max_gap: float) -> Recording:
    """Return samples with strictly increasing stamps and gaps up to `max_gap` [s].

    Samples out of order are sorted in if that makes the hand's path no longer; otherwise their stamps are wrong.
    """
    missing = np.isnan(recording.time)
    if missing.any():
        recording = _dropped(recording, ~missing, "without a time stamp: left out", "have no time stamp")
    time = recording.time
    if (np.diff(time) < 0.0).any():
        order = np.argsort(time, kind="stable")
        # The way of the hand through all samples in an order [m].
        ways = [float(change(recording, by[:-1], by[1:]).sum()) for by in (order, np.arange(len(time)))]
        late, early = time < np.maximum.accumulate(time), time > np.minimum.accumulate(time[::-1])[::-1]
        moved = late if late.sum() <= early.sum() else early
        if ways[0] <= PATH_RATIO * ways[1]:
            recording = recording.flagged(moved, SampleFlag.REORDERED, "out of order: sorted by their stamps")
            recording = recording.chosen(order)
        elif moved.sum() <= MOST_DROPPED * len(time):
            recording = _dropped(recording, ~moved, "whose stamp contradicts the motion around it: left out")
        else:
            first = int(np.argmax(np.diff(time) < 0.0)) + 1
            back = f"the stamps go backwards at sample {first} ({time[first - 1]:.6g} s, then {time[first]:.6g} s)"
            raise TrajectoryError(f"{back}, and sorted they give no one motion: are these two recordings in one file?")
    recording = _one_piece(_without_repeats(recording), max_gap)
    step = np.diff(recording.time)
    usual = float(np.median(step))
    gap = np.concatenate([[False], step > GAP_STEPS * usual])
    lengths = f"the longest {1e3 * step.max():.0f} ms where {1e3 * usual:.1f} ms is usual"
    return recording.flagged(gap, SampleFlag.GAP_BEFORE, f"gaps, {lengths}: the stamps stay, replays interpolate")


def _without_repeats(recording: Recording) -> Recording:
    time = recording.time
    repeat = np.concatenate([[False], np.diff(time) < SAME_STAMP])
    if not repeat.any():
        return recording
    # A run of close stamps must not be eaten up one by one: what counts is the distance to the last one kept.
    kept = -np.inf
    for i, stamp in enumerate(time.tolist()):
        repeat[i] = stamp - kept < SAME_STAMP
        kept = kept if repeat[i] else stamp
    pairs = ((getattr(recording, key)[1:], getattr(recording, key)[:-1]) for key in MOTION)
    same = all(np.array_equal(now[repeat[1:]], before[repeat[1:]], equal_nan=True) for now, before in pairs)
    how = "with the same values" if same else "with other values, of which the first are kept"
    what = "repeat the stamp before them"
    return _dropped(recording, ~repeat, f"{what}, {how}: left out", what)


def _one_piece(recording: Recording, max_gap: float) -> Recording:
    time = recording.time
    if time.shape[0] < 2:
        raise TrajectoryError(f"{counted(time.shape[0], 'usable sample')}; expected at least 2 with stamps that differ")
    broken = np.flatnonzero(np.diff(time) > max_gap) + 1
    if not broken.size:
        return recording
    edges = [0, *broken.tolist(), time.shape[0]]
    sizes = np.diff(edges)
    largest = int(np.argmax(sizes))
    if sizes[largest] >= MAIN_PIECE_SHARE * time.shape[0]:
        place = np.arange(time.shape[0])
        keep = (place >= edges[largest]) & (place < edges[largest + 1])
        return _dropped(recording, keep, f"more than {max_gap:g} s away from the others: left out")
    i = int(broken[0])
    raise TrajectoryError(f"no sample for {time[i] - time[i - 1]:.3g} s after {time[i - 1]:.6g} s: {TOO_LONG}")


def _dropped(recording: Recording, keep: BoolArray, why: str, fault: str = "") -> Recording:
    """Return the recording without the samples that are not kept; the next one in the file is flagged."""
    lost = int((~keep).sum())
    if fault and lost > MOST_DROPPED * len(keep):
        raise TrajectoryError(f"{lost} of {len(keep)} samples {fault}; expected a stamp of its own for each")
    if not keep.any():
        raise TrajectoryError("no usable sample is left; expected at least 2")
    kept = np.flatnonzero(keep)
    after = np.concatenate([[kept[0] > 0], np.diff(kept) > 1])
    left = recording.chosen(keep)
    mark(left.flags, after, SampleFlag.CUT_BEFORE)
    return left.found(finding_of(recording.time[~keep], SampleFlag.CUT_BEFORE, why))


def _unit_quaternions(recording: Recording) -> Recording:
    norm = np.linalg.norm(recording.orientation, axis=1)
    given = np.isfinite(norm)
    if not given.any():
        return recording
    usual = float(np.median(norm[given]))
    none = given & (norm < MIN_QUATERNION_NORM)
    damaged = none | given & (np.abs(norm - usual) > NORM_DAMAGE * usual)
    if usual < MIN_QUATERNION_NORM or damaged.sum() > MOST_FILLED * recording.sample_count:
        many = f"{int(damaged.sum())} of {recording.sample_count} samples"
        raise TrajectoryError(f"orientation is no unit quaternion in {many}; expected (w, x, y, z) of length 1")
    text = f"quaternions that are none ({int(none.sum())} of length zero, the rest off unit length): interpolated"
    recording = recording.changed(orientation=np.where(damaged[:, None], np.nan, recording.orientation))
    recording = recording.flagged(damaged, SampleFlag.PALM_FILLED, text)
    scaled = given & ~damaged & (np.abs(norm - 1.0) > NORM_TOLERANCE)
    text = f"quaternions not of unit length (median {usual:.4g}): scaled"
    return recording.flagged(scaled, SampleFlag.RENORMALISED, text)


def _ways(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Compute the distances of samples from the next ones, and from those after them [m]."""
    index = np.arange(recording.sample_count)
    return change(recording, index[:-1], index[1:]), change(recording, index[:-2], index[2:])


def _without_outliers(recording: Recording, kind: Kind) -> Recording:
    values, time, total = getattr(recording, kind.key), recording.time, recording.sample_count
    # The palm's coordinates are one vector, every joint moves by itself.
    width = 1 if kind is JOINT else values.shape[1]
    bad, jump, worst = np.zeros(values.shape, dtype=bool), np.zeros(total, dtype=bool), 0.0
    for first in range(0, values.shape[1], width):
        part, out = values[:, first : first + width], np.zeros(total, dtype=bool)
        # A quaternion of length zero is no orientation.
        index = np.flatnonzero(np.isfinite(part).all(axis=1) & (kind is not ORIENTATION or (part != 0.0).any(axis=1)))
        if index.size >= 3:
            runs = _mark_runs(time, index, part, kind, out, jump)
            worst = max(worst, runs, _mark_spikes(time, index[~out[index]], part, kind, out))
        bad[:, first : first + width] = out[:, None]
    outliers = np.asarray(bad.any(axis=1))
    found = int((outliers | jump).sum())
    if found > MOST_JUMPS * total + 3:
        raise TrajectoryError(
            f"the {kind.name} jumps at {found} of {total} samples, faster than {kind.speed:g} {kind.unit}/s: no hand "
            "moves so; are the rows out of order, or the stamps wrong?"
        )
    if outliers.any():
        clean = np.where(bad, np.nan, values)
        recording = recording.with_angles(clean) if kind is JOINT else recording.changed(**{kind.key: clean})
    text = f"{kind.name} off by up to {_amount(worst, kind.unit)}, which no hand does: interpolated"
    recording = recording.flagged(outliers, kind.outlier, text)
    text = f"{kind.name} jumps faster than {kind.speed:g} {kind.unit}/s and stays there: left as it is"
    return recording.flagged(jump, SampleFlag.JUMP, text)


def _mark_runs(
    time: FloatArray, index: IntArray, part: FloatArray, kind: Kind, bad: BoolArray, jump: BoolArray
) -> float:
    """Mark runs that the main motion cannot reach, or jumps where they are too long; return the largest deviation."""
    steps = np.linalg.norm(kind.way(part[index[:-1]], part[index[1:]]), axis=1)
    runs = np.split(index, np.flatnonzero(steps > kind.noise + kind.speed * np.diff(time[index])) + 1)
    longest = int(np.argmax([run.size for run in runs]))
    worst = 0.0
    for direction in (1, -1):
        # From the longest run outwards, each time from the last sample that was believed.
        believed = runs[longest]
        for run in runs[longest + 1 :] if direction > 0 else runs[:longest][::-1]:
            a, b = (believed[-1:], run[:1]) if direction > 0 else (run[-1:], believed[:1])
            off = float(np.linalg.norm(kind.way(part[a], part[b])))
            if off <= kind.noise + kind.speed * float(time[b[0]] - time[a[0]]):
                believed = run
            elif run.size <= LONGEST_COUNT and time[run[-1]] - time[run[0]] <= LONGEST_RUN:
                bad[run] = True
                worst = max(worst, off)
            else:
                jump[b] = True
                believed = run
    return worst


def _mark_spikes(time: FloatArray, index: IntArray, part: FloatArray, kind: Kind, bad: BoolArray) -> float:
    """Mark single samples that no force could have moved there and back; return the largest deviation."""
    if index.size < 3:
        return 0.0
    time, part = time[index], part[index]
    step, over = np.diff(time), np.linalg.norm(kind.way(part[:-2], part[2:]), axis=1)
    off = np.linalg.norm(_off_chord(time, part, kind.way), axis=1)
    spike = (2.0 * off > kind.force * step[:-1] * step[1:]) & (off > kind.noise) & (over < off)
    # The largest of neighbouring deviations is the spike: its neighbours' chords contain it.
    padded = np.concatenate([[0.0], off, [0.0]])
    spike &= (off >= padded[:-2]) & (off >= padded[2:])
    bad[index[1:-1][spike]] = True
    return float(off[spike].max(initial=0.0))


def _frozen(recording: Recording) -> Recording:
    rows = np.concatenate([recording.position, recording.orientation, recording.angles], axis=1)
    same = (rows[1:] == rows[:-1]).all(axis=1)
    frozen = np.zeros(len(rows), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))).reshape(-1, 2)
    for first, last in [] if same.all() else edges.tolist():
        frozen[first : last + 1] |= last - first + 1 >= FROZEN_RUN
    text = "the same numbers over and over: the tracker may have lost the hand; left as they are"
    return recording.flagged(frozen, SampleFlag.FROZEN, text)


def _suspects(recording: Recording) -> Recording:
    """Flag samples that a hand could do, but that differ from their neighbours, or stand in no order."""
    count = recording.sample_count
    if count < 2 * WINDOW + 2:
        return recording
    off = np.zeros(count)
    off[1:-1] = bend(recording)
    suspect = (off > SUSPECT_FLOOR) & (off > SUSPECT_RATIO * _usual(off))
    one, two = _ways(recording)
    ways, wide = (np.convolve(way, np.ones(2 * WINDOW), "same") / (2 * WINDOW) for way in (one[:-1], two))
    suspect[1:-1] |= (ways > SUSPECT_FLOOR) & (ways > MOST_DISORDER * wide)
    most = _amount(off[suspect].max(initial=0.0), "m")
    text = f"out of line with the samples around by up to {most} of a fingertip: left"
    return recording.flagged(suspect, SampleFlag.SUSPECT, text)


def suspect_joints(recording: Recording) -> Recording:
    """Flag samples with a joint out of line with the samples around, or a bone of another length; they stay."""
    joints, count = recording.joints, recording.sample_count
    if joints is None or count < 2 * WINDOW + 2:
        return recording
    off = np.zeros(joints.shape[:2])
    with np.errstate(divide="ignore", invalid="ignore"):
        off[1:-1] = np.linalg.norm(_off_chord(recording.time, joints), axis=2)
    fingers = joints[:, 1:].reshape(count, 5, 4, 3)
    length = np.linalg.norm(np.diff(fingers, axis=2), axis=-1).reshape(count, 15)
    known = np.isfinite(length).all(axis=1)
    stretch = np.abs(length - np.median(length[known], axis=0)) if known.any() else length
    off, stretch = np.nan_to_num(off), np.nan_to_num(stretch)
    text = "a joint out of line with the samples around, or a bone of another length, by up to {:.1f} mm: left"
    bent = (off > JOINT_FLOOR) & (off > SUSPECT_RATIO * _usual(off))
    stretched = (stretch > JOINT_FLOOR) & (stretch > SUSPECT_RATIO * np.median(stretch, axis=0))
    most = 1e3 * max(off[bent].max(initial=0.0), stretch[stretched].max(initial=0.0))
    return recording.flagged(bent.any(axis=1) | stretched.any(axis=1), SampleFlag.SUSPECT, text.format(most))


def _usual(off: FloatArray) -> FloatArray:
    """Return the usual deviation around each sample, shape (T, ...)."""
    padded = np.pad(off, [(WINDOW, WINDOW)] + [(0, 0)] * (off.ndim - 1), mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * WINDOW + 1, axis=0)
    # The sample and its two neighbours, whose chords contain it, are excluded.
    return np.asarray(np.median(np.delete(around, (WINDOW - 1, WINDOW, WINDOW + 1), axis=-1), axis=-1))


def bend(recording: Recording) -> FloatArray:
    """Compute the distance of each sample but the ends from the chord of its neighbours [m of a fingertip]."""
    time = recording.time
    parts = [_off_chord(time, values) for values in (recording.position, FINGER_ARM * recording.angles)]
    parts.append(PALM_ARM * _off_chord(time, recording.orientation, turn))
    return np.asarray(np.sqrt(sum(np.nansum(off * off, axis=1) for off in parts)))


def _off_chord(time: FloatArray, values: FloatArray, way: Callable[..., FloatArray] = _difference) -> FloatArray:
    """Return the vectors from the chords of samples' neighbours to all samples but the ends, shape (T - 2, …)."""
    share = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    return way(values[:-2], values[1:-1]) - share.reshape(-1, *[1] * (values.ndim - 1)) * way(values[:-2], values[2:])


def _amount(value: float, unit: str) -> str:
    return f"{1e3 * value:.0f} mm" if unit == "m" else f"{np.degrees(value):.0f}°"


def _filled(recording: Recording, max_gap: float) -> Recording:
    """Return the recording with the gaps in palm, angles and object interpolated, and findings about them."""
    time, angles, moved = recording.time, recording.angles, recording.object_motion
    pose, lost = _pose_filled(time, recording.position, recording.orientation, max_gap, "palm")
    missing = np.isnan(angles)
    for column, joint in enumerate(JOINT_NAMES):
        angles[:, [column]], _ = _holes_filled(time, angles[:, [column]], max_gap, joint)
    filled = recording.with_angles(angles).changed(position=pose.position, orientation=pose.orientation)
    # Gaps that another finding explains are not reported again.
    new = lost & ~marked(filled.flags, SampleFlag.PALM_FILLED | SampleFlag.PALM_OUTLIER)
    filled = filled.flagged(new, SampleFlag.PALM_FILLED, f"palm pose missing: {FILLED}")
    new = missing.any(axis=1) & ~marked(filled.flags, SampleFlag.FINGERS_OUTLIER)
    filled = filled.flagged(new, SampleFlag.FINGERS_FILLED, f"joint angles missing: {FILLED}")
    if moved is None:
        return filled
    none = np.linalg.norm(moved.orientation, axis=1) < MIN_QUATERNION_NORM
    whole = np.where(none[:, None], np.nan, moved.orientation)
    pose, lost = _pose_filled(time, moved.position, whole, max_gap, "object")
    filled = filled.changed(object_motion=pose)
    text = f"object pose missing: {FILLED}"
    return (
        filled.found(Finding("object", text, int(lost.sum()), float(time[np.argmax(lost)]))) if lost.any() else filled
    )


def _pose_filled(
    time: FloatArray, position: FloatArray, orientation: FloatArray, max_gap: float, what: str
) -> tuple[ObjectMotion, BoolArray]:
    """Return positions and quaternions with their gaps interpolated, and a mask of the gaps, shape (T,)."""
    position, first = _holes_filled(time, position, max_gap, f"{what} position")
    orientation, second = _holes_filled(time, orientation, max_gap, f"{what} orientation", turns=True)
    return ObjectMotion(position, orientation), first | second


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
        raise TrajectoryError(f"{what} is missing for {length:.3g} s after {place:.6g} s: {TOO_LONG}")
    if turns:
        within = np.clip(time, time[first], time[last])
        sound = continuous_orientation(values[good], time[good])
        made = interpolate_orientation(time[good] - time[0], sound, within - time[0])
    else:
        made = np.stack([np.interp(time, time[good], column[good]) for column in values.T], axis=1)
    return np.where(lost[:, None], made, values), lost


def _limited(recording: Recording, limits: HandModel) -> Recording:
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
    names += f" and {more} more" if more else ""
    text = f"joints beyond the hand's limits by up to {np.degrees(excess.max()):.0f}° ({names}): set to the limit{hint}"
    return changed.flagged(limited, SampleFlag.LIMITED, text)


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
        "hand_length": recording.hand_length,
        "mended": cleaned.mended,
        "flags": {flag.word: count for flag, count in counts.items()},
        "checksums": motion.checksums,
        "fit": None if recording.bones is None else recording.bones.to_json(),
        "flag_meanings": {flag.word: flag.meaning for flag in counts},
        "findings": [vars(finding) for finding in cleaned.findings],
    }
