"""A kernel as other kernels call it: code that is optimised and translated as part of its caller, and nowhere else.

numba optimises and translates every function with all that it calls, so that what lies ten calls deep is done ten times
over. That was half of the time to compile a tick. Only what Python calls has to be machine code: a `Kernel` is that,
and its `Callee` is what numba finds where another kernel names it. The machine code comes out the same.

Customised as numba's documentation describes it (a compiler pipeline of one's own); what goes beyond are the two steps
that `_CalleeLibrary` leaves out, and what a cache file of a callee holds.
"""

import functools
import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import binding as llvm
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, compile_result
from numba.core.registry import CPUDispatcher

from hhsim.kernels.kernel_cache import KernelCache, Stored


class _CalleeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The code of a callee and of what it calls, linked."""

    def _optimize_final_module(self) -> None:
        """Left to the caller's library."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _CalleeCompiler(Compiler):  # type: ignore[misc]
    """numba's compiler, up to the code before it is optimised."""

    def __init__(
        self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Any, locals: Any
    ) -> None:
        flags.no_compile = True
        library = _CalleeLibrary(targetctx.codegen(), "callee")
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)


class _StoredCallee(Stored):
    """A callee in the cache, as LLVM's bitcode: a new caller need not type and lower it again."""

    prefix = "callee-"

    def reduce(self, data: Any) -> Any:
        """What is written."""
        data.library._ensure_finalized()
        description = data.fndesc
        description.typemap = description.calltypes = None  # as numba does: they need not be kept, and may not pickle
        code = data.library._get_module_for_linking().as_bitcode()
        return data.library.name, code, description, data.environment, data.signature

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """What was written, as numba's result of a compilation."""
        name, code, description, environment, signature = payload
        library = _CalleeLibrary(target_context.codegen(), name)
        library._final_module = library._shared_module = llvm.parse_bitcode(code)
        library._finalized = True
        return compile_result(
            typing_context=target_context.typing_context,
            target_context=target_context,
            entry_point=object(),
            typing_error=None,
            type_annotation="",
            library=library,
            signature=signature,
            objectmode=False,
            lifted=(),
            fndesc=description,
            environment=environment,
            metadata=None,
            reload_init=(),
            referenced_envs=(),
        )


class Callee(CPUDispatcher):  # type: ignore[misc]
    """What numba calls where a kernel names another one; Python cannot call it."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=_CalleeCompiler)

    def add_overload(self, cres: Any) -> None:
        """Keep what was compiled for one signature, and tell numba that callers may link it.

        Where machine code would begin there is a mere object, by which numba finds the signature's code again.
        """
        if cres.entry_point is None:
            cres = cres._replace(entry_point=object())
            self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [cres.library])
        self.overloads[tuple(cres.signature.args)] = cres


class _EntryCompiler(Compiler):  # type: ignore[misc]
    """numba's compiler of what Python calls; what was compiled for other kernels is neither typed nor lowered again."""

    def __init__(self, stored: Callable[[Any], Any], *state: Any) -> None:
        self._stored = stored
        super().__init__(*state)

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Machine code of the function."""
        state = self.state
        callee = self._stored(tuple(state.args))
        if callee is None:
            return super().compile_extra(func)
        context, description = state.targetctx, callee.fndesc
        library = context.codegen().create_library(callee.library.name)
        library.enable_object_caching()
        code = callee.library._get_module_for_linking().clone()
        # As it is for callers it would be gone when the wrapper has taken it in.
        code.get_function(description.llvm_func_name).linkage = "external"
        library._final_module.link_in(code)
        with context.push_code_library(library):
            context.create_cpython_wrapper(library, description, callee.environment, None, state.flags.release_gil)
        entry = context.get_executable(library, description, callee.environment)
        context.insert_user_function(entry, description, [library])
        return callee._replace(library=library, entry_point=entry, metadata=None)


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Without Python's garbage collector, which takes a third of a compilation to look through what is still in use."""
    at_work = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if at_work:
            gc.enable()


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function that Python calls.

    `options` are numba's; `cached` says whether machine code is kept in the folder of the function's module.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], cached: bool) -> None:
        super().__init__(
            function,
            targetoptions={**options, "no_cfunc_wrapper": True},
            pipeline_class=functools.partial(_EntryCompiler, self._stored_callee),
        )
        self._cached = cached
        if cached:
            self._cache = KernelCache(function)

    def compile(self, sig: Any) -> Any:
        """Machine code for a signature, from the cache or new."""
        with collector_at_rest():
            return super().compile(sig)

    @functools.cached_property
    def callee(self) -> Callee:
        """The same function for other kernels."""
        options = {**self.targetoptions, "no_cpython_wrapper": True}
        callee = Callee(self.py_func, options)
        if self._cached:
            callee._cache = KernelCache(self.py_func, _StoredCallee)
        return callee

    def _stored_callee(self, kinds: tuple[Any, ...]) -> Any:
        """What was compiled of it for other kernels, None where nothing was."""
        return self.callee.overloads.get(kinds) or self.callee._cache.load_overload(kinds, self.targetctx)

    def address(self, *arguments: Any) -> int:
        """Where the machine code for arguments of these types begins; compiled, or loaded, if need be."""
        found = self._compiled_for(arguments)
        return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))

    def entry(self, *arguments: Any) -> Callable[..., Any]:
        """The machine code for arguments of these types, to be called with such arguments and nothing else.

        Which code is meant is known beforehand: a call of the kernel itself looks at the types of its arguments, which
        takes milliseconds where they are many.
        """
        found: Callable[..., Any] = self._compiled_for(arguments).entry_point
        return found

    def _compiled_for(self, arguments: tuple[Any, ...]) -> Any:
        kinds = tuple(self.typeof_pyval(argument) for argument in arguments)
        self.compile(kinds)
        return self.overloads[kinds]

    @property
    def _numba_type_(self) -> types.Dispatcher:
        return types.Dispatcher(self.callee)

    @property
    def signatures(self) -> tuple[Any, ...]:
        """The types it was compiled for, for Python and for other kernels."""
        return tuple(dict.fromkeys([*self.overloads, *self.callee.overloads]))
