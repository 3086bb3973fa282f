"""Recording as a device or a file gave it: unchecked, with missing samples, and its reader's findings.

Formats (`hhsim.recordings.formats`) read one; `hhsim.recordings.cleaning` turns it into a
`hhsim.motion.trajectory.Trajectory`, or refuses it. A missing number is NaN.

The distance between samples is one length: a rotation of the palm counts as the displacement of a point at `PALM_ARM`,
a joint angle as that of a fingertip.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray, BoolArray, Flags, FloatArray, IntArray
from hhsim.errors import TrajectoryError
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_vector
from hhsim.motion.sample_flags import SampleFlag, mark
from hhsim.motion.trajectory import Checksums, HandSide, ObjectMotion, Phase, as_numbers
from hhsim.recordings.finger_ik import RecordedBones
from hhsim.recordings.frames import FileFrame
from hhsim.system.counted import counted

MOST_SAMPLES = 10_000_000
"""Largest number of samples of a hand recording: three hours at 1 kHz."""
MOST = (1e9, 1e20)
"""Largest magnitude of a reading of a motion, and of a clock, in any unit."""
PALM_ARM = 0.1
"""Distance from the palm's origin to a straight fingertip [m]."""
FINGER_ARM = 0.04
"""Usual distance from a joint to the fingertip [m]."""
UNUSED_POSE = "unused pose"
"""Kind of the finding that names what looks like the pose of an object and is not used."""
SIDES: tuple[HandSide, HandSide] = ("right", "left")
OTHER: dict[HandSide, HandSide] = {"right": "left", "left": "right", "": ""}
"""Other side of each."""


@dataclass(frozen=True)
class Finding:
    """Line about a fault in a recording and its repair."""

    kind: str  # a word of `hhsim.motion.sample_flags.SampleFlag`, or "note"
    text: str
    samples: int = 0  # number of samples with it; 0 if it is not about single samples
    first_time: float | None = None  # stamp of the first of them [s], or None


def note(text: str) -> Finding:
    """Return a remark that is not about single samples."""
    return Finding("note", text)


def finding_of(time: FloatArray, flag: SampleFlag, text: str) -> Finding:
    """Return the finding about samples with these stamps, NaN where missing, shape (N,)."""
    known = time[np.isfinite(time)]
    return Finding(flag.word, text, len(time), float(known.min()) if known.size else None)


def unused_poses(recording: "Recording") -> tuple[str, ...]:
    """Return the remarks on what looks like the pose of an object that has none otherwise."""
    if recording.object_motion is not None:
        return ()
    return tuple(finding.text for finding in recording.findings if finding.kind == UNUSED_POSE)


