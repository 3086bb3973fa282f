"""Result files of replays and sessions (format `hhsim-result`, see `hhsim.result.schema`), read complete or not."""

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import EllipsisType
from typing import Any, SupportsIndex, TypeAlias

import h5py
import numpy as np

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.errors import DamagedFileError, InputError, OutputError, UnknownNameError
from hhsim.hand.fingers import BODIES
from hhsim.motion.trajectory import ObjectMotion, RigidMotion, TickPhase, phase_names
from hhsim.result import schema
from hhsim.system.environment import UNKNOWN
from hhsim.system.hdf5_input import DAMAGE, hdf5_format, open_hdf5, read_numbers
from hhsim.system.input_file import media_kind_of
from hhsim.system.output_path import check_output_path

TURNS = {column.name: column.turns for column in schema.TICK_COLUMNS if column.turns}
"""Kind of transformation (`Column.turns`) by dataset."""

View: TypeAlias = Callable[[str, AnyArray, ObjectMotion, ObjectMotion], AnyArray]
"""Transform rows of a /tick dataset: its name, world values, the object's poses at these ticks and the first."""

_HINTS = {
    "hhsim-trajectory": " (to replay a trajectory, give an object first: hhsim replay OBJECT FILE)",
    "hhsim-poses": " (to measure a submission: hhsim score FILE)",
    "hhsim-scene": " (to measure a submission of this scene: hhsim score SUBMISSION --scene FILE)",
    "hhsim-tree": " (to replay with a sphere tree: hhsim replay OBJECT --tree FILE)",
}
"""Hints on files of other formats."""

_TOGETHER = (
    ("object/tree/center", "object/tree/radius", "object/tree/level", "object/tree/parent"),
    ("hand/palm_tree/center", "hand/palm_tree/radius", "hand/palm_tree/level", "hand/palm_tree/parent"),
    ("hand/palm_center", "hand/palm_radius"),
)
"""Arrays with one row a sphere."""
_TABLES = ("tick", schema.LIVE_TICK, schema.CONTACT, schema.LIVE_SAMPLE, schema.LIVE_EVENT)
"""Groups whose datasets are columns of one table; the first two have a row a tick."""

CHUNK_TICKS = 512
"""Ticks in a chunk of the file, and the best size of a block."""

_STORED = {"f": "fiu", "i": "iu", "u": "iu", "S": "SO"}
"""Kinds of values accepted in a file, by the kind of the column."""


def as_object_sees(name: str, values: AnyArray, moved: RigidMotion) -> AnyArray:
    """Transform rows (T, ...) of a /tick dataset to the object's frame, which is the world's at the first tick."""
    transforms = {"point": moved.seen_points, "vector": moved.seen_vectors, "orientation": moved.seen_orientations}
    return _transformed(name, values, transforms)


def in_the_world(columns: Mapping[str, AnyArray], moved: RigidMotion) -> dict[str, AnyArray]:
    """Transform datasets by name from the object's frame to the world."""
    transforms = {"point": moved.points, "vector": moved.vectors, "orientation": moved.orientations}
    return {name: _transformed(name, values, transforms) for name, values in columns.items()}


def _transformed(name: str, values: AnyArray, transforms: Mapping[str, Any]) -> AnyArray:
    kind = TURNS.get(name, "")
    if not kind:
        return values
    shape = values.shape
    whole = values if kind == "orientation" else values.reshape(*shape[:-1], -1, 3)
    return np.ascontiguousarray(transforms[kind](whole).reshape(shape))


