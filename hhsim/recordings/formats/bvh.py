"""Recordings of hands in BVH, of any rig: only the places of the joints count.

A hand is found by the words in the names of its joints: a finger (in 3ds Max's biped finger0 to finger4, in others
finger1 to finger5, in Xsens' MVN first to fifth), a side (right or left, a leading r or l before a capital letter, _r
or .R at the end), and an order from the palm outwards. Metacarpals are left out, but for the thumb's, with which its
chain begins as ours does. The wrist is the joint nearest to the fingers that all five hang from: what else has a
finger's name, such as an ear's ring, hangs from elsewhere. A hand whose joints name no side is read if it is alone.

BVH is a tree of joints with offsets and channels, and the channels' values per frame. A joint's channels are rotations
about axes turned by those before, in their order in the file. Angles are in degrees; lengths have no unit: the hand's
length tells it. Its world has y up unless the options say otherwise.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice, takewhile

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.joint_names import words_of
from hhsim.recordings.recording import MOST_SAMPLES, SIDES, Finding, note
from hhsim.recordings.registry import Content, JointPositions, ReadOptions, RecordingFormat
from hhsim.system.counted import counted

MOST_JOINTS = 2_000
"""Largest number of joints of a skeleton."""
MOST = 1e9
"""Largest magnitude of a number; numbers beyond are damage."""
POSITIONS = ("xposition", "yposition", "zposition")
ROTATIONS = ("xrotation", "yrotation", "zrotation")

FINGER_WORDS = ("thumb", "index|pointer", "middle|mid(?=finger|$)", "ring", "pinky|pinkie|little|small(?=finger|$)")
"""Words for thumb to little finger; that of the middle one, which may be a phalanx too, yields to any other."""
FINGER = re.compile(
    "(?:right|left|r|l)?(?:in)?(?:hand|palm)?(?:" + "|".join(f"({words})" for words in FINGER_WORDS) + ")"
)
"""Beginning of a word, in lower case, that names a finger."""
BIPED = re.compile(r"finger([0-4])[0-9]?(?:nub)?$", re.IGNORECASE)
COUNTED = re.compile(r"finger[ _]?([1-5])(?=[^0-9])", re.IGNORECASE)
MVN = re.compile(r"(?:(first)|(second)|(third)|(fourth)|(fifth))_?(?:mc|pp|mp|dp)", re.IGNORECASE)
METACARPAL = re.compile(r"metacarp|carpal|inhand|palm|(?:second|third|fourth|fifth)_?mc", re.IGNORECASE)
NO_HAND = (
    "expected right or left, and thumb, index, middle, ring and pinky (or little), Finger0 to Finger4, Finger1 to "
    "Finger5, or FirstMC to FifthDP, in the names of joints"
)
MOST_BETWEEN = 3
"""Largest number of joints between the wrist and the first joint of a finger."""
STILL_OFFSET = 1e-3
"""Largest position, as a share of the joint's offset, that is none: a device that measures none writes 0."""


@dataclass
class Joint:
    """Joint of the skeleton, or the end of a bone (End Site), which is named after its parent with " end"."""

    name: str
    parent: int  # index of its parent, -1 for a root
    is_end: bool = False
    # Vector from the parent's joint, in the parent's frame, shape (3,); NaN until it is read.
    offset: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    columns: dict[str, int] = field(default_factory=dict)  # columns of its channels by name in lower case, in order
    children: list[int] = field(default_factory=list)  # indices of its children


