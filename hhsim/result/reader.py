"""Result files of replays and sessions (format `hhsim-result`, see `hhsim.result.schema`), read complete or not."""

import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import EllipsisType
from typing import TYPE_CHECKING, Any, SupportsIndex

import h5py
import numpy as np

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.errors import DamagedFileError, InputError, UnknownNameError
from hhsim.hand.model import SIDES
from hhsim.motion.trajectory import ObjectMotion, RigidMotion, TickPhase, phase_names
from hhsim.result import schema
from hhsim.result.body import Body, Contacts, contact_names
from hhsim.result.labelled import as_dataset, coordinates, variables
from hhsim.system.environment import UNKNOWN
from hhsim.system.hdf5_input import DAMAGE, hdf5_format, open_hdf5, read_numbers
from hhsim.system.input_file import media_kind_of
from hhsim.system.output_path import check_output_path

if TYPE_CHECKING:
    import xarray

_HINTS = {
    "hhsim-trajectory": " (to replay a trajectory, give an object first: hhsim replay OBJECT FILE)",
    "hhsim-poses": " (to measure a submission: hhsim score FILE)",
    "hhsim-tree": " (to replay with a sphere tree: hhsim replay OBJECT --tree FILE)",
}
"""Hints on files of other formats."""

_TREE, _PALM_TREE = (tuple(f"{tree}/{name}" for name in schema.TREE_ARRAYS) for tree in ("tree", "palm_tree"))
"""Arrays with one row a sphere, of a body and of a hand."""

CHUNK_TICKS = 512
"""Ticks in a chunk of the file, and the best size of a block."""

_STORED = {"f": "fiu", "i": "iu", "u": "iu", "S": "SO"}
"""Kinds of values accepted in a file, by the kind of the column."""


