"""A change of a sealed file, sealed anew: one without a seal is read by a child process before it is opened."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from hhsim.system.checksummed_file import seal_file


@contextmanager
def changed(path: Path) -> Iterator[h5py.File]:
    """The file, open to be changed; it is sealed when the block ends."""
    with h5py.File(path, "r+") as file:
        yield file
    seal_file(path, path.stat().st_size)
    # A file that was changed a moment ago is hashed again for each column that is read of it.
    os.utime(path, (0.0, 0.0))