@dataclass(frozen=True, eq=False)
class Bvh:
    """Skeleton and its motion."""

    joints: tuple[Joint, ...]  # joints, parents before children
    frame_time: float  # time between frames [s]
    values: FloatArray  # channels in each frame, shape (T, C)
    findings: tuple[Finding, ...]  # notes about frames that are missing

    def pose(self) -> tuple[FloatArray, FloatArray]:
        """Compute world positions of all joints and ends in the file's unit, (T, J, 3), and rotations, (T, J, 3, 3)."""
        from scipy.spatial.transform import Rotation

        count = len(self.values)
        at, turned = np.empty((count, len(self.joints), 3)), np.empty((count, len(self.joints), 3, 3))
        for index, joint in enumerate(self.joints):
            # Position channels stand for the offset, they do not add to it; but for those that are 0.
            shift = np.tile(joint.offset, (count, 1))
            for axis, channel in enumerate(POSITIONS):
                if channel in joint.columns:
                    shift[:, axis] = self.values[:, joint.columns[channel]]
            turn = np.tile(np.eye(3), (count, 1, 1))
            if turns := {channel: k for channel, k in joint.columns.items() if channel in ROTATIONS}:
                order = "".join(channel[0].upper() for channel in turns)
                turn = Rotation.from_euler(order, self.values[:, [*turns.values()]], degrees=True).as_matrix()
            if joint.parent >= 0:
                parent = turned[:, joint.parent]
                shift, turn = at[:, joint.parent] + np.einsum("tij,tj->ti", parent, shift), parent @ turn
            at[:, index], turned[:, index] = shift, turn
        return at, turned


def _hierarchy(lines: list[tuple[int, list[str]]]) -> tuple[tuple[Joint, ...], int]:
    """Return the joints, and the number of lines up to MOTION."""
    joints: list[Joint] = []
    open_joints: list[int] = []
    declared, columns = False, 0
    for count, (number, words) in enumerate(lines, start=1):
        key, where = words[0].upper(), f"line {number}"
        inside = joints[open_joints[-1]] if open_joints and not declared else None
        if key in ("ROOT", "JOINT", "END") and not declared and (key == "ROOT") == (inside is None):
            if len(joints) >= MOST_JOINTS:
                raise TrajectoryError(f"{where}: more than {MOST_JOINTS} joints; expected a skeleton")
            name = " ".join(words[1:]) if inside is None or key != "END" else f"{inside.name} end"
            joints.append(Joint(name, open_joints[-1] if open_joints else -1, key == "END"))
            declared = True
            if inside is not None:
                inside.children.append(len(joints) - 1)
        elif key == "{" and declared:
            open_joints.append(len(joints) - 1)
            declared = False
        elif key == "}" and inside is not None:
            if np.isnan(inside.offset).any():
                raise TrajectoryError(f"{where}: {inside.name} has no OFFSET")
            open_joints.pop()
        elif key == "OFFSET" and inside is not None:
            inside.offset = np.array(_numbers(words[1:], 3, where, "OFFSET"))
        elif key == "CHANNELS" and inside is not None:
            channels = tuple(word.lower() for word in words[2:])
            known = len(channels) == len({*channels} & {*POSITIONS, *ROTATIONS})
            if words[1:2] != [str(len(channels))] or not known:
                expected = "expected CHANNELS, their number, names as Xposition"
                raise TrajectoryError(f"{where}: {' '.join(words)[:60]}; {expected}")
            inside.columns = {channel: k for k, channel in enumerate(channels, start=columns)}
            columns += len(channels)
        elif key == "MOTION" and joints and not open_joints and not declared:
            return tuple(joints), count
        else:
            raise TrajectoryError(f"{where} is '{' '.join(words)[:40]}', which no BVH hierarchy holds there")
    raise TrajectoryError("a BVH hierarchy without MOTION; was the file cut short?")