@dataclass(frozen=True, repr=False)
class Result:
    """A result file, opened and checked; its datasets are read on demand and kept.

    `result["graphic/joints"]` is that dataset of /tick as a read-only array, shape (ticks, *column.shape);
    `result["live/sample/time"]` one of a session (`hhsim.result.schema.sample_columns`).
    """

    path: Path
    complete: bool  # False if the run was stopped; its ticks are sound
    ticks: int  # number that every dataset has
    schema_version: int
    hhsim_version: str
    created_utc: str
    scene: dict[str, Any]  # every option of the run
    machine: dict[str, Any]
    packages: dict[str, str]
    phases: tuple[TickPhase, ...]  # those that begin within the ticks
    summary: dict[str, Any]
    static: Mapping[str, AnyArray]  # arrays of `STATIC_COLUMNS` by name
    live: Mapping[str, Any] | None = None  # attributes of /live; None for a replay
    command: tuple[str, ...] = ()  # as it was typed; empty for a call of the library
    git_revision: str = UNKNOWN  # commit of the hhsim that wrote it
    git_dirty: bool | str = UNKNOWN  # True if its files had changed since
    repeated: Mapping[str, Any] = field(default_factory=dict)  # `runs`, and mean and std of `times` by name
    score: Mapping[str, float] = field(default_factory=dict, repr=False)  # of a submission: penetration and error [m]
    parts: tuple[str, ...] = ()  # groups of a thing's parts, such as `things/laptop/lid`; empty for one object
    driven: bool = False  # True if the object moves: its poses are `object/position` and `object/orientation`
    view: View | None = field(default=None, compare=False)  # transformation of hands and forces; None: world
    replaced: Mapping[str, AnyArray] = field(default_factory=dict, compare=False)  # instead of those of the file
    _loaded: dict[str, AnyArray] = field(default_factory=dict, compare=False)

    def __repr__(self) -> str:
        run = f"{self.scene['object_name']}, {self.scene['motion']}"
        ticks = f"{self.ticks:,} ticks at {self.rate:g} Hz{'' if self.complete else ', cut short'}"
        return f"Result({self.path.name}: {run}, {self.method} on {self.surface}, {ticks}{phase_names(self.phases)})"

    @property
    def method(self) -> str:
        """Method of the run."""
        return str(self.scene["solver"]["method"])

    @property
    def surface(self) -> str:
        """Surface of the object that the hand touched: `spheres` or `mesh`."""
        return str(self.scene["solver"]["surface"])

    def gives(self, what: str) -> bool:
        """True if the method gives something, one of `hhsim.solver.method.EVERYTHING`; hhsim's own give everything."""
        return what in self.scene.get("gives", [what])

    def told(self, name: str) -> dict[str, Any]:
        """Return the JSON object in an attribute of a session, such as `limits`; raise InputError for anything else."""
        try:
            return _mapping(str((self.live or {})[name]))
        except (KeyError, DamagedFileError) as error:
            raise InputError(f"{self.path}: {name} of /live: {error}") from None

    @property
    def side(self) -> str:
        """Side of the hand, right or left."""
        return str(self.scene["hand"]["side"])

    @property
    def rate(self) -> float:
        """Ticks per second [Hz]."""
        return float(self.scene["rate"])

    @property
    def fingers(self) -> tuple[str, ...]:
        """Names of the modelled fingers."""
        return tuple(self.scene["solver"]["fingers"])

    @property
    def free(self) -> bool:
        """True if forces move the object; its contacts are under `contact/`."""
        return "free" in self.scene

    @cached_property
    def seen_from_object(self) -> "Result":
        """Result in the frame of its object at the first tick; itself where the object stands still."""
        return self.seen_by(lambda name, values, now, first: as_object_sees(name, values, now.since(*first)))

    def seen_by(self, view: View) -> "Result":
        """Result as transformed by `view`; itself where the object stands still."""
        return replace(self, view=view, _loaded={}) if self.driven and self.view is None else self

    def object_motion(self, rows: slice | int = slice(None)) -> ObjectMotion:
        """Read the object's poses at some ticks."""
        if not self.driven:
            count = len(range(self.ticks)[rows]) if isinstance(rows, slice) else 1
            poses = (self.static["object/position"], self.static["object/orientation"])
            return ObjectMotion(*(np.tile(pose, (count, 1)) for pose in poses))
        with _opened(self.path) as file:
            return self._object_motion(file, rows)

    def moved_since_first(self, rows: slice | int = slice(None)) -> RigidMotion:
        """Motion of the object from its place of /object to that at the ticks."""
        return self.object_motion(rows).since(self.static["object/position"], self.static["object/orientation"])

    def meshes_moved(self, rows: slice | int = slice(None)) -> tuple[RigidMotion, ...]:
        """Motion of the object, or of each part, from where its mesh is stored to its place at the ticks.

        It is in the view's frame, and empty where the object stands still there.
        """
        if not self.parts:
            return (self.moved_since_first(rows),) if self.driven and self.view is None else ()
        ticks = slice(rows, rows + 1) if isinstance(rows, int) else rows
        columns = "orientation", "position"
        poses = (RigidMotion(*(self[f"{part}/{column}"][ticks] for column in columns)) for part in self.parts)
        if not self.driven or self.view is None:
            return tuple(poses)
        now = self.moved_since_first(rows)
        return tuple(RigidMotion(now.seen_orientations(one.turn), now.seen_points(one.shift)) for one in poses)

    def _object_motion(self, file: h5py.File, rows: slice | int) -> ObjectMotion:
        part = slice(*rows.indices(self.ticks)) if isinstance(rows, slice) else slice(rows, rows + 1)
        return ObjectMotion(*(_finite_numbers(file["tick"][column.name], part) for column in schema.OBJECT_COLUMNS))

    def _rows(self, file: h5py.File, name: str, rows: slice | int) -> AnyArray:
        """Read rows of a dataset of /tick in the view's frame."""
        if name in self.replaced:
            return np.asarray(self.replaced[name][rows])
        values = read_numbers(file["tick"][name], rows)
        if self.view is None or name not in TURNS:
            return values
        now = self._object_motion(file, rows)
        first = ObjectMotion(self.static["object/position"], self.static["object/orientation"])
        if isinstance(rows, slice):
            return self.view(name, values, now, first)
        return np.asarray(self.view(name, np.asarray(values)[None], now, first)[0])

    def __getitem__(self, name: str) -> AnyArray:
        if name not in self._loaded:
            with _opened(self.path) as file:
                of_ticks = not name.startswith((f"{schema.LIVE}/", f"{schema.CONTACT}/", f"{schema.THINGS}/"))
                dataset = file.get(f"tick/{name}" if of_ticks else name)
                if not isinstance(dataset, h5py.Dataset):
                    raise self._no_dataset(name, dataset)
                rows = slice(self.ticks if of_ticks else self._whole_rows(dataset))
                found = self._rows(file, name, rows) if of_ticks else read_numbers(dataset, rows)
                self._loaded[name] = _frozen(found)
        return self._loaded[name]

    def keys(self) -> list[str]:
        """Names of all datasets: those of /tick, and those under `live/` and `contact/`."""
        with _opened(self.path) as file:
            found = _dataset_names(file["tick"])
            for group in (schema.LIVE, schema.CONTACT, schema.THINGS):
                if group in file:
                    found += [f"{group}/{name}" for name in _dataset_names(file[group])]
            return found

    def __contains__(self, name: object) -> bool:
        return name in self.keys()

    def _no_dataset(self, name: str, group: object) -> InputError:
        if group is not None:
            inside = [known for known in self.keys() if known.startswith(f"{name}/")]
            return InputError(f"{self.path}: {name} is a group; expected one of its datasets: {', '.join(inside)}")
        if name.startswith(f"{schema.LIVE}/") and self.live is None:
            return InputError(f"{self.path} has no dataset {name}: it is no live session")
        if name.startswith(f"{schema.CONTACT}/") and not self.free:
            return InputError(f"{self.path} has no dataset {name}: contacts are stored where the object is free")
        return InputError(f"{self.path}: {UnknownNameError('dataset', name, self.keys())}")

    def blocks(self, names: Sequence[str], size: int = CHUNK_TICKS) -> Iterator[dict[str, AnyArray]]:
        """Yield datasets of /tick, `live/tick` or a part by name, `size` ticks at a time: all may exceed the memory."""
        with _opened(self.path) as file:
            for first in range(0, self.ticks, size):
                rows = slice(first, min(first + size, self.ticks))
                beside = tuple(name for name in names if name.startswith((f"{schema.LIVE}/", f"{schema.THINGS}/")))
                yield {
                    name: read_numbers(file[name], rows) if name in beside else self._rows(file, name, rows)
                    for name in names
                }

    def at(self, tick: int, names: Sequence[str]) -> dict[str, AnyArray]:
        """Read one tick of datasets of /tick; InputError if there is no such tick."""
        if not isinstance(tick, SupportsIndex) or not 0 <= int(tick) < self.ticks:
            raise InputError(f"{self.path} has no tick {tick}: it has {self.ticks:,}, counted from 0")
        with _opened(self.path) as file:
            return {name: np.asarray(self._rows(file, name, tick)) for name in names}

    def _whole_rows(self, dataset: h5py.Dataset) -> int:
        """Number of rows that belong to the ticks: a killed run may have written a block to some datasets only."""
        if f"/{schema.THINGS}/" in dataset.name:
            grows = dataset.name.rpartition("/")[2] in {
                column.name for column in (*schema.PART_COLUMNS, *schema.OWN_COLUMNS, schema.JOINT_COLUMN)
            }
            return self.ticks if grows else len(dataset)
        table = dataset.parent
        if f"{table.name}/".endswith((f"/{schema.LIVE_TICK}/", f"/{schema.LIVE_TICK}/taken/")):
            return self.ticks
        if not table.name.endswith(f"/{schema.CONTACT}"):
            return min(len(column) for column in table.values())
        ticks, bodies = table["tick"][...], table["body"][...]
        # Where two hands hold one object, those of the other hand follow.
        most = 2 * BODIES if self.scene.get(schema.TWO_HANDED) else BODIES
        unknown = (bodies < -1 - len(self.parts)) | (bodies >= most)
        if (np.diff(ticks) < 0).any() or (ticks[:1] < 0).any() or unknown.any():
            raise InputError(f"{self.path} is damaged: a contact of no tick, or of no body")
        return int(np.searchsorted(ticks, self.ticks))

    @cached_property
    def skin_faces(self) -> IntArray | None:
        """Triangles of the shown hand's skin, shape (F, 3); None where a result has none; InputError for damage."""
        with _opened(self.path) as file:
            if schema.SKIN not in file:
                return None
            for column in schema.SKIN_COLUMNS:
                _check_dataset(file[schema.SKIN], column, column.shape, self.path)
            vertices, found = file[schema.SKIN]["vertices"], np.asarray(file[schema.SKIN]["faces"], np.int64)
            if len(vertices) < self.ticks or not len(found) or not 0 <= found.min() <= found.max() < vertices.shape[1]:
                raise InputError(f"{self.path} is damaged: its skin does not fit its ticks or its triangles")
            return found

    def skin(self, rows: slice) -> FloatArray:
        """Read the skin's vertices at some ticks [m], shape (T, V, 3), in the view's frame."""
        with _opened(self.path) as file:
            found = np.asarray(_finite_numbers(file[schema.SKIN]["vertices"], rows), np.float64)
        if self.view is None:
            return found
        return self.moved_since_first(rows).seen_points(found)

    def phase_at(self, tick: int) -> str:
        """Name of the phase of a tick; "" for none."""
        return next((phase.name for phase in self.phases if phase.first_tick <= tick <= phase.last_tick), "")

    def phase(self, name: str) -> slice:
        """Ticks of the first phase of that name; InputError if there is none."""
        for phase in self.phases:
            if phase.name == name:
                return slice(phase.first_tick, min(phase.last_tick + 1, self.ticks))
        known = ", ".join(phase.name for phase in self.phases) or "none"
        raise InputError(f"{self.path} has no phase '{name}': it has {known}")


