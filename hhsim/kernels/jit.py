"""The one jit factory of the kernels.

A `generic` kernel has one implementation for each type of its first argument: so does a tick know its method, and
detection the surface, and only what a run uses is compiled.
"""

import functools
import importlib
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias, TypeVar, cast

import numba
import numpy as np
from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global
from numpy.typing import ArrayLike, NDArray

from hhsim.kernels.callee import Kernel
from hhsim.kernels.kernel_cache import implementing_kernels, source_of

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]

Record: TypeAlias = Any
"""One record of a structured array; its fields are read and written as attributes."""

as_int64 = cast(Callable[[int], int], np.int64)
"""Takes an integer literal to a plain integer, so that numba does not compile a callee once more for it."""

as_bool = cast(Callable[[bool], bool], np.bool_)
"""The same for a truth value."""


def as_argument(values: ArrayLike) -> NDArray[np.float64]:
    """An array as kernels are compiled for: of floats, C-contiguous, and writable, whether it is written to or not.

    What is read-only, as in a stored result, is another type to numba, which compiles what takes it once more.
    """
    return np.require(values, np.float64, ["C", "W"])


F = TypeVar("F", bound=Callable[..., Any])

JIT_ENABLED = not numba.config.DISABLE_JIT


def _compile(function: F, allocates: bool = False, **options: Any) -> F:
    # Without numba's runtime no reference is counted: atomic, once for every array at every call, that was 13 to 62 %
    # of a tick and a fifth of its compilation. What is given to a kernel is held by its caller.
    options = {"nopython": True, "error_model": "numpy", "nogil": True, "_nrt": allocates, **options}
    # A kernel of somebody else's is compiled in every process: what it calls cannot be followed from here.
    cached = source_of(function.__module__) is not None
    return cast(F, Kernel(function, options, cached)) if JIT_ENABLED else function


def jit(function: F) -> F:
    """Compile with strict IEEE arithmetic, no exceptions, no memory of its own, cached.

    numba compiles a callee once more for every literal it is given, and for every shape of a structured array's field.
    Callers therefore wrap literals in `as_int64` or `as_bool` and pass such fields as `field[:]`.
    """
    return _compile(function)


def jit_allocating(function: F) -> F:
    """The same for a kernel that makes arrays: none that a tick runs."""
    return _compile(function, allocates=True)


def jit_inline(function: F) -> F:
    """Compile a small function that callers should absorb."""
    return _compile(function, inline="never", forceinline=True)


def jit_vector(function: F) -> F:
    """Compile with sums that may be reordered and fused, so that loops use the vector unit.

    Only for plain loops over arrays: NaN, infinities and signed zeros keep their meaning, and no tolerance is tested
    inside.
    """
    return _compile(function, fastmath={"reassoc", "contract", "arcp"})


def jit_once(function: F) -> F:
    """Make a kernel that has one caller part of it, before it is even lowered."""
    return _compile(function, inline="always")


class GenericKernel(Protocol):
    """A kernel that `generic` has made, for numba and for Python."""

    def __call__(self, first: Any, *others: Any) -> Any:
        """Call the implementation for the type of the first argument."""

    def of(self, kind: type) -> Callable[[F], F]:
        """Declare the kernel below as the implementation for a NamedTuple as first argument."""


class Generic:
    """How the implementations of a `generic` kernel are declared and found."""

    def __init__(self, module: str) -> None:
        self.module = module
        self.implementations: dict[type, Callable[..., Any]] = {}

    def find(self, kind: type) -> Callable[..., Any] | None:
        """The implementation for a type; the modules that hold some are imported when one is missed."""
        if kind not in self.implementations:
            for module in implementing_kernels().get(self.module, ()):
                importlib.import_module(module)
        return self.implementations.get(kind)

    def of(self, kind: type) -> Callable[[F], F]:
        """Declare the kernel below as the implementation for a NamedTuple as first argument."""

        def declare(function: F) -> F:
            self.implementations[kind] = function
            return function

        return declare

    def __call__(self, first: Any, *others: Any) -> Any:
        """Call the implementation from Python."""
        found = self.find(type(first))
        if found is None:
            raise TypeError(f"a kernel of {self.module} is not implemented for {type(first).__name__}")
        return found(first, *others)


def generic(function: Callable[..., Any]) -> GenericKernel:
    """A kernel with an implementation for each type of its first argument, declared by `@name.of(Type)`.

    The function below says what it takes and gives, and has no body. Which implementation a caller gets is known when
    the caller is compiled, so that none but those in use are.
    """
    table = Generic(function.__module__)

    @functools.wraps(function)
    def choose(*arguments: Any) -> Any:
        return table(*arguments)

    choose.of = table.of  # type: ignore[attr-defined]

    class Chosen(AbstractTemplate):  # type: ignore[misc]
        """How numba types a call: as one of the implementation, without a function in between to compile."""

        key = choose

        def _target(self, kind: types.Type) -> types.Dispatcher | None:
            found = table.find(getattr(kind, "instance_class", type(None)))
            return None if found is None else numba.typeof(found)

        def generic(self, args: Any, kws: Any) -> Any:
            target = self._target(args[0])
            return None if target is None else target.get_call_type(self.context, args, kws)

        def get_impl_key(self, sig: Any) -> Any:
            target = self._target(sig.args[0])
            assert target is not None
            return target.get_overload(sig)

    infer_global(choose, types.Function(Chosen))
    return cast(GenericKernel, choose)
