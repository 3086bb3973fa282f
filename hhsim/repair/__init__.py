"""Repair of recorded hands: the same recording without penetration, in its own format, with the field's figures.

The package is called, as `hhsim.repair(recording, object)`, for `hhsim.repair.in_memory.repair`.
"""

import inspect
import sys
from types import ModuleType
from typing import Any

_DOC = __doc__


class _CalledPackage(ModuleType):
    """Package that stands for its main function too."""

    @property
    def __doc__(self) -> str:  # type: ignore[override]
        """Text of help(hhsim.repair), which has that of the function."""
        from hhsim.repair.in_memory import repair

        # Without the types, which numpy spells out over many lines.
        names = [each.replace(annotation=each.empty) for each in inspect.signature(repair).parameters.values()]
        return f"{_DOC}\nrepair{inspect.Signature(names)}\n\n{inspect.getdoc(repair)}"

    def __call__(self, recording: Any, object_: Any, **options: Any) -> Any:
        """Repair a recording in memory; see `hhsim.repair.in_memory.repair`."""
        from hhsim.repair.in_memory import repair

        return repair(recording, object_, **options)


sys.modules[__name__].__class__ = _CalledPackage
