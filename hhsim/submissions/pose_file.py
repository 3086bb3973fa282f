"""Submissions, format `hhsim-poses`: hands and bodies as other software shows them at every tick, as CSV.

A block of columns is of a hand, or of a body that is free: its name and `_` precede them, but for a file of one hand.

docs/submissions.md lists columns and keys.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, UnknownNameError, named
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import SIDES
from hhsim.motion.csv_file import ABDUCTION_COLUMNS, FLEXION_COLUMNS
from hhsim.motion.csv_table import format_table, read_table
from hhsim.motion.trajectory import ObjectMotion
from hhsim.system.input_file import read_input_text

FORMAT = "hhsim-poses"
FORCES = ("phalanx_force", "palm_force")
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
OF_TICKS = ("time", "duration")
OF_BODY = tuple(ObjectMotion._fields)
ALONE = ""
"""Block of the hand of a file of one hand."""


class Block(NamedTuple):
    """Part of a block's values; of ticks themselves the block is `ALONE`."""

    owner: str
    part: str

    @property
    def name(self) -> str:
        """Its name in messages."""
        return "/".join(filter(None, self))

    @property
    def columns(self) -> list[str]:
        """Names of its columns in the CSV table."""
        return ["_".join(filter(None, (self.owner, column))) for column in PARTS[self.part].columns]


@dataclass(frozen=True, eq=False)
class Submission:
    """Hand, or right hand of two, and free bodies that a method shows at every tick of a scene."""

    method: str  # name of the method
    # Digest of the scene (`hhsim.submissions.scene_folder.scene_digest`), or its first digits; "" if not stated.
    scene: str
    time: FloatArray  # time since the start of the motion [s], shape (T,)
    poses: HandConfiguration  # the shown hand, fields of T rows
    # Contact force on each phalanx [N], world, shape (T, 5, 3, 3); None without forces.
    phalanx_force: FloatArray | None = None
    palm_force: FloatArray | None = None  # contact force on the palm [N], world, shape (T, 3); None for none
    # Computing time of each tick [s], measured by the method, shape (T,); None if not measured.
    duration: FloatArray | None = None
    # Words that the scene is made by (`hhsim.submissions.scene_folder.scene_names`).
    made_by: Mapping[str, Any] = field(default_factory=dict)
    hand: str = ""  # side of the hand, right or left; "" if not stated
    path: Path | None = None
    left: "Submission | None" = None  # the left hand of two
    # Poses of free bodies by their names: of the mesh that `hhsim scene` wrote, world, fields of T rows.
    bodies: Mapping[str, ObjectMotion] = field(default_factory=dict)

    @property
    def hands(self) -> "tuple[Submission, ...]":
        """The hand, or the right and the left one."""
        return (self,) if self.left is None else (self, self.left)

    @property
    def arrays(self) -> dict[Block, FloatArray]:
        """Arrays that it has."""
        of_ticks = {Block(ALONE, name): getattr(self, name) for name in OF_TICKS}
        hands = zip([ALONE] if self.left is None else SIDES, self.hands)
        shown = [(owner, {**hand.poses._asdict(), **{of: getattr(hand, of) for of in FORCES}}) for owner, hand in hands]
        shown += [(name, poses._asdict()) for name, poses in self.bodies.items()]
        found = of_ticks | {Block(owner, name): of for owner, values in shown for name, of in values.items()}
        return {block: array for block, array in found.items() if array is not None}

    def keys(self) -> dict[str, str]:
        """Return its non-empty remarks: scene, made_by, method and hand."""
        made = json.dumps(dict(self.made_by)) if self.made_by else ""
        hand = self.hand if self.left is None else ""
        said = {"scene": self.scene, "made_by": made, "method": self.method, "hand": hand}
        return {key: value for key, value in said.items() if value}


def read_submission(path: Path) -> Submission:
    """Read and check a submission, .csv, as far as it can be checked without its scene.

    Raises InputError for no such file, another format, a column that is missing or of another unit, a wrong shape, a
    number that is not finite, or no unit quaternion; one line that begins with the path.
    """
    if path.suffix.lower() != ".csv":
        raise InputError(f"{path}: unknown suffix '{path.suffix}'; expected a submission, .csv")
    with named(path):
        try:
            # A byte order mark is what spreadsheets put first.
            return _submission(*parse_poses(read_input_text(path, "utf-8-sig")), path)
        except FileNotFoundError:
            raise InputError("no such file; expected a submission, .csv") from None
        except UnicodeDecodeError:
            raise InputError("not UTF-8 text; expected a CSV file") from None
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}") from None


def format_poses(submission: Submission) -> str:
    """Return the CSV text; numbers have full precision, so that the same bits are read back."""
    arrays = submission.arrays
    names = [f"{column} [{PARTS[block.part].unit}]" for block in arrays for column in block.columns]
    numbers = np.column_stack([array.reshape(len(array), -1) for array in arrays.values()]).tolist()
    header = [name.removesuffix(" [1]") for name in names]
    return format_table({"format": FORMAT} | submission.keys(), header, ([*map(repr, row)] for row in numbers))


