"""Manifest of repairs: a CSV file with a row for each recording, or a TOML file of recordings and patterns.

Keys, the same in both; the first two are required::

    version = 1                             # TOML only
    [defaults]                              # TOML only: keys of every recording that does not state them
    mano_model = "MANO_RIGHT.pkl"
    [[recording]]
    recording = "seqs/{object}_*.npz"       # {object} matches as * does, and is known by that name to the other keys
    object = "meshes/{object}.obj"          # a mesh file, a name of the catalogue, or a body's TOML
    poses = "poses/{stem}.npy"              # {stem}: name of the recording's file without suffix; {folder}: its folder
    name = "{folder}-{stem}"                # of the folder of what is written; default: {stem}
    hand = "right"
    unit = "mm"                             # of the mesh file; or size_mm, its largest extent
    max_correction_mm = 15.0
    palm = "fitted"
    time_limit = 3600.0                     # of the repair of one recording [s]

Further keys say how a file is read, by the names of the options of `hhsim import`: format, columns, rate, length_unit,
world_up, mirror, array, joint_order, pose_order, pose_unit, mano_pose, profile, episode; skin is that of `hhsim
repair`. Files are relative to the manifest's folder.

A row is repaired in whatever process; outcome.json, written last, is what its folder keeps of it.
"""

import csv
import faulthandler
import hashlib
import io
import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, field, structs

from hhsim import __version__
from hhsim.errors import InputError, TrajectoryError, UnknownNameError, check_known
from hhsim.mesh.catalogue import names_a_body_file, names_a_file
from hhsim.recordings.column_map import read_column_map
from hhsim.recordings.formats.mano import READINGS
from hhsim.recordings.registry import ReadOptions, repaired_suffix
from hhsim.repair.request import Repair, RepairRequest
from hhsim.sweep.engines import Task, TaskEnd, error_line
from hhsim.sweep.input_files import CHANGED, LostFileError, ReadFile, file_digest, read_files, source_digest
from hhsim.sweep.plan import DIGITS, WILD, SweptObject, checked_object
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import open_input, read_input_text
from hhsim.system.plain_json import plain_json
from hhsim.system.settings_file import Settings, Version, a_list, between, one_of, parse_settings, read_toml_text, typed

NAME = re.compile(r"[^./\\][^/\\]{0,99}")
OF_THE_FOLDER = ("table.csv", "table.json", "repairs.json")
OF_THE_ROW = ("outcome.json",)
"""Files of the output folder, and of the folder of a row."""
WITH_PLACES = ("object", "poses", "name", "mano_model", "columns", "profile")
"""Keys in which the parts of a pattern may be named."""
_PIECE = re.compile(r"(\*\*/)|(\*+)|(\?|\[[^]]+\])|\{([A-Za-z_]\w*)\}|(.)")
_PLACE = re.compile(r"\{(\w*)\}")
_LENGTH = Annotated[float, between(1e-3, 1e5, "mm")]
_TEXT = Annotated[str, Meta(pattern=r"\A[^\x00-\x1f\x7f]+\Z", description="text of one line")]


class ManifestRow(Settings, frozen=True, kw_only=True, rename={"form": "format"}):
    """Recording of a manifest; files are relative to its folder."""

    recording: _TEXT
    object: _TEXT
    poses: _TEXT | None = None
    name: _TEXT | None = None
    hand: Literal["right", "left"] | None = None
    mano_model: _TEXT | None = None
    unit: Literal["m", "cm", "mm", "inch"] | None = None
    size_mm: _LENGTH | None = None
    max_correction_mm: _LENGTH = 15.0
    palm: Literal["fitted", "thin", "none"] = "fitted"
    time_limit: Annotated[float, between(0.1, 1e7, "s")] = 3600.0
    form: _TEXT | None = None
    columns: _TEXT | None = None
    rate: Annotated[float, between(0.1, 1e5, "Hz")] | None = None
    length_unit: Literal["m", "cm", "mm", "inch"] | None = None
    world_up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    mirror: Literal["x", "y", "z"] | None = None
    array: _TEXT | None = None
    joint_order: Literal["mediapipe", "mano", "smplx", "openxr", "unity"] | None = None
    pose_order: Literal["wxyz", "xyzw"] | None = None
    pose_unit: Literal["m", "cm", "mm"] | None = None
    mano_pose: Annotated[str, one_of(READINGS)] | None = None
    skin: _TEXT | None = None
    profile: _TEXT | None = None
    episode: Annotated[int, between(0, 2**63 - 1)] | None = None

    def check(self) -> None:
        """Raise InputError for a unit beside a size."""
        if self.unit is not None and self.size_mm is not None:
            raise InputError("unit and size_mm exclude each other: size_mm scales whatever the unit is")


