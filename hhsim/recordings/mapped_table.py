"""Recording from a table whose columns a `hhsim.recordings.column_map.ColumnMap` explains."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.motion.csv_file import phases_of
from hhsim.motion.sample_flags import SampleFlag, mark
from hhsim.motion.trajectory import RawChannel
from hhsim.recordings.column_map import JOINT_NAMES, ColumnMap
from hhsim.recordings.csv_table import Table
from hhsim.recordings.frames import OURS, to_our_palm, to_our_world, turned
from hhsim.recordings.recording import Finding, Recording, note
from hhsim.recordings.unit_detection import ANGLE_UNITS, LENGTH_UNITS, TIME_UNITS
from hhsim.system.counted import counted

NO_PLACE = "no columns of the palm's place: it stays at the origin; hhsim replay --place-object auto moves the object"


def mapped(table: Table, columns: ColumnMap, name: str, form: str) -> Recording:
    """Make the recording of a table by its mapping.

    Args:
        name: Name of the recording if the mapping has none.
        form: Name of the format.

    Raises:
        TrajectoryError: A column holds no numbers.
        InputError: The table has no such column.
    """
    count = len(table.rows)
    findings: list[Finding] = list(table.findings)
    broken = 0

    def numbers(names: tuple[str, ...], factor: float) -> FloatArray:
        nonlocal broken
        values, bad = table.numbers(names)
        broken += bad
        return values * factor

    if columns.time is not None:
        time = numbers((columns.time.column,), TIME_UNITS[columns.time.unit or "s"])[:, 0]
    else:
        time = np.arange(count) / (columns.rate or 1.0)
        findings.append(note(f"no column of stamps: made from the rate, {columns.rate:g} Hz"))
    position = np.zeros((count, 3))
    if columns.position is not None:
        position = numbers(columns.position.columns, LENGTH_UNITS[columns.position.unit or "m"])
    else:
        findings.append(note(NO_PLACE))
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    if columns.orientation is not None:
        euler, order = columns.orientation.euler, columns.orientation.order
        values = numbers(columns.orientation.columns, ANGLE_UNITS[columns.orientation.unit] if euler else 1.0)
        orientation = euler_quaternion(values, order) if euler else values[:, [order.index(c) for c in "wxyz"]]
    angles = np.zeros((count, len(JOINT_NAMES)))
    joints = columns.joint_columns
    for joint, source in joints.items():
        if source.column is not None:
            read = numbers((source.column,), 1.0)[:, 0]
            unit = ANGLE_UNITS[source.unit or columns.angle.unit or "rad"]
            angles[:, JOINT_NAMES.index(joint)] = source.scale * (read - source.offset) * unit
    followed = {joint: source for joint, source in joints.items() if source.joint is not None}
    for joint, source in followed.items():
        angles[:, JOINT_NAMES.index(joint)] = source.scale * angles[:, JOINT_NAMES.index(str(source.joint))]
    if broken:
        findings.append(note(f"{counted(broken, 'cell')} without a number: taken as missing"))
    raw = tuple(
        RawChannel(key, np.nan_to_num(numbers((channel.column,), 1.0)[:, 0], nan=0.0), channel.unit, channel.meaning)
        for key, channel in columns.raw_columns.items()
    )
    position, orientation = placed(position, orientation, columns)
    # Only stamps that increase say when a phase begins.
    has_phases = columns.phase in table.header and np.isfinite(time).all() and (np.diff(time) > 0.0).all()
    recording = Recording(
        time=time,
        position=position,
        orientation=orientation,
        flexion=angles[:, :15].reshape(count, 5, 3),
        abduction=angles[:, 15:],
        stated=columns.stated,
        form=form,
        name=columns.name or name,
        source=columns.source,
        licence=columns.licence,
        device=columns.device,
        hand=columns.hand or "",
        hand_length=columns.hand_length,
        phases=phases_of(table.text(str(columns.phase)), time) if has_phases else (),
        raw=raw,
        findings=tuple(findings),
    )
    if followed:
        mark(recording.flags, np.ones(count, dtype=bool), SampleFlag.ESTIMATED)
        text = f"{counted(len(followed), 'joint')} not measured but made from others: {', '.join(followed)}"
        recording = recording.found(Finding(SampleFlag.ESTIMATED.word, text, count, None))
    return recording


def placed(position: FloatArray, orientation: FloatArray, columns: ColumnMap) -> tuple[FloatArray, FloatArray]:
    """Convert palm poses to our frames."""
    if columns.palm_axes != OURS:
        orientation = to_our_palm(orientation, columns.palm_axes)
    if columns.world_up != "z":
        position, orientation = to_our_world(position, orientation, columns.world_up)
    if columns.palm_offset is not None and any(columns.palm_offset):
        position = position + turned(orientation, np.array(columns.palm_offset))
    return position, orientation


def euler_quaternion(angles: FloatArray, order: str) -> FloatArray:
    """Convert Euler angles [rad], shape (T, 3), to quaternions (w, x, y, z), shape (T, 4).

    Args:
        order: Order of the angles: three of XYZ for turned axes, or of xyz for fixed ones.
    """
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler(order, angles).as_quat(scalar_first=True))
