"""Parser of BVH motion capture text: a tree of joints with offsets and channels, and the channels' values per frame.

A joint's channels are rotations about axes turned by those before, in their order in the file. Angles are in degrees;
lengths have no unit.
"""

from dataclasses import dataclass, field

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.recordings.recording import MOST_SAMPLES, Finding, note
from hhsim.system.counted import counted

MOST_JOINTS = 2_000
"""Largest number of joints of a skeleton."""
MOST = 1e9
"""Largest magnitude of a number; numbers beyond are damage."""
POSITIONS = ("xposition", "yposition", "zposition")
ROTATIONS = ("xrotation", "yrotation", "zrotation")


@dataclass
class Joint:
    """Joint of the skeleton, or the end of a bone (End Site), which is named after its parent with " end"."""

    name: str
    parent: int  # index of its parent, -1 for a root
    offset: FloatArray  # vector from the parent's joint, in the parent's frame, shape (3,)
    channels: tuple[str, ...] = ()  # names in lower case, in their order
    first: int = 0  # column of the first channel
    is_end: bool = False
    children: list[int] = field(default_factory=list)  # indices of its children


@dataclass(frozen=True, eq=False)
class Bvh:
    """Skeleton and its motion."""

    joints: tuple[Joint, ...]  # joints, parents before children
    frame_time: float  # time between frames [s]
    values: FloatArray  # channels in each frame, NaN where missing, shape (T, C)
    findings: tuple[Finding, ...]  # notes about frames that are missing or broken
    lines: tuple[int, ...] = ()  # number of each frame's line in the text, from 1 on

    def pose(self) -> tuple[FloatArray, FloatArray]:
        """Compute world positions of all joints and ends in the file's unit, (T, J, 3), and rotations, (T, J, 3, 3)."""
        count = len(self.values)
        at = np.empty((count, len(self.joints), 3))
        turned = np.empty((count, len(self.joints), 3, 3))
        for index, joint in enumerate(self.joints):
            shift, turn = self._local(joint)
            if joint.parent < 0:
                at[:, index], turned[:, index] = shift, turn
            else:
                parent = turned[:, joint.parent]
                at[:, index] = at[:, joint.parent] + np.einsum("tij,tj->ti", parent, shift)
                turned[:, index] = parent @ turn
        return at, turned

    def _local(self, joint: Joint) -> tuple[FloatArray, FloatArray]:
        """Return position and rotation of a joint in its parent's frame, shapes (T, 3) and (T, 3, 3)."""
        from scipy.spatial.transform import Rotation

        count = len(self.values)
        columns = {channel: self.values[:, joint.first + k] for k, channel in enumerate(joint.channels)}
        # Position channels stand for the offset, they do not add to it.
        offsets = zip(POSITIONS, joint.offset)
        shift = np.stack([columns.get(key, np.full(count, offset)) for key, offset in offsets], axis=1)
        turns = [channel for channel in joint.channels if channel in ROTATIONS]
        if not turns:
            return shift, np.tile(np.eye(3), (count, 1, 1))
        angles = np.stack([columns[channel] for channel in turns], axis=1)
        order = "".join(channel[0].upper() for channel in turns)
        return shift, Rotation.from_euler(order, angles, degrees=True).as_matrix()


def read_bvh(text: str) -> Bvh:
    """Read BVH text; raise TrajectoryError with the line where it stops being BVH."""
    lines = [(number, words) for number, line in enumerate(text.splitlines(), start=1) if (words := line.split())]
    if not lines or lines[0][1][0].upper() != "HIERARCHY":
        raise TrajectoryError("it does not begin with HIERARCHY; expected BVH motion capture")
    joints, count = _hierarchy(lines[1:])
    return _motion(lines[1 + count :], joints, complete=text.endswith(("\n", "\r")))


