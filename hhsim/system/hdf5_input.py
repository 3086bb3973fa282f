"""Safe opening of HDF5 files: none is parsed before a child process has read it to its end.

The HDF5 library can spin for ever, crash, or ask for all memory on a file with a few wrong bytes. A child with limits
of time and memory therefore reads each file first (`hhsim.system.child_reader`). Nor may a file bring in the content of
others: what refers to them is refused before it is followed. The seal (`hhsim.system.checksummed_file`) is checked
before that: it shows accidents, and does not authenticate.
"""

import errno
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from hhsim.errors import DamagedFileError
from hhsim.system.checksummed_file import SIZE, seal_holds
from hhsim.system.child_reader import read_in_child
from hhsim.system.input_file import check_ordinary, file_state, most_unpacked

DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, MemoryError, OverflowError)
"""Errors of h5py for a file with wrong bytes."""
SECONDS = 3.0
"""Processor time for reading a small file [s]; it takes milliseconds."""
BYTES_PER_SECOND = 20e6
"""Rate of the additional time for a larger file [byte/s]."""

BEYOND = 1e30
"""Largest number in a file of ours, in any unit; larger ones are damage."""

_SETTLED_NS = 100_000_000
"""Age of a change [ns] below which the file may change again within one tick of its time stamp."""
_KNOWN: dict[tuple[Path, int, int, int, int], str] = {}
"""Fault of each file that was checked; "" for none."""

SIGNATURE = b"\x89HDF\r\n\x1a\n"
PIECE = 1 << 24
"""Most bytes that are read at a time."""


def read_numbers(dataset: h5py.Dataset, rows: Any = ...) -> NDArray[Any]:
    """Read rows of a dataset; raise DamagedFileError for a number beyond `BEYOND`."""
    values = np.asarray(dataset[rows])
    if values.dtype.kind == "f":
        wild = (np.abs(values) > BEYOND) & np.isfinite(values)
        if wild.any():
            raise DamagedFileError(f"damaged: {dataset.name} holds {values[wild].flat[0]:.3g}, beyond {BEYOND:g}")
    return values


def open_hdf5(path: Path, shipped: bool = False) -> h5py.File:
    """Open a file for reading after a child process has read it; none reads a `shipped` one whose checksum holds.

    Raises DamagedFileError for no ordinary file, other bytes than were sealed, or one that cannot be read to its end;
    BlockingIOError if another process is writing it; OSError for no HDF5 file, or one that cannot be opened.
    """
    try:
        check_ordinary(path, most=sys.maxsize)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise DamagedFileError(f"cannot be read: {error.strerror}") from None
    state = file_state(path)
    fault = _KNOWN.get(state)
    if fault is None:
        fault = "" if shipped and seal_holds(path) else _fault(path)
        if time.time_ns() - state[2] > _SETTLED_NS and file_state(path) == state:
            _KNOWN[state] = fault
    if fault:
        raise DamagedFileError(fault)
    try:
        return h5py.File(path, "r")
    except BlockingIOError:
        raise _written(path) from None


def _written(path: Path) -> BlockingIOError:
    """Return the error for a file that another process is writing; it names the file, which h5py's own does not."""
    return BlockingIOError(errno.EWOULDBLOCK, "another process is writing it", str(path))


def hdf5_format(path: Path) -> str:
    """Return a file's attribute `format`; "" without, or for no sound HDF5 file; BlockingIOError while written."""
    try:
        with open_hdf5(path) as file:
            found = file.attrs.get("format")
    except BlockingIOError:
        raise
    except (DamagedFileError, *DAMAGE):
        return ""
    return found if isinstance(found, str) else ""


