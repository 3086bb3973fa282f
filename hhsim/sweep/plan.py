"""What a sweep runs: a TOML file of objects, motions, methods, surfaces and options, each with each.

Keys, with their defaults where they have one::

    version = 1
    name = "first"                          # of the folder in results/; default: the file's
    objects = ["cube", { file = "mug.stl", unit = "mm" }]       # also name, size_mm, thickness_mm
    motions = ["grasp", "takes/*.npz", { file = "take.h5", name = "third" }]
    methods = ["coupled"]
    surfaces = ["spheres"]
    seeds = [0]
    ticks = 500                             # only the first so many of each motion; default: all
    repeat = 5                              # runs of each cell, for the mean and the deviation of its times; default: 1

    [options.usual]                         # sets of options, each under its name; default: one that changes nothing
    [options.coarse]
    level = 3
    linearisations = 3

Files are relative to the plan's folder. Options are named as a result states them, in SI units.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, get_args

from hhsim.errors import InputError, check_known
from hhsim.mesh.catalogue import names_a_file, object_names
from hhsim.motion.trajectory import ResampleMode
from hhsim.scene.demonstration import Demonstration
from hhsim.scene.motion_catalogue import import_remarks, resolve_trajectory, trajectory_names
from hhsim.scene.open_scene import SIDES
from hhsim.scene.placed_scene import Place
from hhsim.scene.script import Script
from hhsim.solver.known_methods import find_method
from hhsim.solver.surface import SURFACES
from hhsim.sweep.cell import BOTH, OF_THE_SCENE, OF_THE_SOLVER, Cell, SweptMotion, SweptObject
from hhsim.system.counted import counted
from hhsim.system.toml_document import (
    check_keys,
    checked_number,
    checked_table,
    checked_text,
    parse_toml,
    read_toml_text,
)
from hhsim.trees.options import MOST_LEVEL

PLAN_VERSION = 1
MOST_TICKS = 1_000_000_000
MOST_RUNS = 1_000
KEYS = ("version", "name", "objects", "motions", "methods", "surfaces", "seeds", "ticks", "repeat", "options")
UNITS = ("m", "cm", "mm", "inch")
WILD = frozenset("*?[")


@dataclass(frozen=True)
class PlannedCell:
    """A cell, its digest, and how many ticks it has."""

    cell: Cell
    digest: str
    ticks: int

    @property
    def run_ticks(self) -> int:
        """Of all its runs."""
        return self.ticks * self.cell.repeat


@dataclass(frozen=True)
class SweepPlan:
    """What is run.

    Attributes:
        folder: The plan's; files in it are relative to it.
        notes: What cannot be together and what comes to the same, and how many cells that are, and what is said of
            recordings, a sentence each.
    """

    name: str
    folder: Path
    text: str
    cells: tuple[PlannedCell, ...]
    notes: tuple[str, ...] = ()


def load_plan(path: Path) -> SweepPlan:
    """Read a plan and look at all that it names.

    Raises:
        InputError: No such file, no TOML; a key, a name, a file or a value that no plan has; two cells that are the
            same.
    """
    return parse_plan(read_toml_text(path, "plan of a sweep"), path.stem, path.parent, str(path))


def parse_plan(text: str, name: str, folder: Path, where: str) -> SweepPlan:
    """Read the text of a plan.

    Args:
        text: TOML.
        name: Of the sweep where the plan states none.
        folder: That files are relative to.
        where: For messages.

    Raises:
        InputError: As `load_plan`.
    """
    table = parse_toml(text, where)
    check_keys(where, table, KEYS)
    if table.get("version") != PLAN_VERSION:
        raise InputError(f"{where}: version is {table.get('version')!r}, this hhsim reads {PLAN_VERSION}")
    name = checked_text(where, "name", table.get("name", name))
    if not name or name.startswith(".") or "/" in name:
        raise InputError(f"{where}: name = '{name}'; expected a name for a folder")
    objects = _unique(where, "objects", [_object(where, folder, entry) for entry in _listed(where, table, "objects")])
    motions = _unique(
        where,
        "motions",
        [found for entry in _listed(where, table, "motions") for found in _motions(where, folder, entry)],
    )
    methods = [checked_text(where, "methods", entry) for entry in _listed(where, table, "methods", ["coupled"])]
    surfaces = [checked_text(where, "surfaces", entry) for entry in _listed(where, table, "surfaces", ["spheres"])]
    check_known("surface", surfaces, SURFACES.names())
    seeds = [_count(where, "seeds", entry, 0, 2**63 - 1) for entry in _listed(where, table, "seeds", [0])]
    ticks = None if "ticks" not in table else _count(where, "ticks", table["ticks"], 1, MOST_TICKS)
    repeat = _count(where, "repeat", table.get("repeat", 1), 1, MOST_RUNS)
    options = checked_table(where, "options", table.get("options", {"usual": {}}))
    sets = {key: _options(f"{where}, [options.{key}]", folder, value) for key, value in options.items()}
    if not sets:
        raise InputError(f"{where}: options is empty; leave it out, or name a set: [options.usual]")
    left_out: dict[str, int] = {}
    cells: dict[str, PlannedCell] = {}
    durations = {motion.word: _Motion.read(folder, motion) for motion in motions}
    checked: set[tuple[str, str, str]] = set()
    for shape, motion, method, surface, (called, given), seed in product(
        objects, motions, methods, surfaces, sets.items(), seeds
    ):
        why = _impossible(shape, durations[motion.word], motion, method, surface)
        if why:
            left_out[why] = left_out.get(why, 0) + 1
            continue
        cell = Cell(shape, motion, method, surface, called, given, seed, ticks, repeat)
        if (method, surface, called) not in checked:
            _check_options(cell, where)
            checked.add((method, surface, called))
        planned = PlannedCell(cell, cell.digest(folder), durations[motion.word].ticks(given.get("rate", 1000.0), ticks))
        same = cells.setdefault(planned.digest, planned).cell
        if same is not cell:
            names = same.options_name.split(BOTH)
            if called in names or replace(same, options_name=called, options=given) != cell:
                raise InputError(f"{where}: two cells are the same: {same.label}; {cell.label}")
            cells[planned.digest] = replace(
                planned, cell=replace(same, options_name=BOTH.join((same.options_name, called)))
            )
    if not cells:
        raise InputError(f"{where}: no cell is left: {'; '.join(left_out)}")
    notes = [f"{count:,} cell{'s' * (count > 1)} left out: {why}" for why, count in left_out.items()]
    shared = Counter((cell.object.name, cell.options_name) for cell in (planned.cell for planned in cells.values()))
    notes += [
        f"{shape}: {counted(count, 'cell')} computed once and called {names}: there these options come to the same"
        for (shape, names), count in shared.items()
        if BOTH in names
    ]
    notes += [f"{motion.name}: {remark}" for motion in motions for remark in durations[motion.word].remarks]
    return SweepPlan(name, folder, text, tuple(cells.values()), tuple(notes))


@dataclass(frozen=True)
class _Motion:
    """What of a motion decides how many ticks it has, which objects it is for, and what is said of it."""

    duration: float
    closed: bool
    objects: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    @classmethod
    def read(cls, folder: Path, motion: SweptMotion) -> "_Motion":
        shipped = motion.word in trajectory_names()
        word = motion.word if shipped else str(folder / motion.word)
        found = resolve_trajectory(word)
        if isinstance(found, Script):
            return cls(found.sample_count / found.rate, False, found.objects)
        recorded = found.motion if isinstance(found, Demonstration) else found
        return cls(recorded.duration, True, (), tuple(import_remarks(found, word)))

    def ticks(self, rate: float, most: int | None) -> int:
        count = round(self.duration * rate) + self.closed
        return max(1, count if most is None else min(count, most))


def _impossible(shape: SweptObject, motion: _Motion, swept: SweptMotion, method: str, surface: str) -> str:
    if motion.objects and shape.word not in motion.objects:
        return f"motion {swept.name} is made for {', '.join(motion.objects)}"
    refuses = find_method(method).refuses_surfaces
    if surface != "spheres" and refuses:
        return f"method {method} takes no surface {surface}"
    return ""


def _check_options(cell: Cell, where: str) -> None:
    try:
        cell.solver_options()
    except InputError as error:
        raise InputError(f"{where}, [options.{cell.options_name}], {cell.method}: {error}") from None


def _listed(where: str, table: Mapping[str, Any], key: str, usual: list[Any] | None = None) -> list[Any]:
    found = table.get(key, usual)
    if not isinstance(found, list) or not found:
        what = "missing" if found is None else repr(found)
        raise InputError(f"{where}: {key} is {what}; expected a list such as {key} = {EXAMPLES[key]}")
    return found


EXAMPLES = {
    "objects": '["cube", "bunny"]',
    "motions": '["grasp", "takes/*.npz"]',
    "methods": '["coupled"]',
    "surfaces": '["spheres", "mesh"]',
    "seeds": "[0, 1]",
}


def _object(where: str, folder: Path, entry: Any) -> SweptObject:
    if isinstance(entry, str):
        entry = {"file": entry}
    table = checked_table(where, "objects", entry, ("file", "name", "unit", "size_mm", "thickness_mm"))
    word = checked_text(where, "objects: file", table.get("file"))
    if not names_a_file(word):
        check_known("object", [word], object_names())
        if table.keys() & {"unit", "size_mm", "thickness_mm"}:
            raise InputError(f"{where}: '{word}' has its size: unit, size_mm and thickness_mm are for mesh files")
    else:
        _require_file(where, folder, word)
    unit = table.get("unit")
    if unit is not None:
        check_known("unit", [checked_text(where, "unit", unit)], UNITS)
    sizes = {
        key: checked_number(where, key, table[key], 1e-3, 1e5) for key in ("size_mm", "thickness_mm") if key in table
    }
    return SweptObject(checked_text(where, "name", table.get("name", Path(word).stem)), word, unit, **sizes)


def _motions(where: str, folder: Path, entry: Any) -> Iterator[SweptMotion]:
    if isinstance(entry, str):
        entry = {"file": entry}
    table = checked_table(where, "motions", entry, ("file", "name"))
    word = checked_text(where, "motions: file", table.get("file"))
    if word in trajectory_names():
        yield SweptMotion(checked_text(where, "name", table.get("name", word)), word)
        return
    if not WILD.isdisjoint(word):
        root = folder if not Path(word).is_absolute() else Path(word).anchor
        pattern = word if root == folder else str(Path(word).relative_to(Path(word).anchor))
        found = sorted(Path(root).glob(pattern))
        if not found:
            raise InputError(f"{where}: no file is called {word} in {folder.resolve()}")
        for path in found:
            yield SweptMotion(path.stem, str(path.relative_to(folder) if root == folder else path))
        return
    if names_a_file(word):
        _require_file(where, folder, word)
    else:
        check_known("trajectory", [word], trajectory_names())
    yield SweptMotion(checked_text(where, "name", table.get("name", Path(word).stem)), word)


def _require_file(where: str, folder: Path, word: str) -> None:
    if not (folder / word).is_file():
        raise InputError(f"{where}: there is no file {word} in {folder.resolve()}")


def _unique(where: str, key: str, entries: list[Any]) -> list[Any]:
    names = [entry.name for entry in entries]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{where}: {key}: two are called {twice[0]}; give one another name: {{ file = …, name = … }}")
    return entries


def _count(where: str, key: str, value: Any, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InputError(f"{where}: {key}: {value!r}; expected a whole number from {least} to {most}")
    return value


def _options(where: str, folder: Path, value: Any) -> dict[str, Any]:
    table = checked_table(where, "options", value, (*OF_THE_SCENE, *OF_THE_SOLVER))
    for key, check in _CHECKS.items():
        if key in table:
            check(where, key, table[key])
    if "hand_file" in table:
        _require_file(where, folder, checked_text(where, "hand_file", table["hand_file"]))
    if {"level", "max_error"} <= table.keys():
        raise InputError(f"{where}: max_error chooses the level itself: leave level out")
    return table


def _one_of(known: tuple[str, ...]) -> Callable[[str, str, Any], None]:
    def check(where: str, key: str, value: Any) -> None:
        if value not in known:
            raise InputError(f"{where}: {key} = {value!r}; expected {' or '.join(known)}")

    return check


def _within(low: float, high: float) -> Callable[[str, str, Any], object]:
    return lambda where, key, value: checked_number(where, key, value, low, high)


def _level(where: str, key: str, value: Any) -> None:
    _count(where, key, value, 1, MOST_LEVEL)


def _tremor(where: str, key: str, value: Any) -> None:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{where}: {key} = {value!r}; expected two numbers, [mm] and [°], such as [0.1, 0.2]")
    for number in value:
        checked_number(where, key, number, 0.0, 100.0)


_CHECKS: Mapping[str, Callable[[str, str, Any], object]] = {
    "level": _level,
    "max_error": _within(1e-6, 1.0),
    "rate": _within(1.0, 100_000.0),
    "samples": _one_of(get_args(ResampleMode)),
    "place_object": _one_of(get_args(Place)),
    "hand": _one_of(SIDES),
    "tremor_mm_deg": _tremor,
}