def hand_paths(path: Path) -> list[Path]:
    """Return the results in a file: its path, or `FILE/right` and `FILE/left` of two hands; errors as `load_result`."""
    if schema.is_one_of_two(path):
        return [path]
    with _opened(path) as file:
        return [path / side for side in schema.SIDES] if schema.HANDS in file else [path]


def load_result(path: str | Path) -> Result:
    """Open a result file, complete or not; one hand of a file of two is `FILE.h5/right` or `FILE.h5/left`.

    Raises InputError for no such file, no HDF5, no result, another schema, datasets that are missing or misshapen, or a
    file of two hands.
    """
    path = Path(path)
    with _opened(path) as file:
        _check_format(file, path)
        tick = file.get("tick", {})
        parts = _parts(file, path)
        driven = bool(file.attrs["schema_version"] == schema.DRIVEN_SCHEMA_VERSION) or "object/position" in tick
        columns = (
            *schema.TICK_COLUMNS,
            *(schema.OBJECT_COLUMNS if driven else ()),
            *(schema.FREE_COLUMNS if schema.CONTACT in file else ()),
        )
        for column in columns:
            _check_dataset(tick, column, (-1, *column.shape), path)
        for column in schema.STATIC_COLUMNS:
            _check_dataset(file, column, column.shape, path)
        for names in _TOGETHER:
            if len({len(file[name]) for name in names}) > 1:
                raise InputError(f"{path} is damaged: {' and '.join(names)} are not of the same length")
        for column in schema.CONTACT_COLUMNS if schema.CONTACT in file else ():
            _check_dataset(file[schema.CONTACT], column, (-1, *column.shape), path)
        ticks = min(len(tick[column.name]) for column in columns)
        if schema.LIVE_TICK in file:
            ticks = min(ticks, *(len(file[schema.LIVE_TICK][column.name]) for column in schema.LIVE_TICK_COLUMNS))
        attributes = file.attrs
        if attributes["complete"]:
            _require_equal_rows(file, parts, path)
        dirty = attributes["git_dirty"]
        return Result(
            path=path,
            complete=bool(attributes["complete"]),
            ticks=ticks,
            schema_version=int(attributes["schema_version"]),
            hhsim_version=str(attributes["hhsim_version"]),
            created_utc=str(attributes["created_utc"]),
            scene=_Stated(_mapping(attributes["scene"]), path),
            machine=_mapping(attributes["machine"]),
            packages=_mapping(attributes["packages"]),
            phases=tuple(phase for phase in read_phases(file) if phase.first_tick < ticks),
            summary=_attributes(file["summary"]),
            static={column.name: _frozen(_finite_numbers(file[column.name])) for column in schema.STATIC_COLUMNS},
            live=_Stated(_attributes(file[schema.LIVE]), path) if schema.LIVE in file else None,
            command=tuple(json.loads(attributes["command"])),
            git_revision=str(attributes["git_revision"]),
            git_dirty=dirty if isinstance(dirty, str) else bool(dirty),
            repeated=_mapping(attributes.get("repeated", "{}")),
            score=_mapping(attributes.get("score", "{}")),
            driven=driven,
            parts=parts,
        )


