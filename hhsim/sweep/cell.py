"""Cell of a sweep: one replay, its parts, its name, and its digest."""

import hashlib
import json
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import hhsim
from hhsim import __version__
from hhsim.errors import InputError
from hhsim.mesh.catalogue import names_a_file, usual_level
from hhsim.scene.described_scene import SceneWords
from hhsim.scene.motion_catalogue import trajectory_names
from hhsim.solver.known_methods import find_method
from hhsim.solver.options import SolverOptions
from hhsim.system.input_file import read_input
from hhsim.system.settings_file import Settings, between, typed

DIGITS = 20
"""Hexadecimal digits of a cell's digest: 80 bits."""
OF_THE_SOLVER = tuple(key.name for key in fields(SolverOptions) if key.name not in ("method", "surface", "period"))
OF_THE_SCENE = ("level", "max_error", "rate", "samples", "place_object", "hand", "hand_file", "tremor_mm_deg")
"""Options of a plan besides the solver's, by the names of `SceneWords`, SI."""
BOTH = " = "
"""Separator of the names of sets of options that are the same for a cell."""
USUAL_SCENE = {"rate": 1000.0, "samples": "interpolate", "seed": 0}
"""Defaults of a scene; the level's default depends on the object."""


class SweptObject(Settings, frozen=True, rename={"word": "file"}):
    """An object by a name of the catalogue, or a mesh file, relative to the plan's folder, and its name in tables.

    Its sizes are as of `hhsim.scene.described_scene.SceneWords`.
    """

    word: str
    name: str = ""
    unit: Literal["m", "cm", "mm", "inch"] | None = None
    size_mm: Annotated[float, between(1e-3, 1e5)] | None = None
    thickness_mm: Annotated[float, between(1e-3, 1e5)] | None = None


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

    def solver_options(self) -> SolverOptions:
        """Return the solver's options; raise InputError for those that the method refuses, or out of range."""
        given = {name: value for name, value in self.options.items() if name in OF_THE_SOLVER}
        return SolverOptions.from_json({"method": self.method, "surface": self.surface, **given})

    def words(self) -> SceneWords:
        """Return the words that describe its scene."""
        shape = {name: getattr(self.object, name) for name in ("unit", "size_mm", "thickness_mm")}
        names = {"object": self.object.word, "trajectory": self.motion.word}
        stated = {name: value for name, value in self.options.items() if name in OF_THE_SCENE}
        return typed({**names, **shape, **stated, "ticks": self.ticks, "seed": self.seed}, SceneWords, self.label)

    def digest(self, folder: Path) -> str:
        """Return a digest of inputs (by the plan's folder), options and hhsim's sources; InputError if unreadable."""
        shape = self.object
        hand = self.options.get("hand_file")
        # Of those of the scene only what is not a default: stating one makes no other cell.
        usual = {**USUAL_SCENE, "level": usual_level(shape.word), "hand_file": hand}
        scene = {name: value for name, value in self.options.items() if name in OF_THE_SCENE}
        told = {name: value for name, value in scene.items() if name not in usual or value != usual[name]}
        stated = {
            "object": [_content(folder, shape.word, names_a_file(shape.word)), shape.unit, shape.size_mm],
            "thickness_mm": shape.thickness_mm,
            "motion": _content(folder, self.motion.word, self.motion.word not in trajectory_names()),
            "hand": None if hand is None else _content(folder, hand, True),
            "method": [self.method, find_method(self.method).source],
            "surface": self.surface,
            "options": {**self.solver_options().to_json(), **told},
            "seed": self.seed,
            "ticks": self.ticks,
            "hhsim": [__version__, source_digest()],
        }
        return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()[:DIGITS]


@cache
def source_digest() -> str:
    """Return a digest of the library's code, and of the motions and objects that ship."""
    digest = hashlib.sha256()
    root = Path(hhsim.__file__).parent
    parts = [path for path in root.rglob("*.py") if "cli" not in path.relative_to(root).parts]
    for package in ("hhsim.objects", "hhsim.trajectories"):
        entries = files(package).iterdir()
        parts += [Path(str(entry)) for entry in entries if entry.name.endswith((".toml", ".h5", ".csv"))]
    for name, path in sorted((f"{path.parent.name}/{path.name}", path) for path in set(parts)):
        digest.update(name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def file_digest(path: Path) -> str:
    """Return a digest of a file, and of the recording that a demonstration names; InputError if it cannot be read."""
    try:
        state = path.stat()
        found, recording = _read_digest(path, state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return found if recording is None else found + file_digest(path.parent / recording)


# A plan asks for the same file once a cell.
@cache
def _read_digest(path: Path, changed: int, size: int) -> tuple[str, str | None]:
    content = read_input(path)
    recording = None
    if path.suffix.lower() == ".toml":
        with suppress(tomllib.TOMLDecodeError, UnicodeDecodeError):
            recording = tomllib.loads(content.decode()).get("recording")
    return hashlib.sha256(content).hexdigest(), recording if isinstance(recording, str) else None


def _content(folder: Path, word: str, is_file: bool) -> str:
    return file_digest(folder / word) if is_file else word