def _motion(lines: list[tuple[int, list[str]]], joints: tuple[Joint, ...], *, complete: bool) -> Bvh:
    if len(lines) < 2 or lines[0][1][0].lower() != "frames:" or " ".join(lines[1][1][:2]).lower() != "frame time:":
        raise TrajectoryError("no Frames: and Frame Time: after MOTION; was the file cut short?")
    (stated,) = _numbers(lines[0][1][1:], 1, f"line {lines[0][0]}", "Frames:")
    (step,) = _numbers(lines[1][1][2:], 1, f"line {lines[1][0]}", "Frame Time:")
    if not 0.0 < step < 10.0:
        raise TrajectoryError(f"Frame Time: {step:g}; expected seconds between frames")
    rows = lines[2:]
    if not 0 < len(rows) <= MOST_SAMPLES:
        expected = f"one line of numbers each, at most {MOST_SAMPLES:,}"
        raise TrajectoryError(f"{len(rows) or 'no'} frames; expected {expected}")
    findings: list[Finding] = []
    if stated != len(rows):
        findings.append(note(f"{len(rows)} frames where the file says {stated:g}: some are lost"))
    if not complete and len(rows) > 1:
        # A number that was cut in the middle is a wrong number that looks like a right one.
        findings.append(note(f"line {rows[-1][0]}, the last one, has no line end: left out, it may have been cut"))
        rows = rows[:-1]
    width = sum(len(joint.columns) for joint in joints)
    values = np.array([_numbers(words, width, f"line {number}", "frame") for number, words in rows])
    zeros = 0
    for joint in joints:
        places = [k for channel, k in joint.columns.items() if channel in POSITIONS]
        largest = np.abs(values[:, places]).max(initial=0.0)
        if joint.parent >= 0 and places and largest < STILL_OFFSET * np.linalg.norm(joint.offset):
            joint.columns = {channel: k for channel, k in joint.columns.items() if channel in ROTATIONS}
            zeros += 1
    if zeros:
        text = f"{counted(zeros, 'joint')} with position channels that are 0 in every frame: each stands at its OFFSET"
        findings.append(note(text))
    return Bvh(joints, float(step), values, tuple(findings))


def _numbers(words: list[str], count: int, where: str, key: str) -> list[float]:
    try:
        numbers = [float(word) for word in words if "_" not in word]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) <= MOST for number in numbers):
        raise TrajectoryError(f"{where}: {key} {' '.join(words)[:40]}; expected {counted(count, 'number')}")
    return numbers


Hand = tuple[int, dict[str, list[int]]]
"""Index of the wrist, and those of each finger's joints from its base, with the tip where the last bone has one."""


def _read(content: Content, options: ReadOptions) -> JointPositions:
    """Read the hand of the options, else the right one; TrajectoryError with the line where it stops being BVH."""
    text = content.text
    lines = [(number, words) for number, line in enumerate(text.splitlines(), start=1) if (words := line.split())]
    if not lines or lines[0][1][0].upper() != "HIERARCHY":
        raise TrajectoryError("it does not begin with HIERARCHY; expected BVH motion capture")
    joints, count = _hierarchy(lines[1:])
    bvh = _motion(lines[1 + count :], joints, complete=text.endswith(("\n", "\r")))
    content.tell(*bvh.findings)
    found = {side: _hands(bvh.joints, _finger_lines(bvh.joints, side)) for side in (*SIDES, "")}
    found = {side: hands for side, hands in found.items() if hands}
    if not found:
        names = ", ".join(joint.name for joint in bvh.joints if not joint.is_end)[:60]
        raise TrajectoryError(f"no hand with five fingers of three joints each among {names}…; {NO_HAND}")
    side = content.chosen_side(dict.fromkeys(found, 1), options.hand)
    (wrist, fingers), *others = found[side]
    if others:
        at_two = f"at '{bvh.joints[wrist].name}' and '{bvh.joints[others[0][0]].name}'"
        if not side:
            raise TrajectoryError(f"{len(found[side])} hands, {at_two}, and no joint names a side; {NO_HAND}")
        content.note(f"{len(found[side])} {side} hands, {at_two}: the first one is taken")
    at, turned = bvh.pose()
    points = [at[:, wrist]]
    for line in fingers.values():
        points += [at[:, joint] for joint in line]
        if len(line) == 3:
            # A last bone without an end continues the one before in the rest pose, at a usual length.
            points.append(at[:, line[2]] + turned[:, line[2]] @ (0.7 * bvh.joints[line[2]].offset))
    return JointPositions(
        position=np.stack(points, axis=1),
        what=f"{side} hand at '{bvh.joints[wrist].name}'".strip(),
        time=np.arange(len(bvh.values), dtype=np.float64) * bvh.frame_time,
        hand=side,
        up="y",
    )


