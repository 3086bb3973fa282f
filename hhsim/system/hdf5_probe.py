"""Reader of an HDF5 file from end to end in a child process, to see whether that ends.

Every object, attribute and value is visited once, within limits of processor time and memory. The child is a fork of
this process: h5py is loaded already, so that a small file costs milliseconds.
"""

import faulthandler
import gc
import os
import resource
import signal
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"
MEMORY = 4 << 30
"""Address space that reading a file may add to the process [byte]."""
PIECE = 1 << 24
"""Most bytes that are read at a time."""
ALWAYS, PER_BYTE = 1 << 28, 100
"""Largest stated size of all datasets [byte]: so many, and so many more for each byte of the file."""

_SOUND, _BUSY, _UNSOUND = 0, 3, 4
_ENDLESS = (signal.SIGXCPU, signal.SIGALRM)


def probe(path: Path, size: int, seconds: int, patience: float) -> str:
    """Read a file to its end in a child process, and describe its fault; "" for none.

    Args:
        size: Bytes of the file that are HDF5: all but a seal.
        seconds: Limit of processor time.
        patience: Limit of wall-clock time [s].

    Raises:
        BlockingIOError: Another process is writing it.
    """
    with warnings.catch_warnings():
        # Python warns of threads, whose locks a child may find held: this one takes that of h5py, which is made for it.
        warnings.simplefilter("ignore", DeprecationWarning)
        told, tell = os.pipe()
        child = os.fork()
    if child == 0:
        _be_the_child(path, size, seconds, patience, tell)
    os.close(tell)
    try:
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        os.set_blocking(told, False)
        reason = os.read(told, 1000).decode(errors="replace") if code == _UNSOUND else ""
    except BaseException:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise
    finally:
        os.close(told)
    if code == _BUSY:
        raise BlockingIOError("another process is writing it")
    if -code in _ENDLESS:
        return f"a damaged file: reading it does not end within {seconds} s"
    if code == _UNSOUND:
        return f"a damaged HDF5 file: {reason}"
    return "" if code == _SOUND else "a damaged file: the HDF5 library breaks down over it"


def _be_the_child(path: Path, size: int, seconds: int, patience: float, tell: int) -> None:
    """Read the file, report its fault, and exit; the library's own output is discarded."""
    code = 1
    try:
        # What the parent has left to be collected is the parent's: folders to be removed, files to be closed.
        gc.disable()
        faulthandler.disable()
        for number in (signal.SIGINT, signal.SIGTERM, *_ENDLESS):
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        signal.setitimer(signal.ITIMER_REAL, patience)
        _limit(resource.RLIMIT_CORE, 0)
        _limit(resource.RLIMIT_CPU, seconds)
        _limit(resource.RLIMIT_AS, _address_space() + MEMORY)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        read_to_end(path, size)
        code = _SOUND
    except BlockingIOError:
        code = _BUSY
    except Exception as error:
        # Whatever h5py raises over wrong bytes: it has no list of them.
        code = _UNSOUND
        os.write(tell, (str(error).splitlines() or [type(error).__name__])[0][:120].encode(errors="replace"))
    finally:
        os._exit(code)


def _limit(what: int, value: int) -> None:
    most = resource.getrlimit(what)[1]
    resource.setrlimit(what, (value if most == resource.RLIM_INFINITY else min(value, most), most))


def _address_space() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    return pages * resource.getpagesize()


def read_to_end(path: Path, size: int) -> None:
    """Visit every object, attribute and value of a file of so many bytes, without limits.

    Raises:
        ValueError: It states more than such a file holds, or there are bytes behind its end; errors of h5py pass.
    """
    left = ALWAYS + PER_BYTE * size
    with h5py.File(path, "r") as file:
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
    if dataset.shape is None or not dataset.shape:
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
