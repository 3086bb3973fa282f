"""Ctrl-C where it does no harm.

Python raises KeyboardInterrupt wherever it happens to be: halfway into a write, or in a weak reference's callback,
where it is swallowed and the run goes on. A long run therefore only takes note of the first Ctrl-C, and stops between
two blocks.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interruptible_between() -> Iterator[Callable[[], None]]:
    """Hold Ctrl-C back until the function that this yields is called, which then raises KeyboardInterrupt.

    A second Ctrl-C raises at once. Outside of the main thread, where no signal arrives, and where Ctrl-C is ignored or
    another handler is installed, nothing changes.
    """
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield lambda: None
        return
    noted = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal noted
        if noted:
            raise KeyboardInterrupt
        noted = True

    def check() -> None:
        if noted:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
