"""Plan of a sweep: a TOML file of objects, motions, methods, surfaces and options, each combined with each.

docs/results.md lists its keys. Files are relative to the plan's folder. Options have a result's names, in SI units. A
cell is one combination: one replay, its parts, its name, and its digest.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from glob import glob
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, structs

from hhsim import __version__
from hhsim.errors import InputError, check_known, named
from hhsim.mesh.catalogue import names_a_file, object_names, usual_level
from hhsim.scene.described_scene import LoadedWords, SceneWords, load_words
from hhsim.scene.motion_catalogue import import_remarks, resolve_trajectory, trajectory_names
from hhsim.scene.script import Script
from hhsim.solver.method import SURFACES, find_method
from hhsim.solver.options import SolverOptions
from hhsim.sweep.input_files import ReadFile, file_digest, read_files, source_digest
from hhsim.system.counted import counted
from hhsim.system.settings_file import Settings, Version, a_list, between, parse_settings, read_toml_text, typed

DIGITS = 20
"""Hexadecimal digits of a cell's digest: 80 bits."""
OF_THE_SOLVER = tuple(key.name for key in fields(SolverOptions) if key.name not in ("method", "surface", "period"))
OF_THE_SCENE = ("level", "max_error", "rate", "samples", "place_object", "hand", "hand_file", "tremor_mm_deg")
"""Options of a plan besides the solver's, by the names of `SceneWords`, SI."""
BOTH = " = "
"""Separator of the names of sets of options that are the same for a cell."""
WILD = frozenset("*?[")


class SweptObject(Settings, frozen=True, rename={"word": "file"}):
    """An object by a name of the catalogue, or a mesh file, relative to the plan's folder, and its name in tables.

    Its sizes are as of `hhsim.scene.described_scene.SceneWords`.
    """

    word: str
    name: str = ""
    unit: Literal["m", "cm", "mm", "inch"] | None = None
    size_mm: Annotated[float, between(1e-3, 1e5)] | None = None
    solid: bool = False


class SweptMotion(Settings, frozen=True, rename={"word": "file"}):
    """Motion of a plan: a name of the catalogue or a file, relative to the plan's folder, and its name in tables."""

    word: str
    name: str = ""


@dataclass(frozen=True)
class Cell:
    """Replay of a sweep."""

    object: SweptObject
    motion: SweptMotion
    method: str
    surface: str  # surface of the object that the hand touches
    options_name: str = "usual"  # name of the options in the plan
    # Those of `OF_THE_SOLVER` and `OF_THE_SCENE` that the plan states, SI.
    options: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    ticks: int | None = None  # number of ticks from the first; None for all
    # Number of runs. The last one is kept, with the mean and the deviation of all their times. No part of the digest,
    # since it changes only times.
    repeat: int = 1
    folder: Path = field(default=Path(), compare=False)  # folder that its files are relative to
    length: int = field(default=0, compare=False)  # number of ticks of one run

    @property
    def label(self) -> str:
        """Name in messages."""
        parts = [self.object.name, self.motion.name, self.method]
        parts += [self.surface] if self.surface != "spheres" else []
        parts += [self.options_name] if self.options else []
        parts += [f"seed {self.seed}"] if self.seed else []
        return ", ".join(parts)

    @property
    def stated(self) -> str:
        """Options that the plan states, as name=value."""
        return " ".join(f"{name}={value}" for name, value in self.options.items())

    @property
    def files(self) -> tuple[str, ...]:
        """Files that it reads, as the plan names them."""
        shape = [self.object.word] if names_a_file(self.object.word) else []
        motion = [self.motion.word] if self.motion.word not in trajectory_names() else []
        hand = [self.options["hand_file"]] if self.options.get("hand_file") is not None else []
        return (*shape, *motion, *hand)

    def solver_options(self) -> SolverOptions:
        """Return the solver's options; raise InputError for those that the method refuses, or out of range."""
        given = {name: value for name, value in self.options.items() if name in OF_THE_SOLVER}
        return SolverOptions.from_json({"method": self.method, "surface": self.surface, **given})

    def words(self) -> SceneWords:
        """Return the words that describe its scene."""
        shape = {name: getattr(self.object, name) for name in ("unit", "size_mm", "solid")}
        names = {"object": self.object.word, "trajectory": self.motion.word}
        stated = {name: value for name, value in self.options.items() if name in OF_THE_SCENE}
        return typed({**names, **shape, **stated, "ticks": self.ticks, "seed": self.seed}, SceneWords, self.label)

    def read_files(self) -> tuple[ReadFile, ...]:
        """Return the files that it reads, as they are now; InputError if one cannot be read."""
        return tuple(read for word in self.files for read in read_files(self.folder / word))

    def load(self) -> LoadedWords:
        """Load its motion and bodies; HhsimError as `hhsim.scene.described_scene.load_words`."""
        words = self.words()
        stated = {name: getattr(words, name) for name in ("object", "trajectory", "hand_file")}
        own = {name: str(self.folder / word) for name, word in stated.items() if word in self.files}
        return load_words(structs.replace(words, **own), surface=self.surface)

    def digest(self) -> str:
        """Return a digest of inputs, options and hhsim's sources; InputError if a file is unreadable."""
        shape = self.object
        hand = self.options.get("hand_file")
        files = {word: file_digest(self.folder / word) for word in self.files}
        # Of those of the scene only what is not a default: stating one makes no other cell.
        usual = {"rate": 1000.0, "samples": "interpolate", "seed": 0}
        usual |= {"level": usual_level(shape.word), "hand_file": hand}
        scene = {name: value for name, value in self.options.items() if name in OF_THE_SCENE}
        told = {name: value for name, value in scene.items() if name not in usual or value != usual[name]}
        stated = {
            "object": [files.get(shape.word, shape.word), shape.unit, shape.size_mm, shape.solid],
            "motion": files.get(self.motion.word, self.motion.word),
            "hand": None if hand is None else files[hand],
            "method": [self.method, find_method(self.method).source],
            "surface": self.surface,
            "options": {**self.solver_options().to_json(), **told},
            "seed": self.seed,
            "ticks": self.ticks,
            "hhsim": [__version__, source_digest()],
        }
        return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()[:DIGITS]


