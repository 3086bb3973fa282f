"""Trajectory: time-stamped poses of the haptic hand, the pose of the object, and their origin.

World right-handed, z up; quaternions (w, x, y, z); fingers thumb, index, middle, ring, little; joints proximal to
distal. Positive flexion curls towards the palm, positive abduction turns a finger towards the thumb side.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, Self, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import Flags, FloatArray, IntArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.configuration import SHAPES
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_matrix
from hhsim.motion import resample
from hhsim.motion.sample_flags import DAMAGED, marked
from hhsim.system.counted import counted

MIN_QUATERNION_NORM = 1e-6
"""Shortest quaternion that has a direction."""
UNIT_TOLERANCE = 4.0 * float(np.finfo(np.float64).eps)
"""Largest deviation from unit length that is kept, so that a file read back holds the same bytes."""


def as_numbers(label: str, given: ArrayLike, shape: tuple[int, ...] | None = None, expected: str = "") -> FloatArray:
    """Return a float64 copy, C-contiguous, of any shape by default; messages may name the right one as `expected`.

    Raises TrajectoryError for no array of numbers, or one of another shape.
    """
    try:
        values = np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise TrajectoryError(f"{label} does not hold numbers") from None
    if shape is not None and values.shape != shape:
        raise TrajectoryError(f"{label} has shape {values.shape}; expected {expected or shape}")
    return values


def check_finite(label: str, values: FloatArray, time: FloatArray | None = None) -> None:
    """Raise TrajectoryError for NaN and infinity."""
    bad = ~np.isfinite(values)
    if bad.any():
        place = _place(np.argwhere(bad)[0], time)
        bad_count = counted(int(bad.sum()), "NaN or infinite value")
        raise TrajectoryError(f"{label} has {bad_count}, first at {place}; expected finite numbers")


def check_increasing(time: FloatArray) -> None:
    """Raise TrajectoryError for stamps that repeat or go backwards."""
    bad = np.flatnonzero(np.diff(time) <= 0.0) + 1
    if bad.size:
        i = int(bad[0])
        kind = "repeats" if time[i] == time[i - 1] else "goes backwards"
        raise TrajectoryError(
            f"time {kind} at sample {i} ({time[i - 1]:.9g} s, then {time[i]:.9g} s), "
            f"{counted(bad.size, 'such place')}; expected increasing stamps"
        )


def check_magnitude(label: str, values: FloatArray, limit: float, unit: str, question: str, time: FloatArray) -> None:
    """Raise TrajectoryError for values beyond `limit`, which are in another unit; `question` says which."""
    bad = np.abs(values) > limit
    if bad.any():
        first = np.argwhere(bad)[0]
        place = f"{values[tuple(first)]:.6g} at {_place(first, time)}"
        raise TrajectoryError(f"{label} is {place}, beyond {limit:.4g} {unit}: {question}; expected [{unit}]")


def continuous_orientation(quaternions: FloatArray, time: FloatArray, label: str = "orientation") -> FloatArray:
    """Return unit quaternions without sign flips, shape (T, 4); TrajectoryError for one of length zero or infinity."""
    with np.errstate(over="ignore"):
        norm = np.linalg.norm(quaternions, axis=1)
    faults = {"zero quaternion": norm < MIN_QUATERNION_NORM, "infinitely long quaternion": norm == np.inf}
    for what, wrong in faults.items():
        none = np.flatnonzero(wrong)
        if none.size:
            first = f"{counted(none.size, what)}, first at {_place(none[:1], time)}"
            raise TrajectoryError(f"{label} has {first}; expected unit (w, x, y, z)")
    off = np.abs(norm - 1.0) > UNIT_TOLERANCE
    unit = np.where(off[:, None], quaternions / norm[:, None], quaternions)
    flips = np.where(np.sum(unit[1:] * unit[:-1], axis=1) < 0.0, -1.0, 1.0)
    sign = np.concatenate([[1.0], np.cumprod(flips)])
    return np.ascontiguousarray(unit * sign[:, None])


def _place(index: IntArray, time: FloatArray | None) -> str:
    sample = int(index[0])
    place = f"sample {sample}"
    if len(index) > 1:
        place += f", channel {', '.join(str(i) for i in index[1:])}"
    return place if time is None else f"{place} (t = {time[sample]:.6g} s)"


HandSide = Literal["", "right", "left"]
Checksums = Literal["", "held", "missing"]
ResampleMode = Literal["interpolate", "hold"]
_Motion = TypeVar("_Motion", "TickInput", "Trajectory")

UNCHECKED = "some numbers are damaged, and not every one has a checksum: more damage may pass as motion"
"""Warning for a recording that `may_hide_damage`."""
MAX_ANGLE = 2.0 * np.pi
"""Largest joint angle, a full turn [rad]; beyond, the recording is in degrees."""
MAX_POSITION = 100.0
"""Largest coordinate of a palm [m]; beyond, the recording is in millimetres."""

MOST_TICKS = 36_000_000
"""Largest number of ticks of a replay, 10 hours at 1 kHz; beyond, a stamp is wrong or in another unit."""


class ObjectMotion(NamedTuple):
    """Frame of the object over time: origin [m], (T, 3), and orientation to the world, unit (w, x, y, z), (T, 4)."""

    position: FloatArray
    orientation: FloatArray

    @property
    def frame(self) -> "RigidMotion":
        """Motion from the frame to the world, at each pose."""
        return RigidMotion(self.orientation, self.position)

    def at(self, index: int | slice | IntArray) -> Self:
        """Return the poses of an index or a slice."""
        return type(self)(self.position[index], self.orientation[index])

    def since(self, position: FloatArray, orientation: FloatArray) -> "RigidMotion":
        """Compute the motion from a pose, shapes (3,) and (4,), to each of the object's."""
        turn = quaternion_product(self.orientation, conjugate(orientation))
        return RigidMotion(turn, self.position - _turned(turn, np.broadcast_to(position, self.position.shape)))


