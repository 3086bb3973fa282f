"""Output paths: default names, and checks before the work."""

import os
import tempfile
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from hhsim.errors import InputError, OutputError

RESULTS = Path("results")
"""Default folder of results, in the current folder."""


def dated_output_path(stem: str, suffix: str = ".h5") -> Path:
    """Return a new path such as results/2026-03-01-142530-bunny-grasp.h5, by local time.

    Characters of `stem` that no file name has become "-". OutputError if the folder cannot be made or written.
    """
    try:
        RESULTS.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder {RESULTS}: {error.strerror or error}; name another place") from error
    kept = "".join(letter if letter.isalnum() or letter in "._-" else "-" for letter in stem)
    path = free_name(RESULTS / f"{datetime.now():%Y-%m-%d-%H%M%S}-{kept}{suffix}")
    check_output_path(path)
    return path


def free_name(path: Path) -> Path:
    """Return `path`, or if it exists the first of path-2, path-3, … that does not."""
    others = (path.with_name(f"{path.stem}-{number}{path.suffix}") for number in count(2))
    return next(one for one in chain([path], others) if not os.path.lexists(one))


def check_output_path(path: Path) -> None:
    """Raise OutputError if `path` cannot be written or replaced: a folder or a device, no folder, no permission."""
    target = Path(os.path.realpath(path))
    folder = target.parent
    if target.is_dir():
        raise OutputError(f"{path} is a folder: name a file in it, such as {path / ('run' + (path.suffix or '.h5'))}")
    if target.exists() and not target.is_file():
        raise OutputError(f"{path} is no ordinary file: name one that can be written")
    if not folder.exists():
        raise OutputError(f"there is no folder {folder} for {path.name}: make it first, or name another")
    if not folder.is_dir():
        raise OutputError(f"{folder} is a file, not a folder: name another place")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise OutputError(f"cannot write in {folder}: {error.strerror or error}; name another place") from error
    if target.exists() and not os.access(target, os.W_OK):
        raise OutputError(f"no permission to replace {path}: name another file")


def check_picture(path: Path) -> None:
    """Raise OutputError if the picture cannot be written, InputError if matplotlib has no such format."""
    from matplotlib.backend_bases import FigureCanvasBase

    check_output_path(path)
    kinds = sorted(FigureCanvasBase.filetypes)
    if path.suffix.lower().removeprefix(".") not in kinds:
        raise InputError(f"{path} is no picture by its ending: expected .{', .'.join(kinds)}")


def picture_beside(table: Path, named: Path | None) -> Path:
    """Return the path of the picture of a table of `hhsim bench`: as --plot names it, or beside the table, as .png.

    Errors as `check_picture`; OutputError too for a picture that belongs to no table.
    """
    picture = named or table.with_suffix(".png")
    if named is None and picture.exists() and not table.exists():
        raise OutputError(f"{picture} exists and is not of hhsim bench: name another file with --plot or --out")
    check_picture(picture)
    return picture
