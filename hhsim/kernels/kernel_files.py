"""Files of a compiled kernel, one a signature, named by it.

numba names them in an index, which two processes that compile at once write over each other, and which has the types of
all signatures: reading it takes as long as reading the code.
"""

import hashlib
import pickle
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile

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
