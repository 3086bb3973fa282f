"""Detection of units by what no hand can do, and conversion if only one unit fits.

Stamps whose median step is above 0.5 s are ms, µs or ns, whichever gives 10 to 1,000 Hz. A palm far away that sweeps
0.001 to 0.5 at a hand's speed is in metres; positions of which most are farther than 100 from the origin, or faster
than 200 a second, are in mm. Joint angles beyond ±200° in more than a fifth of the samples, read as radians, are
degrees. What more than one unit fits is refused: positions farther than 8 from the origin or faster than 20 a second,
and three joints more than 30° beyond a hand's range in so many samples.

A unit that the file's mapping or the user states is not detected; there speed and sweep refuse, the distance does not.
The name of a column or key may say that it holds the stamps, and their unit.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.sample_flags import SampleFlag
from hhsim.recordings.content import ReadOptions
from hhsim.recordings.finger_ik import usual_hand
from hhsim.recordings.joint_names import words_of
from hhsim.recordings.recording import Recording, note

TIME_UNITS: dict[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
LENGTH_UNITS: dict[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}
ANGLE_UNITS: dict[str, float] = {"rad": 1.0, "deg": np.pi / 180.0}

SLOWEST_STEP = 0.5
"""Longest median step of stamps in seconds [s]: nobody records a hand at less than 2 Hz."""
LATE = 1e6
"""First stamp [s] from which on a clock counts from 1970 or from the computer's start."""
FASTEST_STEP = 1e-4
"""Shortest median step of stamps in seconds [s]: no glove samples at more than 10 kHz."""
STEP_RANGES = {"ms": (1.0, 100.0), "µs": (1e3, 1e5), "ns": (1e6, 1e8)}
FAR = 8.0
"""Largest usual distance from the origin of positions in metres [m]."""
CERTAINLY_FAR = 100.0
STILL, SHORT = 1e-3, 0.5
"""Sweep of a palm [m] up to which it says nothing of its unit, and up to which it is less than a hand's in mm or cm."""
FAST = 20.0
"""Largest usual speed of a palm in metres [m/s]: a punch reaches 10."""
JOINT_LIMIT = np.radians(200.0)
"""Largest joint angle [rad]."""
SLACK, JOINTS_BEYOND = np.radians(30.0), 3
"""Excess over its range [rad] of a joint whose zero is elsewhere, and number of joints that do not have it together."""
CERTAINLY_FAST = 200.0
MANY = 0.2
"""Share of samples above which a unit is wrong, not single samples."""
FEW = 0.05

_TIME_WORDS = {"time", "times", "timestamp", "stamp", "timestamps", "t", "clock"}
_UNIT_WORDS = {
    word: words.split()[0]
    for words in (
        "s sec secs second seconds",
        "ms msec msecs milli millis millisec milliseconds",
        "us usec usecs micro micros microsec microseconds",
        "ns nsec nsecs nano nanos nanosec nanosecs nanoseconds",
    )
    for word in words.split()
}
_OF_A_STAMP = {"header", "tv"}
"""Words around a stamp of two columns that need no other one."""
_OWN_CLOCK = {"device", "sample", "capture", "tracking", "sensor"}


def in_our_units(recording: Recording, options: ReadOptions) -> Recording:
    """Convert stamps to s, positions to m, angles to rad: by the units of the options, else of the file, else detected.

    Raises InputError for a unit that the file states too, TrajectoryError for a wrong or an ambiguous one.
    """
    # Joint centres were scaled as they were fitted.
    length = options.length_unit if recording.bones is None else None
    units = {"time": options.time_unit, "length": length, "angle": options.angle_unit}
    given = {key: unit for key, unit in units.items() if unit is not None}
    for key, unit in given.items():
        if key in recording.stated:
            raise InputError(f"--{key}-unit {unit}: the file, or the mapping of its columns, states that unit already")
    if "time" in given:
        recording = _with_clock(recording, TIME_UNITS[given["time"]])
    if "length" in given:
        recording = recording.resized(LENGTH_UNITS[given["length"]])
    if "angle" in given:
        radian = ANGLE_UNITS[given["angle"]]
        recording = recording.with_angles(recording.angles * radian).changed(angle_unit=radian)
    return _angles(_lengths(in_seconds(recording.changed(stated=recording.stated | given.keys()))))


