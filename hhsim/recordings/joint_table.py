"""Joint centres of one hand in a table, whose columns say each joint and coordinate by their names."""

from collections.abc import Iterator, Mapping, Sequence
from functools import reduce

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.csv_table import Table, format_table
from hhsim.motion.text_edit import NewColumn, NumberEdit, cell_edits
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.correction import ANGLE_DIGITS, Changes
from hhsim.recordings.joint_names import KEYPOINTS, VALIDITY_WORDS, JointName, hand_statement, recognised, stated_value
from hhsim.recordings.joint_positions import JointPositions
from hhsim.recordings.object_poses import poses_in, table_arrays
from hhsim.recordings.recording import HandMotion, chosen_side, note, unreadable, unused
from hhsim.recordings.registry import ReadOptions
from hhsim.recordings.unit_detection import time_column

WORLD_JOINTS = {"palm", *(f"{finger}_metacarpal" for finger in FINGERS[1:])}
"""Joints that OpenXR and WebXR alone have, whose world has y up."""

Columns = dict[HandSide, dict[str, dict[str, str]]]
"""Columns by hand, joint and part."""


def joint_columns(names: Mapping[str, JointName]) -> Columns:
    """Return the columns of each hand that has a joint with all three coordinates, from the meanings of columns."""
    found: Columns = {}
    for column, name in names.items():
        if name.joint and name.part in ("x", "y", "z", "radius", *VALIDITY_WORDS):
            found.setdefault(name.side, {}).setdefault(name.joint, {}).setdefault(name.part, column)
    return {side: joints for side, joints in found.items() if located(joints)}


def located(joints: Mapping[str, Mapping[str, str]]) -> set[str]:
    """Return the joints that have columns of all three coordinates."""
    return {joint for joint, parts in joints.items() if {"x", "y", "z"} <= set(parts)}


def joints_of_table(
    table: Table, names: Mapping[str, JointName], form: str, options: ReadOptions, *, may_be_mirrored: bool = False
) -> JointPositions:
    """Return the joint centres of the hand of the options, else of the one with more columns, whose meanings are given.

    Raises TrajectoryError for no joints, no such hand, or a missing one of the 21 joints.
    """
    hands = joint_columns(names)
    if not hands:
        raise TrajectoryError("no columns named after the joints of a hand, such as left_index_tip_x")
    side, findings = chosen_side({side: len(located(joints)) for side, joints in hands.items()}, options.hand)
    joints = hands[side]
    what = recognised(located(joints), side)
    findings = [*map(note, table.notes), *findings]

    def numbers(*columns: str) -> FloatArray:
        values, broken = table.numbers(columns)
        findings.extend(unreadable(broken, f" of {columns[0]} and its like"))
        return values

    stamps = time_column(column for column in table.header if column not in names or not names[column].joint)
    if stamps is not None and stamps.others:
        findings.append(note(f"stamps from column '{stamps.name}'; there are also {', '.join(stamps.others[:3])}"))
    arrays, moved = table_arrays(table, findings)
    parts_used = {column for parts in joints.values() for column in parts.values()}
    of_hand = {
        column: name.part
        for column in table.header
        if column not in parts_used and (name := hand_statement(column)) and name.side in ("", side)
    }
    stamped = {*stamps.names, *stamps.others} if stamps is not None else set()
    others = {column for column, name in names.items() if name.joint and name.side in hands and name.side != side}
    findings += unused(dict.fromkeys(table.header), parts_used | moved | stamped | others | of_hand.keys())
    validity: dict[str, FloatArray] = {}
    for kind in dict.fromkeys(VALIDITY_WORDS.values()):
        columns = [joints[joint].get(kind, "") for joint in KEYPOINTS]
        whole = [column for column, part in of_hand.items() if part == kind]
        if any(columns) or whole:
            validity[kind] = reduce(np.fmin, [_stated(table, each) for each in (columns, *([name] for name in whole))])
    has_radii = all("radius" in joints[joint] for joint in KEYPOINTS)
    return JointPositions(
        position=np.stack([numbers(*(joints[joint][axis] for axis in "xyz")) for joint in KEYPOINTS], axis=1),
        form=form,
        what=what,
        time=None if stamps is None else stamps.stamps(lambda name: numbers(name)[:, 0]),
        time_unit=None if stamps is None else stamps.unit,
        hand=side,
        up="y" if located(joints) & WORLD_JOINTS else None,
        may_be_mirrored=may_be_mirrored,
        radius=numbers(*(joints[joint]["radius"] for joint in KEYPOINTS)) if has_radii else None,
        validity=validity,
        object_poses=poses_in(arrays, len(table.rows), options),
        findings=tuple(findings),
    )


def joint_edits(
    text: str, table: Table, names: Mapping[str, JointName], options: ReadOptions, made: Changes
) -> Iterator[NumberEdit]:
    """Return the edits of a table's text for a correction of the hand that `joints_of_table` reads.

    Joints beyond the 21 move with the palm; orientations turn with their bone. Raises InputError for orientations that
    are no quaternions.
    """
    hands = joint_columns(names)
    side, _ = chosen_side({side: len(located(joints)) for side, joints in hands.items()}, options.hand)
    columns: dict[str, NewColumn] = {}

    def put(cells: list[str], values: FloatArray, digits: int) -> None:
        columns.update({cell: NewColumn(column, digits) for cell, column in zip(cells, values.T)})

    for joint in located(hands[side]):
        places = [hands[side][joint][axis] for axis in "xyz"]
        put(places, made.moved(joint, table.numbers(places)[0][made.rows]), made.digits)
    for joint, turns in _orientations(names, side).items():
        cells = [turns.get(part, "") for part in "wxyz"]
        if not all(cells) or len(turns) > 4:
            known = ", ".join(turns.values())
            raise InputError(f"the orientation of {joint} is {known}: no quaternion, so it cannot be corrected")
        put(cells, made.turned(joint, table.numbers(cells)[0][made.rows]), ANGLE_DIGITS)
    return cell_edits(text, table, made.rows.tolist(), columns)


def table_of_joints(motion: HandMotion, names: Sequence[str], points: FloatArray) -> bytes:
    """Return a new table of stamps [s] and of points, shape (T, n, 3), whose columns begin with the side and a name."""
    header = ["time_s", *(f"{motion.side}_{name}_{axis}" for name in names for axis in "xyz")]
    rows = np.column_stack([motion.time, points.reshape(len(points), -1)]).tolist()
    return format_table({}, header, (list(map(repr, row)) for row in rows)).encode()


def _orientations(names: Mapping[str, JointName], side: HandSide) -> dict[str, dict[str, str]]:
    """Return the columns of each joint's orientation by the last letter of their names."""
    found: dict[str, dict[str, str]] = {}
    for column, name in names.items():
        if name.joint and name.side == side and name.part == "rotation":
            found.setdefault(name.joint, {})[column.strip().lower()[-1:]] = column
    return found


def _stated(table: Table, columns: list[str]) -> FloatArray:
    """Return the statements in columns, shape (T, n), NaN for a column "" that there is not."""
    missing = [np.nan] * len(table.rows)
    cells = [[*map(stated_value, table.text(column))] if column else missing for column in columns]
    return np.array(cells).T