class _PlanTable(Settings, frozen=True, kw_only=True):
    version: Version
    name: Annotated[str, Meta(pattern=r"^[^./][^/]*$", description="a name for a folder")] | None = None
    objects: Annotated[tuple[str | SweptObject, ...], a_list('["cube", "bunny"]')]
    motions: Annotated[tuple[str | SweptMotion, ...], a_list('["grasp", "takes/*.npz"]')]
    methods: Annotated[tuple[str, ...], a_list('["coupled"]')] = ("coupled",)
    surfaces: Annotated[tuple[str, ...], a_list('["spheres", "mesh"]')] = ("spheres",)
    seeds: Annotated[tuple[Annotated[int, between(0, 2**63 - 1)], ...], a_list("[0, 1]")] = (0,)
    ticks: Annotated[int, between(1, 1_000_000_000)] | None = None
    repeat: Annotated[int, between(1, 1_000)] = 1
    options: Annotated[
        dict[str, dict[str, Any]], Meta(min_length=1, description="sets of options, such as [options.usual]")
    ] = msgspec.field(default_factory=lambda: {"usual": {}})

    def check(self) -> None:
        check_known("surface", self.surfaces, SURFACES.names())
        for name, given in self.options.items():
            check_known(f"key in options.{name}", given, (*OF_THE_SCENE, *OF_THE_SOLVER))


@dataclass(frozen=True)
class SweepPlan:
    """Plan with its cells."""

    name: str
    folder: Path  # the plan's folder; its files are relative to it
    text: str
    cells: Mapping[str, Cell]  # by their digests
    notes: tuple[str, ...] = ()  # sentences about combinations that are left out or the same, and about recordings


def load_plan(path: Path) -> SweepPlan:
    """Read a plan and check everything that it names.

    Raises InputError for no such file, no TOML, an unknown key, name or file, a wrong value, or two cells alike.
    """
    return parse_plan(read_toml_text(path, "plan of a sweep"), path.stem, path.parent, str(path))


