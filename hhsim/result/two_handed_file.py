"""Result file of two hands: `hands/right` and `hands/left` are a result each, and /between holds how far they are."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

from hhsim.arrays import AnyArray
from hhsim.result.schema import HANDS, SIDES, STATIC_COLUMNS, TWO_HANDED_SCHEMA_VERSION, Column, is_one_of_two
from hhsim.result.writer import describe_dataset, output_errors
from hhsim.system.atomic_write import partial_file
from hhsim.system.checksummed_file import seal_file
from hhsim.system.hdf5_input import open_hdf5

OBJECT = "object"
BETWEEN = "between"
BETWEEN_COLUMNS = (
    Column("haptic_distance", (), "<f8", "m", "least signed distance of the two haptic hands, negative inside"),
    Column("graphic_distance", (), "<f8", "m", "least signed distance of the two graphic hands, negative inside"),
)
"""Datasets under /between, one row a tick."""
STATED = ("format", "command", "hhsim_version", "created_utc", "git_revision", "git_dirty", "machine", "packages")
"""Attributes of the right hand's result that the whole file states too."""


def partial_of(path: Path, side: str) -> Path:
    """Return the path at which one of two hands is recorded until both are complete, such as FILE.left.partial.h5."""
    return path.with_name(f"{path.stem}.{side}.partial{path.suffix}")


def other_of_two(path: Path) -> Path | None:
    """Return the path of the other hand's result of a file of two, or of a run that was killed; None if there is none.

    Such a run leaves a file a hand, of the names of `partial_of`.
    """
    if is_one_of_two(path):
        return path.with_name(SIDES[path.name == SIDES[0]])
    for side, theirs in zip(SIDES, reversed(SIDES)):
        stem, mark, rest = path.name.rpartition(f".{side}.partial")
        if mark and (other := path.with_name(f"{stem}.{theirs}.partial{rest}")).is_file():
            return other
    return None


def join_hands(parts: Sequence[Path], between: Mapping[str, AnyArray], path: Path) -> Path:
    """Join the complete results of the right and the left hand, in the order of `SIDES`, to one file, and delete them.

    `between` has the arrays of `BETWEEN_COLUMNS` by name, none where the hands have no ticks in common. Raises
    OutputError where the file cannot be written; the parts stay.
    """
    with output_errors(path):
        with partial_file(path) as partial:
            with h5py.File(partial, "w") as file:
                for side, part in zip(SIDES, parts, strict=True):
                    with open_hdf5(part) as one:
                        _copy_hand(one, file, side)
                file.attrs.update({name: file[HANDS][SIDES[0]].attrs[name] for name in STATED})
                for column in BETWEEN_COLUMNS if between else ():
                    values = np.asarray(between[column.name], column.dtype)
                    describe_dataset(file.create_dataset(f"{BETWEEN}/{column.name}", data=values), column)
                file.attrs.update({"schema_version": TWO_HANDED_SCHEMA_VERSION, "complete": 1})
                file.flush()
                size = int(file.id.get_filesize())
            seal_file(partial, size)
        for part in parts:
            part.unlink()
    return path


def _copy_hand(one: h5py.File, file: h5py.File, side: str) -> None:
    """Copy a result to its hand's group; an object equal to the right hand's becomes a link to that."""
    hand = file.create_group(f"{HANDS}/{side}")
    hand.attrs.update(one.attrs)
    for name in one:
        other = file[HANDS][SIDES[0]].get(name)
        if name == OBJECT and other is not None and _equal(one[name], other):
            hand[name] = other
        else:
            one.copy(name, hand)


def _equal(one: h5py.Group, other: h5py.Group) -> bool:
    """Return whether the object's static datasets of two results are equal."""
    names = [column.name.removeprefix(f"{OBJECT}/") for column in STATIC_COLUMNS if column.name.startswith(OBJECT)]
    return all(np.array_equal(one[name], other[name]) for name in names)