def transformed(name: str, values: AnyArray, moved: RigidMotion, *, seen: bool) -> AnyArray:
    """Transform rows (T, ...) of a /tick dataset from the object's frame, the world's at the first tick, to the world.

    If they are to be `seen`, from the world to that frame.
    """
    group, _, part = name.partition("/")
    points = {"position": "point", "joints": "point", "orientation": "orientation"}
    kind = "vector" if group == "force" else points.get(part) if group in ("haptic", "graphic") else None
    if kind is None:
        return values
    whole = values if kind == "orientation" else values.reshape(*values.shape[:-1], -1, 3)
    transform = getattr(moved, f"seen_{kind}s" if seen else f"{kind}s")
    return np.ascontiguousarray(transform(whole).reshape(values.shape))


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
    name: str = ""  # of the hand whose datasets these are, right or left; "" for a file of two as a whole
    hands: Mapping[str, "Result"] = field(default_factory=dict, compare=False)  # each of the file, by its name
    bodies: Mapping[str, Body] = field(default_factory=dict, compare=False)  # by their names, in the file's order
    static: Mapping[str, AnyArray] = field(default_factory=dict)  # arrays of `HAND_STATIC`, as `hand/NAME`
    live: Mapping[str, Any] | None = None  # attributes of a hand's live; None for a replay
    command: tuple[str, ...] = ()  # as it was typed; empty for a call of the library
    git_revision: str = UNKNOWN  # commit of the hhsim that wrote it
    git_dirty: bool | str = UNKNOWN  # True if its files had changed since
    repeated: Mapping[str, Any] = field(default_factory=dict)  # `runs`, and mean and std of `times` by name
    score: Mapping[str, float] = field(default_factory=dict, repr=False)  # of a submission: penetration and error [m]
    frame: str = ""  # group of the poses of the frame that hands were solved in; "" where that stands still
    from_object: bool = False  # True if hands and forces are in that frame as it was at the first tick, not the world
    replacements: Mapping[str, AnyArray] = field(default_factory=dict, compare=False)  # instead of those of the file
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

    def live_json(self, name: str) -> dict[str, Any]:
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
    def other(self) -> "Result | None":
        """The other hand of a file of two; None in a file of one."""
        return next((hand for name, hand in self.hands.items() if name != self.name), None)

    @property
    def label(self) -> str:
        """Path, and of one of two hands its name, for people."""
        return f"{self.path}, {self.name} hand" if len(self.hands) > 1 and self.name else str(self.path)

    @property
    def body(self) -> Body:
        """First body, which free contacts are of."""
        return next(iter(self.bodies.values()))

    @cached_property
    def contacts(self) -> Contacts:
        """Contacts of the first body as this hand counts them."""
        return Contacts(self, len(self.hands), list(self.hands).index(self.name) if self.name else 0)

    @cached_property
    def seen_from_object(self) -> "Result":
        """Result in the frame that its hands were solved in, at the first tick; itself where that stands still."""
        return replace(self, from_object=True, _loaded={}) if self.frame and not self.from_object else self

    def poses(self, group: str, rows: slice = slice(None)) -> ObjectMotion:
        """Read the poses in a group at some ticks, world."""
        with _opened(self.path) as file:
            return self._poses(file, group, rows)

    def _poses(self, file: h5py.File, group: str, rows: slice) -> ObjectMotion:
        part = slice(*rows.indices(self.ticks))
        return ObjectMotion(*(_finite_numbers(file[group][column.name], part) for column in schema.POSE_COLUMNS))

    @cached_property
    def _first(self) -> ObjectMotion:
        """Pose of the frame that moves where bodies are stored, shapes (3,) and (4,)."""
        if self.frame == schema.FRAME:
            return self.poses(self.frame, slice(1)).at(0)
        return self.body.place

    def moved_since_first(self, rows: slice = slice(None)) -> RigidMotion:
        """Motion of the frame that moves, from where bodies are stored to the ticks."""
        return self.poses(self.frame, rows).since(*self._first)

    def meshes_moved(self, rows: slice | int = slice(None)) -> tuple[RigidMotion, ...]:
        """Motion of each body, from where its mesh is stored to its place at the ticks.

        It is in the hands' frame, and empty for a single body that stands still there.
        """
        ticks = slice(rows, rows + 1) if isinstance(rows, int) else rows
        if len(self.bodies) == 1 and (self.from_object or not self.frame):
            return ()
        moved = tuple(body.moved(ticks) for body in self.bodies.values())
        if not self.from_object:
            return moved
        now = self.moved_since_first(ticks)
        return tuple(RigidMotion(now.seen_orientations(one.turn), now.seen_points(one.shift)) for one in moved)

    def _rows(self, file: h5py.File, name: str, rows: slice) -> AnyArray:
        """Read rows of a dataset with a row a tick, as seen from the object if that is asked for."""
        if name in self.replacements:
            return np.asarray(self.replacements[name][rows])
        values = read_numbers(file[self._path_of(name)], rows)
        if not self.from_object:
            return values
        return transformed(name, values, self._poses(file, self.frame, rows).since(*self._first), seen=True)

    def _path_of(self, name: str) -> str:
        """Path in the file of a dataset by its name."""
        if name.startswith((f"{schema.BODIES}/", f"{schema.CONTACT}/", f"{schema.TICK}/")):
            return name
        if name.startswith(f"{schema.BETWEEN}/") or name == schema.TIME.name:
            return f"{schema.TICK}/{name}"
        if not self.name:
            raise InputError(f"{self.path} holds two hands: {name} is that of .hands['right'] or .hands['left']")
        group = f"{schema.HANDS}/{self.name}"
        return f"{group}/{name}" if name.startswith(f"{schema.LIVE}/") else f"{group}/{schema.TICK}/{name}"

    def __getitem__(self, name: str) -> AnyArray:
        if name not in self._loaded:
            path = self._path_of(name)
            with _opened(self.path) as file:
                dataset = file.get(path)
                if not isinstance(dataset, h5py.Dataset):
                    raise InputError(f"{self.path}: {UnknownNameError('dataset', name, self.keys())}")
                if self._of_ticks(path):
                    self._loaded[name] = _frozen(self._rows(file, name, slice(self.ticks)))
                else:
                    self._loaded[name] = _frozen(read_numbers(dataset, slice(self._whole_rows(dataset))))
        return self._loaded[name]

    @staticmethod
    def _of_ticks(path: str) -> bool:
        """True for the path of a dataset with a row a tick."""
        return schema.TICK in path.split("/")[:-1] and not path.startswith(f"{schema.CONTACT}/")

    def keys(self) -> list[str]:
        """Names of all datasets with rows: the time, those of the hand's ticks, and those under other groups."""
        with _opened(self.path) as file:
            found = [schema.TIME.name]
            shared = [name for name in _dataset_names(file.get(schema.TICK, {})) if name != schema.TIME.name]
            found += [name if name.startswith(f"{schema.BETWEEN}/") else f"{schema.TICK}/{name}" for name in shared]
            if self.name:
                group = file[schema.HANDS][self.name]
                found += [name for name in _dataset_names(group[schema.TICK]) if name != schema.TIME.name]
                found += [f"{schema.LIVE}/{name}" for name in _dataset_names(group.get(schema.LIVE, {}))]
            found += [f"{schema.CONTACT}/{name}" for name in _dataset_names(file.get(schema.CONTACT, {}))]
            names = (f"{schema.BODIES}/{name}" for name in _dataset_names(file[schema.BODIES]))
            found += [name for name in names if self._of_ticks(name)]
            return found

    def __contains__(self, name: object) -> bool:
        return name in self.keys()

    def blocks(self, names: Sequence[str], size: int = CHUNK_TICKS) -> Iterator[dict[str, AnyArray]]:
        """Yield datasets with a row a tick by name, `size` ticks at a time: all of them may exceed the memory."""
        with _opened(self.path) as file:
            for first in range(0, self.ticks, size):
                rows = slice(first, min(first + size, self.ticks))
                yield {name: self._rows(file, name, rows) for name in names}

    def at(self, tick: int, names: Sequence[str]) -> dict[str, AnyArray]:
        """Read one tick of datasets; InputError if there is no such tick."""
        if not isinstance(tick, SupportsIndex) or not 0 <= int(tick) < self.ticks:
            raise InputError(f"{self.path} has no tick {tick}: it has {self.ticks:,}, counted from 0")
        with _opened(self.path) as file:
            rows = slice(int(tick), int(tick) + 1)
            return {name: np.asarray(self._rows(file, name, rows)[0]) for name in names}

    def _whole_rows(self, dataset: h5py.Dataset) -> int:
        """Number of rows that belong to the ticks: a killed run may have written a block to some datasets only."""
        table = dataset.parent
        if table.name.startswith(f"/{schema.BODIES}/"):
            return len(dataset)
        if table.name != f"/{schema.CONTACT}":
            return min(len(column) for column in table.values())
        ticks, a, b = (np.asarray(table[name], np.int64) for name in ("tick", "a", "b"))
        ground, codes = schema.HAND_BODIES * len(self.hands), contact_names(list(self.hands), list(self.bodies))
        # The first body with a hand, the table or another body.
        of_hand = (a >= 0) & (a < ground) & (b == ground + 1)
        of_body = (a == ground + 1) & (b >= ground) & (b != ground + 1) & (b < len(codes))
        known = json.loads(str(table.attrs["names"])) == codes and bool((of_hand | of_body).all())
        if (np.diff(ticks) < 0).any() or (ticks[:1] < 0).any() or not known:
            raise InputError(f"{self.path} is damaged: a contact of no tick, or of no body")
        return int(np.searchsorted(ticks, self.ticks))

    @cached_property
    def skin_faces(self) -> IntArray | None:
        """Triangles of the shown hand's skin, shape (F, 3); None where a result has none; InputError for damage."""
        with _opened(self.path) as file:
            skin = self._skin(file)
            if skin is None:
                return None
            for column in schema.SKIN_COLUMNS:
                _check_dataset(skin, column, column.shape)
            vertices, found = skin["vertices"], np.asarray(skin["faces"], np.int64)
            if len(vertices) < self.ticks or not len(found) or not 0 <= found.min() <= found.max() < vertices.shape[1]:
                raise InputError(f"{self.path} is damaged: its skin does not fit its ticks or its triangles")
            return found

    def skin(self, rows: slice) -> FloatArray:
        """Read the skin's vertices at some ticks [m], shape (T, V, 3), in the hands' frame."""
        with _opened(self.path) as file:
            found = np.asarray(_finite_numbers(self._skin(file)["vertices"], rows), np.float64)
        return self.moved_since_first(rows).seen_points(found) if self.from_object else found

    def _skin(self, file: h5py.File) -> Any:
        return file[schema.HANDS][self.name].get(schema.SKIN)

    def to_xarray(self, names: Sequence[str] = ()) -> "xarray.Dataset":
        """Return datasets and groups by name, or all, as an xarray Dataset along time, with phases as a coordinate.

        Units and descriptions are attributes. A file of two hands as a whole has them along `hand`; bodies are told by
        name, as `bodies/NAME/tick/position`. Raises UnknownNameError for no such name, InputError without xarray.
        """
        found = variables(self, names)
        stated: dict[str, Any] = {
            name: self.scene[name] for name in ("object_name", "motion", "rate") if name in self.scene
        }
        stated |= {"method": self.method, "surface": self.surface, "hhsim_version": self.hhsim_version}
        return as_dataset({name: found[name] for name in found if name != "time"}, coordinates(self), stated)

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


