"""Joints of bodies as files declare them, the motions of driven ones, and where their values bring a body."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import structs

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.motion.csv_table import read_table
from hhsim.motion.npz_arrays import numbers, read_npy, read_npz
from hhsim.motion.pickled_data import flat, npy_dictionary
from hhsim.motion.trajectory import ObjectMotion, RigidMotion, as_numbers
from hhsim.ranges import RANGES
from hhsim.reproducible import norm
from hhsim.scene.body import LEAST_LENGTH
from hhsim.system.input_file import read_input, read_input_text
from hhsim.system.settings_file import Settings, a_list, between

Number = Annotated[float, between(-100.0, 100.0)]
Three = tuple[Number, Number, Number]
Two = tuple[Number, Number]
Keyframe = tuple[Annotated[float, between(0.0, 1e6)], Number]


class JointRecording(Settings, frozen=True):
    """Columns of a CSV file, or arrays of an .npz, that hold a joint's values; the path is relative to the bodies'.

    An .npy has the rate of its rows [Hz], the first of which is at 0 s, and the number of a column, from 0 on; one of
    nested dictionaries the keys of an array with slashes between.
    """

    file: str
    column: str | int
    time: str | None = None
    rate: Annotated[float, between(1e-3, 1e6, "Hz")] | None = None

    def check(self) -> None:
        """Check that an .npy has a column and a rate, and any other file names."""
        rows, numbered = Path(self.file).suffix == ".npy", isinstance(self.column, int)
        fits = (self.rate and self.time is None) if rows else not numbered and self.rate is None
        if not fits:
            expected = "column = 0 and rate = 30.0, no time" if rows else "names of column and time, no rate"
            raise InputError(f"{self.file} has {'no names and no stamps' if rows else 'names'}; expected {expected}")

    def read(self, folder: Path) -> tuple[Keyframe, ...]:
        """Return (time [s], value) of each sample; InputError for no such file or column, or what is no number."""
        path, names = folder / self.file, (self.time or "t", str(self.column))
        try:
            if self.rate is not None and isinstance(self.column, int):
                rows = as_numbers("array", read_npy(read_input(path)))
                if rows.ndim != 2 or not 0 <= self.column < rows.shape[1]:
                    raise InputError(f"no column {self.column} in an array of shape {rows.shape}; expected (T, 7)")
                time, values = np.arange(len(rows)) / self.rate, rows[:, self.column]
            elif self.rate is not None:
                arrays = dict(flat(npy_dictionary(read_input(path), "a joint's values")))
                check_known("array", names[1:], arrays)
                values = numbers(arrays, names[1])
                time = np.arange(len(values)) / self.rate
            elif path.suffix == ".npz":
                arrays = read_npz(read_input(path))
                check_known("array", names, arrays)
                time, values = numbers(arrays, names[0]), numbers(arrays, names[1])
            else:
                time, values = read_table(read_input_text(path), strict=True).numbers(names)[0].T
            if time.ndim != 1 or time.shape != values.shape:
                raise InputError(f"shapes {time.shape} and {values.shape}; expected (T,) of both")
            if not (len(time) and np.isfinite(time).all() and np.isfinite(values).all()):
                missing = " or ".join(names) if isinstance(self.column, str) else f"column {self.column}"
                raise InputError(f"{missing} is empty or lacks a number; expected one a sample")
        except OSError as reason:
            raise InputError(f"{path}: cannot be read: {reason.strerror or reason}") from None
        except (InputError, UnicodeDecodeError) as reason:
            raise InputError(f"{path}: {reason}") from None
        return tuple(zip(time.tolist(), values.tolist(), strict=True))


class JointSettings(Settings, frozen=True):
    """Hinge or slider of a body; `hhsim.scene.body_file` explains the keys."""

    type: Literal["hinge", "slider"]
    axis: Three
    origin: Three = (0.0, 0.0, 0.0)
    on: str = ""
    limits: Two | None = None
    friction: Annotated[float, between(*RANGES["hinge_friction"][:2])] = 0.0
    start: Number | None = None
    motion: Annotated[tuple[Keyframe, ...], a_list("[[0.0, 0.0], [1.0, 1.5]]")] | None = None
    recording: JointRecording | None = None

    def check(self) -> None:
        """Check the axis, the order of the limits and of the times, and each value against the limits."""
        if norm(np.array(self.axis)) < LEAST_LENGTH:
            raise InputError("axis has length 0; expected a direction such as [0.0, 1.0, 0.0]")
        if self.limits is not None and self.limits[0] > self.limits[1]:
            least, most = self.limits
            raise InputError(f"limits are reversed: {least:g} is above {most:g}; expected the least value first")
        given = [name for name in ("motion", "recording", "start") if getattr(self, name) is not None]
        if len(given) > 1:
            raise InputError(f"both a {' and a '.join(given)}; expected one of them")
        self.check_motion(self.motion or ())
        if not self.is_driven:
            self._check_value("start", self.start or 0.0)

    @property
    def is_driven(self) -> bool:
        """True if the joint moves as recorded; otherwise forces move what is on it."""
        return self.motion is not None or self.recording is not None

    def check_motion(self, motion: Sequence[Keyframe]) -> None:
        """Check that times rise, and that values are within the limits."""
        times = [time for time, _ in motion]
        for number, (before, after) in enumerate(pairwise(times), start=2):
            if after <= before:
                raise InputError(f"motion[{number}] is at {after:g} s, not after {before:g} s; expected rising times")
        for number, (_, value) in enumerate(motion, start=1):
            self._check_value(f"motion[{number}]", value)

    def _check_value(self, what: str, value: float) -> None:
        least, most = self.limits or (-np.inf, np.inf)
        if not least <= value <= most:
            raise InputError(
                f"{what} has the value {value:g}, beyond the limits; "
                f"expected {least:g} to {most:g} {'rad' if self.type == 'hinge' else 'm'}"
            )

    def read(self, folder: Path) -> "JointSettings":
        """Return the joint with the motion of its recording, whose path is relative to a folder."""
        if self.recording is None:
            return self
        keyframes = self.recording.read(folder)
        with named(folder / self.recording.file):
            return structs.replace(self, motion=keyframes, recording=None)

    def moved(self, motion: Sequence[Keyframe]) -> "JointSettings":
        """Return the joint driven by another motion; InputError for a value beyond the limits."""
        return structs.replace(self, motion=tuple(motion), recording=None, start=None)

    def values(self, time: FloatArray) -> FloatArray:
        """Return the joint's values [rad] or [m] at these times [s], (T,); its recording has been read."""
        if self.motion is None:
            return np.full(len(time), self.start or 0.0)
        times, values = np.array(self.motion).T
        found: FloatArray = np.interp(time, times, values)
        return found

    def poses(self, position: FloatArray, orientation: FloatArray, values: FloatArray) -> ObjectMotion:
        """Return the poses of a body on the joint at each value, (T,), in the frame of what bears the joint.

        `position` [m], (3,), and `orientation` (w, x, y, z), (4,), are those at the value 0.
        """
        place, turn = np.tile(position, (len(values), 1)), np.tile(orientation, (len(values), 1))
        axis = np.array(self.axis)
        along = values[:, None] * (axis / norm(axis))
        if self.type == "slider":
            return ObjectMotion(place + along, turn)
        moved, origin = quaternion(along), np.array(self.origin)
        about = (rotation_matrix(moved) * (place - origin)[:, None, :]).sum(axis=-1)
        return ObjectMotion(origin + about, quaternion_product(moved, turn))


def require_no_circle(bearers: Mapping[str, str], expected: str) -> None:
    """Raise InputError for joints in a circle; `bearers` has what each hangs on, `expected` ends the message."""
    for name in bearers:
        chain = [name]
        while on := bearers.get(chain[-1]):
            chain.append(on)
            if on in chain[:-1]:
                raise InputError(f"joints in a circle: {' on '.join(chain[chain.index(on) :])}; expected {expected}")


def composed(base: ObjectMotion, poses: ObjectMotion) -> ObjectMotion:
    """Return poses, each given in the frame `base` of its moment, in the frame in which `base` itself is given."""
    frame = RigidMotion(base.orientation, base.position)
    return ObjectMotion(frame.points(poses.position), frame.orientations(poses.orientation))
