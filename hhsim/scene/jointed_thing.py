"""Things of several rigid parts that hang on each other by hinges and sliders, as TOML declares them.

Keys, with their defaults::

    [[part]]
    name = "base"
    mesh = "base.ply"                    # a catalogue name, or a path relative to the file
    unit = "m"                           # of a mesh file: m, cm, mm or inch
    # or: box = [0.3, 0.2, 0.01]         # a box about the part's origin, of these edges [m]
    position = [0.0, 0.0, 0.0]           # of the part's frame in its parent's, all joints at 0 [m]
    orientation = [1.0, 0.0, 0.0, 0.0]   # part to parent, (w, x, y, z)

    [[part]]
    name = "lid"
    mesh = "lid.ply"
    parent = "base"                      # a part without one stands in the thing's frame; there is one such part
    joint.type = "hinge"                 # or "slider"
    joint.axis = [0.0, 1.0, 0.0]         # in the parent's frame, of any length
    joint.origin = [0.0, 0.0, 0.0]       # a point of the axis, in the parent's frame [m]
    joint.limits = [0.0, 2.4]            # least and greatest value, [rad] of a hinge, [m] of a slider
    joint.motion = [[0.0, 0.0], [1.0, 1.5]]   # (time [s], value); straight between, constant before and after
    # or: joint.recording = { file = "lid.csv", column = "angle", time = "t" }   # columns of a CSV, arrays of an .npz
    # or: joint.recording = { file = "box.object.npy", column = 0, rate = 30.0 }   # of rows without stamps, [Hz]
    # or: joint.recording = { file = "box.npy", column = "params/obj_arti", rate = 30.0 }   # in its dictionaries

The value of a joint turns the part about its axis by the right hand's rule, or shifts it along. A script may move the
joints instead, see `hhsim.scene.script`. ARCTIC's `.object.npy` has the angle in column 0 of rows at 30 Hz; its axis is
(0, 0, -1) through the origin of the object, whose two meshes are in one frame (github.com/zc-alexfan/arctic:
docs/data/data_doc.md, common/object_tensors.py).
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, structs

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.motion.csv_table import read_table
from hhsim.motion.npz_arrays import numbers, read_npy, read_npz
from hhsim.motion.pickled_data import flat, npy_dictionary
from hhsim.motion.validation import as_numbers
from hhsim.reproducible import norm
from hhsim.system.input_file import read_input, read_input_text
from hhsim.system.settings_file import Settings, a_list, between, read_settings

LEAST_LENGTH = 1e-9
"""A direction or a quaternion that is shorter has none: rounding would choose it."""
Number = Annotated[float, between(-100.0, 100.0)]
Three = tuple[Number, Number, Number]
Two = tuple[Number, Number]
Edge = Annotated[float, between(1e-3, 10.0, "m")]
Keyframe = tuple[Annotated[float, between(0.0, 1e6)], Number]


class JointRecording(Settings, frozen=True):
    """Columns of a CSV file, or arrays of an .npz, that hold a joint's values; the path is relative to the thing's.

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


class Joint(Settings, frozen=True):
    """Hinge or slider between a part and its parent; the module's docstring explains the keys."""

    type: Literal["hinge", "slider"]
    axis: Three
    limits: Two
    motion: Annotated[tuple[Keyframe, ...], a_list("[[0.0, 0.0], [1.0, 1.5]]")] | None = None
    origin: Three = (0.0, 0.0, 0.0)
    recording: JointRecording | None = None

    def check(self) -> None:
        """Check the axis, the order of the limits and of the times, and each value against the limits."""
        least, most = self.limits
        if norm(np.array(self.axis)) < LEAST_LENGTH:
            raise InputError("axis has length 0; expected a direction such as [0.0, 1.0, 0.0]")
        if least > most:
            raise InputError(f"limits are reversed: {least:g} is above {most:g}; expected the least value first")
        if (self.motion is None) == (self.recording is None):
            raise InputError(f"{'no' if self.motion is None else 'both a'} motion and recording; expected one of them")
        self.check_motion(self.motion or ())

    def check_motion(self, motion: Sequence[Keyframe]) -> None:
        """Check that times rise, and that values are within the limits."""
        least, most = self.limits
        times = [time for time, _ in motion]
        for number, (before, after) in enumerate(pairwise(times), start=2):
            if after <= before:
                raise InputError(f"motion[{number}] is at {after:g} s, not after {before:g} s; expected rising times")
        for number, (_, value) in enumerate(motion, start=1):
            if not least <= value <= most:
                raise InputError(
                    f"motion[{number}] has the value {value:g}, beyond the limits; "
                    f"expected {least:g} to {most:g} {'rad' if self.type == 'hinge' else 'm'}"
                )

    def read(self, folder: Path) -> "Joint":
        """Return the joint with the motion of its recording, whose path is relative to a folder."""
        if self.recording is None:
            return self
        keyframes = self.recording.read(folder)
        with named(folder / self.recording.file):
            return structs.replace(self, motion=keyframes, recording=None)

    def values(self, time: FloatArray) -> FloatArray:
        """Return the joint's values [rad] or [m] at these times [s], (T,); its recording has been read."""
        assert self.motion is not None
        times, values = np.array(self.motion).T
        found: FloatArray = np.interp(time, times, values)
        return found


