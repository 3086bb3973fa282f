"""Records of all methods by name, see `hhsim.solver.method_names`."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from hhsim.errors import InputError
from hhsim.solver.method import FORCES, METHODS, RUNS, TIMES, UNITS, Engine, Method
from hhsim.solver.method_names import ISOLATED, declared_methods, facts_of, isolated_name, outside_class, source_of

SUBMITTED = "submission:"
"""Prefix of the method of a submission's poses in its result; see `hhsim.submissions.score`."""
_known_for_now: dict[str, Method] = {}


def find_method(name: str) -> Method:
    """Return the method of a name of `method_names`, or `package.module:Class`; `ISOLATED` may precede an outside one.

    Raises UnknownNameError for no such method, InputError for one that cannot be imported, or is no method.
    """
    if name in METHODS:
        return METHODS[name]
    if name in _known_for_now:
        return _known_for_now[name]
    if name.startswith(SUBMITTED):
        summary = "poses that were computed elsewhere"
        return Method(summary, partial(_no_engine, name), gives=frozenset(), compiled=False)
    if name.startswith(ISOLATED):
        from hhsim.solver.isolated_method import isolated_engine, isolated_facts

        plain = name.removeprefix(ISOLATED)
        isolated_name(plain)
        facts = isolated_facts(plain)
        return _method(facts, partial(isolated_engine, plain, facts["forces"]))
    found = outside_class(name)
    if isinstance(found, Method):
        return replace(found, source=found.source or source_of(found.engine))
    facts = facts_of(found)
    return _method(facts, partial(_engine, name, found, facts["forces"]))


def names_code(name: str) -> bool:
    """Return True for `package.module:Class`, which `find_method` imports: code that the name's author chose."""
    plain = name.removeprefix(ISOLATED)
    return ":" in plain and not plain.startswith(SUBMITTED) and plain not in declared_methods()


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


def _method(facts: Mapping[str, Any], engine: Callable[[Any], Engine]) -> Method:
    return Method(
        summary=facts["summary"],
        engine=engine,
        never_penetrates=facts["never_penetrates"],
        follows_input=True,
        gives=frozenset((TIMES, RUNS, *([FORCES] if facts["forces"] else []), *([UNITS] if facts["work"] else []))),
        compiled=False,
        missing=facts["missing"],
        source=facts["source"],
    )


def _engine(name: str, made: Callable[[Any], Any], forces: bool, workspace: Any) -> Engine:
    # As hhsim's own, the engine is imported when it is made: it stands above what only names methods.
    from hhsim.solver.outside_method import MethodHere, OutsideEngine

    return OutsideEngine(partial(MethodHere, name, made, forces), forces, workspace)