def _fault(path: Path) -> str:
    """Describe the fault of a file, which a child process reads to its end; "" for none."""
    size = path.stat().st_size
    holds = seal_holds(path)
    if holds is False:
        return "a damaged file: its bytes are not those that its checksum is of"
    size -= SIZE if holds else 0
    if not h5py.is_hdf5(path):
        raise OSError("no HDF5 file: its signature is not there")
    end = stated_end(path)
    if end is not None and size < end:
        return f"a damaged HDF5 file: cut short, {size:,} of {end:,} bytes are there"
    try:
        read_in_child(
            lambda: read_to_end(path, size), "a damaged HDF5 file", size, seconds=SECONDS, rate=BYTES_PER_SECOND
        )
    except BlockingIOError:
        raise _written(path) from None
    except DamagedFileError as error:
        return str(error)
    return ""


def require_own_data(file: h5py.File) -> None:
    """Raise DamagedFileError for a link or a dataset that can bring in the content of another file, and follow none.

    Refused are external links and those of other kinds, soft links that leave their group, external raw storage and
    virtual datasets. hhsim writes none of them.
    """

    # An error that is raised in such a visit is lost: the visit returns what its function does.
    def of_link(name: bytes, link: Any) -> str | None:
        if link.type == h5py.h5l.TYPE_HARD:
            return None
        if link.type != h5py.h5l.TYPE_SOFT:
            return _spelled(name, "an external link" if link.type == h5py.h5l.TYPE_EXTERNAL else "an unknown link")
        # A path that begins with a slash begins at the root; none leads upwards.
        target, group = file.id.links.get_val(name), (b"/" + name).rpartition(b"/")[0] + b"/"
        leaves = target.startswith(b"/") and not target.startswith(group)
        return _spelled(name, "a soft link out of its group") if leaves else None

    def of_storage(name: str, item: Any) -> str | None:
        # Its shape is not looked at: of a virtual dataset the library would look for it in the other files.
        if not isinstance(item, h5py.Dataset) or not (item.is_virtual or item.external):
            return None
        return _spelled(name.encode(), "a virtual dataset" if item.is_virtual else "a dataset with external storage")

    if found := file.id.links.visit(of_link, info=True) or file.visititems(of_storage):
        raise DamagedFileError(f"{found}; expected a file that holds all of its data itself")


def _spelled(name: bytes, what: str) -> str:
    return f"{name.decode(errors='replace')!r} is {what}"


def read_to_end(path: Path, size: int) -> None:
    """Visit every object, attribute and value of a file of so many bytes, without limits; errors of h5py pass.

    DamagedFileError as `require_own_data`; ValueError where it states more than such a file holds, or for bytes behind
    its end.
    """
    left = most_unpacked(size)
    with h5py.File(path, "r") as file:
        require_own_data(file)
        objects: list[Any] = [file]
        file.visititems(lambda _, item: objects.append(item))
        for item in objects:
            dict(item.attrs)
            if isinstance(item, h5py.Dataset):
                left -= item.nbytes
                if left < 0:
                    raise ValueError(f"{item.name} states {item.nbytes:,} bytes, more than such a file holds")
                for part in _pieces(item):
                    item[part]
        stopped = not file.attrs.get("complete", 1)
    # A run that was killed may have begun to write what it had no time to count in.
    end = stated_end(path)
    if not stopped and end is not None and size > end:
        raise ValueError("bytes behind its end, which are no seal")


def _pieces(dataset: Any) -> Iterator[Any]:
    """Yield slices of a dataset along its first axis."""
    if not dataset.shape:
        yield ()
        return
    rows = max(1, PIECE * dataset.shape[0] // max(dataset.nbytes, 1))
    for first in range(0, dataset.shape[0], rows):
        yield slice(first, first + rows)


def stated_end(path: Path) -> int | None:
    """Return the size that a file states in its head [byte]; None for an unknown head."""
    with path.open("rb") as file:
        head = file.read(52)
    # Of a superblock of version 0, 1, and 2 or 3: where the address of the end stands.
    place = {0: 40, 1: 44, 2: 28, 3: 28}.get(head[8] if len(head) == 52 else -1)
    if place is None or not head.startswith(SIGNATURE):
        return None
    return int.from_bytes(head[place : place + 8], "little")
