"""Folder of a sweep: results and rows of cells that are done, and a lock against a second sweep.

`sweep.json` identifies it; `cells/` holds each cell's result (DIGEST.h5) and row (DIGEST.json). Each appears in one
step, so that an interrupted sweep leaves only complete files.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hhsim.errors import InputError, OutputError
from hhsim.sweep.plan import Cell, PlannedCell, SweepPlan
from hhsim.system import posix
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text
from hhsim.system.plain_json import plain_json

MARK = "sweep.json"
CELLS = "cells"
LOCK = ".lock"
FORMAT, ROW_FORMAT, VERSION = "hhsim-sweep", "hhsim-cell", 1
PARTIAL = ".partial.h5"
"""Suffix of a result that is being written, in a name that begins with a point."""


class SweepFolder:
    """Folder of a sweep, which may not exist yet; OutputError where another file or folder is."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cells = path / CELLS
        check_own(path, has_format(path / MARK, FORMAT), "sweep")

    @contextlib.contextmanager
    def taken(self, plan: SweepPlan) -> Iterator[None]:
        """Make and lock the folder and remove unfinished files; OutputError if it is not writable, or locked."""
        with locked(self.path, self.cells, "sweep"):
            try:
                content = {"format": FORMAT, "version": VERSION, "name": plan.name, "plan": plan.text}
                write_atomically(self.path / MARK, (json.dumps(content, indent=1) + "\n").encode())
                self._clean()
                yield
            finally:
                with contextlib.suppress(OSError):
                    self._clean()

    def done(self, planned: PlannedCell, with_result: bool = False) -> bool:
        """Return True if a cell is done as often as planned, with its result if wanted; rename it in its row."""
        path, row = self.row_path(planned), self.row(planned)
        result = row.get("result")
        if not row or (with_result and not result):
            return False
        if result and content_digest(self.cells / result) != row.get("result_sha256"):
            return False
        if row.get("repeated", {}).get("runs", 1) < planned.cell.repeat:
            return False
        if row["cell"] != _named(planned.cell):
            write_row(path, planned.cell, planned.digest, row)
        return True

    def row(self, planned: PlannedCell) -> dict[str, Any]:
        """Return the row of a cell that was run, however often; {} for any other."""
        try:
            found = read_row(self.row_path(planned))
        except InputError:
            return {}
        return found if found.get("digest") == planned.digest else {}

    def row_path(self, planned: PlannedCell) -> Path:
        """Return the path of a cell's row."""
        return self.cells / f"{planned.digest}.json"

    def _clean(self) -> None:
        for pattern in (f".*{PARTIAL}", ".*.tmp"):
            for left in self.cells.glob(pattern):
                left.unlink(missing_ok=True)


def content_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal; "" if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


@contextlib.contextmanager
def locked(path: Path, inner: Path, what: str) -> Iterator[None]:
    """Make and lock a folder and one in it; OutputError if it is not writable, or another `what` works in it."""
    try:
        inner.mkdir(parents=True, exist_ok=True)
        lock = os.open(path / LOCK, posix.CREATE_FLAGS, 0o644)
    except OSError as error:
        raise OutputError(f"cannot write in {path}: {error.strerror or error}") from error
    try:
        try:
            posix.lock(lock)
        except BlockingIOError:
            raise OutputError(f"another {what} works in {path}: wait for it, or name another folder") from None
        except OSError:
            # A file system without locks: two runs do each other's work twice, and no harm.
            pass
        yield
    finally:
        os.close(lock)


def check_own(path: Path, is_own: bool, what: str) -> None:
    """Raise OutputError for a file, or a folder that is not empty and not its own, as that of a `what` is."""
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path} is a file, not a folder: name another with --out")
    if not is_own and path.is_dir() and any(path.iterdir()):
        raise OutputError(f"{path} holds other files, and no {what}: name a new folder with --out")


def has_format(path: Path, form: str) -> bool:
    """Return True if a file is a JSON document of this format."""
    try:
        found = json.loads(read_input_text(path))
    except (OSError, ValueError):
        return False
    return isinstance(found, dict) and found.get("format") == form


def write_row(path: Path, cell: Cell, digest: str, content: Mapping[str, Any]) -> None:
    """Write the row of a cell in one step, null for NaN and infinity; OutputError if it cannot be."""
    row = plain_json({**content, "format": ROW_FORMAT, "version": VERSION, "digest": digest, "cell": _named(cell)})
    sealed = {**row, "sha256": _row_digest(row)}
    write_atomically(path, (json.dumps(sealed, indent=1, sort_keys=True, allow_nan=False) + "\n").encode())


def read_row(path: Path) -> dict[str, Any]:
    """Read a row; raise InputError for a missing or another file."""
    try:
        found = json.loads(read_input_text(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no row of a sweep: {error}") from None
    if not isinstance(found, dict) or found.get("format") != ROW_FORMAT:
        raise InputError(f"{path}: no row of a sweep")
    if found.get("version") != VERSION:
        raise InputError(f"{path}: version {found.get('version')!r} of a row, this hhsim reads {VERSION}")
    if found.get("sha256") != _row_digest(found):
        raise InputError(f"{path}: a row that is not as it was written: remove it, and the sweep runs the cell anew")
    return found


def _row_digest(row: Mapping[str, Any]) -> str:
    """Return the SHA-256 of what a row holds beside it, hexadecimal."""
    content = {name: value for name, value in row.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _named(cell: Cell) -> dict[str, Any]:
    """Return the names that a plan gives a cell."""
    names = {"object": cell.object.name, "motion": cell.motion.name, "method": cell.method}
    return {**names, "surface": cell.surface, "options": cell.options_name, "seed": cell.seed}
