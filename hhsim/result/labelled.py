"""Datasets of a result with named axes and units: as a data set of xarray, or ticks as a CSV table, a line a tick."""

import csv
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import InputError, OutputError, UnknownNameError
from hhsim.hand.fingers import FINGERS, PHALANX_NAMES
from hhsim.result import schema
from hhsim.result.schema import Column
from hhsim.system.atomic_write import partial_file
from hhsim.system.output_path import begins_with, check_output_path
from hhsim.system.progress import Progress, silent

if TYPE_CHECKING:
    import xarray

    from hhsim.result.reader import Result

SIZES = {
    "force/size": (Column("force/size", (), "<f8", "N", "size of the total force"), "force/total"),
    "force/finger": (Column("force/finger", (5,), "<f8", "N", "size of the force on each finger"), "force/phalanx"),
}
"""Columns of force magnitudes, summed over phalanges, and the datasets that they are computed from."""
USUAL = (
    *("time", "input_seq", "haptic/position", "graphic/position", "force/total", "force/size", "force/finger"),
    "force_variation_rate",
    *("penetration_depth", "contacts/candidates", "contacts/touching"),
    *("duration/total_cpu", "duration/total", "status", "lag"),
)
"""Datasets of a CSV table by default."""
ALL = "all"
LABELS: dict[str, Sequence[str]] = {
    "axis": "xyz",
    "quaternion": "wxyz",
    "wrench": ("fx", "fy", "fz", "mx", "my", "mz"),
    "finger": FINGERS,
    "phalanx": PHALANX_NAMES,
    "joint": PHALANX_NAMES,
    "point": (*PHALANX_NAMES, "tip"),
}
"""Labels along the axes of a tick's value."""
_SHARED = (schema.TIME.name, *(f"{group}/" for group in (schema.BETWEEN, schema.BODIES, schema.CONTACT)))
"""Beginnings of the names of datasets that are of no hand."""


class Variable(NamedTuple):
    """Values by axes, the first of which has the rows; SI unit, `1` for none; and a description for people."""

    axes: tuple[str, ...]
    values: AnyArray
    units: str = "1"
    long_name: str = ""


def as_dataset(
    variables: Mapping[str, Variable], coordinates: Mapping[str, Any], attributes: Mapping[str, Any]
) -> "xarray.Dataset":
    """Return an xarray Dataset, units and descriptions as attributes; InputError without xarray.

    Args:
        variables: By name.
        coordinates: Variables, or labels along the axis of their name, as xarray takes them; axes of no variable are
            left out.
        attributes: Of the data set.
    """
    try:
        library = import_module("xarray")
    except ImportError:
        raise InputError("xarray is not installed: pip install 'hhsim[xarray]'") from None
    used = {axis for variable in variables.values() for axis in variable.axes}

    def taken(value: Any) -> Any:
        if not isinstance(value, Variable):
            return value
        stated = {"units": value.units, "long_name": value.long_name}
        return value.axes, value.values, {name: text for name, text in stated.items() if text}

    kept = {
        name: taken(value)
        for name, value in coordinates.items()
        if set(value.axes if isinstance(value, Variable) else () if isinstance(value, str) else (name,)) <= used
    }
    made = {name: taken(variable) for name, variable in variables.items()}
    found: xarray.Dataset = library.Dataset(made, kept, dict(attributes))
    return found


def sizes(force: FloatArray) -> FloatArray:
    """Return magnitudes of forces (T, 3), or of their sums over phalanges (T, fingers, 3, 3) [N]."""
    return np.asarray(np.linalg.norm(force if force.ndim == 2 else force.sum(axis=2), axis=-1))


def tick_columns(result: "Result") -> dict[str, Column]:
    """Return the columns with a row a tick by the names of their datasets, and those of `SIZES`."""
    known = {column.name: column for column in schema.TICK_COLUMNS} | {
        name: column for name, (column, _) in SIZES.items()
    }
    if result.other is not None:
        known |= {column.name: column for column in schema.BETWEEN_COLUMNS if column.name in result}
    if result.live is not None:
        known |= _prefixed(schema.LIVE_TICK, schema.LIVE_TICK_COLUMNS)
    for body in result.bodies.values():
        known |= _prefixed(f"{body.group}/{schema.TICK}", body.columns)
    return known


