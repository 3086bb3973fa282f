"""Tables whose columns are named after the joints of a hand: OpenXR's 26, WebXR's 25, MediaPipe's 21.

Names vary (left_index_tip_x, XR_HAND_JOINT_INDEX_TIP_EXT_x, R_IndexTip.PosX, WRIST_x, …). Positions are read, and
radius and validity where they are there. y is up; the bend of the fingers tells OpenXR's right-handed world from
Unity's left-handed one.
"""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.csv_table import Table, read_header, read_table
from hhsim.recordings.joint_names import KEYPOINTS, JointName, joint_name, joints_found, joints_missing
from hhsim.recordings.joint_positions import (
    JointPositions,
    chosen_side,
    in_right_handed_world,
    joints_by_name,
    recording_of_joints,
    sample_times,
)
from hhsim.recordings.recording import Finding, Recording, note
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat
from hhsim.recordings.unit_detection import time_column
from hhsim.system.counted import counted

FEWEST = 4
"""Number of joints with coordinates that mark this format."""

Columns = dict[HandSide, dict[str, dict[str, str]]]
"""Columns by hand, joint and part."""


def _columns(header: tuple[str, ...]) -> Columns:
    found: Columns = {}
    for name in header:
        said: JointName = joint_name(name)
        if said.joint and said.part in ("x", "y", "z", "radius", "valid"):
            found.setdefault(said.side, {}).setdefault(said.joint, {}).setdefault(said.part, name)
    return {side: joints for side, joints in found.items() if any(_whole(parts) for parts in joints.values())}


def _whole(parts: dict[str, str]) -> bool:
    return {"x", "y", "z"} <= set(parts)


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the one with more columns; raises TrajectoryError."""
    table = read_table(content.text)
    hands = _columns(table.header)
    if not hands:
        raise TrajectoryError("no columns named after the joints of a hand, such as left_index_tip_x")
    named = {side: {joint for joint, parts in joints.items() if _whole(parts)} for side, joints in hands.items()}
    side, findings = chosen_side({each: len(joints) for each, joints in named.items()}, options.hand)
    what = f"{joints_found(named[side])}{f' of the {side} hand' if side else ''} named"
    missing = joints_missing(named[side])
    if missing:
        raise TrajectoryError(
            f"{what}, but no x, y, z of {missing}; expected at least MediaPipe's 21 "
            "(--format keypoints takes 63 columns in their order, whatever their names)"
        )
    count = len(table.rows)
    stamps = time_column(name for name in table.header if not joint_name(name).joint)
    if stamps is None and options.rate is None:
        raise TrajectoryError(f"{what}, but no column with a time; add one, or say --rate")
    findings = [*table.findings, *findings, note(what)]
    given = None if stamps is None else _numbers(table, [stamps.name], findings)[:, 0]
    time, in_seconds, remarks = sample_times(given, stamps and stamps.unit, count, options)
    findings += remarks
    if stamps is not None and stamps.others:
        findings.append(note(f"stamps from column '{stamps.name}'; there are also {', '.join(stamps.others[:3])}"))
    joints = hands[side]
    positions = {
        joint: _numbers(table, [joints[joint][axis] for axis in "xyz"], findings)
        for joint in named[side] & set(KEYPOINTS)
    }
    stated = side or options.hand
    points, turned = in_right_handed_world(joints_by_name(positions, count), stated)
    findings += turned
    radii = {joint: parts["radius"] for joint, parts in joints.items() if "radius" in parts and joint in KEYPOINTS}
    radius = None
    if len(radii) == len(KEYPOINTS):
        radius = np.column_stack([_numbers(table, [radii[joint]], findings)[:, 0] for joint in KEYPOINTS])
    valid = [parts["valid"] for parts in joints.values() if "valid" in parts]
    doubtful = (_truths(table, valid) == 0.0).any(axis=1) if valid else None
    xr = named[side] & {"palm", *(f"{finger}_metacarpal" for finger in FINGERS[1:])}
    joint_positions = JointPositions(
        time=time,
        position=points,
        form="openxr",
        hand=stated,
        up="y" if xr else None,
        radius=radius,
        doubtful=doubtful,
        # Tips with radii are centres of balls; others are points of the skin.
        tip_on_surface=radius is None,
        time_stated=in_seconds,
        findings=tuple(findings),
    )
    return recording_of_joints(joint_positions, content.name, options)


def _numbers(table: Table, columns: list[str], findings: list[Finding]) -> FloatArray:
    values, broken = table.numbers(columns)
    if broken:
        text = f"{counted(broken, 'cell')} of {columns[0]} and its like without a number: taken as missing"
        findings.append(note(text))
    return values


def _truths(table: Table, columns: list[str]) -> FloatArray:
    words = {"true": 1.0, "false": 0.0, "1": 1.0, "0": 0.0, "1.0": 1.0, "0.0": 0.0}
    return np.array([[words.get(cell.lower(), 1.0) for cell in table.text(column)] for column in columns]).T


def _sniff(content: Content, options: ReadOptions) -> bool:
    if options.columns is not None or not content.is_text or content.beginning.lstrip()[:1] in ("{", "["):
        return False
    try:
        hands = _columns(read_header(content.text))
    except (TrajectoryError, InputError):
        return False
    return any(sum(_whole(parts) for parts in joints.values()) >= FEWEST for joints in hands.values())


FORMAT = RecordingFormat(
    "openxr",
    "a table with columns named after the joints: OpenXR, WebXR, Unity XR Hands, MediaPipe",
    (".csv",),
    _sniff,
    _read,
)
