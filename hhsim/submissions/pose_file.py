"""Submissions, format `hhsim-poses`: the hand that some other software shows at every tick of a scene, CSV or HDF5.

docs/submissions.md lists columns, datasets and keys.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import DamagedFileError, InputError, UnknownNameError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.motion.csv_file import ABDUCTION_COLUMNS, FLEXION_COLUMNS
from hhsim.motion.csv_table import format_table, read_table
from hhsim.system.hdf5_input import DAMAGE, open_hdf5
from hhsim.system.input_file import read_input_text

FORMAT = "hhsim-poses"
KEYS = ("scene", "made_by", "method", "hand")
HDF5_SUFFIXES = (".h5", ".hdf5")
LOOSE_UNIT = 1e-3
"""Largest deviation of a quaternion from unit length; one in single precision or of six digits is nearer."""


@dataclass(frozen=True)
class Part:
    """Shape of a tick's value, and its columns of the CSV table."""

    shape: tuple[int, ...]
    unit: str
    columns: tuple[str, ...]
    optional: bool = False


def _axes(*stems: str) -> tuple[str, ...]:
    return tuple(f"{stem}{axis}" for stem in stems for axis in "xyz")


PARTS = {
    "time": Part((), "s", ("time",)),
    "position": Part((3,), "m", _axes("p")),
    "orientation": Part((4,), "1", ("qw", "qx", "qy", "qz")),
    "flexion": Part((5, 3), "rad", FLEXION_COLUMNS),
    "abduction": Part((5,), "rad", ABDUCTION_COLUMNS),
    "phalanx_force": Part(
        (5, 3, 3), "N", _axes(*(f"{finger}_{k}_f" for finger in FINGERS for k in (1, 2, 3))), optional=True
    ),
    "palm_force": Part((3,), "N", _axes("palm_f"), optional=True),
    "duration": Part((), "s", ("duration",), optional=True),
}
COLUMNS = {column: name for name, part in PARTS.items() for column in part.columns}


@dataclass(frozen=True, eq=False)
class Submission:
    """Hand that a method shows at every tick of a scene."""

    method: str  # name of the method
    # Digest of the scene (`hhsim.submissions.scene_file.scene_digest`), or its first digits; "" if not stated.
    scene: str
    time: FloatArray  # time since the start of the motion [s], shape (T,)
    poses: HandConfiguration  # the shown hand, fields of T rows
    # Contact force on each phalanx [N], world, shape (T, 5, 3, 3); None without forces.
    phalanx_force: FloatArray | None = None
    palm_force: FloatArray | None = None  # contact force on the palm [N], world, shape (T, 3); None for none
    # Computing time of each tick [s], measured by the method, shape (T,); None if not measured.
    duration: FloatArray | None = None
    # Words that the scene is made by (`hhsim.submissions.scene_file.scene_names`).
    made_by: Mapping[str, Any] = field(default_factory=dict)
    hand: str = ""  # side of the hand, right or left; "" if not stated
    path: Path | None = None

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """Arrays that it has, by the names in `PARTS`."""
        values = {"time": self.time, **self.poses._asdict()}
        more = {name: getattr(self, name) for name in PARTS if name not in values}
        return {**values, **{name: array for name, array in more.items() if array is not None}}

    def keys(self) -> dict[str, str]:
        """Return its non-empty values of `KEYS`."""
        made = json.dumps(dict(self.made_by)) if self.made_by else ""
        said = {"scene": self.scene, "made_by": made, "method": self.method, "hand": self.hand}
        return {key: value for key, value in said.items() if value}