class RigidMotion(NamedTuple):
    """Transformation at each tick from the frame that moves with the object to the world: x ↦ turn · x + shift.

    Unit quaternions (w, x, y, z), shape (T, 4), and translations [m], shape (T, 3).
    """

    turn: FloatArray
    shift: FloatArray

    def at(self, index: slice | IntArray) -> Self:
        """Return the motion of some ticks."""
        return type(self)(self.turn[index], self.shift[index])

    def points(self, seen: FloatArray) -> FloatArray:
        """Transform points [m], shape (T, ..., 3), from the object's frame to the world."""
        return _turned(self.turn, seen) + _beside(self.shift, seen)

    def vectors(self, seen: FloatArray) -> FloatArray:
        """Transform vectors, shape (T, ..., 3), from the object's frame to the world."""
        return _turned(self.turn, seen)

    def orientations(self, seen: FloatArray) -> FloatArray:
        """Transform quaternions, shape (T, 4), from the object's frame to the world."""
        return quaternion_product(self.turn, seen)

    def seen_points(self, world: FloatArray) -> FloatArray:
        """Transform points [m], shape (T, ..., 3), from the world to the object's frame."""
        return _turned(conjugate(self.turn), world - _beside(self.shift, world))

    def seen_vectors(self, world: FloatArray) -> FloatArray:
        """Transform vectors, shape (T, ..., 3), from the world to the object's frame."""
        return _turned(conjugate(self.turn), world)

    def seen_hand(self, world: PlacedHand) -> PlacedHand:
        """Transform placed hands from the world to the object's frame."""
        return PlacedHand(
            self.seen_points(world.joints), self.seen_points(world.position), self.seen_orientations(world.orientation)
        )

    def seen_orientations(self, world: FloatArray) -> FloatArray:
        """Transform quaternions, shape (T, 4), from the world to the object's frame."""
        return quaternion_product(conjugate(self.turn), world)


def _beside(rows: FloatArray, values: FloatArray) -> FloatArray:
    """Insert the axes of `values` into rows of shape (T, 3)."""
    return rows.reshape(len(rows), *[1] * (values.ndim - 2), 3)


def _turned(turn: FloatArray, values: FloatArray) -> FloatArray:
    x, y, z = np.moveaxis(np.asarray(values, np.float64), -1, 0)
    matrix = rotation_matrix(turn).reshape(len(turn), *[1] * (x.ndim - 1), 3, 3)
    # Sums written out: the same bytes however many ticks there are at a time.
    return np.stack([matrix[..., i, 0] * x + matrix[..., i, 1] * y + matrix[..., i, 2] * z for i in range(3)], axis=-1)


