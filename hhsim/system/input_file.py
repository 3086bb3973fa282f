"""The one way in which files that people name are opened, so that none keeps its reader waiting or fills the memory."""

import errno
import io
import os
import stat
import sys
from pathlib import Path

MOST_BYTES = 1 << 30
"""Of a file that is read whole."""
LFS_POINTER = b"version https://git-lfs.github.com/spec/v1"
"""Begins what stands in the place of a file that Git LFS has not fetched."""

_KINDS = (
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def check_ordinary(path: Path, most: int = MOST_BYTES) -> None:
    """Refuse what is no ordinary file: nobody may ever write what a pipe or a device waits for. A folder passes.

    Args:
        most: Bytes of a file that are not too many.

    Raises:
        OSError: It is none, or too large, or a pointer of Git LFS, or there is no such file; `strerror` says which.
    """
    _check(path, path.stat(), most)
    if path.is_file() and path.stat().st_size < 1024:
        with path.open("rb") as file:
            if file.read(len(LFS_POINTER)) == LFS_POINTER:
                raise OSError(errno.EINVAL, "a Git LFS pointer: git lfs pull fetches the file", str(path))


def _check(path: Path, state: os.stat_result, most: int) -> None:
    for is_kind, name in _KINDS:
        if is_kind(state.st_mode):
            raise OSError(errno.EINVAL, f"{name}, no ordinary file", str(path))
    if stat.S_ISREG(state.st_mode) and state.st_size > most:
        raise OSError(errno.EFBIG, f"{state.st_size:,} bytes, more than such a file has", str(path))


def open_input(path: Path, most: int = sys.maxsize) -> io.BufferedReader:
    """Open an ordinary file for reading.

    Raises:
        OSError: As `check_ordinary`; or no permission, or a folder.
    """
    check_ordinary(path, most)
    # Something else may take the file's place between the look and the opening.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        _check(path, os.fstat(descriptor), most)
        return os.fdopen(descriptor, "rb")
    except OSError:
        os.close(descriptor)
        raise


def read_input(path: Path, most: int = MOST_BYTES) -> bytes:
    """The bytes of an ordinary file.

    Raises:
        OSError: As `open_input`.
    """
    with open_input(path, most) as file:
        return file.read()


def read_input_text(path: Path, encoding: str = "utf-8", errors: str = "strict", most: int = MOST_BYTES) -> str:
    r"""The text of an ordinary file, each line ended by "\n".

    Raises:
        OSError: As `open_input`.
        UnicodeDecodeError: It is of another encoding.
    """
    with io.TextIOWrapper(open_input(path, most), encoding, errors) as file:
        return file.read()