def variables(result: "Result", names: Sequence[str] = ()) -> dict[str, Variable]:
    """Return datasets by name, or all of those named `GROUP/…`; all that there are for no name.

    The rows are along `time`, `contact` or `sample`; the next axis is `hand` for what each hand of two has.

    Raises:
        UnknownNameError: No such dataset or group.
    """
    hands = [result] if result.name else list(result.hands.values())
    known = {name: ("time", column) for name, column in tick_columns(hands[0]).items()}
    tables = {"contact": _prefixed(schema.CONTACT, schema.CONTACT_COLUMNS)}
    if len(hands) == 1 and result.live is not None:
        tables["sample"] = _prefixed(schema.LIVE_SAMPLE, schema.sample_columns(-1))
    stored = result.keys()
    known |= {name: (row, of[name]) for row, of in tables.items() for name in of if name in stored}

    def values(name: str) -> Any:
        """Return the rows of a dataset, of both hands in a file of two as a whole."""
        if name.startswith(_SHARED):
            return result[name]
        of_hands = [sizes(hand[SIZES[name][1]]) if name in SIZES else hand[name] for hand in hands]
        return of_hands[0] if result.name else np.stack(of_hands, axis=1)

    found: dict[str, Variable] = {}
    for word in names or known:
        inside = [word] if word in known else [name for name in known if name.startswith(f"{word}/")]
        if not inside:
            raise UnknownNameError("dataset", word, known)
        for name in inside:
            row, column = known[name]
            of_hand = () if result.name or name.startswith(_SHARED) else ("hand",)
            found[name] = Variable((row, *of_hand, *_axes(column)), values(name), column.units, column.long_name)
    return found


def coordinates(result: "Result") -> dict[str, Any]:
    """Return the time, number and phase of each tick, the hand or both, and `LABELS`."""
    phase = np.zeros(result.ticks, f"U{max((len(phase.name) for phase in result.phases), default=1)}")
    for one in reversed(result.phases):
        phase[one.first_tick : one.last_tick + 1] = one.name
    time = Variable(("time",), result["time"], schema.TIME.units, schema.TIME.long_name)
    tick = Variable(("time",), np.arange(result.ticks), long_name="number of the tick, from 0")
    of_ticks = {"time": time, "tick": tick, "phase": Variable(("time",), phase, "")}
    return {**of_ticks, "hand": result.name or list(result.hands), **{name: list(of) for name, of in LABELS.items()}}


def _prefixed(group: str, columns: Any) -> dict[str, Column]:
    return {f"{group}/{column.name}": replace(column, name=f"{group}/{column.name}") for column in columns}


def _axes(column: Column) -> tuple[str, ...]:
    """Return the axes of a tick's value, named as `LABELS`."""
    if column.shape == (-1,):
        return ("channel",)
    last = {3: "joint" if column.units == "rad" else "axis", 4: "quaternion", 5: "finger", 6: "wrench"}
    axes = ("finger", "point" if column.shape[1:2] == (4,) else "phalanx")[: max(len(column.shape) - 1, 0)]
    return (*axes, *(last[size] for size in column.shape[-1:]))


def export_ticks(
    result: "Result", path: Path, columns: Sequence[str] | None = None, progress: Progress = silent
) -> tuple[str, ...]:
    """Write datasets of every tick and return the headings, each with index and unit.

    Args:
        result: Complete or not.
        path: The table; an existing one is replaced when the new one is complete.
        columns: Names of datasets of the hand at the ticks, of `SIZES`, of live/tick of a session, of bodies at the
            ticks; or `all`. None for the usual ones.

    Raises:
        UnknownNameError: No such dataset.
        OutputError: It cannot be written there, the name does not end in .csv, or another file is there.
    """
    check_output_path(path, "table of ticks", begins_with(b"tick,"), (".csv",))
    known = tick_columns(result)
    wanted = tuple(known) if columns and ALL in columns else tuple(columns or USUAL)
    for name in wanted:
        if name not in known:
            raise UnknownNameError("dataset", name, known)
        headings: list[str] = []
    for column in (known[name] for name in wanted):
        unit = "" if column.units in ("", "1") else f" [{column.units}]"
        for index in itertools.product(*(range(size) for size in column.shape)):
            place = f"[{','.join(map(str, index))}]" if index else ""
            headings.append(f"{column.name}{place}{unit}")
    try:
        with partial_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(("tick", *headings))
            first = 0
            needed = tuple(dict.fromkeys(SIZES[name][1] if name in SIZES else name for name in wanted))
            for block in result.blocks(needed):
                progress("ticks", first, result.ticks)
                # As Python's numbers: they are written with as many digits as give the same number back.
                values = [sizes(block[SIZES[name][1]]) if name in SIZES else block[name] for name in wanted]
                flat = [each.reshape(len(each), -1).tolist() for each in values]
                table.writerows([tick, *itertools.chain(*row)] for tick, row in enumerate(zip(*flat), start=first))
                first += len(flat[0])
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error
    return tuple(headings)
