"""Output paths: the rule for every output, default names, and checks before the work.

The rule: no output replaces an input of the command, by whatever name or link; none is written through a symbolic link;
and an existing file is replaced only where it is of the kind that is written. Writers (`hhsim.system.atomic_write`)
keep its first two parts even where a path was not checked.
"""

import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from hhsim.errors import InputError, OutputError
from hhsim.system.input_file import media_kind_of, read_input

RESULTS = Path("results")
"""Default folder of results, in the current folder."""
PICTURES = ("a picture", "a document (PDF)")
"""Beginnings of the kinds of file that a picture replaces, as `hhsim.system.input_file.media_kind` names them."""
_kept: dict[tuple[int, int], Path] = {}
"""Inputs of the command that runs, by device and inode."""


@contextmanager
def keeping(inputs: Iterable[Path]) -> Iterator[None]:
    """Keep files while the block runs: no output replaces one. Paths at which no file is are passed by."""
    before = _kept.copy()
    for path in inputs:
        with suppress(OSError, ValueError):
            if path.is_file():
                found = path.stat()
                _kept[found.st_dev, found.st_ino] = path
    try:
        yield
    finally:
        _kept.clear()
        _kept.update(before)


def require_apart(path: Path) -> None:
    """Raise OutputError for a symbolic link, but for one to a folder, or for an input that `keeping` keeps."""
    if path.is_symlink() and not path.is_dir():
        raise OutputError(f"{path} is a symbolic link, and nothing is written through one: name the file itself")
    with suppress(OSError, ValueError):
        found = path.stat()
        if (name := _kept.get((found.st_dev, found.st_ino))) is not None:
            same = "an input of this command" if name == path else f"the same file as the input {name}"
            raise OutputError(f"{path} is {same}, so it is not replaced: name another file")


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


def check_output_path(
    path: Path, kind: str = "", is_of_kind: Callable[[Path], object] = lambda path: False, suffixes: Sequence[str] = ()
) -> None:
    """Raise OutputError unless `path` can be written by the rule: what is not there, or an ordinary file of a kind.

    An existing file is replaced where `is_of_kind` returns true for it; `kind` is its name for the message, such as
    "result file". Without them nothing is replaced. OutputError too for a suffix that is none of `suffixes`, if there
    are any, without a folder, or without permission.
    """
    require_apart(path)
    folder = path.parent
    if path.is_dir():
        raise OutputError(f"{path} is a folder: name a file in it, such as {path / ('run' + (path.suffix or '.h5'))}")
    if suffixes and path.suffix.lower() not in suffixes:
        raise OutputError(f"{path} is no name for a {kind}: it has to end in {' or '.join(suffixes)}")
    if path.exists() and not path.is_file():
        raise OutputError(f"{path} is no ordinary file: name one that can be written")
    if not folder.exists():
        raise OutputError(f"there is no folder {folder.resolve()} for {path.name}: make it first, or name another")
    if not folder.is_dir():
        raise OutputError(f"{folder} is a file, not a folder: name another place")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise OutputError(f"cannot write in {folder}: {error.strerror or error}; name another place") from error
    # An empty file holds nothing to lose.
    if not path.exists() or not path.stat().st_size:
        return
    if not os.access(path, os.W_OK):
        raise OutputError(f"no permission to replace {path}: name another file")
    try:
        if is_of_kind(path):
            return
    except BlockingIOError as error:
        raise OutputError(f"{path} is being written by another process: name another file") from error
    except (InputError, OSError):
        pass
    no_kind = f" and is no {kind}" if kind else ""
    raise OutputError(f"{path} exists{no_kind}, so it is not replaced: name another file")


def begins_with(*beginnings: bytes) -> Callable[[Path], bool]:
    """Return a function that is true for a file with one of these beginnings."""
    return lambda path: read_input(path).startswith(beginnings)


def holds(words: bytes) -> Callable[[Path], bool]:
    """Return a function that is true for a file in which these bytes stand somewhere."""
    return lambda path: words in read_input(path)


def check_picture(path: Path) -> None:
    """Raise OutputError if the picture cannot be written, InputError if matplotlib has no such format.

    A picture is replaced by a picture, and an SVG or a PostScript file too.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    drawn = begins_with(b"<?xml", b"<svg", b"%!PS")
    check_output_path(path, "picture", lambda path: media_kind_of(path).startswith(PICTURES) or drawn(path))
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
