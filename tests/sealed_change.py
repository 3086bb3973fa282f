"""A change of a sealed file, sealed anew; a file that h5py has just written is opened without a child's reading it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from hhsim.system import hdf5_input
from hhsim.system.checksummed_file import seal_file


@contextmanager
def changed(path: Path) -> Iterator[h5py.File]:
    """The file, open to be changed; it is sealed when the block ends."""
    with h5py.File(path, "r+") as file:
        yield file
    seal_file(path, path.stat().st_size)
    know_as_sound(path)


def know_as_sound(path: Path) -> None:
    """Have this process take a file as read by a child: to fork a process that holds all tests takes long."""
    # A file that was changed a moment ago is hashed again for each column that is read of it.
    os.utime(path, (0.0, 0.0))
    hdf5_input._KNOWN[hdf5_input.file_state(path)] = ""
