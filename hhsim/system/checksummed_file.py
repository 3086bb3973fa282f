"""Files whose bytes are sealed: one line behind the content holds its SHA-256, so that damage is noticed.

HDF5 hardly checks its data, and its library can run for ever on a file with a few wrong bytes. What stands behind the
end of an HDF5 file it ignores, and so does every program that uses it; one that changes the file cuts the seal off.
"""

import hashlib
from pathlib import Path

MARK = b"\nhhsim-sha256 "
SIZE = len(MARK) + 64 + 1
_PIECE = 1 << 20


def sealed(content: bytes) -> bytes:
    """The content with its seal behind it."""
    return content + _seal(hashlib.sha256(content).hexdigest())


def seal_file(path: Path, size: int) -> None:
    """Seal the first `size` bytes of a file; what stands behind them makes room for the seal.

    Raises:
        OSError: The file cannot be read or written.
    """
    seal = _seal(_digest(path, size))
    with path.open("r+b") as file:
        # Written before the rest is cut off: on a full disk, space that the file has already is space for the seal.
        file.seek(size)
        file.write(seal)
        file.truncate()


def seal_holds(path: Path) -> bool | None:
    """Whether the bytes before the seal are those that were sealed; None where no seal ends the file.

    Raises:
        OSError: The file cannot be read.
    """
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
    """SHA-256 of the first `size` bytes, piece by piece: a long session does not fit into memory."""
    digest, left = hashlib.sha256(), size
    with path.open("rb") as file:
        while left > 0 and (piece := file.read(min(left, _PIECE))):
            digest.update(piece)
            left -= len(piece)
    return digest.hexdigest()