@dataclass(frozen=True)
class Phase:
    """Named part of a motion: start_time <= t < end_time [s] on the stamps' clock.

    The last phase includes the last sample if it ends there.
    """

    name: str
    start_time: float
    end_time: float


class TickPhase(NamedTuple):
    """Phase in ticks, both ends included."""

    name: str
    first_tick: int
    last_tick: int

    def timed(self, time: FloatArray) -> Phase:
        """Return the phase by the ticks' stamps [s], up to where the next one begins, the last one to the last tick."""
        end = min(self.last_tick + 1, len(time) - 1)
        return Phase(self.name, float(time[self.first_tick]), float(time[end]))


def phase_names(phases: Iterable[Phase | TickPhase]) -> str:
    """Return the names of phases as the end of a repr; "" for none."""
    names = ", ".join(phase.name for phase in phases)
    return f"; {names}" if names else ""


@dataclass(frozen=True, eq=False, repr=False)
class TickInput:
    """Haptic hand at each tick of the replay; arrays are C-contiguous and writable, as the kernels take them."""

    time: FloatArray  # k / rate [s], 0 at the first sample, shape (N,)
    input_seq: IntArray  # index of the newest sample at or before the tick, shape (N,)
    # As in `Trajectory`, N rows.
    position: FloatArray
    orientation: FloatArray
    flexion: FloatArray
    abduction: FloatArray
    phases: tuple[TickPhase, ...]  # phases with at least one tick
    rate: float  # ticks a second [Hz]
    object_motion: ObjectMotion | None = None  # the object's pose at each tick; None if it stands still

    def __repr__(self) -> str:
        return f"TickInput({self.tick_count:,} ticks at {self.rate:g} Hz{phase_names(self.phases)})"

    @property
    def tick_count(self) -> int:
        """Number of ticks N."""
        return int(self.time.shape[0])

    def first(self, count: int) -> "TickInput":
        """Return the first ticks, at most `count`; a phase that goes on ends with the last one."""
        arrays = ("time", "input_seq", "position", "orientation", "flexion", "abduction")
        phases = [phase for phase in self.phases if phase.first_tick < count]
        return replace(
            self,
            **{name: getattr(self, name)[:count] for name in arrays},
            phases=tuple(phase._replace(last_tick=min(phase.last_tick, count - 1)) for phase in phases),
            object_motion=self.object_motion and self.object_motion.at(slice(count)),
        )

    def seen_from_object(self) -> "TickInput":
        """Return the hand in the frame that moves with the object, and is the world's at the first tick."""
        return _seen_from_object(self)


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """Checked motion: the constructor validates it.

    Quaternions become unit and without sign flips; all arrays are read-only copies.

    Raises TrajectoryError for wrong shape, no samples, NaN or infinity, stamps that do not increase, a quaternion of
    length zero, angles in degrees, positions in millimetres, phases out of order, flags that are no whole numbers.
    """

    time: FloatArray  # strictly increasing stamps [s], any rate, also irregular, shape (T,)
    position: FloatArray  # palm origin [m], shape (T, 3), world
    orientation: FloatArray  # palm to world, (w, x, y, z), shape (T, 4)
    flexion: FloatArray  # joint angles [rad], shape (T, 5, 3)
    abduction: FloatArray  # joint angles [rad], shape (T, 5)
    phases: tuple[Phase, ...] = ()  # in order of time, not overlapping
    # Object's origin [m], shape (3,), world; constant, or at the first sample.
    object_position: FloatArray = field(default_factory=lambda: np.zeros(3))
    # Object to world, (w, x, y, z), shape (4,); constant, or that of the first sample.
    object_orientation: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    name: str = ""
    source: str = ""  # person or program that made the motion
    licence: str = ""  # licence of the motion
    device: str = ""  # device that measured it; "" for synthetic motions
    hand: HandSide = ""  # side of the hand; "" if unknown, or if the motion fits both
    flags: Flags | None = None  # bits of `hhsim.motion.sample_flags.SampleFlag`, shape (T,); None if not examined
    # The object's pose at each sample, if it moves; one that stands still becomes the constant pose, and None here.
    object_motion: ObjectMotion | None = None
    # State of its recording: "held" if every number agreed with a checksum, "missing" if some have none, so that damage
    # may pass as motion; "" without a recording.
    checksums: Checksums = ""

    def __post_init__(self) -> None:
        time = as_numbers("time", self.time)
        if time.ndim != 1:
            raise TrajectoryError(f"time has shape {time.shape}; expected (T,), one stamp [s] a sample")
        count = time.shape[0]
        if count == 0:
            raise TrajectoryError("no samples; expected at least one")
        check_finite("time", time)
        check_increasing(time)
        checked = {"time": time}
        for label, tail in SHAPES.items():
            checked[label] = _rows(label, getattr(self, label), time, tail)
        checked["orientation"] = continuous_orientation(checked["orientation"], time)
        for label in ("flexion", "abduction"):
            check_magnitude(label, checked[label], MAX_ANGLE, "rad", "is it in degrees?", time)
        check_magnitude("position", checked["position"], MAX_POSITION, "m", "is it in millimetres?", time)
        object.__setattr__(self, "object_motion", self._checked_object_motion(time))
        checked["object_position"] = _constant("object_position", self.object_position, 3)
        pose = _constant("object_orientation", self.object_orientation, 4)
        checked["object_orientation"] = continuous_orientation(pose[None], time[:1], "object_orientation")[0]
        for label, values in checked.items():
            values.setflags(write=False)
            object.__setattr__(self, label, values)
        object.__setattr__(self, "phases", tuple(self.phases))
        _check_phases(self.phases)
        if self.hand not in get_args(HandSide):
            raise TrajectoryError(f"hand is '{self.hand}'; expected right, left, or nothing")
        if self.flags is not None:
            object.__setattr__(self, "flags", _checked_flags(self.flags, count))

    @property
    def may_hide_damage(self) -> bool:
        """True if damage was found in some samples, and no checksums prove the others."""
        return self.checksums == "missing" and self.flags is not None and bool(marked(self.flags, DAMAGED).any())

    def _checked_object_motion(self, time: FloatArray) -> ObjectMotion | None:
        """Return the object's motion if it moves; its first pose becomes the constant one."""
        if self.object_motion is None:
            return None
        position = _rows("object_position", self.object_motion.position, time, (3,))
        orientation = _rows("object_orientation", self.object_motion.orientation, time, (4,))
        check_magnitude("object_position", position, MAX_POSITION, "m", "is it in millimetres?", time)
        motion = ObjectMotion(position, continuous_orientation(orientation, time, "object_orientation"))
        object.__setattr__(self, "object_position", motion.position[0])
        object.__setattr__(self, "object_orientation", motion.orientation[0])
        for values in motion:
            values.setflags(write=False)
        still = all(bool((values == values[:1]).all()) for values in motion)
        return None if still else motion

    def __repr__(self) -> str:
        samples = f"{self.sample_count:,} samples in {self.duration:.3f} s"
        return f"Trajectory({self.name or 'motion'}: {samples}{phase_names(self.phases)})"

    @property
    def sample_count(self) -> int:
        """Number of samples T."""
        return int(self.time.shape[0])

    @property
    def duration(self) -> float:
        """Time from the first to the last stamp [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def mean_rate(self) -> float:
        """Samples a second [Hz], 0 for a single sample."""
        return (self.sample_count - 1) / self.duration if self.sample_count > 1 else 0.0

    def resampled(self, rate: float, mode: ResampleMode = "interpolate") -> TickInput:
        """Resample the motion to the ticks of a replay at `rate` [Hz].

        The mode "interpolate" is monotone cubic and slerp, without overshoot; "hold" gives each tick the newest sample,
        as from a glove that is slower than the loop. Raises InputError for a rate that is not positive, or an unknown
        mode; TrajectoryError for more ticks than `MOST_TICKS`.
        """
        if not (np.isfinite(rate) and rate > 0.0):
            raise InputError(f"tick rate {rate} Hz; expected a positive number")
        if mode not in get_args(ResampleMode):
            raise InputError(f"resampling mode '{mode}'; expected {' or '.join(get_args(ResampleMode))}")
        if self.duration * rate > MOST_TICKS:
            raise TrajectoryError(
                f"{self.name or 'motion'} lasts {self.duration:.6g} s, which is more than {MOST_TICKS:,} ticks at "
                f"{rate:g} Hz: is a stamp wrong, or not in seconds?"
            )
        # Stamps may be seconds since 1970: subtract first, so that the arithmetic keeps its nanoseconds.
        stamps = self.time - self.time[0]
        ticks = resample.tick_times(self.duration, rate)
        newest = resample.newest_sample(stamps, ticks)

        def at_ticks(values: FloatArray, way: Callable[..., FloatArray] = resample.interpolate_monotone) -> FloatArray:
            return values[newest] if mode == "hold" else way(stamps, values, ticks)

        palm = at_ticks(self.position), at_ticks(self.orientation, resample.interpolate_orientation)
        carrier = self.object_motion and ObjectMotion(
            at_ticks(self.object_motion.position),
            at_ticks(self.object_motion.orientation, resample.interpolate_orientation),
        )
        phases = _phase_ticks(self.phases, float(self.time[0]), ticks.shape[0], rate)
        joints = at_ticks(self.flexion), at_ticks(self.abduction)
        return TickInput(ticks, newest, *palm, *joints, phases, float(rate), carrier)

    def placed(self, object_position: ArrayLike, object_orientation: ArrayLike) -> Self:
        """Return it beside an object that stands still elsewhere: world, [m], shape (3,), (w, x, y, z), shape (4,)."""
        return replace(
            self,
            object_position=as_numbers("object_position", object_position),
            object_orientation=as_numbers("object_orientation", object_orientation),
            object_motion=None,
        )

    def seen_from_object(self) -> "Trajectory":
        """Return the motion in the frame that moves with the object, and is the world's at the first sample."""
        return _seen_from_object(self)


