"""The one jit factory of the kernels.

numba's file cache sees edits of the file that holds a function but not of the functions it calls, and would then return
yesterday's callee. The kernels of a module therefore lie in a folder named by a digest of that module's source, of the
sources of all kernel modules that it imports, directly or not, of the numba version and of the CPU. Nothing else
counts: another checkout of the same sources, or the same one installed anew, runs what is there.

A `generic` kernel has one implementation for each type of its first argument: so does a tick know its method, and
detection the surface, and only what a run uses is compiled.
"""

import ast
import functools
import hashlib
import importlib
import os
import re
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol, TypeAlias, TypeVar, cast

import numba
import numpy as np
from numba import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.typing.templates import AbstractTemplate, infer_global

Record: TypeAlias = Any
"""One record of a structured array; its fields are read and written as attributes."""

as_int64 = cast(Callable[[int], int], np.int64)
"""Takes an integer literal to a plain integer, so that numba does not compile a callee once more for it."""

as_bool = cast(Callable[[bool], bool], np.bool_)
"""The same for a truth value."""

F = TypeVar("F", bound=Callable[..., Any])

PACKAGE = __name__.rpartition(".")[0]
"""Whose modules a digest covers."""

SOURCES = Path(__file__).parent

JIT_ENABLED = not numba.config.DISABLE_JIT


def cache_root() -> Path:
    """Folder for everything hhsim may delete and make again.

    `HHSIM_CACHE_DIR` wins, then `XDG_CACHE_HOME`/hhsim, then ~/.cache/hhsim; where none can be written, a folder of the
    user's in the system's temporary directory.
    """
    named = os.environ.get("HHSIM_CACHE_DIR")
    if named:
        root = Path(named)
    else:
        base = os.environ.get("XDG_CACHE_HOME")
        root = (Path(base) if base else Path("~/.cache").expanduser()) / "hhsim"
    try:
        root.mkdir(parents=True, exist_ok=True)
        if os.access(root, os.W_OK):
            return root
    except OSError:
        pass
    fallback = Path(tempfile.gettempdir()) / f"hhsim-{os.getuid()}"
    fallback.mkdir(mode=0o700, parents=True, exist_ok=True)
    state = fallback.lstat()
    if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.getuid() or state.st_mode & 0o077:
        # Compiled kernels are run as they are found: never take them from a folder that another user can write.
        return Path(tempfile.mkdtemp(prefix="hhsim-"))
    return fallback


def source_of(module: str) -> Path | None:
    """File of a module or package of the kernels by its dotted name; None for what is neither."""
    if module != PACKAGE and not module.startswith(f"{PACKAGE}."):
        return None
    path = SOURCES.joinpath(*module.split(".")[PACKAGE.count(".") + 1 :])
    found = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in found if file.is_file()), None)


def _import_statements(source: str) -> Iterator[ast.stmt]:
    # The statements alone are parsed: whole modules would cost every start a tenth of a second and more.
    for found in re.finditer(r"^[ \t]*((?:from|import)[ \t][^\n(]*(?:\([^)]*\))?[^\n]*)", source, re.MULTILINE):
        try:
            yield from ast.parse(found.group(1).strip()).body
        except SyntaxError:  # a line of a docstring
            continue


