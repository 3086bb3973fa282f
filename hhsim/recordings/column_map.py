"""Column maps: a small TOML file that names the columns of any CSV, and the recording that it makes of a table.

docs/recordings.md has an example with all keys. Everything but the joints and the time is optional. Names of joints are
those of our own CSV: thumb_flex1 (metacarpal) to little_flex3, proximal to distal, and thumb_abd to little_abd. Joints
that are not named stay at 0, the palm without position or orientation stays at the origin. A unit that is not named is
s, m or rad, unless the numbers, or an option, say otherwise.
"""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.motion.csv_file import ABDUCTION_COLUMNS, FLEXION_COLUMNS
from hhsim.motion.csv_table import Table
from hhsim.motion.sample_flags import SampleFlag
from hhsim.recordings.content import Content, ReadOptions
from hhsim.recordings.frames import OURS, FileFrame, axes_matrix, turned, world_matrix
from hhsim.recordings.object_poses import placed, poses_in, table_arrays
from hhsim.recordings.recording import Recording
from hhsim.recordings.unit_detection import ANGLE_UNITS, LENGTH_UNITS, TIME_UNITS, time_column
from hhsim.recordings.unit_detection import TimeColumn as StampColumns
from hhsim.system.counted import counted
from hhsim.system.settings_file import Settings, between, one_of, read_settings

JOINT_NAMES = (*FLEXION_COLUMNS, *ABDUCTION_COLUMNS)
Joint = Annotated[str, one_of(JOINT_NAMES)]
Angle = Literal["rad", "deg"]
Name = Annotated[str, Meta(min_length=1)]
Factor = Annotated[float, between(-1e6, 1e6)]
Offset = Annotated[float, between(-1.0, 1.0)]
NO_PLACE = "no columns of the palm's place: it stays at the origin; hhsim replay --place-object auto moves the object"


class JointColumn(Settings, frozen=True):
    """One joint angle: scale · (value - offset) · unit."""

    column: Name | None = None  # column of the table; None for an angle that is computed from another joint's
    joint: Name | None = None  # joint that the angle is computed from, by the scale alone
    scale: Factor = 1.0
    offset: Factor = 0.0  # in the column's unit
    unit: Angle | None = None  # unit of the angle; None for the unit of all joints

    def check(self) -> None:
        """Raise InputError unless there is exactly one source."""
        if (self.column is None) == (self.joint is None):
            raise InputError("expected a column, or another joint that it follows")


class TimeColumn(Settings, frozen=True):
    """Column of the time stamps."""

    column: Name
    unit: Literal["s", "ms", "us", "µs", "ns"] | None = None


class PositionColumns(Settings, frozen=True):
    """Columns of the palm's position."""

    columns: tuple[Name, Name, Name]
    unit: Literal["m", "cm", "mm", "inch"] | None = None


class OrientationColumns(Settings, frozen=True):
    """Columns of the palm's orientation: a quaternion, or Euler angles."""

    columns: Annotated[tuple[Name, ...], Meta(min_length=3, max_length=4, description="3 or 4 names in a list")]
    order: str = "wxyz"
    unit: Angle = "rad"

    def check(self) -> None:
        """Raise InputError for an order that does not fit the number of columns."""
        euler = len(self.columns) == 3
        of_axes = len(self.order) == 3 and set(self.order.lower()) <= set("xyz")
        if euler and not (of_axes and self.order in (self.order.lower(), self.order.upper())):
            orders = "ZYX (turned axes) or zyx (fixed axes)"
            raise InputError(f"order = {self.order!r} for 3 columns; expected an Euler order such as {orders}")
        if not euler and self.order not in ("wxyz", "xyzw"):
            raise InputError(f"order = {self.order!r} for 4 columns; expected wxyz or xyzw")
        named = "".join(name[-1:].lower() for name in self.columns)
        if not euler and named in ("wxyz", "xyzw") and named != self.order:
            raise InputError(f"order = {self.order!r} for columns {', '.join(self.columns)}; expected {named!r}")


class AngleUnit(Settings, frozen=True):
    """Unit of all angles that name none."""

    unit: Angle | None = None