def read_submission(path: Path) -> Submission:
    """Read and check a submission, .csv or .h5, as far as it can be checked without its scene.

    Raises InputError for no such file, another format, a column that is missing or of another unit, a wrong shape, a
    number that is not finite, or no unit quaternion; one line that begins with the path.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file; expected a submission, .csv or .h5")
    suffix = path.suffix.lower()
    if suffix not in (".csv", *HDF5_SUFFIXES):
        raise InputError(f"{path}: unknown suffix '{suffix}'; expected a submission, .csv or .h5")
    try:
        if suffix == ".csv":
            # A byte order mark is what spreadsheets put first.
            said, arrays = parse_poses(read_input_text(path, "utf-8-sig"))
        else:
            said, arrays = _read_hdf5(path)
        return _submission(said, arrays, path)
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text; expected a CSV file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (DamagedFileError, InputError) as error:
        raise InputError(f"{path}: {error}") from None


def format_poses(submission: Submission) -> str:
    """Return the CSV text; numbers have full precision, so that the same bits are read back."""
    arrays = submission.arrays
    names = [f"{column} [{PARTS[name].unit}]" for name in arrays for column in PARTS[name].columns]
    numbers = np.column_stack([array.reshape(len(array), -1) for array in arrays.values()]).tolist()
    header = [name.removesuffix(" [1]") for name in names]
    return format_table({"format": FORMAT} | submission.keys(), header, ([*map(repr, row)] for row in numbers))


def parse_poses(text: str) -> tuple[dict[str, str], dict[str, FloatArray]]:
    """Read the keys and the arrays of a CSV text.

    Raises InputError for a missing or unknown column, another unit, a line of another length, or a cell without a
    number.
    """
    table = read_table(text, strict=True)
    said = table.remarks
    if said.get("format", FORMAT) != FORMAT:
        raise InputError(f"format {said['format']}; expected {FORMAT}")
    header = _columns(table.header)
    numbers, _ = table.numbers(table.header)
    arrays = {}
    for name, part in PARTS.items():
        if part.columns[0] in header:
            chosen = [header.index(column) for column in part.columns]
            arrays[name] = np.ascontiguousarray(numbers[:, chosen]).reshape(len(numbers), *part.shape)
    return said, arrays


def _columns(headings: Sequence[str]) -> list[str]:
    """Return the names of the columns; raise InputError for missing or unknown ones, or another unit."""
    found = []
    for heading in headings:
        match = re.fullmatch(r"\s*([^\[\]]*?)\s*(?:\[(.*)\])?\s*", heading)
        column, unit = (match[1], match[2]) if match else (heading, None)
        if column not in COLUMNS:
            raise InputError(f"the header has an {UnknownNameError('column', column, COLUMNS)}")
        expected = PARTS[COLUMNS[column]].unit
        if unit is not None and unit != expected:
            raise InputError(f"column {column} is in {unit}; expected {expected}")
        if column in found:
            raise InputError(f"the header has column {column} twice")
        found.append(column)
    for part in PARTS.values():
        missing = [column for column in part.columns if column not in found]
        if missing and not (part.optional and len(missing) == len(part.columns)):
            more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
            raise InputError(f"the header lacks {', '.join(missing[:4])}{more}")
    return found


def _read_hdf5(path: Path) -> tuple[dict[str, str], dict[str, FloatArray]]:
    try:
        with open_hdf5(path) as file:
            if file.attrs.get("format") != FORMAT:
                raise InputError(f"format {file.attrs.get('format')}; expected an attribute format, {FORMAT}")
            said = {key: str(file.attrs[key]) for key in KEYS if key in file.attrs}
            arrays = {}
            for name, part in PARTS.items():
                dataset = file.get(name)
                if not isinstance(dataset, h5py.Dataset):
                    if not part.optional:
                        raise InputError(f"no dataset {name}; expected one of shape {_spelled(part.shape)}")
                    continue
                unit = dataset.attrs.get("units", part.unit)
                if unit != part.unit:
                    raise InputError(f"dataset {name} is in {unit}; expected {part.unit}")
                if dataset.dtype.kind not in "fiu":
                    raise InputError(f"dataset {name} holds no numbers")
                arrays[name] = np.asarray(dataset[()], dtype=np.float64)
            return said, arrays
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError(f"no HDF5 file, or a damaged one: {str(error).splitlines()[0][:120]}") from None


def _submission(said: Mapping[str, str], arrays: dict[str, FloatArray], path: Path) -> Submission:
    ticks = len(arrays["time"]) if arrays["time"].ndim else 0
    if ticks == 0:
        raise InputError("no ticks; expected a pose for every tick of the scene")
    for name, array in arrays.items():
        if array.shape != (ticks, *PARTS[name].shape):
            wanted = _spelled(PARTS[name].shape)
            raise InputError(f"{name} has shape {array.shape}; expected {wanted}, T = {ticks:,} as time has")
        bad = np.flatnonzero(~np.isfinite(array).reshape(ticks, -1).all(axis=1))
        if bad.size:
            others = f", and of {bad.size - 1:,} more" if bad.size > 1 else ""
            raise InputError(f"{name} of tick {bad[0]:,} is not finite{others}")
    length = np.linalg.norm(arrays["orientation"], axis=1)
    bad = np.flatnonzero(np.abs(length - 1.0) > LOOSE_UNIT)
    if bad.size:
        off = f"has length {length[bad[0]]:.4g}"
        raise InputError(f"orientation of tick {bad[0]:,} {off}; expected a unit quaternion w x y z")
    if "duration" in arrays and (arrays["duration"] < 0.0).any():
        raise InputError(f"duration of tick {int(np.argmax(arrays['duration'] < 0.0)):,} is negative")
    if "palm_force" in arrays and "phalanx_force" not in arrays:
        raise InputError("palm_force without phalanx_force; expected both, or the second alone")
    try:
        made_by = json.loads(said.get("made_by", "{}"))
        if not isinstance(made_by, dict):
            raise ValueError("no object")
    except ValueError:
        raise InputError(f"made_by is {said['made_by']}; expected JSON as in the example of hhsim scene") from None
    if said.get("hand", "") not in ("", "right", "left"):
        raise InputError(f"hand is '{said['hand']}'; expected right or left")
    method = " ".join(said.get("method", path.stem).split()) or path.stem
    poses = HandConfiguration(*(arrays[name] for name in HandConfiguration._fields))
    poses.orientation[:] /= length[:, None]
    more = {name: arrays.get(name) for name in ("phalanx_force", "palm_force", "duration")}
    scene, hand = said.get("scene", ""), said.get("hand", "")
    return Submission(method, scene, arrays["time"], poses, **more, made_by=made_by, hand=hand, path=path)


def _spelled(shape: tuple[int, ...]) -> str:
    return f"({', '.join(map(str, ('T', *shape)))}{'' if shape else ','})"