def _parts(file: h5py.File, path: Path) -> tuple[str, ...]:
    """Groups of the parts of a thing, in their order; none in other files."""
    if file.attrs["schema_version"] != schema.JOINTED_SCHEMA_VERSION:
        return ()
    named = _mapping(file.attrs["scene"])["thing"]
    groups = tuple(f"{schema.THINGS}/{named['name']}/{part}" for part in named["parts"])
    for group in groups:
        for column in schema.PART_STATIC_COLUMNS:
            _check_dataset(file[group], column, column.shape, path)
        for column in schema.PART_COLUMNS:
            _check_dataset(file[group], column, (-1, *column.shape), path)
    return groups


class _Stated(dict[str, Any]):
    """Mapping of what a file states of itself; raises InputError for a name that it lacks, which is damage."""

    def __init__(self, found: Mapping[str, Any], path: Path) -> None:
        super().__init__(
            {name: _Stated(value, path) if isinstance(value, dict) else value for name, value in found.items()}
        )
        self.path = path

    def __missing__(self, name: str) -> Any:
        raise InputError(f"{self.path} is damaged: it does not say its '{name}'")


def _finite_numbers(dataset: h5py.Dataset, rows: slice | EllipsisType = ...) -> AnyArray:
    """Read rows of a dataset that cannot hold NaN or infinity; raise DamagedFileError where it does."""
    values = read_numbers(dataset, rows)
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise DamagedFileError(f"damaged: {dataset.name} is not finite everywhere")
    return values