def load_result(path: str | Path) -> Result:
    """Open a result file, complete or not; a file of two hands has each of them in `Result.hands`.

    Raises InputError for no such file, no HDF5, no result, another schema, or datasets that are missing or misshapen.
    """
    path = Path(path)
    with _opened(path) as file:
        _check_format(file, path)
        names = [side for side in SIDES if side in file[schema.HANDS]]
        named = [str(name) for name in json.loads(str(file[schema.BODIES].attrs["names"]))]
        if not names or not named:
            raise DamagedFileError(f"damaged: it has no {'body' if names else 'hand'}")
        for table, columns in _tables(file, names, named).items():
            for column in columns:
                _check_dataset(file.get(table, {}), column, (-1, *column.shape))
        attributes, summary = file.attrs, file[schema.SUMMARY]
        dirty, common = attributes["git_dirty"], _mapping(attributes["scene"])
        ticks, group = _ticks(file), file["phase"]
        begun = zip(group["name"].asstr()[...], group["first_tick"], group["last_tick"])
        # Filled below: each hand and each body needs the result that it is a part of.
        hands: dict[str, Result] = {}
        bodies: dict[str, Body] = {}
        whole = Result(
            path=path,
            complete=bool(attributes["complete"]),
            ticks=ticks,
            schema_version=int(attributes["schema_version"]),
            hhsim_version=str(attributes["hhsim_version"]),
            created_utc=str(attributes["created_utc"]),
            scene=_Stated(common, path),
            machine=_mapping(attributes["machine"]),
            packages=_mapping(attributes["packages"]),
            phases=tuple(TickPhase(str(name), int(first), int(last)) for name, first, last in begun if first < ticks),
            summary=_attributes(summary),
            command=tuple(json.loads(attributes["command"])),
            git_revision=str(attributes["git_revision"]),
            git_dirty=dirty if isinstance(dirty, str) else bool(dirty),
            repeated=_mapping(attributes.get("repeated", "{}")),
            score=_mapping(attributes.get("score", "{}")),
            frame=_moving_frame(file, named),
            hands=hands,
            bodies=bodies,
        )
        for name in names:
            group = file[schema.HANDS][name]
            static = _static(group, schema.HAND_STATIC, _PALM_TREE, ("palm_center", "palm_radius"))
            hands[name] = replace(
                whole,
                name=name,
                scene=_Stated({**common, **_mapping(group.attrs["scene"])}, path),
                summary={**whole.summary, **_attributes(summary[name])},
                static={f"hand/{column}": array for column, array in static.items()},
                live=_Stated(_attributes(group[schema.LIVE]), path) if schema.LIVE in group else None,
                _loaded={},
            )
        found = hands[names[0]] if len(names) == 1 else whole
        for body in named:
            group = file[schema.BODIES][body]
            kind, properties = str(group.attrs["kind"]), _mapping(str(group.attrs["properties"]))
            if words := [key for key, value in properties.items() if isinstance(value, str)]:
                raise DamagedFileError(f"damaged: {words[0]} of body '{body}' is no number")
            own = tuple(column for column in schema.BODY_COLUMNS if column.name in group.get(schema.TICK, ()))
            bodies[body] = Body(kind, _static(group, schema.BODY_STATIC, _TREE), own, properties, body, found)
            kinds = ("fixed", "free") if "velocity" in bodies[body] else ("fixed", "driven")
            if kind not in (("driven",) if "recorded_position" in bodies[body] else kinds):
                raise DamagedFileError(f"damaged: body '{body}' does not move as its kind, {kind}, says")
        return found