def readings(key: str, given: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return a float64 copy with NaN for what is no reading; raise TrajectoryError for another shape."""
    values = as_numbers(key, given, shape, f"{shape} for {counted(shape[0], 'stamp')}")
    # Infinity is as little a reading as NaN is, and what overflows when it is squared.
    with np.errstate(invalid="ignore"):
        values[~(np.abs(values) <= MOST[key == "time"])] = np.nan
    return values


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples as they came, in our frames and units if known; fields of a `Trajectory` are as there, or commented."""

    # Stamps [s], or in another unit if `stated` lacks "time"; any order, NaN where missing, shape (T,).
    time: FloatArray
    position: FloatArray  # palm origin [m, or another unit if `stated` lacks "length"], world, shape (T, 3)
    orientation: FloatArray  # palm to world (w, x, y, z), any length and sign, shape (T, 4)
    flexion: FloatArray  # [rad, or another unit if `stated` lacks "angle"], shape (T, 5, 3)
    abduction: FloatArray  # the same, shape (T, 5)
    # Flags that the reader set, shape (T,); empty for none.
    flags: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    # Units that the file or the user stated, which are not detected: "time", "length", "angle".
    stated: frozenset[str] = frozenset()
    form: str = ""  # name of the format
    name: str = ""
    source: str = ""
    licence: str = ""
    device: str = ""
    hand: HandSide = ""
    hand_length: float | None = None  # length from wrist crease to middle fingertip [m]; None if unknown
    # Bones of the recorded hand, with the error of the fit; None without joint centres.
    bones: RecordedBones | None = None
    phases: tuple[Phase, ...] = ()
    object_position: FloatArray | None = None
    object_orientation: FloatArray | None = None
    findings: tuple[Finding, ...] = ()
    # The object's pose at each sample, in the palm's world and units, NaN where missing; None without any.
    object_motion: ObjectMotion | None = None
    object_metric: bool = False  # True if the object's positions are in m, whatever unit the palm's are in
    checksums: Checksums = ""
    # Joint centres as recorded, in the order of `hhsim.recordings.joint_names.KEYPOINTS` [m], our world, NaN where
    # missing, shape (T, 21, 3); None if the file holds angles.
    joints: FloatArray | None = None
    file_frame: FileFrame = field(default_factory=FileFrame)  # coordinates of the file's joints or palm
    angle_unit: float = 1.0  # unit of the file's angles [rad]
    # Row, line or frame of the file that each sample was read from, shape (T,); empty for all in order.
    rows: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    first_stamp: float = 0.0  # stamp of the file [s] at which `time` is zero
    is_written_back: bool = True  # False if its file is read and not written: what is corrected needs a new file

    def __post_init__(self) -> None:
        count = len(np.atleast_1d(self.time))
        if count > MOST_SAMPLES:
            raise TrajectoryError(f"{count:,} samples; expected at most {MOST_SAMPLES:,}")
        tails = {"time": (), "position": (3,), "orientation": (4,), "flexion": (5, 3), "abduction": (5,)}
        tails |= {} if self.joints is None else {"joints": (21, 3)}
        for key, tail in tails.items():
            object.__setattr__(self, key, readings(key, getattr(self, key), (count, *tail)))
        if self.object_motion is not None:
            position = readings("object's position", self.object_motion.position, (count, 3))
            orientation = readings("object's orientation", self.object_motion.orientation, (count, 4))
            object.__setattr__(self, "object_motion", ObjectMotion(position, orientation))
        rows = self.rows if len(self.rows) else np.arange(count)
        object.__setattr__(self, "rows", np.asarray(rows, dtype=np.int64))
        flags = np.array(self.flags, dtype=np.uint32) if len(self.flags) else np.zeros(count, dtype=np.uint32)
        if flags.shape != (count,):
            raise TrajectoryError(f"flags has shape {flags.shape}; expected ({count},)")
        object.__setattr__(self, "flags", flags)

    @property
    def sample_count(self) -> int:
        """Number of samples T."""
        return int(self.time.shape[0])

    def chosen(self, index: AnyArray) -> Self:
        """Return the samples of these indices (or of a mask), in this order."""
        samples = {key: getattr(self, key)[index] for key in ("time", *MOTION, "flags", "rows")}
        samples |= {} if self.joints is None else {"joints": self.joints[index]}
        return replace(self, **samples, object_motion=self.object_motion and self.object_motion.at(index))

    def resized(self, factor: float) -> Self:
        """Return it with the positions of palm, joints and object times a factor."""
        moved = self.object_motion
        moved = moved and moved._replace(position=moved.position * (1.0 if self.object_metric else factor))
        joints = None if self.joints is None else self.joints * factor
        frame = self.file_frame._replace(metre=self.file_frame.metre * factor)
        return replace(self, position=self.position * factor, object_motion=moved, joints=joints, file_frame=frame)

    def shifted(self, step: FloatArray) -> Self:
        """Return it with palm, joints and object moved by a step in its world, shape (3,); its file's frame stays."""
        moved, still = self.object_motion, self.object_position
        moved = moved and moved._replace(position=moved.position + step)
        joints = None if self.joints is None else self.joints + step
        still = None if still is None else still + step
        at = self.position + step
        return replace(self, position=at, object_motion=moved, object_position=still, joints=joints)

    def changed(self, **fields: Any) -> Self:
        """Return it with these fields replaced."""
        return replace(self, **fields)

    def found(self, *findings: Finding) -> Self:
        """Return it with these findings added."""
        return replace(self, findings=(*self.findings, *findings))

    def flagged(self, where: BoolArray, flag: SampleFlag, text: str) -> Self:
        """Return it with a flag on the samples `where`, shape (T,), and a finding about them; unchanged if none."""
        if not where.any():
            return self
        mark(self.flags, where, flag)
        return self.found(finding_of(self.time[where], flag, text))

    @property
    def angles(self) -> FloatArray:
        """Flexion finger by finger, then abduction, shape (T, 20)."""
        return np.concatenate([self.flexion.reshape(self.sample_count, 15), self.abduction], axis=1)

    def with_angles(self, angles: FloatArray) -> Self:
        """Return it with other `angles`."""
        return self.changed(flexion=angles[:, :15].reshape(-1, 5, 3), abduction=angles[:, 15:])


MOTION = ("position", "orientation", "flexion", "abduction")
"""Fields of a motion with one row a sample."""


def turn(first: FloatArray, second: FloatArray) -> FloatArray:
    """Compute rotation vectors [rad] from quaternions of any length `first` to `second`, in the frame of `first`."""
    with np.errstate(invalid="ignore", divide="ignore"):
        a = first / np.linalg.norm(first, axis=-1, keepdims=True)
        b = second / np.linalg.norm(second, axis=-1, keepdims=True)
        return rotation_vector(quaternion_product(conjugate(a), b))


def change(recording: Recording, first: IntArray, second: IntArray) -> FloatArray:
    """Compute the distance of samples `second` from samples `first` [m]; missing numbers count as unchanged."""
    parts = [
        recording.position[second] - recording.position[first],
        PALM_ARM * turn(recording.orientation[first], recording.orientation[second]),
        FINGER_ARM * (recording.flexion[second] - recording.flexion[first]).reshape(len(first), -1),
        FINGER_ARM * (recording.abduction[second] - recording.abduction[first]),
    ]
    return np.asarray(np.sqrt(sum(np.nansum(part * part, axis=1) for part in parts)))