def parse_poses(text: str) -> tuple[dict[str, str], dict[Block, FloatArray]]:
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
    for block in header.values():
        chosen = [[*header].index(column) for column in block.columns]
        arrays[block] = np.ascontiguousarray(numbers[:, chosen]).reshape(len(numbers), *PARTS[block.part].shape)
    return said, arrays


def _columns(headings: Sequence[str]) -> dict[str, Block]:
    """Return the block of each column; InputError for missing, unknown or repeated ones, or another unit."""
    split = (re.fullmatch(r"\s*([^\[\]]*?)\s*(?:\[(.*)\])?\s*", heading) for heading in headings)
    units = {match[1] if match else heading: match and match[2] for match, heading in zip(split, headings)}
    blocks = _expected(units)
    known = {column: block for block in blocks for column in block.columns}
    for column, unit in units.items():
        if column not in known:
            raise InputError(f"the header has an {UnknownNameError('column', column, known)}")
        expected = PARTS[known[column].part].unit
        if unit not in (None, expected):
            raise InputError(f"column {column} is in {unit}; expected {expected}")
    if len(units) < len(headings):
        raise InputError("the header has a column twice, with its unit and without")
    for block in blocks:
        missing = [column for column in block.columns if column not in units]
        if missing and not (PARTS[block.part].optional and len(missing) == len(block.columns)):
            more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
            raise InputError(f"the header lacks {', '.join(missing[:4])}{more}")
    return {column: known[column] for column in units}


def _expected(columns: Iterable[str]) -> list[Block]:
    """Return the blocks that a file with some of these columns may or must have: of ticks, hands and bodies."""
    owners = dict.fromkeys(column.partition("_")[0] for column in columns)
    hands = SIDES if owners.keys() & set(SIDES) else (ALONE,)
    split = (column.rpartition("_") for column in columns if column.partition("_")[0] not in SIDES)
    bodies = dict.fromkeys(owner for owner, _, own in split if owner and COLUMNS.get(own) in OF_BODY)
    of_hand = [part for part in PARTS if part not in OF_TICKS]
    found = [Block(ALONE, part) for part in OF_TICKS]
    found += [Block(hand, part) for hand in hands for part in of_hand]
    return found + [Block(body, part) for body in bodies for part in OF_BODY]


def _submission(said: Mapping[str, str], arrays: dict[Block, FloatArray], path: Path) -> Submission:
    time = arrays[Block(ALONE, "time")]
    ticks = len(time)
    if ticks == 0:
        raise InputError("no ticks; expected a pose for every tick of the scene")
    for block, array in arrays.items():
        name = block.name
        bad = np.flatnonzero(~np.isfinite(array).reshape(ticks, -1).all(axis=1))
        if bad.size:
            others = f", and of {bad.size - 1:,} more" if bad.size > 1 else ""
            raise InputError(f"{name} of tick {bad[0]:,} is not finite{others}")
        if block.part == "orientation":
            length = np.linalg.norm(array, axis=1)
            bad = np.flatnonzero(np.abs(length - 1.0) > LOOSE_UNIT)
            if bad.size:
                off = f"has length {length[bad[0]]:.4g}"
                raise InputError(f"{name} of tick {bad[0]:,} {off}; expected a unit quaternion w x y z")
            array /= length[:, None]
    duration = arrays.get(Block(ALONE, "duration"))
    if duration is not None and (duration < 0.0).any():
        raise InputError(f"duration of tick {int(np.argmax(duration < 0.0)):,} is negative")
    owners = list(dict.fromkeys(block.owner for block in arrays if block.part not in OF_TICKS))
    sides = [owner for owner in (ALONE, *SIDES) if owner in owners]
    forces = {side: [arrays.get(Block(side, name)) for name in FORCES] for side in sides}
    for phalanx, palm in forces.values():
        if palm is not None and phalanx is None:
            raise InputError("palm_force without phalanx_force; expected both, or the second alone")
    if len({phalanx is None for phalanx, _ in forces.values()}) > 1:
        raise InputError("forces of one of two hands; expected those of both, or none")
    try:
        made_by = json.loads(said.get("made_by", "{}"))
        if not isinstance(made_by, dict):
            raise ValueError("no object")
    except ValueError:
        raise InputError(f"made_by is {said['made_by']}; expected JSON as in the example of hhsim scene") from None
    if said.get("hand", "") not in ("", *SIDES):
        raise InputError(f"hand is '{said['hand']}'; expected right or left")
    method = " ".join(said.get("method", path.stem).split()) or path.stem
    about: dict[str, Any] = {"duration": duration, "made_by": made_by, "path": path}
    about["bodies"] = {
        name: ObjectMotion(*(arrays[Block(name, part)] for part in OF_BODY)) for name in owners if name not in sides
    }
    for side in reversed(sides):
        poses = HandConfiguration(*(arrays[Block(side, name)] for name in HandConfiguration._fields))
        hand = side or said.get("hand", "")
        about |= {"hand": hand, **dict(zip(FORCES, forces[side], strict=True))}
        made = Submission(method, said.get("scene", ""), time, poses, **about)
        about["left"] = made
    return made