def in_seconds(recording: Recording) -> Recording:
    """Convert stamps to s, from the first one if they count from long ago; TrajectoryError for a wrong unit."""
    time = np.unique(recording.time[np.isfinite(recording.time)])
    step = float(np.median(np.diff(time))) if time.size > 1 else SLOWEST_STEP
    if not FASTEST_STEP <= step <= SLOWEST_STEP:
        stated = "time" in recording.stated
        how = f"are they in another unit? {_corrected('time') if stated else 'Say --time-unit'}"
        if step < FASTEST_STEP:
            raise TrajectoryError(f"the stamps step by {step:.3g} s, {1.0 / step:,.0f} a second; expected [s]: {how}")
        fitting = [unit for unit, (low, high) in STEP_RANGES.items() if low <= step <= high]
        if stated or not fitting:
            raise TrajectoryError(f"the stamps step by {step:.6g} s, too slow for a hand; expected [s]: {how}")
        text = f"stamps step by {step:.4g}: taken for {fitting[0]}; if they are not, say --time-unit"
        recording = _with_clock(_converted(recording, text), TIME_UNITS[fitting[0]])
    time = recording.time[np.isfinite(recording.time)]
    if not time.size or float(np.median(time)) <= LATE:
        return recording
    found = note(f"stamps begin at {time[0]:.6f} s: they count from the first one now")
    return _with_clock(recording, 1.0, -float(time[0])).found(found)


def _lengths(recording: Recording) -> Recording:
    place = recording.position[np.isfinite(recording.position).all(axis=1)]
    if not place.size:
        return recording
    distance = float(np.median(np.linalg.norm(place, axis=1)))
    sweep = float(np.linalg.norm(np.subtract(*np.percentile(place, (95.0, 5.0), axis=0))))
    way, step = np.linalg.norm(np.diff(recording.position, axis=0), axis=1), np.diff(recording.time)
    with np.errstate(invalid="ignore", divide="ignore"):
        speeds = (way / step)[(step > 0.0) & (way > 0.0)]
    # A hand rests at times, a unit never does: the faster half decides.
    speed = float(np.percentile(speeds, 75.0)) if speeds.size else 0.0
    by_hand, stated = sweep <= FAR and speed <= FAST, "length" in recording.stated
    if max(distance / FAR, speed / FAST) <= 1.0 or (by_hand and (stated or STILL < sweep <= SHORT)):
        return recording
    if stated:
        reason = f"palm moves at {speed:.4g} m/s" if speed > FAST else f"palm sweeps {sweep:.4g} m"
        raise TrajectoryError(f"{reason}, which is no hand's; expected another unit: {_corrected('length')}")
    reason = f"palm moves at {speed:.4g} m/s" if distance <= FAR else f"palm {distance:.4g} m from the origin"
    if (by_hand and sweep > STILL) or (distance <= CERTAINLY_FAR and speed <= CERTAINLY_FAST):
        raise TrajectoryError(f"{reason}: maybe not in metres, but cm, mm and inch are all possible; say --length-unit")
    text = f"positions: {reason}: taken for millimetres; if they are not, say --length-unit"
    return _converted(recording, text).resized(LENGTH_UNITS["mm"])


def near_origin(*recordings: Recording) -> tuple[Recording, ...]:
    """Move the origin of hands in one world [m] near to the first one's palm, by whole metres, if that is far away."""
    place = recordings[0].position[np.isfinite(recordings[0].position).all(axis=1)]
    middle = np.round(np.median(place, axis=0)) if place.size else np.zeros(3)
    if np.linalg.norm(middle) <= FAR:
        return recordings
    at = ", ".join(f"{each:.0f}" for each in middle)
    text = f"palm {np.linalg.norm(middle):.4g} m from the origin, which is moved to ({at}) m; sizes and paths stay"
    return tuple(each.shifted(-middle).found(note(text)) for each in recordings)


