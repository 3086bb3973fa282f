"""Files whose bytes are sealed: one line behind the content holds its SHA-256, so that damage is noticed.

HDF5 hardly checks its data, and its library can run for ever on a file with a few wrong bytes. What stands behind the
end of an HDF5 file it ignores, and so does every program that uses it.
"""

import hashlib

MARK = b"\nhhsim-sha256 "
SIZE = len(MARK) + 64 + 1


def sealed(content: bytes) -> bytes:
    """The content with its seal behind it."""
    return content + MARK + hashlib.sha256(content).hexdigest().encode() + b"\n"


def seal_holds(data: bytes) -> bool | None:
    """Whether the bytes before the seal are those that were sealed; None where there is no seal.

    A seal that is damaged itself, or cut off in part, is none.
    """
    content, mark, digest = data[:-SIZE], data[-SIZE : -SIZE + len(MARK)], data[-65:-1]
    if len(data) < SIZE or mark != MARK:
        # Of a file that lost or gained bytes the seal may still be there, elsewhere.
        return False if MARK in data else None
    return hashlib.sha256(content).hexdigest().encode() == digest