class _ManifestTable(Settings, frozen=True, kw_only=True):
    version: Version
    defaults: dict[str, Any] = field(default_factory=dict)
    recording: Annotated[tuple[dict[str, Any], ...], a_list("[[recording]], a table for each")]


@dataclass(frozen=True)
class PlannedRepair:
    """Repair of a manifest: its name, its request, and the longest duration [s]."""

    name: str
    request: RepairRequest
    time_limit: float


def is_manifest(path: Path) -> bool:
    """Return True for a TOML file, and for a table with the columns of a manifest."""
    if path.suffix.lower() == ".toml":
        return True
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    with open_input(path) as file:
        header = file.readline(4096).decode(errors="replace").removeprefix("\ufeff").strip().split(",")
    return {"recording", "object"} <= {name.strip() for name in header}


def load_manifest(path: Path, out: Path, *, pictures: bool = True) -> tuple[str, list[PlannedRepair]]:
    """Return the text of a manifest and its repairs, of which `out` is the output folder; patterns match nothing in it.

    With `pictures` each repair has a page and pictures.

    Raises InputError for no such file; an unknown key, name or file, a wrong value; two recordings of one name.
    """
    folder, output = path.parent.resolve(), out.resolve()
    if path.suffix.lower() not in (".toml", ".csv"):
        raise InputError(f"{path}: expected a manifest of repairs, .toml or .csv")
    text = read_toml_text(path, "manifest of repairs").removeprefix("\ufeff")
    found: dict[str, PlannedRepair] = {}
    for where, content in _csv_rows(text, path) if path.suffix.lower() == ".csv" else _toml_rows(text, path):
        for row in _expanded(where, content, folder, output):
            planned = _planned(where, row, folder, output, pictures)
            other = found.setdefault(planned.name.casefold(), planned)
            if other is not planned:
                raise InputError(f"{where}: two recordings are called '{planned.name}': give this one another name")
    return text, list(found.values())