def _mapping(written: str) -> dict[str, Any]:
    """Return a JSON object; raise DamagedFileError for anything else."""
    try:
        found = json.loads(written)
    except json.JSONDecodeError:
        found = None
    if not isinstance(found, dict):
        raise DamagedFileError(f"damaged: expected a JSON object, found '{written[:20]}'")
    return found


def _dataset_names(group: h5py.Group) -> list[str]:
    names: list[str] = []
    group.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    return names


def check_result_path(path: Path) -> None:
    """Check, before the work, that a result can be written to `path`.

    Raises OutputError as `hhsim.system.output_path.check_output_path`; for another suffix; or for an existing file that
    is no result.
    """
    check_output_path(path, "result file", lambda path: hdf5_format(path) == schema.FORMAT)
    if path.suffix.lower() not in schema.SUFFIXES:
        raise OutputError(f"{path} is no name for a result: it has to end in {' or '.join(schema.SUFFIXES)}")


def read_phases(file: h5py.File) -> Iterator[TickPhase]:
    """Yield the phases in a file of ticks."""
    group = file["phase"]
    for name, first, last in zip(group["name"].asstr()[...], group["first_tick"], group["last_tick"]):
        yield TickPhase(str(name), int(first), int(last))


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open for reading, of `FILE.h5/left` that hand's group; raise InputError for every failure of the file."""
    if schema.is_one_of_two(path):
        with _opened(path.parent) as file:
            if schema.HANDS not in file:
                raise InputError(f"{path.parent} holds one hand: name it without /{path.name}")
            yield file[schema.HANDS][path.name]
        return
    if not path.exists():
        raise InputError(f"{path}: no such file; expected a result (.h5)")
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a result file")
    try:
        with open_hdf5(path) as file:
            yield file
    except DamagedFileError as error:
        raise InputError(f"{path}: {error}") from error
    except BlockingIOError as error:
        raise InputError(f"{path} is still being written by another process: wait for it to end") from error
    except PermissionError as error:
        raise InputError(f"no permission to read {path}") from error
    except KeyError as error:
        raise InputError(f"{path} is damaged or no result file: {error.args[0]}") from error
    except DAMAGE as error:
        media = media_kind_of(path)
        what = f"{media}, not a result file" if media else "no HDF5 file, or one that is cut short or damaged"
        raise InputError(f"{path} is {what}") from error