def _angles(recording: Recording) -> Recording:
    angles, stated = recording.angles, "angle" in recording.stated
    if not angles.size:
        return recording
    worst = np.nanmax(np.abs(angles), initial=0.0)
    share = float((np.abs(angles) > JOINT_LIMIT).any(axis=1).mean())
    if share > FEW:
        reason = f"joint angles reach {worst:.4g} rad in {100.0 * share:.0f} % of the samples, which no joint does"
        if stated:
            raise TrajectoryError(f"{reason}: are they in another unit? {_corrected('angle')}")
        if share <= MANY:
            raise TrajectoryError(f"{reason}; expected [rad]: are they in degrees? Say --angle-unit")
        converted = _converted(recording, f"{reason}: taken for degrees; if they are not, say --angle-unit")
        return converted.with_angles(angles * ANGLE_UNITS["deg"]).changed(angle_unit=ANGLE_UNITS["deg"])
    # As degrees within ±200°, as radians maybe beyond what a hand bends.
    hand = usual_hand()
    least, most = np.append(hand.flexion_min, hand.abduction_min), np.append(hand.flexion_max, hand.abduction_max)
    beyond = (np.maximum(least - angles, angles - most) > SLACK).sum(axis=1)
    share = float((beyond >= JOINTS_BEYOND).mean())
    if share > MANY and not stated:
        beyond_range = f"as radians, {JOINTS_BEYOND} or more are over {np.degrees(SLACK):.0f}° beyond a hand's range"
        raise TrajectoryError(f"joint angles reach {worst:.3g}: {beyond_range}; say --angle-unit deg or rad")
    return recording


def _corrected(key: str) -> str:
    """Say where a stated unit can be corrected."""
    return f"check --{key}-unit, or the unit in the mapping of the columns"


def _with_clock(recording: Recording, factor: float, shift: float = 0.0) -> Recording:
    phases = tuple(
        replace(phase, start_time=factor * phase.start_time + shift, end_time=factor * phase.end_time + shift)
        for phase in recording.phases
    )
    first = factor * recording.first_stamp - shift
    return recording.changed(time=recording.time * factor + shift, phases=phases, first_stamp=first)


def _converted(recording: Recording, text: str) -> Recording:
    return recording.flagged(np.ones(recording.sample_count, dtype=bool), SampleFlag.UNIT, text)


class TimeColumn(NamedTuple):
    """Column of stamps, its unit (s, ms, us, ns; None if the name does not say), and other such columns of the file.

    The name is "" where there is none.
    Where it has whole seconds alone, as ROS writes them, `fraction` is the column of what is left, in the same `unit`.
    """

    name: str = ""
    unit: str | None = None
    others: tuple[str, ...] = ()
    fraction: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns: none, one or two."""
        return tuple(name for name in (self.name, self.fraction) if name)

    def stamps(self, numbers: Callable[[str], FloatArray]) -> FloatArray | None:
        """Return the stamps in the unit, of columns whose numbers are given by their names, (T,); None without one."""
        if not self.fraction:
            return numbers(self.name) if self.name else None
        seconds, fraction = numbers(self.name), numbers(self.fraction)
        second = round(1.0 / TIME_UNITS[self.unit or "ns"])
        known = np.isfinite(seconds) & np.isfinite(fraction)
        is_part = ((fraction >= 0.0) & (fraction < second) & (seconds == np.round(seconds)))[known].all()
        # Otherwise it is the same stamp in another unit.
        return second * seconds + fraction if is_part else fraction


def time_column(names: Iterable[str]) -> TimeColumn:
    """Return the column of stamps among these; of several that of the device, which has no delay."""
    named_words = {name: {word for word in words_of(name) if word.isalpha()} for name in names}
    unit_of = {
        name: next((_UNIT_WORDS[word] for word in sorted(words) if word in _UNIT_WORDS), None)
        for name, words in named_words.items()
    }
    alike: dict[frozenset[str], dict[str | None, str]] = {}
    for name, words in named_words.items():
        alike.setdefault(frozenset(words - _UNIT_WORDS.keys()), {}).setdefault(unit_of[name], name)
    found = [(name, words) for name, words in named_words.items() if words & _TIME_WORDS and not words & {"zone", "of"}]
    # Seconds and what is left of one make a stamp whatever they are called.
    found = found or [
        (units["s"], set(rest))
        for rest, units in alike.items()
        if rest <= _OF_A_STAMP and "s" in units and units.keys() & {"us", "ns"}
    ]
    if not found:
        return TimeColumn()
    name, words = next((each for each in found if each[1] & _OWN_CLOCK), found[0])
    units = alike[frozenset(words - _UNIT_WORDS.keys())]
    small = next((unit for unit in ("ns", "us") if unit in units and "s" in units), None)
    pair = (units["s"], units[small]) if small is not None else ()
    others = tuple(other for other, _ in found if other not in (name, *pair))
    if small is not None and name in pair:
        return TimeColumn(units["s"], small, others, units[small])
    return TimeColumn(name, unit_of[name], others)
