"""Every method that can be named: hhsim's own, those that installed packages declare, and a class in any module.

A package declares one as an entry point of the group "hhsim.methods"; `package.module:Class` names one that nobody
declares. Either is a `hhsim.solver.method.Method`, or a class as `hhsim.solver.outside_method.OutsideMethod`.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, cast

from hhsim.errors import InputError, UnknownNameError
from hhsim.solver.method import FORCES, METHODS, RUNS, TIMES, Engine, Method

GROUP = "hhsim.methods"
"""Of the entry points."""
SUBMITTED = "submission:"
"""What the name of a submission's poses begins with, in its result; see `hhsim.submissions.score`."""
_known_for_now: dict[str, Method] = {}


@cache
def declared_methods() -> dict[str, EntryPoint]:
    """What installed packages declare, by name; a name of hhsim's own is theirs no longer."""
    return {entry.name: entry for entry in entry_points(group=GROUP) if entry.name not in METHODS}


def method_names() -> list[str]:
    """Every name that `find_method` knows, hhsim's own first, without importing a method."""
    return [*METHODS.names(), *sorted(declared_methods())]


def find_method(name: str) -> Method:
    """The method of a name.

    Args:
        name: One of `method_names`, or `package.module:Class`.

    Raises:
        UnknownNameError: Nothing is called so.
        InputError: It cannot be imported, or is no method.
    """
    if name in METHODS:
        return METHODS[name]
    if name in _known_for_now:
        return _known_for_now[name]
    if name.startswith(SUBMITTED):
        return Method(
            "poses that were computed elsewhere", partial(_no_engine, name), gives=frozenset(), compiled=False
        )
    if name in declared_methods():
        return _as_method(name, _imported(name, declared_methods()[name].load))
    if ":" in name:
        return _as_method(name, _imported(name, lambda: _named(name)))
    raise UnknownNameError("method", name, method_names())


@contextmanager
def known_for_now(name: str, method: Method) -> Iterator[None]:
    """Have `find_method` know a method by a name, which begins with `SUBMITTED`, until the block ends."""
    _known_for_now[name] = method
    try:
        yield
    finally:
        del _known_for_now[name]


def _no_engine(name: str, workspace: Any) -> Engine:
    raise InputError(
        f"'{name}' is poses that were computed elsewhere, which cannot be computed again: hhsim score measures their "
        "file anew"
    )


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
    except Exception as error:
        # Whatever somebody else's module raises is told in one line.
        why = f"{type(error).__name__}: {error}"
        raise InputError(
            f"method '{name}' cannot be imported: {why} (package.module:Class, from the current folder or installed)"
        ) from error


def _as_method(name: str, found: Any) -> Method:
    if isinstance(found, Method):
        return found
    missing = [part for part in ("begin", "tick") if not callable(getattr(found, part, None))]
    if not isinstance(found, type) or missing:
        what = f"lacks {' and '.join(missing)}" if missing else "is an instance"
        raise InputError(
            f"method '{name}' is no method: {found!r} {what}; expected a class with __init__(scene), begin(pose) and "
            "tick(haptic)"
        )
    return outside_method(name, found)


def outside_method(name: str, made: Callable[[Any], Any]) -> Method:
    """The record of a method from outside.

    Args:
        name: For messages.
        made: The class, as `hhsim.solver.outside_method.OutsideMethod`, or whatever makes one for a scene and has its
            attributes.
    """
    forces = bool(getattr(made, "gives_forces", False))
    lines = (getattr(made, "__doc__", None) or "").strip().splitlines()
    return Method(
        summary=str(getattr(made, "summary", lines[0] if lines else "a method from outside")).rstrip("."),
        engine=partial(_engine, name, made, forces),
        never_penetrates=bool(getattr(made, "never_penetrates", False)),
        refuses_backends=f"method {name} comes from outside and takes no QP solver of hhsim's, not {{qp}}",
        gives=frozenset((TIMES, RUNS, *([FORCES] if forces else []))),
        compiled=False,
        missing=str(getattr(made, "missing", "")),
    )


def _engine(name: str, made: Callable[[Any], Any], forces: bool, workspace: Any) -> Engine:
    # As hhsim's own, the engine is imported when it is made: it stands above what only names methods.
    return cast(Engine, import_module("hhsim.solver.outside_method").OutsideEngine(name, made, forces, workspace))
