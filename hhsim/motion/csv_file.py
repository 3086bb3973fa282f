"""Trajectories as CSV text.

UTF-8, comma separated, one header line, one line a sample; numbers with a decimal point, in full precision, so that a
file read back is the same motion bit for bit. Semicolons or tabs for the commas are read too, then with decimal commas
as well. Columns, in any order:

| columns | unit | meaning |
|---|---|---|
| time | s | increasing stamps |
| px, py, pz | m | palm origin, world |
| qw, qx, qy, qz | 1 | palm to world |
| thumb_flex1, thumb_flex2, thumb_flex3, index_flex1, …, little_flex3 | rad | flexion, proximal to distal |
| thumb_abd, index_abd, …, little_abd | rad | abduction, positive towards the thumb side |
| object_px, object_py, object_pz (optional) | m | object origin, world, if the object moves |
| object_qw, object_qx, object_qy, object_qz (with them) | 1 | object to world |
| phase (optional) | | phase of the sample, or empty |
| flags (optional) | | sum of the bits of `hhsim.motion.sample_flags.SampleFlag` |

Lines `# key: value` before the header hold name, source, licence, device and hand; object_position (x y z) and
object_orientation (w x y z) of an object that stands still; and samples, the number of lines, by which a file that was
cut short is noticed. Equal phase names on neighbouring lines are one phase; it ends where the next line begins.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, check_known
from hhsim.hand.fingers import FINGERS
from hhsim.motion.csv_table import Table, format_table, read_table
from hhsim.motion.trajectory import ObjectMotion, Phase, Trajectory
from hhsim.system.counted import counted

CSV_SUFFIX = ".csv"
POSE_COLUMNS = ("time", "px", "py", "pz", "qw", "qx", "qy", "qz")
FLEXION_COLUMNS = tuple(f"{finger}_flex{joint}" for finger in FINGERS for joint in (1, 2, 3))
ABDUCTION_COLUMNS = tuple(f"{finger}_abd" for finger in FINGERS)
COLUMNS = (*POSE_COLUMNS, *FLEXION_COLUMNS, *ABDUCTION_COLUMNS)
OBJECT_COLUMNS = tuple(f"object_{column}" for column in POSE_COLUMNS[1:])
PHASE = "phase"
FLAGS = "flags"
TEXTS = ("name", "source", "licence", "device", "hand")
SAMPLES = "samples"
POSE_SIZES = {"object_position": 3, "object_orientation": 4}


def format_csv(trajectory: Trajectory) -> str:
    """Return the CSV text of a motion."""
    count, moving = trajectory.sample_count, trajectory.object_motion
    remarks = {key: getattr(trajectory, key) for key in TEXTS if getattr(trajectory, key).strip()}
    if moving is None:
        remarks |= {key: " ".join(map(repr, getattr(trajectory, key).tolist())) for key in POSE_SIZES}
    remarks[SAMPLES] = str(count)
    extra: dict[str, list[str]] = {}
    if trajectory.phases:
        extra[PHASE] = _phase_names(trajectory)
    if trajectory.flags is not None:
        extra[FLAGS] = [str(bits) for bits in trajectory.flags.tolist()]
    fingers = trajectory.flexion.reshape(count, -1), trajectory.abduction
    hand = trajectory.position, trajectory.orientation, *fingers
    numbers = np.column_stack([trajectory.time, *hand, *(moving or ())]).tolist()
    added = zip(*extra.values(), strict=True) if extra else [()] * count
    rows = ([*map(repr, row), *more] for row, more in zip(numbers, added, strict=True))
    return format_table(remarks, (*COLUMNS, *(OBJECT_COLUMNS if moving is not None else ()), *extra), rows)


def parse_csv(text: str, *, name: str = "") -> Trajectory:
    """Read the motion of a CSV text; `name` is its name if the text has none.

    Raises TrajectoryError for a missing column, a line of another length, a value that is no number (with its line), or
    a motion that cannot be replayed; UnknownNameError for a column of another name.
    """
    table = read_table(text, strict=True)
    fields, _ = csv_fields(table)
    check_known("column", table.header, (*COLUMNS, *OBJECT_COLUMNS, PHASE, FLAGS))
    count = len(table.rows)
    if table.remarks.get(SAMPLES, str(count)) != str(count):
        held = f"it holds {counted(count, 'sample')} but says # {SAMPLES}: {table.remarks[SAMPLES]}"
        raise TrajectoryError(f"{held}; was it cut short? Expected as many as it says, or no such line")
    return Trajectory(**{"name": name} | fields)


def csv_fields(table: Table) -> tuple[dict[str, Any], int]:
    """Return the fields of a `Trajectory` in a table with our own columns, and the count of unreadable cells.

    Missing numbers are NaN, and nothing but the shapes is checked. Raises TrajectoryError where a column is missing or
    holds no numbers, or a remark holds no pose.
    """
    header, count = table.header, len(table.rows)
    moves = any(column in header for column in OBJECT_COLUMNS)
    if missing := [column for column in (*COLUMNS, *(OBJECT_COLUMNS if moves else ())) if column not in header]:
        others = [column for column in header if column not in (*COLUMNS, *OBJECT_COLUMNS, PHASE, FLAGS)]
        instead = f"; it has {_some(others)} instead" if others else ""
        raise TrajectoryError(
            f"no column {_some(missing)} of hhsim's own{instead}: rename them, or map them with hhsim import --columns"
        )
    values, broken = table.numbers(COLUMNS)
    time = values[:, 0]
    fields: dict[str, Any] = {
        "time": time,
        "position": values[:, 1:4],
        "orientation": values[:, 4:8],
        "flexion": values[:, 8:23].reshape(count, 5, 3),
        "abduction": values[:, 23:],
        **{key: table.remarks[key] for key in TEXTS if key in table.remarks},
        **_object_pose(table.remarks),
    }
    if moves:
        poses, bad = table.numbers(OBJECT_COLUMNS)
        fields["object_motion"], broken = ObjectMotion(*np.split(poses, [3], axis=1)), broken + bad
    if FLAGS in header:
        flags, bad = table.numbers([FLAGS])
        fields[FLAGS], broken = flags[:, 0], broken + bad
    # Only stamps that increase say when a phase begins.
    if PHASE in header and (np.diff(time) > 0.0).all():
        fields["phases"] = _phases(table.text(PHASE), time)
    return fields, broken


def _some(names: Sequence[str], most: int = 6) -> str:
    return ", ".join(name[:20] for name in names[:most]) + (", …" if len(names) > most else "")


def _object_pose(remarks: dict[str, str]) -> dict[str, FloatArray]:
    """Return the object's pose in the remarks, as far as it is there; raise TrajectoryError for wrong numbers."""
    pose = {}
    for key, size in POSE_SIZES.items():
        if key in remarks:
            try:
                values = [float(word) for word in remarks[key].split()]
            except ValueError:
                values = []
            if len(values) != size:
                raise TrajectoryError(f"# {key}: {remarks[key]}; expected {size} numbers with spaces between")
            pose[key] = np.array(values)
    return pose


def _phases(names: Sequence[str], time: FloatArray) -> tuple[Phase, ...]:
    """Return phases from the name at each sample: runs of equal names.

    A run ends at the stamp after it, the last one at the last stamp.
    """
    starts = [k for k in range(len(names)) if k == 0 or names[k] != names[k - 1]]
    runs = zip(starts, [*starts[1:], len(names) - 1])
    return tuple(Phase(names[k], float(time[k]), float(time[end])) for k, end in runs if names[k])


def _phase_names(trajectory: Trajectory) -> list[str]:
    """Return the phase of each sample, "" if there is none."""
    names = [""] * trajectory.sample_count
    for phase in trajectory.phases:
        first = int(np.searchsorted(trajectory.time, phase.start_time, side="left"))
        end = int(np.searchsorted(trajectory.time, phase.end_time, side="left"))
        if phase is trajectory.phases[-1] and phase.end_time >= trajectory.time[-1]:
            end = trajectory.sample_count
        names[first:end] = [phase.name] * (end - first)
    return names
