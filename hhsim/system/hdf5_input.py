"""The one door by which HDF5 files come in: none is parsed before a child process has read it to its end.

The HDF5 library can spin for ever, crash, or ask for all memory on a file with a few wrong bytes. A child with limits
of time and memory (`hhsim.system.hdf5_probe`) therefore reads each file first. The seal of a file
(`hhsim.system.checksummed_file`) is looked at before: it tells of accidents, and not of who sealed the file.
"""

import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from hhsim.errors import DamagedFileError
from hhsim.system import hdf5_probe
from hhsim.system.checksummed_file import SIZE, seal_holds
from hhsim.system.input_file import check_ordinary

DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, MemoryError, OverflowError)
"""What h5py raises on a file with wrong bytes in it."""
SECONDS = 3.0
"""What reading a small file may take of the processor's time; it takes milliseconds."""
PATIENCE = 10.0
"""By the wall clock it may take so many times more: where others have the processor, a sound file takes longer too."""
BYTES_PER_SECOND = 20e6
"""A larger file gets as much more time as it takes at this rate."""

BEYOND = 1e30
"""No number of a file of ours is as large, in any unit: what is larger was left by damage."""

_SETTLED_NS = 100_000_000
"""A file that was changed this recently may be changed again within one tick of its time stamp."""


class _State(NamedTuple):
    """What tells that a file is the one that was looked at."""

    path: Path
    size: int
    changed_ns: int
    number: int


_KNOWN: dict[_State, str] = {}
"""What is wrong with files that were looked at; "" for nothing."""


def read_numbers(dataset: h5py.Dataset, rows: Any = ...) -> NDArray[Any]:
    """Read rows of a dataset.

    Raises:
        DamagedFileError: A number beyond `BEYOND`, of which squares and sums would be none.
    """
    values = np.asarray(dataset[rows])
    if values.dtype.kind == "f":
        wild = (np.abs(values) > BEYOND) & np.isfinite(values)
        if wild.any():
            raise DamagedFileError(f"damaged: {dataset.name} holds {values[wild].flat[0]:.3g}, beyond {BEYOND:g}")
    return values


def open_hdf5(path: Path) -> h5py.File:
    """Open a file for reading, once it is known that the library gets through it.

    Raises:
        DamagedFileError: No ordinary file; its bytes are not those that were sealed, or it cannot be read to its end.
        BlockingIOError: Another process is writing it.
        OSError: No HDF5 file, or one that cannot be opened.
    """
    try:
        check_ordinary(path, most=sys.maxsize)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise DamagedFileError(f"cannot be read: {error.strerror}") from None
    state = _state(path)
    fault = _KNOWN.get(state)
    if fault is None:
        fault = _fault(path)
        if time.time_ns() - state.changed_ns > _SETTLED_NS and _state(path) == state:
            _KNOWN[state] = fault
    if fault:
        raise DamagedFileError(fault)
    return h5py.File(path, "r")


def hdf5_format(path: Path) -> str:
    """What a file's attribute `format` says; "" where it says nothing, or is no sound HDF5 file.

    Raises:
        BlockingIOError: Another process is writing it.
    """
    try:
        with open_hdf5(path) as file:
            found = file.attrs.get("format")
    except BlockingIOError:
        raise
    except (DamagedFileError, *DAMAGE):
        return ""
    return found if isinstance(found, str) else ""


def _state(path: Path) -> _State:
    found = path.stat()
    return _State(path.resolve(), found.st_size, found.st_mtime_ns, found.st_ino)


def _fault(path: Path) -> str:
    """What is wrong with a file; "" for nothing."""
    size = path.stat().st_size
    holds = seal_holds(path)
    if holds is False:
        return "a damaged file: its bytes are not those that its checksum is of"
    if holds:
        size -= SIZE
    if not _is_signed(path):
        raise OSError("no HDF5 file: its signature is not there")
    end = hdf5_probe.stated_end(path)
    if end is not None and size < end:
        return f"a damaged HDF5 file: cut short, {size:,} of {end:,} bytes are there"
    seconds = int(SECONDS + size / BYTES_PER_SECOND) + 1
    try:
        hdf5_probe.probe(path, size, seconds, PATIENCE * seconds)
    except hdf5_probe.UnsoundError as error:
        return f"a damaged HDF5 file: {error}"
    except hdf5_probe.EndlessError:
        return f"a damaged file: reading it does not end within {seconds} s"
    except hdf5_probe.BreakdownError:
        return "a damaged file: the HDF5 library breaks down over it"
    return ""


def _is_signed(path: Path) -> bool:
    """Whether the signature stands where HDF5 looks for it: at 0, 512, 1,024, 2,048 and so on."""
    size, place = path.stat().st_size, 0
    with path.open("rb") as file:
        while place + len(hdf5_probe.SIGNATURE) <= size:
            file.seek(place)
            if file.read(len(hdf5_probe.SIGNATURE)) == hdf5_probe.SIGNATURE:
                return True
            place = max(512, 2 * place)
    return False
