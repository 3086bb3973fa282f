"""Compiled kernels that a wheel brings: read-only, and loaded only where every byte is the one that was built.

They lie in folders named as those of the cache, so that kernels of other sources, of another numba or for another
processor are not found; `SHA256SUMS` holds a digest of each file.
"""

import functools
import hashlib
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache

from hhsim.kernels.kernel_files import DIGEST, KernelFiles
from hhsim.kernels.target import BUILT_FOR, CHOICE, COMPILED, TARGET, is_named

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
