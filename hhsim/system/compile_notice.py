"""Notice that kernels have to be compiled, which explains the wait."""

import functools
import logging
from collections.abc import Callable

from numba.core import event

from hhsim.kernels.callee import Kernel

COMPILING = "hhsim: compiling the kernels that this needs: once, and again after an upgrade"


class _FirstCompilation(event.Listener):  # type: ignore[misc]
    """Listener that calls `tell` at the first compilation; a kernel from the cache makes no event."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, begun: event.Event) -> None:
        if self._tell is not None and isinstance(begun.data["dispatcher"], Kernel):
            tell, self._tell = self._tell, None
            tell()

    def on_end(self, done: event.Event) -> None:
        pass


def tell_of_compilation(tell: Callable[[], None]) -> Callable[[], None]:
    """Call `tell` when the first kernel is compiled from here on; return a function that ends that."""
    listener = _FirstCompilation(tell)
    event.register("numba:compile", listener)
    return functools.partial(event.unregister, "numba:compile", listener)


@functools.cache
def log_compilation() -> None:
    """Log a warning when this process first compiles a kernel; Python prints it on stderr."""
    tell_of_compilation(functools.partial(logging.getLogger("hhsim").warning, COMPILING))
