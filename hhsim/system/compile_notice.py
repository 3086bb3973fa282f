"""Notice that kernels have to be compiled, which explains the wait."""

import functools
import logging
from collections.abc import Callable

from numba.core import event

from hhsim.kernels.callee import Kernel
from hhsim.kernels.kernel_cache import TURNS

COMPILING = "hhsim: compiling the kernels that this needs: once, and again after an upgrade"


class _FirstCompilation(event.Listener):  # type: ignore[misc]
    """Listener that calls `tell` at the first compilation, or wait for another process's; loading makes no event."""

    def __init__(self) -> None:
        self.tell: Callable[[], None] | None = None

    def on_start(self, begun: event.Event) -> None:
        if isinstance(begun.data["dispatcher"], Kernel):
            self.on_wait()

    def on_end(self, done: event.Event) -> None:
        pass

    def on_wait(self) -> None:
        """Take it that a kernel is not there yet."""
        if self.tell is not None:
            tell, self.tell = self.tell, None
            tell()


@functools.cache
def _listener() -> _FirstCompilation:
    listener = _FirstCompilation()
    event.register("numba:compile", listener)
    TURNS.on_wait = listener.on_wait
    return listener


def tell_of_compilation(tell: Callable[[], None]) -> Callable[[], None]:
    """Call `tell`, and nobody who asked before, when the next kernel is compiled; return a function that ends that."""
    listener = _listener()
    listener.tell = tell

    def end() -> None:
        if listener.tell is tell:
            listener.tell = None

    return end


@functools.cache
def log_compilation() -> None:
    """Log a warning when this process first compiles a kernel; Python prints it on stderr."""
    tell_of_compilation(functools.partial(logging.getLogger("hhsim").warning, COMPILING))
