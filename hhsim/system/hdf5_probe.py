"""Reads an HDF5 file from end to end, to see whether that ends: run as a script, in a process of its own.

`python hdf5_probe.py FILE SECONDS` visits every object, attribute and value once, within limits of processor time and
memory. It imports nothing of hhsim, so that it starts in a fraction of a second.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

SIGNATURE = b"\x89HDF\r\n\x1a\n"
SOUND, BUSY, UNSOUND = 0, 3, 4
"""Exit codes; with `UNSOUND`, stdout says why. Any other is the library's breakdown."""
MEMORY = 4 << 30
"""Address space of the process [bytes]."""
PIECE = 1 << 24
"""Most bytes that are read at a time."""
ALWAYS, PER_BYTE = 1 << 28, 100
"""A dataset states at most so many bytes, and so many more for each byte of the file."""


class UnsoundError(Exception):
    """A file that HDF5 reads and that nevertheless cannot be right."""


def main(path: Path, seconds: int) -> int:
    """Read a file and say what is wrong with it.

    Args:
        seconds: Of processor time that this may take.

    Returns:
        The exit code.
    """
    import resource

    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    return judge(path)


def judge(path: Path) -> int:
    """Read a file and print what is wrong with it, without limits; returns the exit code."""
    try:
        _read(path)
    except BlockingIOError:
        return BUSY
    except Exception as error:
        # Whatever h5py raises over wrong bytes: it has no list of them.
        print((str(error).splitlines() or [type(error).__name__])[0][:120])
        return UNSOUND
    return SOUND


def _read(path: Path) -> None:
    import h5py

    most = ALWAYS + PER_BYTE * path.stat().st_size
    with h5py.File(path, "r") as file:
        objects: list[Any] = [file]
        file.visititems(lambda _, item: objects.append(item))
        for item in objects:
            dict(item.attrs)
            if isinstance(item, h5py.Dataset):
                if item.nbytes > most:
                    raise UnsoundError(f"{item.name} states {item.nbytes:,} bytes, more than such a file holds")
                for part in _pieces(item):
                    item[part]
        stopped = not file.attrs.get("complete", 1)
    # A run that was killed may have begun to write what it had no time to count in.
    end = stated_end(path)
    if not stopped and end is not None and path.stat().st_size > end:
        raise UnsoundError("bytes behind its end, which are no seal")


def _pieces(dataset: Any) -> Iterator[Any]:
    """Parts of a dataset, along its first axis."""
    if dataset.shape is None or not dataset.shape:
        yield ()
        return
    rows = max(1, PIECE * dataset.shape[0] // max(dataset.nbytes, 1))
    for first in range(0, dataset.shape[0], rows):
        yield slice(first, first + rows)


def stated_end(path: Path) -> int | None:
    """How many bytes a file says that it has; None where its head is of no kind that is known here."""
    with path.open("rb") as file:
        head = file.read(52)
    # Of a superblock of version 0, 1, and 2 or 3: where the address of the end stands.
    place = {0: 40, 1: 44, 2: 28, 3: 28}.get(head[8] if len(head) == 52 else -1)
    if place is None or not head.startswith(SIGNATURE):
        return None
    return int.from_bytes(head[place : place + 8], "little")


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2])))
