"""Files of a compiled kernel, one a signature, named by it.

numba names them in an index, which two processes that compile at once write over each other, and which has the types of
all signatures: reading it takes as long as reading the code.
"""

import hashlib
from typing import Any

from numba.core.caching import IndexDataCacheFile

SUFFIX = ".nbc"


class KernelFiles(IndexDataCacheFile):  # type: ignore[misc]
    """Files of one kernel in its folder, whose name identifies sources, numba and target."""

    def __init__(self, folder: str, kernel: str) -> None:
        super().__init__(folder, kernel, "")
        self._kernel = kernel

    def save(self, key: Any, data: Any) -> None:
        """Keep what was compiled for a key: a signature and what numba adds."""
        self._save_data(self.name(key), data)

    def load(self, key: Any) -> Any:
        """Return what is kept for a key; None for nothing, or for what names a type that is declared no more."""
        try:
            return self._load_data(self.name(key))
        except (OSError, AttributeError, ImportError):
            return None

    def name(self, key: Any) -> str:
        """Return the name of the file for a key."""
        return f"{self._kernel}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}{SUFFIX}"