def _seen_from_object(motion: _Motion) -> _Motion:
    carrier = motion.object_motion
    if carrier is None:
        return motion
    moved = carrier.since(*carrier.at(0))
    seen = moved.seen_points(motion.position), moved.seen_orientations(motion.orientation)
    return replace(motion, position=seen[0], orientation=seen[1], object_motion=None)


def _rows(label: str, given: ArrayLike, time: FloatArray, tail: tuple[int, ...]) -> FloatArray:
    """Return finite numbers with one row a stamp."""
    shape = (len(time), *tail)
    values = as_numbers(label, given, shape, f"{shape} for {counted(len(time), 'stamp')}")
    check_finite(label, values, time)
    return values


def _constant(label: str, given: ArrayLike, size: int) -> FloatArray:
    values = as_numbers(label, given, (size,), f"({size},), one constant pose")
    check_finite(label, values)
    return values


def _check_phases(phases: tuple[Phase, ...]) -> None:
    end = -np.inf
    for phase in phases:
        span = f"phase '{phase.name}' from {phase.start_time:.6g} s to {phase.end_time:.6g} s"
        if not phase.name:
            raise TrajectoryError(f"{span} has no name")
        if not np.isfinite([phase.start_time, phase.end_time]).all() or phase.end_time < phase.start_time:
            raise TrajectoryError(f"{span}; expected finite times in order")
        if phase.start_time < end - resample.STAMP_TOLERANCE:
            raise TrajectoryError(f"{span} overlaps the one before, which ends at {end:.6g} s")
        end = phase.end_time


def _checked_flags(flags: Any, count: int) -> Flags:
    numbers = as_numbers("flags", flags, (count,), f"({count},), one number a sample")
    if not ((numbers >= 0.0) & (numbers < 2.0**32) & (numbers == np.floor(numbers))).all():
        raise TrajectoryError("flags holds what is no sum of bits; expected whole numbers from 0 to 2^32 - 1")
    checked = numbers.astype(np.uint32)
    checked.setflags(write=False)
    return checked


def _phase_ticks(phases: tuple[Phase, ...], start: float, tick_count: int, rate: float) -> tuple[TickPhase, ...]:
    found = []
    for phase in phases:
        first = max(0, int(np.ceil((phase.start_time - start - resample.STAMP_TOLERANCE) * rate)))
        end = int(np.ceil((phase.end_time - start - resample.STAMP_TOLERANCE) * rate))
        if phase is phases[-1] and end == tick_count - 1:
            end = tick_count
        last = min(tick_count, end) - 1
        if last >= first:
            found.append(TickPhase(phase.name, first, last))
    return tuple(found)
