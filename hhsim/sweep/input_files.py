"""Files that a cell or a row of a manifest reads: their digests, and a check that they stay; and that of the code."""

import hashlib
import os
import re
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import hhsim
from hhsim.errors import InputError
from hhsim.linkage.urdf import mesh_file
from hhsim.system.input_file import file_state, read_input

CHANGED = "its files changed after they were listed, so nothing is kept of it; the same command runs it anew"
"""Reason of a cell or a row whose files are not those of its digest."""
NAMING = frozenset({".toml", ".urdf", ".xml", ".mjcf", ".gltf"})
"""Suffixes of text that names further files, in quotes."""
LONGEST = 255
"""Letters of the longest name of a file."""
_QUOTED = re.compile(rb"""\"([^\"\n\0]*)\"|'([^'\n\0]*)'""")


class LostFileError(InputError):
    """A file cannot be read, or is not the one that a digest is of."""


class ReadFile(NamedTuple):
    """File as it was read."""

    state: tuple[object, ...]  # as of `hhsim.system.input_file.file_state`
    digest: str  # SHA-256, hexadecimal
    named: tuple[Path, ...]  # files that its text names


def read_files(path: Path) -> tuple[ReadFile, ...]:
    """Return a file and those that it names, and they name, as they are now; InputError if one cannot be read."""
    waiting, found = [path], dict[Path, ReadFile]()
    try:
        for each in waiting:
            if each not in found:
                found[each] = _read(each, file_state(each))
                waiting += found[each].named
    except OSError as error:
        raise LostFileError(f"{error.filename or path}: {error.strerror or error}") from None
    return tuple(found.values())


def file_digest(path: Path) -> str:
    """Return a digest of a file and of those that it names; InputError if one cannot be read."""
    return "".join(read.digest for read in read_files(path))


# A plan asks for the same file once a cell.
@cache
def _read(path: Path, state: tuple[object, ...]) -> ReadFile:
    content = read_input(path)
    named: list[Path] = []
    if path.suffix.lower() in NAMING:
        words = sorted({(a or b).decode(errors="surrogateescape") for a, b in _QUOTED.findall(content)})
        # An MJCF has its meshes in a folder that it names.
        folders = [path.parent / word for word in words if os.path.isdir(path.parent / word)]  # noqa: PTH112
        whole = [word for word in words if Path(word).suffix and len(word) <= LONGEST]
        tries = [file for word in whole for file in (mesh_file(word, path), *(folder / word for folder in folders))]
        named = [file for file in tries if file.is_file()]
    return ReadFile(state, hashlib.sha256(content).hexdigest(), tuple(named))


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
