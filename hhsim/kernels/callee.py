"""Kernels whose code is optimised and translated once, as part of the kernel that Python calls.

numba optimises and translates every function with all that it calls, so that a function ten calls deep is translated
ten times: half of the time to compile a tick. Only a `Kernel`, which Python calls, becomes machine code; its `Callee`
is what numba finds where another kernel names it. The machine code is the same.

A compiler pipeline as numba's documentation describes it, except for the two steps that `_CalleeLibrary` leaves out and
the content of a callee's cache file.
"""

import functools
import gc
import hashlib
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import binding as llvm
from numba import types
from numba.core import typed_passes as typed
from numba.core import untyped_passes as untyped
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, compile_result
from numba.core.compiler_machinery import PassManager
from numba.core.cpu import CPUContext
from numba.core.itanium_mangler import mangle
from numba.core.registry import CPUDispatcher

from hhsim.kernels.kernel_cache import KernelCache, type_digest

CALLEE_PREFIX = "callee-"
"""How the names of callees' files begin."""


def _symbol(name: str, kinds: Any, *, abi_tags: Any = (), uid: Any = None) -> str:
    """Return the symbol of a function for types: numba spells them out, and LLVM would read megabytes of names."""
    digest = hashlib.sha256("".join((*map(type_digest, kinds), *abi_tags)).encode()).hexdigest()[:16]
    return str(mangle(name, (digest,), uid=uid))


CPUContext.mangler = staticmethod(_symbol)


class _CalleeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Linked code of a callee and of what it calls."""

    def _optimize_final_module(self) -> None:
        """Leave it to the caller's library."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


PASSES = (
    untyped.TranslateByteCode,
    untyped.FixupArgs,
    untyped.IRProcessing,
    untyped.RewriteSemanticConstants,
    untyped.DeadBranchPrune,
    untyped.GenericRewrites,
    untyped.InlineInlinables,
    untyped.DeadBranchPrune,
    untyped.ReconstructSSA,
    untyped.DeadBranchPrune,
    typed.NopythonTypeInference,
    typed.PreLowerStripPhis,
    typed.NoPythonSupportedFeatureValidation,
    typed.IRLegalization,
    typed.NativeLowering,
    typed.NoPythonBackend,
)
"""numba's passes in their order, but for those of what no kernel has (closures, literals to unroll, raises, arrays made
of others) and the annotation of types for people; each would look through every function."""


class _CalleeCompiler(Compiler):  # type: ignore[misc]
    """Compiler that ends before optimisation."""

    def __init__(self, typing: Any, target: Any, _: Any, args: Any, returned: Any, flags: Any, locals: Any) -> None:
        flags.no_compile = True
        own = _CalleeLibrary(target.codegen(), "callee")
        super().__init__(typing, target, own, args, returned, flags, locals)
        self.state.type_annotation = ""  # which the last pass takes

    def define_pipelines(self) -> list[PassManager]:
        """Return `PASSES`."""
        passes = PassManager("kernel")
        for one in PASSES:
            passes.add_pass(one, one._name)
        passes.finalize()
        return [passes]


def _reduce_callee(result: Any) -> Any:
    """Return what is written of a callee: LLVM bitcode, which a new caller need not type and lower again."""
    result.library._ensure_finalized()
    description = result.fndesc
    description.typemap = description.calltypes = None  # as numba does: they need not be kept, and may not pickle
    code = result.library._get_module_for_linking().as_bitcode()
    return result.library.name, code, description, result.environment, result.signature


def _rebuild_callee(target_context: Any, payload: Any) -> Any:
    name, code, description, environment, signature = payload
    library = _CalleeLibrary(target_context.codegen(), name)
    library._final_module = library._shared_module = llvm.parse_bitcode(code)
    library._finalized = True
    return compile_result(
        typing_context=target_context.typing_context,
        target_context=target_context,
        entry_point=object(),
        type_annotation="",
        library=library,
        signature=signature,
        objectmode=False,
        lifted=(),
        fndesc=description,
        environment=environment,
        reload_init=(),
        referenced_envs=(),
    )


def _reduce_entry(result: Any) -> Any:
    """Return what is written of a kernel: machine code alone, since callers take the bitcode of the callee.

    Environments of callees hold what exceptions are made of; to read one imports the callee's module.
    """
    *stored, environments = result._replace(type_annotation="")._reduce()
    return _without_bitcode((*stored, tuple(one for one in environments if one.consts)))


