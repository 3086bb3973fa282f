"""Terminal kept free of what compiled libraries print."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from hhsim.system.posix import flush_c_output


@contextmanager
def silent() -> Iterator[None]:
    """Keep what compiled code prints off the terminal until the block ends."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
        # The C library's own buffer would be written out later.
        flush_c_output()
    finally:
        for place, was in zip((1, 2), kept):
            os.dup2(was, place)
            os.close(was)
        os.close(nowhere)
