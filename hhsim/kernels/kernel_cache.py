"""Cache of compiled kernels: a file for each signature, in folders that a digest names.

The kernels of a module lie in a folder named by a digest of that module's source, of the sources of all kernel modules
that it depends on, directly or not, and of the target: numba's version, its settings and the processor. Every checkout
of the same sources shares it, and what a wheel brings lies in folders of the same names. numba's own cache would see
edits of the file that holds a function but not of the functions that it calls.

Of processes that need one kernel at once the first compiles it, others wait and load it. Such a turn is a lock of one
byte of a file, at a place given by the kernel's file: it ends with its process.
"""

import errno
import fcntl
import functools
import hashlib
import os
import pickle
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

from numba import types
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from hhsim.kernels.by_reference import Reference
from hhsim.kernels.cache_folder import cache_root
from hhsim.kernels.target import TARGET

PACKAGE = __name__.rpartition(".")[0]
SOURCES = Path(__file__).parent
KERNEL_CACHE: Path = cache_root() / "kernels"
"""Folder of compiled kernels, with a folder for each module."""
SHIPPED = SOURCES / "compiled"
"""Folder of a wheel's kernels, with the same folders; there is none in the sources."""
SUFFIX = ".nbc"
DIGEST = hashlib.sha256().digest_size
"""Bytes before the code: with a byte of the code flipped, LLVM ends the process."""
PATIENCE = 60.0
"""Time for which one waits for another process's kernel [s], before one compiles, too: it may be stopped."""
POLL = 0.01
"""Time between two looks [s]."""


class DamagedKernelWarning(UserWarning):
    """A compiled kernel is not what was written, and is compiled anew."""


class Turns:
    """The turns to compile that this process has; `on_wait` is called when it begins to wait for another's."""

    def __init__(self, path: Path) -> None:
        self._path, self._patience = path, PATIENCE
        self.on_wait: Callable[[], None] = lambda: None

    @functools.cached_property
    def _file(self) -> int:
        """A descriptor that stays open: to close any of a file would end all locks that a process has on it."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)

    def take(self, kernel: str) -> bool:
        """Wait for the turn of a kernel, by the path of its file; return True if another process had it."""
        began, waited = time.monotonic(), False
        while not self._lock(kernel, fcntl.LOCK_EX | fcntl.LOCK_NB):
            if not waited:
                self.on_wait()
            waited = True
            if time.monotonic() - began > self._patience:
                self._patience = 0.0
                break
            time.sleep(POLL)
        return waited

    def end(self, kernel: str) -> None:
        """End the turn of a kernel, if it is this process's."""
        self._lock(kernel, fcntl.LOCK_UN)

    def _lock(self, kernel: str, how: int) -> bool:
        """Return False if another process has the lock; where the system has no locks, nobody waits."""
        place = int.from_bytes(hashlib.sha256(kernel.encode()).digest()[:7], "big")
        try:
            fcntl.lockf(self._file, how, 1, place)
        except OSError as error:
            return error.errno not in (errno.EAGAIN, errno.EACCES)
        return True


TURNS = Turns(cache_root() / "turns")


@functools.cache
def kernel_sources() -> dict[str, str]:
    """Return the sources of the package of kernels, of its modules and packages, by their dotted names."""
    found = {}
    for path in sorted(SOURCES.rglob("*.py")):
        name = ".".join((PACKAGE, *path.relative_to(SOURCES).with_suffix("").parts))
        found[name.removesuffix(".__init__")] = path.read_text(encoding="utf-8")
    return found


@functools.cache
def imported_kernels(module: str) -> set[str]:
    """Return the kernel modules that a kernel module names, as it does to import from them."""
    # To parse it as Python would cost every start a tenth of a second.
    return {*re.findall(rf"\b{PACKAGE}[.\w]*\w", kernel_sources()[module])} & kernel_sources().keys()


@functools.cache
def implementing_kernels() -> dict[str, list[str]]:
    """Return, for each module that declares `generic` kernels, the modules that implement them."""
    found: dict[str, list[str]] = {}
    for module, source in kernel_sources().items():
        for name in {*re.findall(r"^@(\w+)\.of\(", source, re.MULTILINE)}:
            for declaring in imported_kernels(module):
                if f"\ndef {name}(" in kernel_sources()[declaring]:
                    found.setdefault(declaring, []).append(module)
    return found