@functools.cache
def imported_kernels(module: str) -> tuple[str, ...]:
    """Modules of the kernels that a module of them imports, in whatever form and wherever in the file."""
    source = source_of(module)
    if source is None:
        return ()
    package = module if source.name == "__init__.py" else module.rpartition(".")[0]
    named: list[str] = []
    for node in _import_statements(source.read_text(encoding="utf-8")):
        if isinstance(node, ast.Import):
            named += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: package.count(".") + 2 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            named += [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return tuple(dict.fromkeys(name for name in named if source_of(name) is not None))


@functools.cache
def implementing_kernels() -> dict[str, tuple[str, ...]]:
    """For each module that declares `generic` kernels, the modules that implement them."""
    found: dict[str, list[str]] = {}
    for path in sorted(SOURCES.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        generics = set(re.findall(r"^@(\w+)\.of\(", source, re.MULTILINE))
        if generics:
            module = ".".join([PACKAGE, *path.relative_to(SOURCES).with_suffix("").parts])
            for node in _import_statements(source):
                if isinstance(node, ast.ImportFrom) and not generics.isdisjoint(alias.name for alias in node.names):
                    found.setdefault(str(node.module), []).append(module)
    return {module: tuple(others) for module, others in found.items()}


@functools.cache
def module_digest(module: str) -> str:
    """Digest of all that the compiled kernels of a module depend on."""
    closure: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in closure:
            closure.add(name)
            waiting.extend(imported_kernels(name))
            waiting.extend(implementing_kernels().get(name, ()))
    digest = _machine_digest()
    for name in sorted(closure):
        source = source_of(name)
        assert source is not None, f"{name} is no module of {PACKAGE}"
        digest.update(name.encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _machine_digest() -> "hashlib._Hash":
    digest = hashlib.sha256(numba.__version__.encode())
    digest.update(str(numba.config.CPU_NAME or _host_cpu()).encode())
    digest.update(str(bool(numba.config.BOUNDSCHECK)).encode())
    return digest


@functools.cache
def _host_cpu() -> str:
    from llvmlite import binding

    return f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}"


KERNEL_CACHE: Path = cache_root() / "kernels"
"""Where compiled kernels lie, each module's in its own folder."""

_folders: set[Path] = set()


def module_cache(module: str) -> Path:
    """Folder of the compiled kernels of exactly this source of a module, by its dotted name."""
    return KERNEL_CACHE / f"{module.removeprefix(f'{PACKAGE}.')}-{module_digest(module)}"


class _Folder(_CacheLocator):  # type: ignore[misc]
    """A folder whose name says what its kernels were made of: numba's own stamps, path and time, are not needed."""

    def __init__(self, folder: Path, function: Callable[..., Any]) -> None:
        self._folder = folder
        self._line = function.__code__.co_firstlineno
        self._py_file = function.__code__.co_filename  # for numba's warning of what cannot be cached

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return ""

    def get_disambiguator(self) -> str:
        return str(self._line)


class _Stored(CompileResultCacheImpl):  # type: ignore[misc]
    """Names the files of one kernel in its folder."""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._locator = _Folder(folder, function)
        self._lineno = function.__code__.co_firstlineno
        self._filename_base = self.get_filename_base(function.__qualname__, sys.abiflags)


class _FolderCache(FunctionCache):  # type: ignore[misc]
    """numba's file cache of one kernel, in a given folder."""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._impl_class = functools.partial(_Stored, folder=folder)
        super().__init__(function)


class _KernelCache(_FolderCache):
    """The file cache of one kernel, in numba's place for it.

    What was compiled for a type that is declared outside of the kernels lies apart, in a folder named by that type's
    source: its edits are seen, and other programs, which do not know the type, never meet it.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function, module_cache(function.__module__))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled code for a signature, None where there is none."""
        foreign = self._foreign(sig)
        return foreign.load_overload(sig, target_context) if foreign else super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code for its signature."""
        foreign = self._foreign(sig)
        if foreign:
            foreign.save_overload(sig, data)
        else:
            super().save_overload(sig, data)

    def _foreign(self, sig: Any) -> _FolderCache | None:
        sources = {source for argument in getattr(sig, "args", sig) for source in _foreign_sources(argument)}
        if not sources:
            return None
        digest = _machine_digest()
        for source in sorted(sources):
            digest.update(Path(source).read_bytes())
        return _FolderCache(self._py_func, Path(self.cache_path) / digest.hexdigest()[:16])


def _foreign_sources(argument: types.Type) -> Iterator[str]:
    """Files outside of the kernels that declare the NamedTuple that a type is, or those in it."""
    if isinstance(argument, types.NamedTuple | types.NamedUniTuple):
        module = argument.instance_class.__module__
        if source_of(module) is None:
            yield str(sys.modules[module].__file__)
        for inner in argument.types:
            yield from _foreign_sources(inner)


def _compile(function: F, allocates: bool = False, **options: Any) -> F:
    # Without numba's runtime no reference is counted: atomic, once for every array at every call, that was 13 to 62 %
    # of a tick and a fifth of its compilation. What is given to a kernel is held by its caller.
    compiled = numba.njit(error_model="numpy", nogil=True, _nrt=allocates, **options)(function)
    # A kernel of somebody else's is compiled in every process: what it calls cannot be followed from here.
    if JIT_ENABLED and source_of(function.__module__) is not None:
        compiled._cache = _KernelCache(function)
        _folders.add(Path(compiled._cache.cache_path))
    return cast(F, compiled)


def cached_kernels() -> int:
    """How many compiled kernels of the modules imported so far lie in the cache."""
    return sum(1 for folder in _folders for _ in folder.rglob("*.nbc"))


def is_cached() -> bool:
    """Whether compiled ticks of exactly these sources lie in the cache; if not, the first run compiles."""
    folder = module_cache(f"{PACKAGE}.tick.tick")
    return folder.is_dir() and any(folder.rglob("*.nbi"))


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
    """Make a kernel that has one caller part of it: compiled apart, it would be optimised twice."""
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
            return None if found is None else types.Dispatcher(found)

        def generic(self, args: Any, kws: Any) -> Any:
            target = self._target(args[0])
            return None if target is None else target.get_call_type(self.context, args, kws)

        def get_impl_key(self, sig: Any) -> Any:
            target = self._target(sig.args[0])
            assert target is not None
            return target.get_overload(sig)

    infer_global(choose, types.Function(Chosen))
    return cast(GenericKernel, choose)