def load_hand(path: str | Path, side: str = "") -> Result:
    """Open a hand of a result file, the only one or that of a side; errors as `load_result`, or for no such hand."""
    found = load_result(path)
    if side and side not in found.hands:
        raise InputError(f"{path} has no {side} hand: it holds the {' and the '.join(found.hands)} one")
    if not (side or found.name):
        raise InputError(f"{path} holds two hands: --hand right or --hand left names one of them")
    return found.hands[side or found.name]


def _tables(file: h5py.File, hands: Sequence[str], bodies: Sequence[str]) -> dict[str, Sequence[schema.Column]]:
    """Return the groups whose datasets have rows, each with the columns that it has to have."""
    known = {column.name: column for column in schema.BODY_COLUMNS}
    tables: dict[str, Sequence[schema.Column]] = {}
    for name in hands:
        tables[f"{schema.HANDS}/{name}/{schema.TICK}"] = schema.hand_columns()
        if schema.LIVE in file[schema.HANDS][name]:
            tables[f"{schema.HANDS}/{name}/{schema.LIVE_TICK}"] = schema.LIVE_TICK_COLUMNS
    tables[schema.TICK] = (schema.TIME,)
    for group in (schema.FRAME, *(f"{schema.BODIES}/{name}/{schema.TICK}" for name in bodies)):
        if group in file:
            tables[group] = (*schema.POSE_COLUMNS, *(known[name] for name in file[group]))
    if schema.CONTACT in file:
        tables[schema.CONTACT] = schema.CONTACT_COLUMNS
    return tables


