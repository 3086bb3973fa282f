"""Names of methods: hhsim's own, those that installed packages declare, and classes of any module.

A package declares one as an entry point of the group "hhsim.methods"; `package.module:Class` names an undeclared one.
Either is a `hhsim.solver.method.Method`, or a class as `hhsim.solver.outside_method.OutsideMethod`.
"""

import hashlib
import inspect
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

from hhsim.errors import InputError, UnknownNameError
from hhsim.registry import declared
from hhsim.solver.method import METHODS, Method

GROUP = "hhsim.methods"
"""Group of the entry points."""


def declared_methods() -> dict[str, EntryPoint]:
    """Return the entry points of installed packages by name, but for hhsim's own names."""
    return {name: entry for name, entry in declared(GROUP).items() if name not in METHODS}


def method_names() -> list[str]:
    """Return every name that `find_method` knows, hhsim's own first, without importing a method."""
    return [*METHODS.names(), *sorted(declared_methods())]


def outside_class(name: str) -> Any:
    """Import the class of a declared method or `package.module:Class`; raises InputError or UnknownNameError."""
    if name in declared_methods():
        found = _imported(name, declared_methods()[name].load)
    elif ":" in name:
        found = _imported(name, lambda: _named(name))
    else:
        raise UnknownNameError("method", name, method_names())
    missing = [part for part in ("begin", "tick") if not callable(getattr(found, part, None))]
    if not isinstance(found, Method) and (not isinstance(found, type) or missing):
        what = f"lacks {' and '.join(missing)}" if missing else "is an instance"
        expected = "expected a class with __init__(scene), begin(pose) and tick(haptic)"
        raise InputError(f"method '{name}' is no method: {found!r} {what}; {expected}")
    return found


def _named(name: str) -> Any:
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        # Behind all that is installed: a file beside the user's data must not take a library's place.
        sys.path.append(here)
    return getattr(import_module(module), attribute)


def _imported(name: str, load: Callable[[], Any]) -> Any:
    try:
        return load()
    except (Exception, SystemExit) as error:
        # Whatever somebody else's module raises is told in one line.
        where = "package.module:Class, from the current folder or installed"
        raise InputError(f"method '{name}' cannot be imported: {type(error).__name__}: {error} ({where})") from error


def facts_of(made: Any) -> dict[str, Any]:
    """Return `summary`, `forces`, `work`, `never_penetrates`, `missing` and `source` (SHA-256, or "") of a class."""
    lines = (getattr(made, "__doc__", None) or "").strip().splitlines()
    return {
        "summary": str(getattr(made, "summary", lines[0] if lines else "a method from outside")).rstrip("."),
        "forces": bool(getattr(made, "gives_forces", False)),
        "work": bool(getattr(made, "gives_work", False)),
        "never_penetrates": bool(getattr(made, "never_penetrates", False)),
        "missing": str(getattr(made, "missing", "")),
        "source": source_of(made),
    }


def source_of(made: Any) -> str:
    """Return the SHA-256 of the file of a class or function; "" without one."""
    try:
        return hashlib.sha256(Path(inspect.getfile(made)).read_bytes()).hexdigest()
    except (TypeError, OSError):
        return ""
