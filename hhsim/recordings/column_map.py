"""Which column of a table is what: a small TOML file that makes a recording of any CSV.

Everything but the joints and the time is optional. Names of joints are those of our own CSV: thumb_flex1 (metacarpal)
to little_flex3, proximal to distal, and thumb_abd to little_abd::

    device = "ExampleGlove 2"       # also name, source, licence
    hand = "right"                  # or left
    hand_length = 0.182             # of the recorded hand [m], wrist crease to middle fingertip
    rate = 100.0                    # [Hz], where no column holds the time
    delimiter = ";"                 # found in the header if not given
    decimal = ","                   # default "."
    world_up = "y"                  # the axis that points up, default z
    palm_axes = ["-y", "x", "z"]    # our palm's x (to the little finger), y (to the fingers), z (out of the back),
                                    # each as an axis of the recording's palm; default ["x", "y", "z"]
    palm_offset = [0.0, 0.075, 0.0] # from the tracked point to the palm's centre, along our palm's axes [m]

    [time]
    column = "Time"
    unit = "ms"                     # s, ms, us or ns

    [position]
    columns = ["X", "Y", "Z"]
    unit = "mm"                     # m, cm, mm or inch

    [orientation]
    columns = ["qx", "qy", "qz", "qw"]
    order = "xyzw"                  # or wxyz; Euler angles: "ZYX" about the turned axes, "zyx" about the fixed ones
    unit = "deg"                    # of Euler angles

    [angle]
    unit = "deg"                    # of all joints that name no unit; default rad

    [joint]
    index_flex1 = "IndexMCP"
    index_flex2 = { column = "IndexPIP", offset = 12.0, scale = -1.0 }    # angle = scale · (column - offset) · unit
    index_flex3 = { joint = "index_flex2", scale = 0.667 }                # not measured: made from another joint
    index_abd = { column = "IndexAbd", unit = "rad" }

    [raw]                           # kept beside the motion
    emg = { column = "EMG1", unit = "V", meaning = "forearm muscle" }

Joints that are not named stay at 0, the palm without position or orientation stays at the origin. A unit that is not
named is s, m or rad, unless the numbers, or an option, say otherwise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from hhsim.errors import InputError, UnknownNameError
from hhsim.motion.csv_file import ABDUCTION_COLUMNS, COLUMNS, FLEXION_COLUMNS, PHASE
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.frames import OURS, axes_matrix, world_matrix
from hhsim.recordings.unit_detection import ANGLE_UNITS, LENGTH_UNITS, TIME_UNITS
from hhsim.system.toml_document import (
    check_keys,
    checked_number,
    checked_table,
    checked_text,
    parse_toml,
    read_toml_text,
)

JOINT_NAMES = (*FLEXION_COLUMNS, *ABDUCTION_COLUMNS)
TEXTS = ("name", "source", "licence", "device")


@dataclass(frozen=True)
class JointColumn:
    """One joint angle: scale · (value - offset) · unit.

    Attributes:
        column: Of the table; None where it is made from another joint.
        joint: The joint that it is made from.
        scale, offset: Offset in the column's unit; of another joint the scale alone counts.
        unit: "rad" or "deg".
    """

    column: str | None = None
    joint: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    unit: str = "rad"


@dataclass(frozen=True)
class RawColumn:
    """A column that is kept as it is."""

    column: str
    unit: str = ""
    meaning: str = ""


@dataclass(frozen=True)
class ColumnMap:
    """A checked mapping; the module's docstring says what each field means, `stated` which units it names."""

    joints: Mapping[str, JointColumn]
    time: str | None = None
    time_unit: str = "s"
    position: tuple[str, ...] = ()
    position_unit: str = "m"
    orientation: tuple[str, ...] = ()
    order: str = "wxyz"
    euler_unit: str = "rad"
    rate: float | None = None
    delimiter: str | None = None
    decimal: str = "."
    world_up: str = "z"
    palm_axes: tuple[str, ...] = OURS
    palm_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    hand: HandSide = ""
    hand_length: float | None = None
    texts: Mapping[str, str] = field(default_factory=dict)
    raw: Mapping[str, RawColumn] = field(default_factory=dict)
    phase: str | None = None
    stated: frozenset[str] = frozenset()


