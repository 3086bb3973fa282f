"""Safe opening of HDF5 files: none is parsed before a child process has read it to its end.

The HDF5 library can spin for ever, crash, or ask for all memory on a file with a few wrong bytes. A child with limits
of time and memory (`hhsim.system.hdf5_probe`) therefore reads each file first. The seal
(`hhsim.system.checksummed_file`) is checked before that: it shows accidents, and does not authenticate.
"""

import sys
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from hhsim.errors import DamagedFileError
from hhsim.system import hdf5_probe
from hhsim.system.checksummed_file import SIZE, seal_holds
from hhsim.system.input_file import check_ordinary

DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, MemoryError, OverflowError)
"""Errors of h5py for a file with wrong bytes."""
SECONDS = 3.0
"""Processor time for reading a small file [s]; it takes milliseconds."""
PATIENCE = 10.0
"""Ratio of wall-clock limit to processor time, for a busy machine."""
BYTES_PER_SECOND = 20e6
"""Rate of the additional time for a larger file [byte/s]."""

BEYOND = 1e30
"""Largest number in a file of ours, in any unit; larger ones are damage."""

_SETTLED_NS = 100_000_000
"""Age of a change [ns] below which the file may change again within one tick of its time stamp."""


_KNOWN: dict[tuple[Path, int, int, int], str] = {}
"""Fault of each file that was checked; "" for none."""


def read_numbers(dataset: h5py.Dataset, rows: Any = ...) -> NDArray[Any]:
    """Read rows of a dataset; raise DamagedFileError for a number beyond `BEYOND`."""
    values = np.asarray(dataset[rows])
    if values.dtype.kind == "f":
        wild = (np.abs(values) > BEYOND) & np.isfinite(values)
        if wild.any():
            raise DamagedFileError(f"damaged: {dataset.name} holds {values[wild].flat[0]:.3g}, beyond {BEYOND:g}")
    return values


def open_hdf5(path: Path) -> h5py.File:
    """Open a file for reading after a child process has read it.

    Raises:
        DamagedFileError: No ordinary file, other bytes than were sealed, or one that cannot be read to its end.
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
        if time.time_ns() - state[2] > _SETTLED_NS and _state(path) == state:
            _KNOWN[state] = fault
    if fault:
        raise DamagedFileError(fault)
    return h5py.File(path, "r")


def hdf5_format(path: Path) -> str:
    """Return a file's attribute `format`; "" if there is none, or for no sound HDF5 file.

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


def _state(path: Path) -> tuple[Path, int, int, int]:
    """Return what identifies a file's content: path, size, time of the last change [ns] and inode."""
    found = path.stat()
    return path.resolve(), found.st_size, found.st_mtime_ns, found.st_ino


def _fault(path: Path) -> str:
    """Describe the fault of a file; "" for none."""
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
    return hdf5_probe.probe(path, size, seconds, PATIENCE * seconds)


def _is_signed(path: Path) -> bool:
    """Return True if there is a signature where HDF5 looks for it: at 0, 512, 1,024, 2,048 and so on."""
    size, place = path.stat().st_size, 0
    with path.open("rb") as file:
        while place + len(hdf5_probe.SIGNATURE) <= size:
            file.seek(place)
            if file.read(len(hdf5_probe.SIGNATURE)) == hdf5_probe.SIGNATURE:
                return True
            place = max(512, 2 * place)
    return False
