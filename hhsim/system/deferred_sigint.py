"""Deferred Ctrl-C.

Python raises KeyboardInterrupt at any instruction: within a write, or in a weak reference's callback, where it is
lost. A long run only notes the first Ctrl-C, and stops between two blocks.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_noted = False


@contextmanager
def interruptible_between() -> Iterator[Callable[[], None]]:
    """Hold Ctrl-C back until the function that this yields is called, which then raises KeyboardInterrupt.

    A second Ctrl-C raises at once. Nothing changes outside of the main thread, where no signal arrives, or if Ctrl-C is
    ignored or has another handler.
    """
    if not _is_usual():
        yield lambda: None
        return

    def check() -> None:
        if _noted:
            raise KeyboardInterrupt

    with _handled(raises=False):
        yield check


@contextmanager
def watched_sigint() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns True if Ctrl-C was pressed, which still raises KeyboardInterrupt.

    It distinguishes Ctrl-C from a KeyboardInterrupt that code raises by itself.
    """
    if not _is_usual():
        yield interrupt_is_noted
        return
    with _handled(raises=True):
        yield interrupt_is_noted


def interrupt_is_noted() -> bool:
    """Return True if Ctrl-C was pressed and has been held back since."""
    return _noted


def _is_usual() -> bool:
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler


@contextmanager
def _handled(*, raises: bool) -> Iterator[None]:
    """Note Ctrl-C, and raise it if `raises`, or at the second one."""
    global _noted

    def handler(number: int, frame: FrameType | None) -> None:
        global _noted
        is_second, _noted = _noted, True
        if raises or is_second:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _noted = False