def _toml_rows(text: str, path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    table = parse_settings(text, _ManifestTable, str(path))
    typed({"recording": "any", "object": "any", **table.defaults}, ManifestRow, f"{path}: defaults")
    for number, row in enumerate(table.recording, 1):
        yield f"{path}: recording[{number}]", {**table.defaults, **row}


def _csv_rows(text: str, path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        header = reader.fieldnames or []
        check_known("column", header, _KEYS)
        if len(set(header)) < len(header) or not {"recording", "object"} <= set(header):
            raise InputError(f"the columns are {', '.join(header)}; expected recording and object, and each once")
        rows = [(reader.line_num, row) for row in reader]
    except (csv.Error, InputError) as error:
        raise InputError(f"{path}: line {max(1, reader.reader.line_num)}: {error}".replace("\n", "\\n")) from None
    if not rows:
        raise InputError(f"{path}: no row below the columns")
    for line, row in rows:
        if None in row:
            raise InputError(f"{path}: line {line}: more cells than the {len(header)} columns")
        yield f"{path}: line {line}", {key: _value(key, cell.strip()) for key, cell in row.items() if cell}


def _value(key: str, cell: str) -> str | int | float:
    if key in ("size_mm", "max_correction_mm", "time_limit", "rate", "episode"):
        for kind in (int, float):
            with suppress(ValueError):
                return kind(cell)
    return cell


def _expanded(where: str, content: dict[str, Any], folder: Path, output: Path) -> Iterator[ManifestRow]:
    """Return the row, or that of each file that its pattern matches; the parts of a pattern are put in their places."""
    word = typed(content, ManifestRow, where).recording
    found: dict[str, dict[str, str]] = {}
    if _is_file(folder / word):
        found[word] = {}
    elif not WILD.union("{").isdisjoint(word):
        # That of a Path takes no absolute pattern.
        for path in sorted(glob(_PLACE.sub("*", word), root_dir=folder, recursive=True)):  # noqa: PTH207
            match = _shape(word).fullmatch(path)
            if match and _is_file(folder / path) and output not in (folder / path).resolve().parents:
                found[path] = match.groupdict()
    if not found:
        raise InputError(f"{where}: recording: there is no file {word} in {folder}")
    for path, parts in found.items():
        places = {**parts, "stem": Path(path).stem, "folder": (folder / path).parent.name}
        filled = {key: _filled(where, key, content[key], places) for key in WITH_PLACES if key in content}
        yield typed({**content, **filled, "recording": path}, ManifestRow, where)


def _shape(pattern: str) -> re.Pattern[str]:
    """Return the expression of a pattern whose files are known, in which {x} is `*` and, mentioned again, the same."""

    def piece(found: re.Match[str]) -> str:
        deep, stars, one, name, letter = found.groups()
        if name:
            again = f"{{{name}}}" in pattern[: found.start()]
            return f"(?P={name})" if again else f"(?P<{name}>[^/]+?)"
        return "(?:.*/)?" if deep else "[^/]*" if stars else "[^/]" if one else re.escape(letter)

    return re.compile(_PIECE.sub(piece, pattern))


def _filled(where: str, key: str, text: str, places: dict[str, str]) -> str:
    def value(found: re.Match[str]) -> str:
        if found[1] not in places:
            raise InputError(f"{where}: {key}: {UnknownNameError('place', found[0], [f'{{{one}}}' for one in places])}")
        return places[found[1]]

    return _PLACE.sub(value, text)


def _planned(where: str, row: ManifestRow, folder: Path, output: Path, pictures: bool) -> PlannedRepair:
    recording = folder / row.recording
    name = row.name or recording.stem
    if not NAME.fullmatch(name) or name.casefold() in OF_THE_FOLDER:
        raise InputError(f"{where}: name: '{name}' is none for a folder: expected at most 100 letters, no / in them")
    if recording.name.casefold() in OF_THE_ROW:
        raise InputError(f"{where}: recording: {recording.name} is the name of a file beside it: rename the recording")
    if names_a_file(row.object) or not names_a_body_file(row.object):
        checked_object(f"{where}: object", folder, SweptObject(row.object, unit=row.unit, size_mm=row.size_mm))

    def file(key: str) -> Path | None:
        word: str | None = getattr(row, key)
        if word is None:
            return None
        if not _is_file(folder / word):
            raise InputError(f"{where}: {key}: there is no file {word} in {folder}")
        # What is in the folder of a row goes when the row is run.
        if output in (folder / word).resolve().parents:
            raise InputError(f"{where}: {key}: {word} is in the output folder: expected a file outside of it")
        return folder / word

    file("recording")
    columns = file("columns")
    stated = {key: getattr(row, key) for key in _OF_THE_READER}
    stated |= {"profile": file("profile"), "columns": None if columns is None else read_column_map(columns)}
    options = {key: value for key, value in stated.items() if value is not None}
    request = RepairRequest(
        recording=recording,
        object=str(folder / row.object) if names_a_file(row.object) else row.object,
        out=output / name / f"{recording.stem}{repaired_suffix(recording, ReadOptions(**options))}",
        object_poses=file("poses"),
        mano_model=file("mano_model"),
        hand=row.hand or "",
        unit=row.unit,
        size=None if row.size_mm is None else 1e-3 * row.size_mm,
        max_correction=1e-3 * row.max_correction_mm,
        skin=file("skin"),
        palm=row.palm,
        pictures=pictures,
        options=options,
    )
    return PlannedRepair(name, request, row.time_limit)


def _is_file(path: Path) -> bool:
    # That of a Path raises for a name that is too long.
    return os.path.isfile(path)  # noqa: PTH113


_OF_THE_READER = (
    *("form", "rate", "length_unit", "world_up", "mirror", "mano_pose", "episode"),
    *("array", "joint_order", "pose_order", "pose_unit"),
)
"""Keys that are fields of `hhsim.recordings.registry.ReadOptions` as they are."""
_KEYS = tuple({"form": "format"}.get(key, key) for key in ManifestRow.__struct_fields__)


OUTCOME = "outcome.json"
State = Literal["repaired", "missed", "refused", "failed"]


class RowOutcome(Settings, frozen=True, kw_only=True):
    """Outcome of a row."""

    format: Literal["hhsim-repair"] = "hhsim-repair"
    version: Version = 1
    digest: str  # digest of what it depends on
    # "repaired" within all limits; "missed", repaired but a limit is missed; "refused", a recording that cannot be read
    # or used; "failed" for any other reason.
    state: State
    reason: str = ""  # reason of a state other than "repaired"
    is_final: bool = True  # False if the same row may come to another end next time, as after a crash
    # As in `hhsim.repair.request.RepairOutcome`; null for NaN.
    figures: dict[str, float | None] = field(default_factory=dict)
    frames: int = 0
    marked: tuple[int, ...] = ()
    verdict: str = ""
    doubts: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    paths: dict[str, str] = field(default_factory=dict)  # names of files in the row's folder, by what they hold


@dataclass(frozen=True, kw_only=True)
class RowTask(Task):
    """Row of a manifest, in the folder of all of them: the end has a reason if it left no outcome in its own folder."""

    row: PlannedRepair
    repair: Repair  # function of a module that the process can import

    def work(self) -> TaskEnd:
        """Repair the recording."""
        folder = self.row.request.out.parent
        # A cluster runs again what a worker had done when it was lost.
        if not finished(self.row, self.digest):
            _empty(folder)
            write_outcome(folder, self._outcome(folder))
        return TaskEnd(self.digest)

    def _outcome(self, folder: Path) -> RowOutcome:
        try:
            with _within(self.row.time_limit):
                files = row_files(self.row)
                if row_digest(self.row) != self.digest:
                    raise LostFileError(CHANGED)
                try:
                    done = self.repair(self.row.request)
                finally:
                    if row_files(self.row) != files:
                        raise LostFileError(CHANGED)
            if not self.row.request.out.is_file():
                raise InputError(f"it wrote no {self.row.request.out.name}")
            return RowOutcome(
                digest=self.digest,
                state="repaired" if done.ok else "missed",
                reason="" if done.ok else done.verdict,
                figures={name: float(value) for name, value in done.figures.items()},
                frames=int(done.frames),
                marked=tuple(map(int, done.marked)),
                verdict=done.verdict,
                doubts=tuple(done.doubts),
                findings=tuple(done.findings),
                paths={name: Path(os.path.relpath(path, folder)).as_posix() for name, path in done.paths.items()},
            )
        except Exception as error:
            is_final = isinstance(error, InputError | TrajectoryError) and not isinstance(error, LostFileError)
            state: State = "refused" if isinstance(error, TrajectoryError) else "failed"
            _empty(folder)
            return RowOutcome(digest=self.digest, state=state, reason=error_line(error), is_final=is_final)


@contextmanager
def _within(seconds: float) -> Iterator[None]:
    """End the process where this takes longer [s]."""
    with Path(os.devnull).open("w") as nowhere:
        # Its thread waits for no lock of Python, which compiled code may hold.
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def row_files(row: PlannedRepair) -> tuple[ReadFile, ...]:
    """Return the files that a row reads, as they are now; InputError if one cannot be read."""
    request = row.request
    shape = [Path(request.object)] if names_a_file(request.object) else []
    given = [value for name, value in (*vars(request).items(), *request.options.items()) if name != "out"]
    return tuple(read for value in (*given, *shape) if isinstance(value, Path) for read in read_files(value))


def row_digest(row: PlannedRepair) -> str:
    """Return a digest of a row: the content of its files, its options, its name, and hhsim's sources."""
    request = row.request
    stated = {name: value for name, value in vars(request).items() if name != "out"}
    stated["object"] = Path(request.object) if names_a_file(request.object) else request.object
    stated |= {"name": row.name, "file": request.out.name, "hhsim": [__version__, source_digest()]}
    text = json.dumps(stated, sort_keys=True, default=_content)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def read_outcome(row: PlannedRepair, digest: str) -> RowOutcome | None:
    """Return the outcome of a row with this digest; None if there is none, or it lacks its recording."""
    path = row.request.out.parent / OUTCOME
    try:
        found = typed(json.loads(read_input_text(path)), RowOutcome, str(path))
    except (OSError, ValueError, InputError):
        return None
    if found.state in ("repaired", "missed") and not row.request.out.is_file():
        return None
    return found if found.digest == digest else None


def finished(row: PlannedRepair, digest: str) -> RowOutcome | None:
    """Return the outcome of a row that has come to an end for good."""
    found = read_outcome(row, digest)
    return found if found is not None and found.is_final else None


def write_outcome(folder: Path, outcome: RowOutcome) -> None:
    """Write the outcome of a row in one step; OutputError if that fails."""
    text = json.dumps(plain_json(structs.asdict(outcome)), indent=1, allow_nan=False)
    write_atomically(folder / OUTCOME, f"{text}\n".encode())


def keep_lost(task: RowTask, reason: str) -> None:
    """Write the outcome of a row whose worker left none; OutputError if that fails."""
    folder = task.row.request.out.parent
    _empty(folder)
    reason = f"{reason}; its time_limit is {task.row.time_limit:,g} s"
    write_outcome(folder, RowOutcome(digest=task.digest, state="failed", reason=reason, is_final=False))


def _empty(folder: Path) -> None:
    """Make a folder, and remove what is in it."""
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _content(value: Any) -> str:
    try:
        return file_digest(value) if isinstance(value, Path) else repr(value)
    except InputError as error:
        # The repair of this row will say so; the others go on.
        return str(error)