def _finger_lines(joints: tuple[Joint, ...], side: str) -> dict[str, list[list[int]]]:
    """Return the lines of three and more joints that are named after a finger of one side, from the palm outwards."""
    found = {}
    for finger in FINGERS:
        members = {
            index
            for index, joint in enumerate(joints)
            if not joint.is_end
            and finger_of(joint.name) == finger
            and next((each for k in _ancestors(joints, index) if (each := side_of(joints[k].name))), "") == side
            and (finger == "thumb" or METACARPAL.search(joint.name) is None)
        }
        # Each joint the child of the one before.
        lines = [[*takewhile(members.__contains__, _ancestors(joints, last))][::-1] for last in sorted(members)]
        if finger != "thumb":
            # The joint numbered 0 of four is a metacarpal.
            numbered = re.compile(r"0\D*$")
            lines = [line[len(line) >= 4 and numbered.search(joints[line[0]].name) is not None :] for line in lines]
        if long := [line for line in lines if len(line) >= 3]:
            found[finger] = long
    return found


def _hands(joints: tuple[Joint, ...], fingers: dict[str, list[list[int]]]) -> list[Hand]:
    """Return the hands of one side: five lines that hang from one joint, as near to it as there are any."""
    if len(fingers) < len(FINGERS):
        return []

    def above(line: list[int]) -> list[int]:
        return [*islice(_ancestors(joints, joints[line[0]].parent), 1 + MOST_BETWEEN)]

    def whole(line: list[int]) -> list[int]:
        """Return three joints and the tip, if the last bone has an end."""
        ends = line[3:4] or [child for child in joints[line[2]].children if joints[child].is_end][:1]
        return line[:3] + [end for end in ends if np.linalg.norm(joints[end].offset) > 0.0]

    shared = set.intersection(*({k for line in lines for k in above(line)} for lines in fingers.values()))
    nearest = shared - {k for wrist in shared for k in _ancestors(joints, joints[wrist].parent)}
    return [
        (wrist, {f: whole(max((line for line in fingers[f] if wrist in above(line)), key=len)) for f in FINGERS})
        for wrist in sorted(nearest)
    ]


def _ancestors(joints: tuple[Joint, ...], index: int) -> Iterator[int]:
    """Yield a joint and all that it hangs from."""
    while index >= 0:
        yield index
        index = joints[index].parent


def side_of(name: str) -> HandSide:
    """Return the side in a joint's name, or ""."""
    words = words_of(name.rsplit(":", 1)[-1])
    return next((side for word in words for side in SIDES if word == side[0] or word.startswith(side)), "")


def finger_of(name: str) -> str:
    """Return the finger in a joint's name, or ""."""
    plain = name.rsplit(":", 1)[-1]
    words = words_of(plain)
    found = [match.lastindex for word in words if (match := FINGER.match(word)) is not None]
    if any("toe" in word for word in words):
        return ""
    if found:
        return FINGERS[(next((place for place in found if place != 3), 3) or 1) - 1]
    if (mvn := MVN.search(plain)) is not None:
        return FINGERS[(mvn.lastindex or 1) - 1]
    if (biped := BIPED.search(plain)) is not None:
        return FINGERS[int(biped[1])]
    counted_from_1 = COUNTED.search(plain)
    return "" if counted_from_1 is None else FINGERS[int(counted_from_1[1]) - 1]


FORMAT = RecordingFormat(
    "bvh",
    "BVH motion capture with the joints of fingers",
    (".bvh",),
    lambda content, options: content.beginning.lstrip()[:9].upper() == "HIERARCHY",
    _read,
)