def _without_bitcode(stored: Any) -> Any:
    """Return a stored kernel with machine code alone.

    numba writes a library as a triple of its name, "object", and a pair of machine code and bitcode. It reads from the
    bitcode which functions there are: their names stay, with nothing in them.
    """
    if not isinstance(stored, tuple):
        return stored
    if len(stored) == 3 and stored[1] == "object":
        code, bitcode = stored[2]
        names = [function.name for function in llvm.parse_bitcode(bitcode).functions if not function.is_declaration]
        empty = llvm.parse_assembly("".join(f'define void @"{name}"() {{ ret void }}\n' for name in names))
        return stored[0], stored[1], (code, empty.as_bitcode())
    return tuple(_without_bitcode(part) for part in stored)


def _rebuild_entry(target_context: Any, payload: Any) -> Any:
    return CompileResult._rebuild(target_context, *payload)


class Callee(CPUDispatcher):  # type: ignore[misc]
    """A kernel as other kernels call it; Python cannot."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], inlined: bool) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=_CalleeCompiler)
        self._inlined = inlined

    def add_overload(self, cres: Any) -> None:
        """Keep the code for one signature for callers to link; an object stands for the entry of machine code."""
        if not self._inlined:
            code = cres.library._final_module.get_function(cres.fndesc.llvm_func_name)
            code.add_function_attribute("noinline")
        if cres.entry_point is None:
            cres = cres._replace(entry_point=object())
            self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [cres.library])
        self.overloads[tuple(cres.signature.args)] = cres


class _EntryCompiler(Compiler):  # type: ignore[misc]
    """Compiler of what Python calls, which reuses what was compiled for other kernels."""

    def __init__(self, stored: Callable[[Any], Any], *state: Any) -> None:
        self._stored = stored
        super().__init__(*state)

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile machine code of the function."""
        state = self.state
        callee = self._stored(tuple(state.args))
        if callee is None:
            return super().compile_extra(func)
        context, description = state.targetctx, callee.fndesc
        library = context.codegen().create_library(callee.library.name)
        library.enable_object_caching()
        code = callee.library._get_module_for_linking().clone()
        # With a callee's linkage it would be dropped once it is inlined in the wrapper.
        code.get_function(description.llvm_func_name).linkage = "external"
        library._final_module.link_in(code)
        with context.push_code_library(library):
            context.create_cpython_wrapper(library, description, callee.environment, None, state.flags.release_gil)
        entry = context.get_executable(library, description, callee.environment)
        context.insert_user_function(entry, description, [library])
        return callee._replace(library=library, entry_point=entry, metadata=None)


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Suspend the garbage collector, which takes a third of a compilation's time and frees nothing."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function that Python calls, by numba's options; if cached, in the folder of the function's module.

    Where other kernels call it LLVM may inline it, unless it is not `inlined`.
    """

    _cache: Any

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], cached: bool, inlined: bool) -> None:
        # numba asks for it twice, which takes half of the time to declare hundreds of kernels.
        vars(function)["__signature__"] = inspect.signature(function)
        super().__init__(
            function,
            targetoptions={**options, "no_cfunc_wrapper": True},
            pipeline_class=functools.partial(_EntryCompiler, self._stored_callee),
        )
        self._cached, self._inlined = cached, inlined

    def compile(self, sig: Any) -> Any:
        """Load machine code for a signature from the cache, or compile it."""
        # A program declares hundreds of kernels and calls a few: the others' folders need not be known.
        if self._cached and not isinstance(self._cache, KernelCache):
            self._cache = KernelCache(self.py_func, "", _reduce_entry, _rebuild_entry)
        with collector_at_rest():
            return super().compile(sig)

    @functools.cached_property
    def callee(self) -> Callee:
        """Version of the function for other kernels."""
        options = {**self.targetoptions, "no_cpython_wrapper": True}
        callee = Callee(self.py_func, options, self._inlined)
        if self._cached:
            callee._cache = KernelCache(self.py_func, CALLEE_PREFIX, _reduce_callee, _rebuild_callee)
        return callee

    def _stored_callee(self, kinds: tuple[Any, ...]) -> Any:
        """Return what was compiled of it for other kernels, None if nothing was."""
        known = self.callee.overloads.get(kinds)
        return self.callee._cache.look_up(kinds, self.targetctx) if known is None and self._cached else known

    def address(self, *arguments: Any) -> int:
        """Return the address of the machine code for arguments of these types, compiled or loaded if need be."""
        found = self._compiled_for(arguments)
        return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))

    def entry(self, *arguments: Any) -> Callable[..., Any]:
        """Return the machine code for arguments of these types only: a look at many types takes milliseconds."""
        found: Callable[..., Any] = self._compiled_for(arguments).entry_point
        return found

    def _compiled_for(self, arguments: tuple[Any, ...]) -> Any:
        kinds = tuple(self.typeof_pyval(argument) for argument in arguments)
        self.compile(kinds)
        return self.overloads[kinds]

    @property
    def _numba_type_(self) -> types.Dispatcher:
        return types.Dispatcher(self.callee)
