"""Decorators that compile the kernels, one for each kind of kernel, and the types of their arguments."""

import functools
import importlib
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias, TypeVar, cast

import numba
import numpy as np
from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic
from numba.np import numpy_support
from numpy.typing import ArrayLike, NDArray

from hhsim.kernels.callee import Kernel
from hhsim.kernels.kernel_cache import implementing_kernels, kernel_sources

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]

Triple: TypeAlias = tuple[float, float, float]
Record: TypeAlias = Any
"""One record of a structured array; its fields are read and written as attributes."""

as_int64 = cast(Callable[[int], int], np.int64)
as_bool = cast(Callable[[bool], bool], np.bool_)
"""Convert a literal to a plain value, so that numba does not compile a callee once more for that literal."""

F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R")

# numba derives the types of a record's fields anew whenever one is passed: a quarter of a short replay.
numpy_support.from_struct_dtype = functools.cache(numpy_support.from_struct_dtype)

_find_signature = types.Function.get_call_type
_signatures: dict[Any, Any] = {}


def _signature(function: Any, context: Any, arguments: Any, named: Any) -> Any:
    """Return the signature of a call of one of numba's functions or operators for types.

    numba tries one implementation after another anew at each call, and writes down why each does not fit.
    """
    key = function, arguments, tuple(named.items())
    if key not in _signatures:
        _signatures[key] = _find_signature(function, context, arguments, named)
    return _signatures[key]


types.Function.get_call_type = _signature


def as_argument(values: ArrayLike) -> NDArray[np.float64]:
    """Return an array as kernels are compiled for: floats, C-contiguous, writable (else numba compiles once more)."""
    return np.require(values, np.float64, ["C", "W"])


def _compile(function: F, allocates: bool = False, inlined: bool = True, **options: Any) -> F:
    # Without numba's runtime no reference is counted: atomic, once for every array at every call, that was 13 to 62 %
    # of a tick and a fifth of its compilation. The caller of a kernel holds the arrays that it passes.
    options = {"nopython": True, "error_model": "numpy", "nogil": True, "_nrt": allocates, **options}
    # Where it is not said, numba takes it from the kernel during whose compilation a callee happens to be compiled.
    options.setdefault("forceinline", False)
    # A kernel of another package is compiled in every process: the digest cannot cover what it calls.
    cached = function.__module__ in kernel_sources()
    return cast(F, Kernel(function, options, cached, inlined))


def jit(function: F) -> F:
    """Compile with strict IEEE arithmetic, no exceptions, no memory of its own, cached.

    numba compiles a callee once more for every literal argument, and for every shape of a structured array's field.
    Callers therefore wrap literals in `as_int64` or `as_bool` and pass such fields as `field[:]`.
    """
    return _compile(function)


def jit_allocating(function: F) -> F:
    """Compile a kernel that makes arrays: none that a tick runs."""
    return _compile(function, allocates=True)


def jit_inline(function: F) -> F:
    """Compile a function that is always inlined in machine code: a small one, or one on the path of every tick."""
    return _compile(function, inline="never", forceinline=True)


def jit_noinline(function: F) -> F:
    """Compile a large kernel that is never inlined: its callers share its machine code, which is made once."""
    return _compile(function, inlined=False)


LOWERED = {float: types.float64, int: types.int64, bool: types.boolean, type(None): types.void}


def lowered(returned: type[R]) -> Callable[[Callable[..., Any]], Callable[..., R]]:
    """Have kernels call what a function writes with LLVM's builder, which it gets before its arguments.

    Of an array it gets numba's structure of it. Python cannot call it.
    """

    def lower(write: Callable[..., Any]) -> Callable[..., R]:
        @functools.wraps(write)
        def declare(_: Any, *given: types.Type) -> Any:
            kinds = [types.int64 if isinstance(kind, types.Integer) else kind for kind in given]

            def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
                arguments = (
                    context.make_array(kind)(context, builder, value) if isinstance(kind, types.Array) else value
                    for kind, value in zip(kinds, values)
                )
                return write(builder, *arguments) or context.get_dummy_value()

            return LOWERED[returned](*kinds), generate

        return cast(Callable[..., R], intrinsic(declare))

    return lower


class GenericKernel(Protocol):
    """A kernel made by `generic`, for numba and for Python."""

    def __call__(self, first: Any, *others: Any) -> Any:
        """Call the implementation for the type of the first argument."""

    def of(self, kind: type) -> Callable[[F], F]:
        """Declare the kernel below as the implementation for a NamedTuple as first argument."""


def generic(function: Callable[..., Any]) -> GenericKernel:
    """Return a kernel with an implementation for each type of its first argument, declared by `@name.of(Type)`.

    One for `object` is that of every type without its own. The function has no body. A caller gets its implementation
    when it is compiled: a tick knows its method, and detection the surface, and only what a run uses is compiled.
    Modules with implementations are imported when one is missing.
    """
    implementations: dict[type, Callable[..., Any]] = {}

    def find(kind: type) -> Callable[..., Any] | None:
        if kind not in implementations:
            for module in implementing_kernels().get(function.__module__, ()):
                importlib.import_module(module)
        return implementations.get(kind, implementations.get(object))

    @functools.wraps(function)
    def choose(first: Any, *others: Any) -> Any:
        found = find(type(first))
        if found is None:
            raise TypeError(f"a kernel of {function.__module__} is not implemented for {type(first).__name__}")
        return found(first, *others)

    def of(kind: type) -> Callable[[F], F]:
        def declare(implementation: F) -> F:
            implementations[kind] = implementation
            return implementation

        return declare

    choose.of = of  # type: ignore[attr-defined]

    class Chosen(AbstractTemplate):  # type: ignore[misc]
        """Type of a call: that of the implementation, without a function in between to compile."""

        key = choose

        def _target(self, kind: types.Type) -> types.Dispatcher | None:
            found = find(getattr(kind, "instance_class", type(None)))
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