OWN_COLUMNS = ColumnMap(
    joints={name: JointColumn(name) for name in JOINT_NAMES},
    time="time",
    position=("px", "py", "pz"),
    orientation=("qw", "qx", "qy", "qz"),
    phase=PHASE,
)
"""The mapping of our own CSV."""


def is_own_header(header: tuple[str, ...]) -> bool:
    """Whether these are the columns of our own CSV."""
    return set(COLUMNS) <= set(header)


def read_column_map(path: Path) -> ColumnMap:
    """Read a mapping from a TOML file.

    Raises:
        InputError: No such file, no TOML, or a key or value that no mapping has.
    """
    return parse_column_map(read_toml_text(path, "mapping of columns"), where=str(path))


def parse_column_map(text: str, *, where: str) -> ColumnMap:
    """Make a mapping from TOML text.

    Args:
        where: Names it in messages.

    Raises:
        InputError: No TOML, or a key or value that no mapping has.
    """
    table = parse_toml(text, where)
    known = (*TEXTS, "hand", "hand_length", "rate", "delimiter", "decimal", "world_up", "palm_axes", "palm_offset")
    check_keys(where, table, (*known, "time", "position", "orientation", "angle", "joint", "raw", "phase"))
    fields: dict[str, Any] = {"texts": {key: _text(where, key, table[key]) for key in TEXTS if key in table}}
    for key, (low, high) in {"rate": (0.1, 1e5), "hand_length": (0.05, 0.4)}.items():
        if key in table:
            fields[key] = checked_number(where, key, table[key], low, high)
    if "hand" in table:
        if table["hand"] not in ("right", "left"):
            raise InputError(f"{where}: hand = {table['hand']!r}; expected right or left")
        fields["hand"] = cast(HandSide, table["hand"])
    for key in ("delimiter", "decimal"):
        if key in table:
            fields[key] = _text(where, key, table[key])
            if len(fields[key]) != 1:
                raise InputError(f"{where}: {key} = {table[key]!r}; expected one character")
    if "world_up" in table:
        fields["world_up"] = _text(where, "world_up", table["world_up"])
        world_matrix(fields["world_up"], f"{where}: world_up")
    if "palm_axes" in table:
        fields["palm_axes"] = _texts(where, "palm_axes", table["palm_axes"], (3,))
        axes_matrix(fields["palm_axes"], f"{where}: palm_axes")
    if "palm_offset" in table:
        numbers = table["palm_offset"]
        if not isinstance(numbers, list) or len(numbers) != 3:
            raise InputError(f"{where}: palm_offset = {numbers!r}; expected three numbers [m]")
        fields["palm_offset"] = tuple(checked_number(where, "palm_offset", value, -1.0, 1.0) for value in numbers)
    if "phase" in table:
        fields["phase"] = _text(where, "phase", table["phase"])
    return ColumnMap(
        **fields, **_time(where, table), **_palm(where, table), **_joints(where, table), stated=_stated(table)
    )


def _stated(table: Mapping[str, Any]) -> frozenset[str]:
    """The units that a checked document names; what it does not name is still open to an option, or to the numbers."""
    joints = table["joint"].values()
    own = any(isinstance(joint, dict) and "unit" in joint for joint in joints)
    named = {
        "time": "unit" in table.get("time", {}) or "time" not in table,
        # The palm's offset is in metres, and is added to the position as it is read.
        "length": "unit" in table.get("position", {}) or "palm_offset" in table or "position" not in table,
        "angle": "unit" in table.get("angle", {}) or own,
    }
    return frozenset(key for key, given in named.items() if given)


def _time(where: str, table: Mapping[str, Any]) -> dict[str, Any]:
    if "time" not in table:
        if "rate" not in table:
            raise InputError(f"{where}: no [time] and no rate; expected [time] with a column, or rate = … [Hz]")
        return {}
    given = checked_table(where, "time", table["time"], ("column", "unit"))
    if "column" not in given:
        raise InputError(f"{where}: [time] names no column")
    unit = _unit(where, "time", given, TIME_UNITS, "s")
    return {"time": _text(where, "time.column", given["column"]), "time_unit": unit}


