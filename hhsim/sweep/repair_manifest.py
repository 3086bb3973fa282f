"""Manifest of repairs: a TOML file of recordings and patterns, whose keys docs/repair.md lists."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, field

from hhsim.errors import InputError, UnknownNameError
from hhsim.mesh.catalogue import names_a_body_file, names_a_file
from hhsim.recordings.column_map import read_column_map
from hhsim.recordings.formats.mano import READINGS
from hhsim.recordings.registry import ReadOptions, repaired_suffix
from hhsim.repair.request import RepairRequest
from hhsim.sweep.plan import WILD, SweptObject, checked_object
from hhsim.system.settings_file import Settings, Version, a_list, between, one_of, parse_settings, read_toml_text, typed

NAME = re.compile(r"[^./\\][^/\\]{0,99}")
OF_THE_FOLDER = ("table.csv", "table.json", "repairs.json")
OUTCOME = "outcome.json"
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


def load_manifest(path: Path, out: Path, *, pictures: bool = True) -> tuple[str, list[PlannedRepair]]:
    """Return the text of a manifest and its repairs, of which `out` is the output folder; patterns match nothing in it.

    With `pictures` each repair has a page and pictures.

    Raises InputError for no such file; an unknown key, name or file, a wrong value; two recordings of one name.
    """
    folder, output = path.parent.resolve(), out.resolve()
    text = read_toml_text(path, "manifest of repairs").removeprefix("\ufeff")
    table = parse_settings(text, _ManifestTable, str(path))
    typed({"recording": "any", "object": "any", **table.defaults}, ManifestRow, f"{path}: defaults")
    found: dict[str, PlannedRepair] = {}
    for number, stated in enumerate(table.recording, 1):
        where = f"{path}: recording[{number}]"
        for row in _expanded(where, {**table.defaults, **stated}, folder, output):
            planned = _planned(where, row, folder, output, pictures)
            other = found.setdefault(planned.name.casefold(), planned)
            if other is not planned:
                raise InputError(f"{where}: two recordings are called '{planned.name}': give this one another name")
    return text, list(found.values())


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
    if recording.name.casefold() == OUTCOME:
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
    read = ReadOptions(
        hand=row.hand or "",
        mano_model=file("mano_model"),
        profile=file("profile"),
        columns=None if columns is None else read_column_map(columns),
        **{key: getattr(row, key) for key in _OF_THE_READER},
    )
    request = RepairRequest(
        recording=recording,
        object=str(folder / row.object) if names_a_file(row.object) else row.object,
        out=output / name / f"{recording.stem}{repaired_suffix(recording, read)}",
        object_poses=file("poses"),
        unit=row.unit,
        size=None if row.size_mm is None else 1e-3 * row.size_mm,
        max_correction=1e-3 * row.max_correction_mm,
        palm=row.palm,
        pictures=pictures,
        read=read,
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
