"""Silence around compiled code that prints when it is loaded, whoever reads the output."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def silent() -> Iterator[None]:
    """Keep what is printed off the terminal, also by compiled code, until the block ends."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
        # Its own buffer would be written out later.
        ctypes.CDLL(None).fflush(None)
    finally:
        for place, was in zip((1, 2), kept):
            os.dup2(was, place)
            os.close(was)
        os.close(nowhere)
