"""Opening of files that users name, which may not block the reader or fill the memory; their kind by first bytes."""

import errno
import io
import os
import stat
import sys
from pathlib import Path

from hhsim.system.posix import READ_FLAGS

MOST_BYTES = 1 << 30
"""Size of the largest file that is read whole [byte]."""
ALWAYS, PER_BYTE = 1 << 28, 100
"""Largest size of what a packed file holds, unpacked [byte]: so many, and so many more for each byte of the file."""
LFS_POINTER = b"version https://git-lfs.github.com/spec/v1"
"""Beginning of the pointer in the place of a file that Git LFS has not fetched."""

_PIPE, _DEVICE, _SOCKET = "a named pipe", "a device", "a socket"
_KINDS = {stat.S_IFIFO: _PIPE, stat.S_IFCHR: _DEVICE, stat.S_IFBLK: _DEVICE, stat.S_IFSOCK: _SOCKET}

_STARTS: tuple[tuple[bytes, str], ...] = (
    (b"\x89PNG\r\n\x1a\n", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"GIF8", "a picture (GIF)"),
    (b"II*\x00", "a picture (TIFF)"),
    (b"MM\x00*", "a picture (TIFF)"),
    (b"<svg", "a picture (SVG)"),
    (b"\x1aE\xdf\xa3", "a video (Matroska or WebM)"),
    (b"OggS", "a sound or a video (Ogg)"),
    (b"ID3", "a sound (MP3)"),
    (b"%PDF-", "a document (PDF)"),
    (b"<!DOCTYPE html", "a page (HTML)"),
    (b"<!doctype html", "a page (HTML)"),
)
_IN_RIFF = {b"WEBP": "a picture (WebP)", b"AVI ": "a video (AVI)", b"WAVE": "a sound (WAV)"}
_HEAD_BYTES = 16


def check_ordinary(path: Path, most: int = MOST_BYTES) -> None:
    """Raise OSError, whose `strerror` has the reason, for no ordinary file, too many bytes, or a Git LFS pointer.

    A pipe or a device may block for ever. A folder passes.
    """
    _check(path, path.stat(), most)
    if path.is_file() and path.stat().st_size < 1024:
        with path.open("rb") as file:
            if file.read(len(LFS_POINTER)) == LFS_POINTER:
                raise OSError(errno.EINVAL, "a Git LFS pointer: git lfs pull fetches the file", str(path))


def _check(path: Path, state: os.stat_result, most: int) -> None:
    if name := _KINDS.get(stat.S_IFMT(state.st_mode)):
        raise OSError(errno.EINVAL, f"{name}, no ordinary file", str(path))
    if stat.S_ISREG(state.st_mode) and state.st_size > most:
        raise OSError(errno.EFBIG, f"{state.st_size:,} bytes, more than such a file has", str(path))


def file_state(path: Path) -> tuple[Path, int, int, int, int]:
    """Return what identifies a file's content: path, size, times of change [ns], the second unforgeable, and inode."""
    found = path.stat()
    return path.resolve(), found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino


def open_input(path: Path, most: int = sys.maxsize) -> io.BufferedReader:
    """Open an ordinary file for reading; raise OSError as `check_ordinary`, or if it cannot be opened."""
    check_ordinary(path, most)
    # Something else may take the file's place between the look and the opening.
    descriptor = os.open(path, READ_FLAGS)
    try:
        _check(path, os.fstat(descriptor), most)
        return os.fdopen(descriptor, "rb")
    except OSError:
        os.close(descriptor)
        raise


def read_input(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return the bytes of an ordinary file; raise OSError as `open_input`."""
    with open_input(path, most) as file:
        return file.read()


def read_input_text(path: Path, encoding: str = "utf-8", errors: str = "strict", most: int = MOST_BYTES) -> str:
    """Return the text of an ordinary file, lines ended by a newline; OSError as `open_input`, or UnicodeDecodeError."""
    with io.TextIOWrapper(open_input(path, most), encoding, errors) as file:
        return file.read()


def most_unpacked(size: int) -> int:
    """Return the largest size [byte] that the content of a packed file of so many bytes may have."""
    return ALWAYS + PER_BYTE * size


def media_kind(head: bytes) -> str:
    """Return what a file with these first bytes is, as "a picture (PNG)"; "" for none of them."""
    if head[:4] == b"RIFF":
        return _IN_RIFF.get(head[8:12], "")
    if head[4:8] == b"ftyp":
        # HEIF and AVIF are pictures in the same box as films.
        return "a picture (HEIF)" if head[8:12] in (b"heic", b"heix", b"mif1", b"avif") else "a video (MP4)"
    return next((kind for start, kind in _STARTS if head.startswith(start)), "")


def media_kind_of(path: Path) -> str:
    """Return the kind of a file; "" if it cannot be read."""
    try:
        with open_input(path) as file:
            return media_kind(file.read(_HEAD_BYTES))
    except OSError:
        return ""
