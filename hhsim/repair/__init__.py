"""Repair of recorded hands: the same recording without penetration, in its own format, with the field's figures.

The package is called, as `hhsim.repair(recording, object)`, for `hhsim.repair.in_memory.repair`.
"""

import sys
from types import ModuleType
from typing import Any


class _CalledPackage(ModuleType):
    """Package that stands for its main function too."""

    def __call__(self, recording: Any, object_: Any, **options: Any) -> Any:
        """Repair a recording in memory; see `hhsim.repair.in_memory.repair`."""
        from hhsim.repair.in_memory import repair

        return repair(recording, object_, **options)


sys.modules[__name__].__class__ = _CalledPackage