def _hierarchy(lines: list[tuple[int, list[str]]]) -> tuple[tuple[Joint, ...], int]:
    """Return the joints, and the number of lines up to MOTION."""
    joints: list[Joint] = []
    open_joints: list[int] = []
    pending: Joint | None = None
    columns = 0
    for count, (number, words) in enumerate(lines, start=1):
        key, where = words[0].upper(), f"line {number}"
        if key in ("ROOT", "JOINT", "END") and pending is None and (key == "ROOT") == (not open_joints):
            if len(joints) >= MOST_JOINTS:
                raise TrajectoryError(f"{where}: more than {MOST_JOINTS} joints; expected a skeleton")
            parent = open_joints[-1] if open_joints else -1
            name = f"{joints[parent].name} end" if key == "END" else " ".join(words[1:])
            pending = Joint(name, parent, np.full(3, np.nan), is_end=key == "END")
        elif key == "{" and pending is not None:
            joints.append(pending)
            if pending.parent >= 0:
                joints[pending.parent].children.append(len(joints) - 1)
            open_joints.append(len(joints) - 1)
            pending = None
        elif key == "}" and open_joints and pending is None:
            if np.isnan(joints[open_joints[-1]].offset).any():
                raise TrajectoryError(f"{where}: {joints[open_joints[-1]].name} has no OFFSET")
            open_joints.pop()
        elif key == "OFFSET" and open_joints and pending is None:
            joints[open_joints[-1]].offset = np.array(_numbers(words[1:], 3, where, "OFFSET"))
        elif key == "CHANNELS" and open_joints and pending is None:
            joint = joints[open_joints[-1]]
            joint.channels, joint.first = _channels(words, where), columns
            columns += len(joint.channels)
        elif key == "MOTION" and not open_joints and joints:
            return tuple(joints), count
        else:
            raise TrajectoryError(f"{where} is '{' '.join(words)[:40]}', which no BVH hierarchy holds there")
    raise TrajectoryError("a BVH hierarchy without MOTION; was the file cut short?")


def _channels(words: list[str], where: str) -> tuple[str, ...]:
    channels = tuple(word.lower() for word in words[2:])
    fits = len(words) > 1 and words[1].isdecimal() and int(words[1]) == len(channels) == len(set(channels))
    if not fits or not set(channels) <= {*POSITIONS, *ROTATIONS}:
        raise TrajectoryError(f"{where}: {' '.join(words)[:60]}; expected CHANNELS, their number, names as Xposition")
    return channels


def _motion(lines: list[tuple[int, list[str]]], joints: tuple[Joint, ...], *, complete: bool) -> Bvh:
    if len(lines) < 2 or lines[0][1][0].lower() != "frames:" or " ".join(lines[1][1][:2]).lower() != "frame time:":
        raise TrajectoryError("no Frames: and Frame Time: after MOTION; was the file cut short?")
    (stated,) = _numbers(lines[0][1][1:], 1, f"line {lines[0][0]}", "Frames:")
    (step,) = _numbers(lines[1][1][2:], 1, f"line {lines[1][0]}", "Frame Time:")
    if not 0.0 < step < 10.0:
        raise TrajectoryError(f"Frame Time: {step:g}; expected seconds between frames")
    rows = lines[2:]
    if not rows:
        raise TrajectoryError("no frames; expected one line of numbers each")
    if len(rows) > MOST_SAMPLES:
        raise TrajectoryError(f"{len(rows):,} frames; expected at most {MOST_SAMPLES:,}")
    width = sum(len(joint.channels) for joint in joints)
    values = np.full((len(rows), width), np.nan)
    findings: list[Finding] = []
    if stated != len(rows):
        findings.append(note(f"{len(rows)} frames where the file says {stated:g}: some are lost"))
    if not complete and len(rows) > 1:
        # A number that was cut in the middle is a wrong number that looks like a right one.
        findings.append(note(f"line {rows[-1][0]}, the last one, has no line end: left out, it may have been cut"))
        rows, values = rows[:-1], values[:-1]
    broken = []
    for row, (number, words) in enumerate(rows):
        try:
            values[row] = _numbers(words, width, f"line {number}", "frame")
        except TrajectoryError:
            broken.append(number)
    if len(broken) > 0.25 * len(rows):
        what = f"frames without {width} numbers, one a channel; first line {broken[0]}"
        raise TrajectoryError(f"{len(broken)} of {len(rows)} {what}")
    if broken:
        text = f"{counted(len(broken), 'frame')} without {width} numbers: missing, first line {broken[0]}"
        findings.append(note(text))
    return Bvh(joints, float(step), values, tuple(findings), tuple(number for number, _ in rows))


def _numbers(words: list[str], count: int, where: str, key: str) -> list[float]:
    try:
        numbers = [float(word) for word in words if "_" not in word]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) <= MOST for number in numbers):
        raise TrajectoryError(f"{where}: {key} {' '.join(words)[:40]}; expected {counted(count, 'number')}")
    return numbers
