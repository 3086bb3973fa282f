"""Signals that end a session, recorded and never raised: it has to end in order, or the fingers stay held."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

WORDS = {
    "SIGINT": "Ctrl-C",
    "SIGTERM": "SIGTERM",
    "SIGHUP": "the terminal is gone",
    # A suspended session would leave the hand in the glove with nobody to watch over it.
    "SIGTSTP": "Ctrl-Z, which ends a live session",
    "SIGQUIT": "Ctrl-backslash",
}
NOT_BY_THE_USER = {WORDS[number.name]: int(number) for number in (signal.SIGTERM, signal.SIGHUP)}
"""Signals that come from another program or from a lost terminal, by their words."""


@contextmanager
def stop_signals() -> Iterator[Callable[[], str]]:
    """Record every signal that ends a session while the block runs; yields a function that returns the first in words.

    A signal that is ignored already (nohup) stays ignored. Outside of the main thread nothing is recorded: "".
    """
    received: list[str] = []

    def note(number: int, frame: FrameType | None) -> None:
        received.append(WORDS[signal.Signals(number).name])

    before = {}
    if threading.current_thread() is threading.main_thread():
        for name in WORDS:
            number = signal.Signals[name]
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, note)
    try:
        yield lambda: received[0] if received else ""
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