class ColumnMap(Settings, frozen=True, kw_only=True, rename={"joints": "joint"}):
    """Checked mapping of columns; the fields are the keys that docs/recordings.md explains."""

    device: Name = ""
    hand: Literal["right", "left"] | None = None
    hand_length: Annotated[float, between(0.05, 0.4, "m")] | None = None
    rate: Annotated[float, between(0.1, 1e5, "Hz")] | None = None
    world_up: str = "z"
    mirror: Literal["x", "y", "z"] | None = None
    palm_axes: tuple[str, ...] = OURS
    palm_offset: Annotated[tuple[Offset, Offset, Offset], Meta(description="three numbers [m]")] | None = None
    time: TimeColumn | None = None
    position: PositionColumns | None = None
    orientation: OrientationColumns | None = None
    angle: AngleUnit = AngleUnit()
    joints: Annotated[dict[Joint, Name | JointColumn], Meta(min_length=1, description="[joint] with thumb_flex1, …")]

    def check(self) -> None:
        """Raise InputError for wrong axes, a missing time, or a joint that follows one without a column."""
        world_matrix(self.world_up)
        axes_matrix(self.palm_axes, "palm_axes")
        if self.time is None and self.rate is None:
            raise InputError("no [time] and no rate; expected [time] with a column, or rate = … [Hz]")
        joints = self.joint_columns
        for name, joint in joints.items():
            if joint.joint is not None and (joint.joint not in joints or joints[joint.joint].column is None):
                raise InputError(f"joint.{name} follows '{joint.joint}', which has no column of its own")

    @property
    def joint_columns(self) -> dict[str, JointColumn]:
        """Source of each joint."""
        return {name: JointColumn(of) if isinstance(of, str) else of for name, of in self.joints.items()}

    @property
    def names(self) -> set[str]:
        """Names of all columns that the mapping names."""
        single = [self.time, *self.joint_columns.values()]
        names = {part.column for part in single if part is not None and part.column}
        return names.union(*(part.columns for part in (self.position, self.orientation) if part is not None))

    @property
    def stated(self) -> frozenset[str]:
        """Units that the mapping states ("time", "length", "angle"); the others are stated by an option or detected."""
        own = any(joint.unit is not None for joint in self.joint_columns.values())
        named = {
            "time": self.time is None or self.time.unit is not None,
            # The palm's offset is in metres, and is added to the position as it is read.
            "length": self.position is None or self.position.unit is not None or self.palm_offset is not None,
            "angle": own or self.angle.unit is not None,
        }
        return frozenset(key for key, given in named.items() if given)


def read_column_map(path: Path) -> ColumnMap:
    """Read a mapping from a TOML file; raise InputError for a missing file, no TOML, or an unknown key or value."""
    return read_settings(path, ColumnMap, "mapping of columns")


def mapped(
    content: Content, table: Table, columns: ColumnMap, options: ReadOptions, used: Collection[str] = ()
) -> Recording:
    """Make the recording of a table, with the object whose pose is in its columns.

    Frames of the options go before those of the mapping; `used` are columns that it does not name and that are read
    elsewhere. Raises TrajectoryError for a column without numbers, InputError for a missing one.
    """
    axes, up = options.palm_axes or columns.palm_axes, options.world_up or columns.world_up
    count = len(table.rows)
    content.note(*table.notes)

    def numbers(*names: str) -> FloatArray:
        return content.numbers(table, names)

    stamps = StampColumns()
    if columns.time is not None:
        found, stamps = time_column(table.header), StampColumns(columns.time.column, columns.time.unit or "s")
        # Seconds may stand beside a column of what is left of one.
        if found.fraction and (found.name, "s") == stamps[:2]:
            stamps = found
            content.note(f"stamps from columns {' and '.join(stamps.names)}")
    time, step = stamps.stamps(lambda name: numbers(name)[:, 0]), TIME_UNITS[stamps.unit or "s"]
    if time is None:
        time, step = np.arange(count) / (columns.rate or 1.0), 1.0
        content.note(f"no column of stamps: made from the rate, {columns.rate:g} Hz")
    metre = LENGTH_UNITS[(columns.position and columns.position.unit) or "m"]
    frame, position = FileFrame.of(up, options.mirror or columns.mirror, metre), np.zeros((count, 3))
    if columns.position is not None:
        position = numbers(*columns.position.columns)
    else:
        content.note(NO_PLACE)
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    if columns.orientation is not None:
        order = columns.orientation.order
        if len(columns.orientation.columns) == 3:
            from scipy.spatial.transform import Rotation

            angles = numbers(*columns.orientation.columns) * ANGLE_UNITS[columns.orientation.unit]
            orientation = Rotation.from_euler(order, angles).as_quat(scalar_first=True)
        else:
            orientation = numbers(*columns.orientation.columns)[:, [order.index(part) for part in "wxyz"]]
    angles = np.zeros((count, len(JOINT_NAMES)))
    joints = columns.joint_columns
    for joint, source in joints.items():
        if source.column is not None:
            read = numbers(source.column)[:, 0]
            unit = ANGLE_UNITS[source.unit or columns.angle.unit or "rad"]
            angles[:, JOINT_NAMES.index(joint)] = source.scale * (read - source.offset) * unit
    followed = {joint: source for joint, source in joints.items() if source.joint is not None}
    for joint, source in followed.items():
        angles[:, JOINT_NAMES.index(joint)] = source.scale * angles[:, JOINT_NAMES.index(str(source.joint))]
    position, orientation = frame.poses(position, orientation, axes)
    if columns.palm_offset is not None and any(columns.palm_offset):
        position = position + turned(orientation, np.array(columns.palm_offset))
    recording = Recording(
        time=step * time,
        position=position,
        orientation=orientation,
        flexion=angles[:, :15].reshape(count, 5, 3),
        abduction=angles[:, 15:],
        stated=columns.stated,
        device=columns.device,
        hand=columns.hand or "",
        hand_length=columns.hand_length,
        file_frame=frame,
        findings=content.told(),
    )
    text = f"{counted(len(followed), 'joint')} not measured but made from others: {', '.join(followed)}"
    recording = recording.flagged(np.full(count, bool(followed)), SampleFlag.ESTIMATED, text)
    arrays, moved = table_arrays(content, table)
    content.unused(dict.fromkeys(table.header), moved | columns.names | {*stamps.names, *used})
    return placed(recording.found(*content.told()), poses_in(arrays, count, options))