class Shape(Settings, frozen=True):
    """Rigid shape by its name, and its place; the module's docstring explains the keys."""

    name: Annotated[str, Meta(pattern=r"\A[A-Za-z0-9_-]+\Z", description="letters, digits, - and _")]
    mesh: str = ""
    position: Three = (0.0, 0.0, 0.0)
    orientation: tuple[Number, Number, Number, Number] = (1.0, 0.0, 0.0, 0.0)
    unit: str | None = None
    box: tuple[Edge, Edge, Edge] | None = None

    def check(self) -> None:
        """Check for one shape, and the orientation's length."""
        if bool(self.mesh) == (self.box is not None):
            found = "both a mesh and a box" if self.mesh else "no mesh and no box"
            raise InputError(f"part '{self.name}' has {found}; expected one of them")
        if norm(np.array(self.orientation)) < LEAST_LENGTH:
            raise InputError("orientation has length 0; expected (w, x, y, z) such as [1.0, 0.0, 0.0, 0.0]")


class Part(Shape, frozen=True):
    """Rigid part of a thing; the module's docstring explains the keys."""

    parent: str = ""
    joint: Joint | None = None

    def check(self) -> None:
        """Check the shape, and that a part has a joint if it has a parent, else none."""
        super().check()
        if bool(self.parent) != (self.joint is not None):
            has, lacks = ("parent", "joint") if self.parent else ("joint", "parent")
            raise InputError(f"part '{self.name}' has a {has} and no {lacks}; expected both or neither")


class JointedThing(Settings, frozen=True):
    """Rigid parts in the order of the file, each but one on a hinge or a slider."""

    part: Annotated[tuple[Part, ...], Meta(min_length=1, description="at least one table [[part]]")]

    def check(self) -> None:
        """Check that names differ, that parents are parts, and that each part hangs on the one without a parent."""
        names = [part.name for part in self.part]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"two parts have the name '{name}'; expected a name for each")
        check_known("part", [part.parent for part in self.part if part.parent], names)
        check_no_circle({part.name: part.parent for part in self.part}, "one part without a parent")
        roots = [part.name for part in self.part if not part.parent]
        if len(roots) > 1:
            raise InputError(f"parts {', '.join(roots)} have no parent; expected one such part")

    def moved(self, motions: Mapping[str, Sequence[Keyframe]]) -> "JointedThing":
        """Return the thing with other motions of joints, by the name of the part; InputError for one it has not."""
        joints = {part.name: part.joint for part in self.part if part.joint}
        check_known("joint", motions, joints)
        for name, motion in motions.items():
            with named(f"joint {name}"):
                joints[name].check_motion(motion)
        parts = (
            structs.replace(part, joint=structs.replace(joints[part.name], motion=tuple(motions[part.name])))
            if part.name in motions
            else part
            for part in self.part
        )
        return structs.replace(self, part=tuple(parts))

    def joint_values(self, time: FloatArray) -> dict[str, FloatArray]:
        """Return the values [rad] or [m] of each joint at these times [s], (T,), by the name of its part."""
        return {part.name: part.joint.values(time) for part in self.part if part.joint}

    def poses(self, values: Mapping[str, FloatArray]) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Return position [m] (T, 3) and orientation (T, 4) of each part in the thing's frame, by its name.

        `values` has those of each joint [rad] or [m], (T,), by the name of its part.
        """
        steps = len(next(iter(values.values()))) if values else 1
        known: dict[str, tuple[FloatArray, FloatArray]] = {}
        waiting = list(self.part)
        while waiting:
            part = next(one for one in waiting if one.parent in known or not one.parent)
            waiting.remove(part)
            position, orientation = moved_by(part, part.joint, values.get(part.name, np.zeros(steps)))
            if part.parent:
                base, turn = known[part.parent]
                position = base + _turned(turn, position)
                orientation = quaternion_product(turn, orientation)
            known[part.name] = (position, orientation)
        return {part.name: known[part.name] for part in self.part}


def check_no_circle(bearers: Mapping[str, str], expected: str) -> None:
    """Check that nothing hangs on itself, by the name of what each hangs on; InputError says what is expected."""
    for name in bearers:
        chain = [name]
        while on := bearers.get(chain[-1]):
            chain.append(on)
            if on in chain[:-1]:
                raise InputError(f"joints in a circle: {' on '.join(chain[chain.index(on) :])}; expected {expected}")


def read_jointed_thing(path: Path) -> JointedThing:
    """Read a thing of several parts from TOML; InputError names what is wrong and what would be right."""
    thing = read_settings(path, JointedThing, "thing of several parts")
    parts = (structs.replace(part, joint=part.joint and part.joint.read(path.parent)) for part in thing.part)
    return structs.replace(thing, part=tuple(parts))


def _turned(orientation: FloatArray, vectors: FloatArray) -> FloatArray:
    turned: FloatArray = (rotation_matrix(orientation) * vectors[:, None, :]).sum(axis=-1)
    return turned


def moved_by(shape: Shape, joint: Joint | None, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return position [m] (T, 3) and orientation (T, 4) of a shape, in its parent's frame, at each value of a joint."""
    place = np.tile(np.array(shape.position), (len(values), 1))
    given = np.array(shape.orientation)
    orientation = np.tile(given / norm(given), (len(values), 1))
    if joint is None:
        return place, orientation
    axis = np.array(joint.axis)
    along = values[:, None] * (axis / norm(axis))
    if joint.type == "slider":
        return place + along, orientation
    turn, origin = quaternion(along), np.array(joint.origin)
    return origin + _turned(turn, place - origin), quaternion_product(turn, orientation)
