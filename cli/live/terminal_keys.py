"""Single key strokes from the terminal, and the terminal as it was on every way out."""

import atexit
import os
import re
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

ReadKeys = Callable[[], "str | None"]
"""Returns the keys pressed since it was last called, "" for none; None when the terminal is gone."""


@contextmanager
def terminal_keys() -> Iterator[ReadKeys | None]:
    """Let stdin hand on each key at once, without showing it; yields None where stdin is no terminal of ours.

    Ctrl-C, Ctrl-Z and Ctrl-backslash stay signals. The terminal is set back when the block is left, by whatever error
    or exit, and once more when the interpreter ends.
    """
    found = _terminal()
    if found is None:
        yield None
        return
    import termios
    import tty

    descriptor, before = found
    ours = os.getpid()

    def restore() -> None:
        # A terminal that has gone cannot be set back, and a child that was forked is not the one that changed it.
        if os.getpid() == ours:
            try:
                termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
            except (termios.error, OSError):
                return

    atexit.register(restore)
    try:
        tty.setcbreak(descriptor, termios.TCSANOW)
        yield lambda: _keys(descriptor)
    finally:
        restore()
        atexit.unregister(restore)


def _terminal() -> "tuple[int, list[int | list[bytes | int]]] | None":
    """Stdin's descriptor and settings, where it is a terminal and we are in its foreground."""
    try:
        import termios

        descriptor = sys.stdin.fileno()
        if not os.isatty(descriptor) or os.tcgetpgrp(descriptor) != os.getpgrp():
            return None
        return descriptor, termios.tcgetattr(descriptor)
    except (ImportError, OSError, ValueError):
        return None
    except termios.error:
        return None


def _keys(descriptor: int) -> str | None:
    found = b""
    try:
        while select.select([descriptor], [], [], 0.0)[0]:
            more = os.read(descriptor, 256)
            if not more:
                return None
            found += more
    except OSError:
        return None
    return _without_sequences(found.decode("utf-8", "replace"))


def _without_sequences(text: str) -> str:
    """Drop what arrow and function keys send (Escape, a bracket, a letter), so that none of them reads as Escape."""
    return re.sub(r"\x1b[\[O][^@-~]*[@-~]?", "", text)
