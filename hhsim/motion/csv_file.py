"""Trajectories as CSV text.

UTF-8, comma separated, one header line, one line a sample; numbers with a decimal point, in full precision, so that a
file read back is the same motion bit for bit. Semicolons or tabs for the commas are read too. Columns, in any order:

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
cut short is noticed. Equal phase names on neighbouring lines are one phase; it ends where the next line begins. Raw
channels are not part of a CSV file.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.object_motion import ObjectMotion
from hhsim.motion.trajectory import Phase, Trajectory
from hhsim.motion.validation import as_numbers
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
SEPARATORS = (",", ";", "\t")
DECIMAL_POINT = " with a decimal point"
"""Expectation for a number with a comma."""
POSE_SIZES = {"object_position": 3, "object_orientation": 4}


def format_csv(trajectory: Trajectory) -> str:
    """Return the CSV text of a motion, without its raw channels."""
    text = io.StringIO()
    for key in TEXTS:
        # A line break in a name would end the remark.
        value = " ".join(getattr(trajectory, key).split())
        if value:
            text.write(f"# {key}: {value}\n")
    moving = trajectory.object_motion
    for key in POSE_SIZES if moving is None else ():
        text.write(f"# {key}: {' '.join(repr(float(x)) for x in getattr(trajectory, key))}\n")
    count = trajectory.sample_count
    text.write(f"# {SAMPLES}: {count}\n")
    writer = csv.writer(text, lineterminator="\n")
    extra: dict[str, list[str]] = {}
    if trajectory.phases:
        extra[PHASE] = _phase_names(trajectory)
    if trajectory.flags is not None:
        extra[FLAGS] = [str(bits) for bits in trajectory.flags.tolist()]
    writer.writerow((*COLUMNS, *(OBJECT_COLUMNS if moving is not None else ()), *extra))
    numbers = np.column_stack(
        [
            trajectory.time,
            trajectory.position,
            trajectory.orientation,
            trajectory.flexion.reshape(count, -1),
            trajectory.abduction,
            *(moving or ()),
        ]
    ).tolist()
    added = zip(*extra.values(), strict=True) if extra else [()] * count
    writer.writerows([*map(repr, row), *more] for row, more in zip(numbers, added, strict=True))
    return text.getvalue()


def parse_csv(text: str, *, name: str = "") -> Trajectory:
    """Read the motion of a CSV text; `name` is its name if the text has none.

    Raises:
        TrajectoryError: A missing or unknown column, a line of another length, a value that is no number (with its
            line), or a motion that cannot be replayed.
    """
    remarks, header, found = csv_rows(text, "time,px,py,pz,qw,qx,qy,qz,thumb_flex1,…")
    columns = (*COLUMNS, *(OBJECT_COLUMNS if any(column in header for column in OBJECT_COLUMNS) else ()))
    missing = [column for column in columns if column not in header]
    if missing:
        shown = ", ".join(missing[:6]) + (f" and {len(missing) - 6} more" if len(missing) > 6 else "")
        raise TrajectoryError(f"the header lacks {shown}; expected {len(columns)} columns and perhaps {PHASE}")
    known = (*COLUMNS, *OBJECT_COLUMNS, PHASE, FLAGS)
    for column in header:
        if column not in known:
            raise TrajectoryError(f"the header has an {UnknownNameError('column', column, known)}")
        if header.count(column) > 1:
            raise TrajectoryError(f"the header has column {column} twice")
    rows: list[list[float]] = []
    names: list[str] = []
    flags: list[str] = []
    order = [header.index(column) for column in columns]
    phase_column = header.index(PHASE) if PHASE in header else None
    flags_column = header.index(FLAGS) if FLAGS in header else None
    for number, cells in found:
        rows.append(numbers_of(cells, columns, order, number))
        names.append(cells[phase_column].strip() if phase_column is not None else "")
        if flags_column is not None:
            flags.append(cells[flags_column])
    if remarks.get(SAMPLES, str(len(rows))) != str(len(rows)):
        held = f"it holds {counted(len(rows), 'sample')} but says # {SAMPLES}: {remarks[SAMPLES]}"
        raise TrajectoryError(f"{held}; was it cut short? Expected as many as it says, or no such line")
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(columns))
    stated: dict[str, Any] = (
        {"name": name} | {key: remarks[key] for key in TEXTS if key in remarks} | object_pose(remarks)
    )
    if flags_column is not None:
        stated[FLAGS] = as_numbers(FLAGS, flags)
    if len(columns) > len(COLUMNS):
        stated["object_motion"] = ObjectMotion(*np.split(table[:, len(COLUMNS) :], [3], axis=1))
    return Trajectory(
        time=table[:, 0],
        position=table[:, 1:4],
        orientation=table[:, 4:8],
        flexion=table[:, 8:23].reshape(-1, 5, 3),
        abduction=table[:, 23 : len(COLUMNS)],
        phases=phases_of(names, table[:, 0]),
        **stated,
    )


def csv_rows(text: str, expected: str) -> tuple[dict[str, str], list[str], Iterator[tuple[int, list[str]]]]:
    """Return the remarks of a CSV text, the cells of its header, and each row's line number and cells.

    Raises:
        TrajectoryError: No header line (the message says what is `expected`), or a row of another length.
    """
    lines = text.splitlines()
    remarks, first = read_remarks(lines)
    if first == len(lines):
        raise TrajectoryError(f"no header line; expected {expected}")
    separator = separator_of(lines[first])
    header = [word.strip() for word in next(csv.reader([lines[first]], delimiter=separator))]

    def rows() -> Iterator[tuple[int, list[str]]]:
        for number, cells in enumerate(csv.reader(lines[first + 1 :], delimiter=separator), start=first + 2):
            if any(cell.strip() for cell in cells):
                if len(cells) != len(header):
                    expected_count = f"expected {len(header)} as in the header"
                    raise TrajectoryError(f"line {number} has {len(cells)} values; {expected_count}")
                yield number, cells

    return remarks, header, rows()


def read_remarks(lines: Sequence[str]) -> tuple[dict[str, str], int]:
    """Return the `# key: value` lines, and the index of the header line."""
    remarks = {}
    for index, line in enumerate(lines):
        if line.startswith("#"):
            key, colon, value = line[1:].partition(":")
            if colon:
                remarks[key.strip()] = value.strip()
        elif line.strip():
            return remarks, index
    return remarks, len(lines)


def separator_of(header: str, separators: Sequence[str] = SEPARATORS) -> str:
    """Return the most frequent separator of a header line, of equals the first."""
    return max(separators, key=header.count)


def numbers_of(cells: Sequence[str], columns: Sequence[str], order: Iterable[int], line: int) -> list[float]:
    """Return the numbers in the cells of `columns` at the indices `order`.

    Raises:
        TrajectoryError: A cell holds none; the message names its line and its column.
    """
    values = []
    for column, index in zip(columns, order):
        try:
            values.append(float(cells[index]))
        except ValueError:
            cell = cells[index].strip()
            point = DECIMAL_POINT if "," in cell else ""
            raise TrajectoryError(f"line {line}: {column} is '{cell}'; expected a number{point}") from None
    return values


def object_pose(remarks: dict[str, str]) -> dict[str, FloatArray]:
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


def phases_of(names: Sequence[str], time: FloatArray) -> tuple[Phase, ...]:
    """Return phases from the name at each sample: runs of equal names.

    A run ends at the stamp after it, the last one at the last stamp.
    """
    found = []
    start = 0
    for index in range(1, len(names) + 1):
        if index == len(names) or names[index] != names[start]:
            if names[start]:
                found.append(Phase(names[start], float(time[start]), float(time[min(index, len(names) - 1)])))
            start = index
    return tuple(found)


def _phase_names(trajectory: Trajectory) -> list[str]:
    """Return the phase of each sample, "" if there is none."""
    names = [""] * trajectory.sample_count
    last = trajectory.phases[-1]
    for phase in trajectory.phases:
        first = int(np.searchsorted(trajectory.time, phase.start_time, side="left"))
        end = int(np.searchsorted(trajectory.time, phase.end_time, side="left"))
        if phase is last and phase.end_time >= trajectory.time[-1]:
            end = trajectory.sample_count
        names[first:end] = [phase.name] * (end - first)
    return names
