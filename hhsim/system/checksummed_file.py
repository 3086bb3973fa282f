"""Sealed files: a line behind the content holds its SHA-256, so that damage is noticed.

HDF5 hardly checks its data, and its library can run for ever on a few wrong bytes. It ignores bytes behind the end of
a file, and so does every program that uses it; one that changes the file removes the seal.
"""

import hashlib
from pathlib import Path

MARK = b"\nhhsim-sha256 "
SIZE = len(MARK) + 64 + 1
_PIECE = 1 << 20


def sealed(content: bytes) -> bytes:
    """Return the content followed by its seal."""
    return content + _seal(hashlib.sha256(content).hexdigest())


def seal_file(path: Path, size: int) -> None:
    """Seal the first `size` bytes of a file, and cut off the rest; raise OSError if it cannot be written."""
    seal = _seal(_digest(path, size))
    with path.open("r+b") as file:
        # Written before the rest is cut off: on a full disk, space that the file has already is space for the seal.
        file.seek(size)
        file.write(seal)
        file.truncate()


def seal_holds(path: Path) -> bool | None:
    """Return True if the seal is that of the bytes before it, None without a seal; OSError if it cannot be read."""
    size = path.stat().st_size - SIZE
    if size < 0:
        return None
    with path.open("rb") as file:
        file.seek(size)
        seal = file.read(SIZE)
    if not seal.startswith(MARK):
        return None
    return _seal(_digest(path, size)) == seal


def _seal(digest: str) -> bytes:
    return MARK + digest.encode() + b"\n"


def _digest(path: Path, size: int) -> str:
    """Return the SHA-256 of the first `size` bytes, read in pieces that fit into memory."""
    digest, left = hashlib.sha256(), size
    with path.open("rb") as file:
        while left > 0 and (piece := file.read(min(left, _PIECE))):
            digest.update(piece)
            left -= len(piece)
    return digest.hexdigest()
