"""Calls of code that is not hhsim's, such as a method from outside.

Its output goes to stderr, the current folder is restored after each call, and anything it raises, an exit of the
interpreter included, becomes one exception. This protects from accidents; malicious code needs a process of its own
(`hhsim.solver.isolated_method`).
"""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter_ns, process_time_ns
from typing import Any, NamedTuple

from hhsim.system.deferred_sigint import watched_sigint
from hhsim.system.posix import flush_c_output


class ForeignError(Exception):
    """Exception of foreign code, as "Type: message"; its `__cause__` is that exception."""


class Timed(NamedTuple):
    """Value that a call returned, and its wall and CPU time [ns]."""

    value: Any
    wall: int
    cpu: int


def foreign_call(function: Callable[..., Any], *given: Any) -> Timed:
    """Call foreign code and measure it by clocks that were bound before that code was imported.

    Raises ForeignError for any exception of the code, SystemExit and its own KeyboardInterrupt included;
    KeyboardInterrupt if Ctrl-C was pressed.
    """
    with _own_output(), watched_sigint() as is_pressed:
        try:
            cpu, wall = process_time_ns(), perf_counter_ns()
            value = function(*given)
            return Timed(value, perf_counter_ns() - wall, process_time_ns() - cpu)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt) and is_pressed():
                raise
            raise ForeignError(f"{type(error).__name__}: {error}") from error


@contextmanager
def _own_output() -> Iterator[None]:
    """Redirect output to stderr, that of compiled code too, and restore the current folder at the end."""
    folder, shown = Path.cwd(), sys.stdout
    for stream in (shown, sys.__stdout__):
        if stream is not None:
            stream.flush()
    descriptor = os.dup(1)
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    try:
        yield
    finally:
        if sys.__stdout__ is not None:
            sys.__stdout__.flush()
        flush_c_output()
        os.dup2(descriptor, 1)
        os.close(descriptor)
        sys.stdout = shown
        os.chdir(folder)