def _check_format(file: h5py.File, path: Path) -> None:
    found = file.attrs.get("format")
    if found != schema.FORMAT:
        what = f"its format is '{found}'" if isinstance(found, str) else "it states no format"
        raise InputError(f"{path} is no result file: {what}, not '{schema.FORMAT}'{_HINTS.get(str(found), '')}")
    version = file.attrs.get("schema_version")
    if version == schema.TWO_HANDED_SCHEMA_VERSION:
        raise InputError(f"{path} holds two hands: name one of them, {path}/right or {path}/left")
    if version not in schema.SCHEMA_VERSIONS:
        raise InputError(f"{path} {schema.wrong_schema(version)}")


def _check_dataset(group: Mapping[str, Any], column: schema.Column, shape: tuple[int, ...], path: Path) -> None:
    dataset = group.get(column.name)
    if dataset is None:
        raise InputError(f"{path} is damaged or no result file: it lacks the dataset {column.name}")
    if not fits(dataset.shape, shape):
        raise InputError(f"{path}: {column.name} has shape {dataset.shape}, expected {spelled(shape)}")
    if dataset.dtype.kind not in _STORED[np.dtype(column.dtype).kind]:
        raise InputError(f"{path}: {column.name} holds {dataset.dtype}, expected {column.dtype}")


def _require_equal_rows(file: h5py.Group, parts: Sequence[str], path: Path) -> None:
    """Raise InputError for columns of a table that are not of one length, as they are after a run that was killed."""
    moving = *schema.PART_COLUMNS, *schema.OWN_COLUMNS, *schema.DRIVEN_COLUMNS, schema.JOINT_COLUMN
    own = {column.name for column in moving}
    of_ticks, of_live, *others = (
        [f"{group}/{name}" for name in _dataset_names(file[group])] if group in file else [] for group in _TABLES
    )
    of_parts = [f"{part}/{name}" for part in parts for name in _dataset_names(file[part]) if name in own]
    for names in (of_ticks + of_live + of_parts, *others):
        rows = {name: len(file[name]) for name in names}
        if len(set(rows.values())) > 1:
            least, most = (end(rows, key=rows.__getitem__) for end in (min, max))
            raise InputError(f"{path} is damaged: {least} has {rows[least]:,} rows, {most} {rows[most]:,}")


def fits(shape: tuple[int, ...], expected: tuple[int, ...]) -> bool:
    """True if a shape is the expected one, in which -1 is any size."""
    return len(shape) == len(expected) and all(want in (-1, have) for have, want in zip(shape, expected))


def spelled(shape: tuple[int, ...]) -> str:
    """Return a shape as messages show it."""
    return f"({', '.join('any' if size == -1 else str(size) for size in shape)})"


def _frozen(array: AnyArray) -> AnyArray:
    array.flags.writeable = False
    return array


def _attributes(group: h5py.Group) -> dict[str, Any]:
    return {name: value.item() if isinstance(value, np.generic) else value for name, value in group.attrs.items()}
