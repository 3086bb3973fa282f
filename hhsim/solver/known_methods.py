"""Records of all methods by name, see `hhsim.solver.method_names`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from hhsim.errors import InputError
from hhsim.solver.method import FORCES, METHODS, RUNS, TIMES, UNITS, Engine, Method
from hhsim.solver.method_names import declared_methods, facts_of, outside_class, source_of

SUBMITTED = "submission:"
"""Prefix of the method of a submission's poses in its result; see `hhsim.submissions.score`."""
_known_for_now: dict[str, Method] = {}


def find_method(name: str) -> Method:
    """Return the method of a name of `method_names`, or `package.module:Class`.

    Raises UnknownNameError for no such method, InputError for one that cannot be imported, or is no method.
    """
    if name in METHODS:
        return METHODS[name]
    if name in _known_for_now:
        return _known_for_now[name]
    if name.startswith(SUBMITTED):
        summary = "poses that were computed elsewhere"
        return Method(summary, partial(_no_engine, name), gives=frozenset(), compiled=False)
    found = outside_class(name)
    if isinstance(found, Method):
        return replace(found, source=found.source or source_of(found.engine))
    facts = facts_of(found)
    return Method(
        summary=facts["summary"],
        engine=partial(_engine, name, found, facts["forces"]),
        never_penetrates=facts["never_penetrates"],
        follows_input=True,
        gives=frozenset((TIMES, RUNS, *([FORCES] if facts["forces"] else []), *([UNITS] if facts["work"] else []))),
        compiled=False,
        missing=facts["missing"],
        source=facts["source"],
    )


def names_code(name: str) -> bool:
    """Return True for `package.module:Class`, which `find_method` imports: code that the name's author chose."""
    return ":" in name and not name.startswith(SUBMITTED) and name not in declared_methods()


@contextmanager
def known_for_now(name: str, method: Method) -> Iterator[None]:
    """Make `find_method` know a method by a name, which begins with `SUBMITTED`, until the block ends."""
    _known_for_now[name] = method
    try:
        yield
    finally:
        del _known_for_now[name]


def _no_engine(name: str, workspace: Any) -> Engine:
    raise InputError(f"'{name}' is poses computed elsewhere: hhsim score measures their file anew")


def _engine(name: str, made: Callable[[Any], Any], forces: bool, workspace: Any) -> Engine:
    # As hhsim's own, the engine is imported when it is made: it stands above what only names methods.
    from hhsim.solver.outside_method import MethodHere, OutsideEngine

    return OutsideEngine(partial(MethodHere, name, made, forces), forces, workspace)
