"""Key strokes from the terminal, whose settings are restored on every way out."""

import os
import re
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress


@contextmanager
def terminal_keys() -> Iterator[Callable[[], str | None] | None]:
    """Read each key of stdin at once, without echo; yields None if stdin is not our terminal.

    What it yields returns the keys pressed since the last call, "" for none; None if the terminal is gone. Ctrl-C,
    Ctrl-Z and Ctrl-backslash stay signals. The settings are restored when the block is left, by whatever error or exit.
    """
    found = _terminal()
    if found is None:
        yield None
        return
    import termios
    import tty

    descriptor, before = found
    try:
        tty.setcbreak(descriptor, termios.TCSANOW)
        yield lambda: _keys(descriptor)
    finally:
        # A terminal that is gone cannot be restored.
        with suppress(termios.error, OSError):
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _terminal() -> "tuple[int, list[int | list[bytes | int]]] | None":
    """Return descriptor and settings of stdin if it is a terminal and we are in its foreground."""
    with suppress(ImportError, OSError, ValueError):
        import termios

        descriptor = sys.stdin.fileno()
        if os.isatty(descriptor) and os.tcgetpgrp(descriptor) == os.getpgrp():
            with suppress(termios.error):
                return descriptor, termios.tcgetattr(descriptor)
    return None


def _keys(descriptor: int) -> str | None:
    found = b""
    try:
        while select.select([descriptor], [], [], 0.0)[0]:
            found += (more := os.read(descriptor, 256))
            if not more:
                return None
    except OSError:
        return None
    # Without the sequences of arrow and function keys, which begin with Escape.
    return re.sub(r"\x1b[\[O][^@-~]*[@-~]?", "", found.decode("utf-8", "replace"))
