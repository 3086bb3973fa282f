"""Repair of one recording of a manifest, in whatever process, and what its folder keeps of it: outcome.json, last."""

import faulthandler
import hashlib
import json
import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from msgspec import field, structs

from hhsim import __version__
from hhsim.errors import InputError, TrajectoryError
from hhsim.mesh.catalogue import names_a_file
from hhsim.repair.request import PICTURE, REPORT, Illustrate, Repair, RepairOutcome
from hhsim.sweep.engines import FolderTask, TaskEnd, error_line
from hhsim.sweep.input_files import CHANGED, LostFileError, ReadFile, file_digest, read_files, source_digest
from hhsim.sweep.plan import DIGITS
from hhsim.sweep.repair_manifest import PlannedRepair
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text
from hhsim.system.plain_json import plain_json
from hhsim.system.settings_file import Settings, Version, typed

OUTCOME = "outcome.json"
MARK = ".begun"
"""File of a row that is being run: its attempt, and the traceback at its time limit."""

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
class RowTask(FolderTask):
    """Row of a manifest, in the folder of all of them: the end has a reason if it left no outcome in its own folder."""

    row: PlannedRepair
    repair: Repair  # function of a module that the process can import
    illustrate: Illustrate  # another one
    attempt: str  # name of the run that it belongs to

    def work(self) -> TaskEnd:
        """Repair the recording."""
        folder = self.row.request.out.parent
        # A cluster runs again what a worker had done, or had begun, when it was lost.
        if is_done(self.row, self.digest):
            return TaskEnd(self.digest)
        if done := finished(self.row, self.digest):
            return self._pictured(done)
        if _begun(folder, self.attempt) is not None:
            return TaskEnd(self.digest, "its worker was lost")
        _empty(folder)
        outcome = self._outcome(folder)
        (folder / MARK).unlink()
        write_outcome(folder, outcome)
        return TaskEnd(self.digest)

    def _pictured(self, done: RowOutcome) -> TaskEnd:
        """Add what is missing of the page and the picture; nothing else in the folder is touched."""
        request = self.row.request
        known = {name: math.nan if value is None else value for name, value in done.figures.items()}
        outcome = RepairOutcome(
            known, done.frames, done.marked, done.verdict, done.state == "repaired", done.findings, doubts=done.doubts
        )
        for name in (REPORT, PICTURE):
            request.beside(name).unlink(missing_ok=True)
        with Path(os.devnull).open("w") as nowhere:
            faulthandler.dump_traceback_later(self.row.time_limit, exit=True, file=nowhere)
            try:
                self.illustrate(request, outcome)
            finally:
                faulthandler.cancel_dump_traceback_later()
        return TaskEnd(self.digest)

    def _outcome(self, folder: Path) -> RowOutcome:
        try:
            with (folder / MARK).open("w", encoding="utf-8") as mark:
                print(self.attempt, file=mark, flush=True)
                # Its thread waits for no lock of Python, which compiled code may hold.
                faulthandler.dump_traceback_later(self.row.time_limit, exit=True, file=mark)
                try:
                    files = row_files(self.row)
                    if row_digest(self.row) != self.digest:
                        raise LostFileError(CHANGED)
                    try:
                        done = self.repair(self.row.request)
                    finally:
                        if row_files(self.row) != files:
                            raise LostFileError(CHANGED)
                finally:
                    faulthandler.cancel_dump_traceback_later()
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
        except LostFileError as error:
            outcome = RowOutcome(digest=self.digest, state="failed", reason=error_line(error), is_final=False)
        except TrajectoryError as error:
            outcome = RowOutcome(digest=self.digest, state="refused", reason=error_line(error))
        except InputError as error:
            outcome = RowOutcome(digest=self.digest, state="failed", reason=error_line(error))
        except Exception as error:
            outcome = RowOutcome(digest=self.digest, state="failed", reason=error_line(error), is_final=False)
        _empty(folder, but=MARK)
        return outcome


def row_files(row: PlannedRepair) -> tuple[ReadFile, ...]:
    """Return the files that a row reads, as they are now; InputError if one cannot be read."""
    request = row.request
    shape = [Path(request.object)] if names_a_file(request.object) else []
    given = [value for name, value in (*vars(request).items(), *request.options.items()) if name != "out"]
    return tuple(read for value in (*given, *shape) if isinstance(value, Path) for read in read_files(value))


def row_digest(row: PlannedRepair) -> str:
    """Return a digest of a row: the content of its files, its options, its name, and hhsim's sources."""
    request = row.request
    # Pictures are made of what is repaired, and change nothing of it.
    stated = {name: value for name, value in vars(request).items() if name not in ("out", "pictures")}
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


def is_done(row: PlannedRepair, digest: str) -> bool:
    """Return True if a row has come to an end for good, with its pictures if it is to have them."""
    found = finished(row, digest)
    if found is None:
        return False
    unpictured = row.request.pictures and found.state in ("repaired", "missed")
    return not unpictured or row.request.beside(PICTURE).is_file()


def finished(row: PlannedRepair, digest: str) -> RowOutcome | None:
    """Return the outcome of a row that has come to an end for good, be it without its pictures."""
    found = read_outcome(row, digest)
    return found if found is not None and found.is_final else None


def write_outcome(folder: Path, outcome: RowOutcome) -> None:
    """Write the outcome of a row in one step; OutputError if that fails."""
    text = json.dumps(plain_json(structs.asdict(outcome)), indent=1, allow_nan=False)
    write_atomically(folder / OUTCOME, f"{text}\n".encode())


def keep_lost(task: RowTask, reason: str) -> None:
    """Write the outcome of a row whose worker left none; OutputError if that fails."""
    folder, limit = task.row.request.out.parent, task.row.time_limit
    if _begun(folder, task.attempt):
        reason = f"not done within its time_limit of {limit:,g} s"
    _empty(folder)
    write_outcome(folder, RowOutcome(digest=task.digest, state="failed", reason=reason, is_final=False))


def _begun(folder: Path, attempt: str) -> str | None:
    """Return what stands below the mark of this attempt at a row; None if it was not begun."""
    try:
        found, _, below = (folder / MARK).read_text(encoding="utf-8", errors="replace").partition("\n")
    except OSError:
        return None
    return below if found == attempt else None


def _empty(folder: Path, but: str = "") -> None:
    """Make a folder, and remove what is in it but for one file."""
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != but:
            path.unlink()


def _content(value: Any) -> str:
    try:
        return file_digest(value) if isinstance(value, Path) else repr(value)
    except InputError as error:
        # The repair of this row will say so; the others go on.
        return str(error)
