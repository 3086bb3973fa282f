"""Cache of compiled kernels: its files, the turns of processes that compile, and kernels that a wheel brings.

Turns of processes that need one kernel: the first compiles it, others wait and load it.

A turn is a lock of one byte of a file in the cache, at a place given by the kernel's file: such locks end with their
process, and need no file each. Where the system has none, nobody waits.

Files of a compiled kernel, one a signature, named by it.

numba names them in an index, which two processes that compile at once write over each other, and which has the types of
all signatures: reading it takes as long as reading the code.

Compiled kernels that a wheel brings: read-only, and loaded only where every byte is the one that was built.

They lie in folders named as those of the cache, so that kernels of other sources, of another numba or for another
processor are not found; `SHA256SUMS` holds a digest of each file.

Cache of compiled kernels.

numba's file cache sees edits of the file that holds a function but not of the functions that it calls. The kernels of a
module therefore lie in a folder named by a digest of that module's source, of the sources of all kernel modules that it
imports, directly or not, and of the target: numba's version, its settings and the processor. Every checkout of the same
sources shares it.
"""

import functools
import hashlib
import os
import pickle
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from llvmlite import binding as llvm
from numba import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.runtime import rtsys

from hhsim.kernels.by_reference import Reference
from hhsim.kernels.cache_folder import cache_root
from hhsim.kernels.target import BUILT_FOR, CHOICE, COMPILED, TARGET, is_named

PATIENCE = 60.0
"""Time for which one waits [s], before one compiles, too: the other process may be stopped."""
POLL = 0.01
"""Time between two looks [s]."""


class Turns:
    """The turns that this process has, one thread at a time; `on_wait` is called when it begins to wait."""

    def __init__(self, path: Path) -> None:
        self._path, self._patience = path, PATIENCE
        self._held: list[str] = []
        self.on_wait: Callable[[], None] = lambda: None

    @functools.cached_property
    def _file(self) -> int:
        """A descriptor that stays open: to close any of a file would end all locks that a process has on it."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """End all turns that are taken meanwhile, when that is done or fails."""
        before = len(self._held)
        try:
            yield
        finally:
            while len(self._held) > before:
                self._lock(self._held.pop(), taken=False)

    def take(self, kernel: str) -> bool:
        """Wait for the turn of a kernel, by the path of its file; return True if another process had it."""
        began, waited = time.monotonic(), False
        try:
            while not self._lock(kernel):
                if not waited:
                    self.on_wait()
                waited = True
                if time.monotonic() - began > self._patience:
                    self._patience = 0.0
                    return True
                time.sleep(POLL)
        except OSError:
            return waited
        self._held.append(kernel)
        return waited

    def _lock(self, kernel: str, taken: bool = True) -> bool:
        """Have a turn, or end it; return False if another process has it."""
        if sys.platform == "win32":
            return True
        import fcntl

        place = int.from_bytes(hashlib.sha256(kernel.encode()).digest()[:7], "big")
        what = fcntl.LOCK_EX | fcntl.LOCK_NB if taken else fcntl.LOCK_UN
        try:
            fcntl.lockf(self._file, what, 1, place)
        except (BlockingIOError, PermissionError):
            return False
        return True


TURNS = Turns(cache_root() / "turns")
"""Turns to compile what is not in the cache."""


SUFFIX = ".nbc"
DIGEST = hashlib.sha256().digest_size
"""Bytes before the code: with a byte of the code flipped, LLVM ends the process."""


class KernelFiles(IndexDataCacheFile):  # type: ignore[misc]
    """Files of one kernel in its folder, whose name identifies sources, numba and target."""

    def __init__(self, folder: str, kernel: str) -> None:
        super().__init__(folder, kernel, "")
        self._kernel = kernel

    def save(self, key: Any, data: Any) -> None:
        """Keep what was compiled for a key: a signature and what numba adds."""
        self._save_data(self.name(key), data)

    def load(self, key: Any) -> Any:
        """Return what is kept for a key; None for nothing, for damage, or for a type that is declared no more."""
        try:
            return self._load_data(self.name(key))
        except (OSError, AttributeError, ImportError):
            return None

    def _dump(self, data: Any) -> bytes:
        code: bytes = super()._dump(data)
        return hashlib.sha256(code).digest() + code

    def _load_data(self, name: str) -> Any:
        content = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
            raise OSError(f"{name} is damaged")
        return pickle.loads(content[DIGEST:])

    def name(self, key: Any) -> str:
        """Return the name of the file for a key."""
        return f"{self._kernel}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}{SUFFIX}"


FOLDER = COMPILED
SUMS = "SHA256SUMS"


class ShippedKernelWarning(UserWarning):
    """A kernel of the wheel is not used, and compiled anew."""


@functools.cache
def sums() -> dict[str, str]:
    """Return the digest of each file by its path in the folder; none where nothing is shipped."""
    try:
        lines = (FOLDER / SUMS).read_text(encoding="utf-8").splitlines()
        built_for = (FOLDER / BUILT_FOR).read_text(encoding="utf-8").strip()
    except OSError:
        return {}
    if built_for != TARGET:
        if is_named():
            _warn(f"the kernels of this wheel are for {built_for!r} and this is {TARGET!r}: they are compiled here")
        return {}
    return {name: digest for digest, _, name in (line.partition("  ") for line in lines)}


def checked(path: Path) -> bytes | None:
    """Return the content of a shipped file; None, with a warning, where it is missing or not what was built."""
    name = path.relative_to(FOLDER).as_posix()
    if name not in sums():
        return None
    try:
        content = path.read_bytes()
    except OSError as error:
        _warn(f"{path} cannot be read ({error.strerror}): its kernel is compiled here")
        return None
    if hashlib.sha256(content).hexdigest() != sums()[name]:
        _warn(f"{path} is not what was built: its kernel is compiled here")
        return None
    return content


def _warn(text: str) -> None:
    warnings.warn(f"{text}; install hhsim anew, or see {CHOICE}", ShippedKernelWarning, stacklevel=3)


class _ShippedFiles(KernelFiles):
    """Files of one kernel."""

    def _load_data(self, name: str) -> Any:
        content = checked(Path(self._data_path(name)))
        if content is None:
            raise FileNotFoundError(name)
        return pickle.loads(content[DIGEST:])


class ShippedCache(FunctionCache):  # type: ignore[misc]
    """Shipped code of one kernel, which is never written."""

    def __init__(self, function: Callable[..., Any], implementation: Callable[..., Any], folder: str) -> None:
        place = FOLDER / folder
        self._impl_class = functools.partial(implementation, folder=place)
        super().__init__(function)
        self._cache_file = _ShippedFiles(str(place), self._impl.filename_base)


def is_shipped(folder: str) -> bool:
    """Return True if the wheel brings kernels of a folder of the cache, by its name."""
    return bool(sums()) and (FOLDER / folder).is_dir()


PACKAGE = __name__.rpartition(".")[0]
SOURCES = Path(__file__).parent


@functools.cache
def kernel_sources() -> dict[str, Path]:
    """Return the files of the package of kernels, its modules' and packages', by their dotted names."""
    found = {}
    for path in SOURCES.rglob("*.py"):
        name = ".".join((PACKAGE, *path.relative_to(SOURCES).with_suffix("").parts))
        found[name.removesuffix(".__init__")] = path
    return found


def source_of(module: str) -> Path | None:
    """Return the file of a module or package of the kernels by its dotted name; None if it is neither."""
    return kernel_sources().get(module)


@functools.cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(?P<base>[.\w]+)[ \t]+import[ \t]*(?:\((?P<inside>[^)]*)\)|(?P<names>[^\n(]+))"
    r"|import[ \t]+(?P<modules>[^\n]+))",
    re.MULTILINE,
)


def _import_statements(source: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the module that is imported from, "" for modules themselves, and the names, also those of a docstring."""
    # To parse them as Python would cost every start a tenth of a second.
    for found in _IMPORT.finditer(source):
        names = re.sub(r"#[^\n]*", "", found["inside"] or found["names"] or found["modules"])
        yield found["base"] or "", [name.split()[0] for name in names.replace("\\", "").split(",") if name.split()]


