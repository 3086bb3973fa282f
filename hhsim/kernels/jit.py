"""The one jit factory of the kernels.

numba's file cache sees edits of the file that holds a function but not of the functions it calls, and would then return
yesterday's callee. The kernels of a module therefore lie in a folder named by a digest of that module's source, of the
sources of all kernel modules that it imports, directly or not, of the numba version and of the CPU.
"""

import ast
import functools
import hashlib
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast

import numba
import numpy as np

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


@functools.cache
def imported_kernels(module: str) -> tuple[str, ...]:
    """Modules of the kernels that a module of them imports, in whatever form and wherever in the file."""
    source = source_of(module)
    if source is None:
        return ()
    package = module if source.name == "__init__.py" else module.rpartition(".")[0]
    named: list[str] = []
    for node in ast.walk(ast.parse(source.read_bytes())):
        if isinstance(node, ast.Import):
            named += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: package.count(".") + 2 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            named += [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return tuple(dict.fromkeys(name for name in named if source_of(name) is not None))


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
    digest = hashlib.sha256(numba.__version__.encode())
    digest.update(str(numba.config.CPU_NAME or _host_cpu()).encode())
    digest.update(str(numba.config.BOUNDSCHECK).encode())
    for name in sorted(closure):
        source = source_of(name)
        assert source is not None, f"{name} is no module of {PACKAGE}"
        digest.update(name.encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


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


def _compile(function: F, **options: Any) -> F:
    folder = module_cache(function.__module__)
    _folders.add(folder)
    # Only while the decorator runs: other packages of the process keep their own cache folder.
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(folder)
    try:
        compiled: F = numba.njit(cache=True, error_model="numpy", nogil=True, **options)(function)
    finally:
        numba.config.CACHE_DIR = before
    return compiled


def cached_kernels() -> int:
    """How many compiled kernels of the modules imported so far lie in the cache."""
    return sum(1 for folder in _folders for _ in folder.rglob("*.nbc"))


def is_cached() -> bool:
    """Whether compiled ticks of exactly these sources lie in the cache; if not, the first run compiles."""
    folder = module_cache(f"{PACKAGE}.tick.tick")
    return folder.is_dir() and any(folder.rglob("*.nbi"))


def jit(function: F) -> F:
    """Compile with strict IEEE arithmetic, no exceptions, cached.

    numba compiles a callee once more for every literal it is given, and for every shape of a structured array's field.
    Callers therefore wrap literals in `as_int64` or `as_bool` and pass such fields as `field[:]`.
    """
    return _compile(function)


def jit_inline(function: F) -> F:
    """Compile a small function that callers should absorb."""
    return _compile(function, inline="never", forceinline=True)


def jit_vector(function: F) -> F:
    """Compile with sums that may be reordered and fused, so that loops use the vector unit.

    Only for plain loops over arrays: NaN, infinities and signed zeros keep their meaning, and no tolerance is tested
    inside.
    """
    return _compile(function, fastmath={"reassoc", "contract", "arcp"})