def _palm(where: str, table: Mapping[str, Any]) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    if "position" in table:
        given = checked_table(where, "position", table["position"], ("columns", "unit"))
        fields["position"] = _texts(where, "position.columns", given.get("columns"), (3,))
        fields["position_unit"] = _unit(where, "position", given, LENGTH_UNITS, "m")
    if "orientation" in table:
        given = checked_table(where, "orientation", table["orientation"], ("columns", "order", "unit"))
        columns = _texts(where, "orientation.columns", given.get("columns"), (3, 4))
        order = _text(where, "orientation.order", given.get("order", "wxyz"))
        euler = len(columns) == 3
        fits = (
            len(order) == 3
            and order.lower() != ""
            and set(order.lower()) <= set("xyz")
            and order in (order.lower(), order.upper())
            if euler
            else order in ("wxyz", "xyzw")
        )
        if not fits:
            wanted = "an Euler order such as ZYX (turned axes) or zyx (fixed axes)" if euler else "wxyz or xyzw"
            raise InputError(f"{where}: orientation.order = {order!r} for {len(columns)} columns; expected {wanted}")
        fields |= {"orientation": columns, "order": order}
        fields["euler_unit"] = _unit(where, "orientation", given, ANGLE_UNITS, "rad")
    return fields


def _joints(where: str, table: Mapping[str, Any]) -> dict[str, Any]:
    usual = _unit(where, "angle", checked_table(where, "angle", table.get("angle", {}), ("unit",)), ANGLE_UNITS, "rad")
    given = table.get("joint")
    if not isinstance(given, dict) or not given:
        raise InputError(f"{where}: no [joint] table; expected at least one of {', '.join(JOINT_NAMES[:3])}, …")
    joints = {}
    for name, value in given.items():
        if name not in JOINT_NAMES:
            raise InputError(f"{where}: {UnknownNameError('joint', name, JOINT_NAMES)}")
        if isinstance(value, str):
            joints[name] = JointColumn(value, unit=usual)
            continue
        entry = checked_table(where, f"joint.{name}", value, ("column", "joint", "scale", "offset", "unit"))
        if ("column" in entry) == ("joint" in entry):
            raise InputError(f"{where}: joint.{name}: expected a column, or another joint that it follows")
        numbers = {
            key: checked_number(where, f"{name}.{key}", entry[key], -1e6, 1e6)
            for key in ("scale", "offset")
            if key in entry
        }
        texts = {key: _text(where, f"{name}.{key}", entry[key]) for key in ("column", "joint") if key in entry}
        joints[name] = JointColumn(
            texts.get("column"),
            texts.get("joint"),
            numbers.get("scale", 1.0),
            numbers.get("offset", 0.0),
            _unit(where, name, entry, ANGLE_UNITS, usual),
        )
    for name, joint in joints.items():
        if joint.joint is not None and (joint.joint not in joints or joints[joint.joint].column is None):
            raise InputError(f"{where}: joint.{name} follows '{joint.joint}', which has no column of its own")
    raw = {}
    for name, value in checked_table(where, "raw", table.get("raw", {})).items():
        entry = (
            {"column": value}
            if isinstance(value, str)
            else checked_table(where, f"raw.{name}", value, ("column", "unit", "meaning"))
        )
        if "column" not in entry:
            raise InputError(f"{where}: raw.{name} names no column")
        raw[name] = RawColumn(**{key: _text(where, f"raw.{name}.{key}", text) for key, text in entry.items()})
    return {"joints": joints, "raw": raw}


def _unit(where: str, key: str, table: Mapping[str, Any], units: Mapping[str, float], usual: str) -> str:
    unit = table.get("unit", usual)
    if not isinstance(unit, str) or unit not in units:
        raise InputError(f"{where}: {key}: unit {unit!r}; expected {', '.join(units)}")
    return unit


def _text(where: str, key: str, value: Any) -> str:
    if value == "":
        raise InputError(f"{where}: {key} = ''; expected text in quotes")
    return checked_text(where, key, value)


def _texts(where: str, key: str, value: Any, counts: tuple[int, ...]) -> tuple[str, ...]:
    if not isinstance(value, list) or len(value) not in counts:
        raise InputError(f"{where}: {key} = {value!r}; expected {' or '.join(map(str, counts))} names in a list")
    return tuple(_text(where, key, item) for item in value)