@functools.cache
def module_digest(module: str) -> str:
    """Return a digest of all that the compiled kernels of a module depend on."""
    closure, waiting = set[str](), [module]
    while waiting:
        name = waiting.pop()
        if name not in closure:
            closure.add(name)
            waiting += [*imported_kernels(name), *implementing_kernels().get(name, ())]
    digest = hashlib.sha256(TARGET.encode())
    for name in sorted(closure):
        digest.update(f"{name}{kernel_sources()[name]}".encode())
    return digest.hexdigest()[:16]


def module_folder(module: str) -> str:
    """Return the name of the folder of the compiled kernels of this source of a module, by its dotted name."""
    return f"{module.removeprefix(f'{PACKAGE}.')}-{module_digest(module)}"


def is_cached() -> bool:
    """Return True if compiled ticks of these sources are shipped or in the cache; if not, the first run compiles."""
    folder = module_folder(f"{PACKAGE}.tick.tick")
    return any(any((root / folder).glob(f"*{SUFFIX}")) for root in (SHIPPED, KERNEL_CACHE))


@functools.cache
def type_digest(kind: types.Type) -> str:
    """Return a digest of a type: of a record it spells out all fields, tens of thousands of letters."""
    return hashlib.sha256(repr(kind).encode()).hexdigest()


def _foreign_sources(argument: types.Type) -> Iterator[str]:
    """Yield the files outside of the kernels that declare a NamedTuple type, or those in it."""
    if isinstance(argument, types.NamedTuple | types.NamedUniTuple | Reference):
        module = argument.instance_class.__module__
        if module not in kernel_sources():
            yield str(sys.modules[module].__file__)
        for inner in argument.types:
            yield from _foreign_sources(inner)


_written: list[str] = []


def compiled_kernels() -> int:
    """Return the number of kernels that this process has compiled and not loaded."""
    return len(_written)


Reduce: TypeAlias = Callable[[Any], Any]
"""Makes what is written of the result of a compilation."""
Rebuild: TypeAlias = Callable[[Any, Any], Any]
"""Makes that result of what was written, for a target."""


class KernelCache:
    """Files of one kernel, in place of numba's cache of a function; their names begin with a prefix."""

    def __init__(self, function: Callable[..., Any], prefix: str, reduce: Reduce, rebuild: Rebuild) -> None:
        self._reduce, self._rebuild = reduce, rebuild
        version = f"py{sys.version_info.major}{sys.version_info.minor}"
        kernel = f"{prefix}{function.__qualname__}-{function.__code__.co_firstlineno}.{version}"
        self._kernel = f"{module_folder(function.__module__)}/{kernel}"

    def _file(self, sig: Any) -> str:
        """Return the path of the file for a signature, in the cache or in `SHIPPED`.

        With a type that is declared outside of the kernels it depends on that type's source, so that edits are seen.
        """
        foreign = {source for argument in sig for source in _foreign_sources(argument)}
        key = repr((list(map(type_digest, sig)), [Path(source).read_bytes() for source in sorted(foreign)]))
        return f"{self._kernel}.{hashlib.sha256(key.encode()).hexdigest()[:16]}{SUFFIX}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return compiled code for a signature; None where it is this process's turn to compile it."""
        file = self._file(sig)
        found = self._read(file, target_context)
        if found is None and TURNS.take(file):
            found = self._read(file, target_context)
            if found is not None:
                TURNS.end(file)
        return found

    def look_up(self, sig: Any, target_context: Any) -> Any:
        """Return compiled code for a signature, None if there is none."""
        return self._read(self._file(sig), target_context)

    def _read(self, file: str, target_context: Any) -> Any:
        # Machine code needs numba's runtime alone; numba would also import scipy's BLAS and all that it can compile.
        rtsys.initialize(target_context)
        for path in (SHIPPED / file, KERNEL_CACHE / file):
            try:
                content = path.read_bytes()
                if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
                    warnings.warn(f"{path} is damaged: its kernel is compiled anew", DamagedKernelWarning, stacklevel=2)
                    continue
                found = pickle.loads(content[DIGEST:])
            except (OSError, AttributeError, ImportError):
                # There is no such file, or it has a type that is declared no more.
                continue
            return self._rebuild(target_context, found)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code for its signature."""
        _written.append(self._kernel)
        file = self._file(sig)
        if not data.library.has_dynamic_globals:
            code, path = dumps(self._reduce(data)), KERNEL_CACHE / file
            path.parent.mkdir(parents=True, exist_ok=True)
            # Who reads meanwhile finds none, or all of it.
            temporary = path.with_suffix(f".{os.getpid()}")
            temporary.write_bytes(hashlib.sha256(code).digest() + code)
            temporary.replace(path)
        TURNS.end(file)
