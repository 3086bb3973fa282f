"""Deferred Ctrl-C.

Python raises KeyboardInterrupt at any instruction: within a write, or in a weak reference's callback, where it is
lost. A long run only notes the first Ctrl-C, and stops between two blocks.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interruptible_between() -> Iterator[Callable[[], None]]:
    """Hold Ctrl-C back until the function that this yields is called, which then raises KeyboardInterrupt.

    A second Ctrl-C raises at once. Nothing changes outside of the main thread, where no signal arrives, or if Ctrl-C is
    ignored or has another handler.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield lambda: None
        return

    noted = False

    def handler(number: int, frame: FrameType | None) -> None:
        nonlocal noted
        is_second, noted = noted, True
        if is_second:
            raise KeyboardInterrupt

    def check() -> None:
        if noted:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, handler)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