@functools.cache
def imported_kernels(module: str) -> tuple[str, ...]:
    """Return the kernel modules that a kernel module imports, in any form and anywhere in the file."""
    source = source_of(module)
    if source is None:
        return ()
    package = module if source.name == "__init__.py" else module.rpartition(".")[0]
    named: list[str] = []
    for base, names in _import_statements(_text(source)):
        level = len(base) - len(base.lstrip("."))
        above = package.split(".")[: package.count(".") + 2 - level] if level else []
        whole = ".".join([*above, *([base[level:]] if base[level:] else [])])
        named += [whole, *(f"{whole}.{name}" for name in names)] if base else names
    return tuple(dict.fromkeys(name for name in named if source_of(name) is not None))


@functools.cache
def implementing_kernels() -> dict[str, tuple[str, ...]]:
    """Return, for each module that declares `generic` kernels, the modules that implement them."""
    found: dict[str, list[str]] = {}
    for module, path in sorted(kernel_sources().items()):
        generics = set(re.findall(r"^@(\w+)\.of\(", _text(path), re.MULTILINE)) if ".of(" in _text(path) else set()
        if generics:
            for base, names in _import_statements(_text(path)):
                if base and not generics.isdisjoint(names):
                    found.setdefault(base, []).append(module)
    return {module: tuple(others) for module, others in found.items()}


def kernel_closure(module: str) -> set[str]:
    """Return the kernel modules that a kernel module depends on, itself included."""
    closure: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in closure:
            closure.add(name)
            waiting.extend(imported_kernels(name))
            waiting.extend(implementing_kernels().get(name, ()))
    return closure


@functools.cache
def module_digest(module: str) -> str:
    """Return a digest of all that the compiled kernels of a module depend on."""
    digest = hashlib.sha256(TARGET.encode())
    for name in sorted(kernel_closure(module)):
        source = source_of(name)
        assert source is not None, f"{name} is no module of {PACKAGE}"
        digest.update(name.encode())
        digest.update(_text(source).encode())
    return digest.hexdigest()[:16]