def parse_plan(text: str, name: str, folder: Path, where: str) -> SweepPlan:
    """Read the text of a plan, whose files are relative to `folder`; errors as of `load_plan`.

    `name` is the sweep's if the plan states none, `where` the text's in messages.
    """
    plan = parse_settings(text, _PlanTable, where)
    objects = _unique(where, "objects", [checked_object(where, folder, entry) for entry in plan.objects])
    motions = _unique(where, "motions", [found for entry in plan.motions for found in _motions(where, folder, entry)])
    for called, given in plan.options.items():
        # Those of the solver are checked for each method.
        stated = {name: value for name, value in given.items() if name in OF_THE_SCENE}
        words = typed({"object": "", "trajectory": "", **stated}, SceneWords, f"{where}: options.{called}")
        if words.hand_file is not None:
            _require_file(f"{where}: options.{called}", folder, words.hand_file)
    left_out: Counter[str] = Counter()
    cells: dict[str, Cell] = {}
    durations = {motion.word: _Motion.read(folder, motion) for motion in motions}
    checked: set[tuple[str, str, str]] = set()
    for shape, motion, method, surface, (called, given), seed in product(
        objects, motions, plan.methods, plan.surfaces, plan.options.items(), plan.seeds
    ):
        why = _impossible(shape, durations[motion.word], motion, method, surface)
        if why:
            left_out[why] += 1
            continue
        ticks = durations[motion.word].ticks(given.get("rate", 1000.0), plan.ticks)
        cell = Cell(shape, motion, method, surface, called, given, seed, plan.ticks, plan.repeat, folder, ticks)
        if (method, surface, called) not in checked:
            with named(f"{where}, [options.{called}], {method}"):
                cell.solver_options()
            checked.add((method, surface, called))
        digest = cell.digest()
        same = cells.setdefault(digest, cell)
        if same is not cell:
            names = same.options_name.split(BOTH)
            if called in names or replace(same, options_name=called, options=given) != cell:
                raise InputError(f"{where}: two cells are the same: {same.label}; {cell.label}")
            cells[digest] = replace(same, options_name=BOTH.join((same.options_name, called)))
    if not cells:
        raise InputError(f"{where}: no cell is left: {'; '.join(left_out)}")
    notes = [f"{count:,} cell{'s' * (count > 1)} left out: {why}" for why, count in left_out.items()]
    shared = Counter((cell.object.name, cell.options_name) for cell in cells.values())
    notes += [
        f"{shape}: {counted(count, 'cell')} computed once and called {names}: there these options come to the same"
        for (shape, names), count in shared.items()
        if BOTH in names
    ]
    notes += [f"{motion.name}: {remark}" for motion in motions for remark in durations[motion.word].remarks]
    return SweepPlan(plan.name or name, folder, text, cells, tuple(notes))


@dataclass(frozen=True)
class _Motion:
    """Duration, objects and remarks of a motion."""

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
        return cls(found.duration, True, (), tuple(import_remarks(found, word)))

    def ticks(self, rate: float, most: int | None) -> int:
        count = round(self.duration * rate) + self.closed
        return max(1, count if most is None else min(count, most))


def _impossible(shape: SweptObject, motion: _Motion, swept: SweptMotion, method: str, surface: str) -> str:
    if motion.objects and shape.word not in motion.objects:
        return f"motion {swept.name} is made for {', '.join(motion.objects)}"
    refuses = surface != "spheres" and find_method(method).refuses_surfaces
    return f"method {method} takes no surface {surface}" if refuses else ""


def checked_object(where: str, folder: Path, entry: str | SweptObject) -> SweptObject:
    """Return an object with its name; InputError for no such file or name, or a size for one of the catalogue."""
    found = SweptObject(entry) if isinstance(entry, str) else entry
    if names_a_file(found.word):
        _require_file(where, folder, found.word)
    else:
        with named(where):
            check_known("object", [found.word], object_names())
        if (found.unit, found.size_mm, found.solid) != (None, None, False):
            what = "unit, size_mm and solid are for mesh files"
            raise InputError(f"{where}: '{found.word}' has its size: {what}")
    return structs.replace(found, name=found.name or Path(found.word).stem)


def _motions(where: str, folder: Path, entry: str | SweptMotion) -> Iterator[SweptMotion]:
    found = SweptMotion(entry) if isinstance(entry, str) else entry
    word = found.word
    if word in trajectory_names() or WILD.isdisjoint(word):
        if names_a_file(word):
            _require_file(where, folder, word)
        else:
            check_known("trajectory", [word], trajectory_names())
        yield structs.replace(found, name=found.name or Path(word).stem)
        return
    # That of a Path takes no absolute pattern.
    paths = sorted(glob(word, root_dir=folder, recursive=True))  # noqa: PTH207
    if not paths:
        raise InputError(f"{where}: no file is called {word} in {folder.resolve()}")
    yield from (SweptMotion(path, Path(path).stem) for path in paths)


def _require_file(where: str, folder: Path, word: str) -> None:
    if not (folder / word).is_file():
        raise InputError(f"{where}: there is no file {word} in {folder.resolve()}")


def _unique(where: str, key: str, entries: list[Any]) -> list[Any]:
    names = [entry.name for entry in entries]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{where}: {key}: two are called {twice[0]}; give one another name: {{ file = …, name = … }}")
    return entries