def _ticks(file: h5py.File) -> int:
    """Return the number of ticks that every dataset has.

    Raises DamagedFileError for columns of a table of a complete file that are not of one length.
    """
    tables: dict[str, dict[str, int]] = {schema.TICK: {}}
    for name in _dataset_names(file):
        group = name.rpartition("/")[0]
        if schema.TICK in group.split("/"):
            tables[schema.TICK][name] = len(file[name])
        elif schema.LIVE in group.split("/") or group == schema.CONTACT:
            tables.setdefault(group, {})[name] = len(file[name])
    for rows in tables.values() if file.attrs["complete"] else ():
        least, most = (end(rows, key=rows.__getitem__) for end in (min, max))
        if rows[least] != rows[most]:
            raise DamagedFileError(f"damaged: {least} has {rows[least]:,} rows, {most} {rows[most]:,}")
    return min(tables[schema.TICK].values())


def _static(group: h5py.Group, columns: Sequence[schema.Column], *together: Sequence[str]) -> dict[str, AnyArray]:
    """Read arrays that do not change with time; DamagedFileError for those `together` of different lengths."""
    for column in columns:
        _check_dataset(group, column, column.shape)
    for names in together:
        if len({len(group[name]) for name in names}) > 1:
            raise DamagedFileError(f"damaged: {' and '.join(names)} are not of the same length")
    return {column.name: _frozen(_finite_numbers(group[column.name])) for column in columns}


def _moving_frame(file: h5py.File, bodies: Sequence[str]) -> str:
    """Group of the poses of the frame that hands were solved in; "" where it stands still."""
    if schema.FRAME in file:
        return schema.FRAME
    group = file[schema.BODIES][bodies[0]]
    # Several bodies without a free one are in the frame that carries all of them, or in the world.
    moves = schema.TICK in group and (len(bodies) == 1 or group.attrs["kind"] == "free")
    return f"{schema.BODIES}/{bodies[0]}/{schema.TICK}" if moves else ""


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
    except ValueError:  # A number of thousands of digits is one, too.
        found = None
    if not isinstance(found, dict):
        raise DamagedFileError(f"damaged: expected a JSON object, found '{written[:20]}'")
    return found


def _dataset_names(group: Any) -> list[str]:
    names: list[str] = []
    if not isinstance(group, h5py.Group):
        return names
    group.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    return names


def check_result_path(path: Path) -> None:
    """Check, before the work, that a result can be written to `path`.

    Raises OutputError as `hhsim.system.output_path.check_output_path`; for another suffix; or for an existing file that
    is no result.
    """
    check_output_path(path, "result file", lambda path: hdf5_format(path) == schema.FORMAT, schema.SUFFIXES)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open for reading; raise InputError for every failure of the file."""
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
    if version != schema.SCHEMA_VERSION:
        says = f"is a result of schema {version}; this hhsim reads schema {schema.SCHEMA_VERSION} alone: make it anew"
        if isinstance(version, int | np.integer) and version > schema.SCHEMA_VERSION:
            reads = f"schema {version}; this one reads {schema.SCHEMA_VERSION}"
            says = f"was written by a newer hhsim ({reads}): upgrade hhsim"
        raise InputError(f"{path} {says}")


def _check_dataset(group: Mapping[str, Any], column: schema.Column, shape: tuple[int, ...]) -> None:
    dataset = group.get(column.name)
    if dataset is None:
        raise DamagedFileError(f"damaged or no result file: it lacks the dataset {column.name}")
    fits = len(dataset.shape) == len(shape) and all(size in (-1, has) for has, size in zip(dataset.shape, shape))
    if not fits:
        expected = ", ".join("any" if size == -1 else str(size) for size in shape)
        raise DamagedFileError(f"damaged: {column.name} has shape {dataset.shape}, expected ({expected})")
    if dataset.dtype.kind not in _STORED[np.dtype(column.dtype).kind]:
        raise DamagedFileError(f"damaged: {column.name} holds {dataset.dtype}, expected {column.dtype}")


def _frozen(array: AnyArray) -> AnyArray:
    array.flags.writeable = False
    return array


def _attributes(group: h5py.Group) -> dict[str, Any]:
    return {name: value.item() if isinstance(value, np.generic) else value for name, value in group.attrs.items()}