KERNEL_CACHE: Path = cache_root() / "kernels"
"""Folder of compiled kernels, with a folder for each module."""

_written: list[str] = []


def module_cache(module: str) -> Path:
    """Return the folder of the compiled kernels of this source of a module, by its dotted name."""
    return KERNEL_CACHE / f"{module.removeprefix(f'{PACKAGE}.')}-{module_digest(module)}"


class _Folder(_CacheLocator):  # type: ignore[misc]
    """A folder whose name identifies the sources, in place of numba's stamps, path and time."""

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


class Stored(CompileResultCacheImpl):  # type: ignore[misc]
    """Reader and writer of one kernel's files in its folder."""

    prefix = ""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._locator = _Folder(folder, function)
        self._lineno = function.__code__.co_firstlineno
        self._filename_base = self.prefix + self.get_filename_base(function.__qualname__, getattr(sys, "abiflags", ""))

    def reduce(self, data: Any) -> Any:
        """Return what is written: machine code alone, since its bitcode serves callers, which take the callee's.

        Environments of callees hold what exceptions are made of; to read one imports the callee's module.
        """
        *stored, environments = super().reduce(data)
        return without_bitcode((*stored, tuple(one for one in environments if one.consts)))


def without_bitcode(stored: Any) -> Any:
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
    return tuple(without_bitcode(part) for part in stored)


class _FolderCache(FunctionCache):  # type: ignore[misc]
    """numba's file cache of one kernel, in a given folder."""

    def __init__(self, function: Callable[..., Any], folder: Path, stored: type[Stored]) -> None:
        self._stored = stored
        self._impl_class = functools.partial(stored, folder=folder)
        super().__init__(function)
        self._cache_file = KernelFiles(self._cache_path, self._impl.filename_base)

    def file_of(self, sig: Any, codegen: Any) -> str:
        """Return the path of the file for a signature."""
        return f"{self._cache_path}/{self._cache_file.name(self._index_key(sig, codegen))}"


class KernelCache(_FolderCache):
    """File cache of one kernel.

    Code for a type that is declared outside of the kernels lies in a folder named by that type's source, so that edits
    are seen and other programs, which do not know the type, never read it.
    """

    def __init__(self, function: Callable[..., Any], stored: type[Stored] = Stored) -> None:
        folder = module_cache(function.__module__)
        super().__init__(function, folder, stored)
        # A callee's code is part of the shipped kernels that call it.
        ships = stored is Stored and is_shipped(folder.name)
        self._shipped = ShippedCache(function, stored, folder.name) if ships else None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return compiled code for a signature; None where it is this process's turn to compile it."""
        found = self.look_up(sig, target_context)
        if found is None:
            file = (self._foreign(sig) or self).file_of(sig, target_context.codegen())
            if TURNS.take(file):
                return self.look_up(sig, target_context)
        return found

    def look_up(self, sig: Any, target_context: Any) -> Any:
        """Return compiled code for a signature, None if there is none."""
        foreign = self._foreign(sig)
        if foreign:
            return foreign.load_overload(sig, target_context)
        if self._stored is not Stored:
            return super().load_overload(sig, target_context)
        # Machine code needs numba's runtime alone; numba would also import scipy's BLAS and all that it can compile.
        rtsys.initialize(target_context)
        found = self._shipped._load_overload(sig, target_context) if self._shipped else None
        return self._load_overload(sig, target_context) if found is None else found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code for its signature."""
        _written.append(self._py_func.__qualname__)
        foreign = self._foreign(sig)
        if foreign:
            foreign.save_overload(sig, data)
        else:
            super().save_overload(sig, data)

    def _foreign(self, sig: Any) -> _FolderCache | None:
        sources = {source for argument in getattr(sig, "args", sig) for source in _foreign_sources(argument)}
        if not sources:
            return None
        digest = hashlib.sha256(TARGET.encode())
        for source in sorted(sources):
            digest.update(Path(source).read_bytes())
        return _FolderCache(self._py_func, Path(self.cache_path) / digest.hexdigest()[:16], self._stored)


def _foreign_sources(argument: types.Type) -> Iterator[str]:
    """Yield the files outside of the kernels that declare a NamedTuple type, or those in it."""
    if isinstance(argument, types.NamedTuple | types.NamedUniTuple | Reference):
        module = argument.instance_class.__module__
        if source_of(module) is None:
            yield str(sys.modules[module].__file__)
        for inner in argument.types:
            yield from _foreign_sources(inner)


def compiled_kernels() -> int:
    """Return the number of kernels that this process has compiled and not loaded."""
    return len(_written)


def is_cached() -> bool:
    """Return True if compiled ticks of these sources are shipped or in the cache; if not, the first run compiles."""
    folder = module_cache(f"{PACKAGE}.tick.tick")
    return is_shipped(folder.name) or (folder.is_dir() and any(folder.rglob(f"*{SUFFIX}")))
