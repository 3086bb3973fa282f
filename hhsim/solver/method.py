"""Methods: what each promises, its options and engine, and how it is found by its name.

hhsim's own are in `METHODS`. An installed package declares one as an entry point of the group "hhsim.methods";
`package.module:Class` names an undeclared one. Either is a `Method`, or a class as
`hhsim.solver.outside_method.OutsideMethod`. Surfaces are modules of `hhsim.kernels.surfaces` with a `SURFACE` and its
kernels.
"""

import hashlib
import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from hhsim.errors import InputError, UnknownNameError
from hhsim.registry import Registry, declared

if TYPE_CHECKING:
    from hhsim.kernels.contact.surface import Surface
    from hhsim.kernels.tick.block import HapticBlock, TickRecord
    from hhsim.kernels.world.record import WorldRecord

FORCES, WORK, UNITS, TIMES, STATUS, RUNS = "forces", "work", "units", "times", "status", "runs"
EVERYTHING = frozenset((FORCES, WORK, UNITS, TIMES, STATUS, RUNS))
"""Possible contents of a method's ticks besides the shown hand: forces, counters of work, work as one number, times,
stuck and lagging ticks, and runs of its own (a hold that a trembling hand repeats)."""

PROMISES = ("never_penetrates", "nearest_to_user", "follows_input")
"""Promises that a method may make; it is held only to limits of figures that it promises."""

USUAL: Mapping[str, Any] = {"force": "kkt", "linearisations": 12, "margin": 1e-3}
"""Defaults of the options that a method may set otherwise: force model, linearisations, margin [m]."""


class Engine(Protocol):
    """Runs the ticks of one program: of a method for a hand alone, or of all hands and what moves freely."""

    def begin(self) -> None:
        """Continue from the graphic hands in the workspaces; HhsimError if more pairs are near than the arrays hold."""

    def run(self, haptic: "HapticBlock", record: "TickRecord", bodies: "WorldRecord") -> int:
        """Run one tick for each row of the haptic input, after the hand the second axis; return the ticks done.

        They are fewer than the rows only where the pairs of the last one did not fit, as its status says. `bodies` is
        written where one is free.
        """


@dataclass(frozen=True)
class Method:
    """A method that can be selected and measured."""

    summary: str  # one line for help texts and tables
    # Makes the engine for a `hhsim.solver.workspace.TickWorkspace`; imports what it needs only then.
    engine: Callable[[Any], Engine]
    never_penetrates: bool = False  # promised; without the promise penetration is measured, but misses no bar
    nearest_to_user: bool = False  # promised: no hand near the shown one is closer to the user's in coupling energy
    follows_input: bool = False  # promised: where nothing is near, the shown hand is the user's
    takes_threads: bool = False  # the fingers' programs of a tick can be shared among threads
    takes_backends: bool = False  # its programs can be solved by any QP solver that qpsolvers offers
    takes_self_contact: bool = False  # it can keep the hand's own parts out of each other
    refuses_surfaces: str = ""  # reason for taking no surface but spheres; "" if it takes any
    defaults: Mapping[str, Any] = field(default_factory=lambda: USUAL)  # defaults of the options named in `USUAL`
    gives: frozenset[str] = EVERYTHING  # subset of `EVERYTHING`; what is missing has no row in a table
    compiled: bool = True  # True if its ticks run in hhsim's own compiled blocks
    beside_parts: bool = False  # from outside, and says where a hand is beside parts that move
    missing: str = ""  # what has to be installed first, in one line; "" if it can run
    source: str = ""  # SHA-256 of the file of a class from outside; "" for hhsim's own, and without a file

    @property
    def promises(self) -> frozenset[str]:
        """Promises of `PROMISES` that it makes."""
        return frozenset(promise for promise in PROMISES if getattr(self, promise))


def _made(module: str, name: str, *about: Any) -> Engine:
    # Imported when it is made: an engine stands above what only names methods.
    engine: Engine = getattr(import_module(f"hhsim.solver.{module}"), name)(*about)
    return engine


OWN = {
    "coupled": Method(
        summary="one program for the whole hand",
        engine=partial(_made, "world_engine", "WorldEngine"),
        never_penetrates=True,
        nearest_to_user=True,
        follows_input=True,
        takes_backends=True,
        takes_self_contact=True,
    ),
    "progressive": Method(
        summary="the paper's way made safe, first the palm, then each finger",
        engine=partial(_made, "world_engine", "WorldEngine"),
        never_penetrates=True,
        follows_input=True,
        takes_threads=True,
    ),
    "paper": Method(
        summary="the paper's way as printed",
        engine=partial(_made, "block_engine", "paper_engine"),
        refuses_surfaces="the paper's constraints are between frustums and spheres",
        # Forces by Eq. 14, one linearisation a tick, Δr = 0.5 mm.
        defaults={"force": "paper", "linearisations": 1, "margin": 5e-4},
    ),
    "penalty": Method(
        summary="spring-dampers at the contacts and no program",
        engine=partial(_made, "block_engine", "penalty_engine"),
        refuses_surfaces="its springs let the hand sink in, and triangles have no depth",
    ),
}
METHODS: Registry[Method] = Registry(OWN, kind="method", first=tuple(OWN))
"""hhsim's own methods by name; `find_method` knows those from outside too."""


def methods_that(promise: str) -> tuple[str, ...]:
    """Return the names of the methods with a true attribute of `Method`, such as `never_penetrates`."""
    return tuple(name for name, method in METHODS.items() if getattr(method, promise))


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
    entry = declared_methods().get(name, EntryPoint(name, name, GROUP))
    if name not in declared_methods():
        if ":" not in name:
            raise UnknownNameError("method", name, method_names())
        folder = str(Path.cwd())
        if folder not in sys.path:
            # Behind all that is installed: a file beside the user's data must not take a library's place.
            sys.path.append(folder)
    try:
        found = entry.load()
    except (Exception, SystemExit) as error:
        # Whatever somebody else's module raises is told in one line.
        where = "package.module:Class, from the current folder or installed"
        raise InputError(f"method '{name}' cannot be imported: {type(error).__name__}: {error} ({where})") from error
    missing = [part for part in ("begin", "tick") if not callable(getattr(found, part, None))]
    if not isinstance(found, Method) and (not isinstance(found, type) or missing):
        what = f"lacks {' and '.join(missing)}" if missing else "is an instance"
        expected = "expected a class with __init__(scene), begin(pose) and tick(haptic)"
        raise InputError(f"method '{name}' is no method: {found!r} {what}; {expected}")
    return found


def source_of(definition: Any) -> str:
    """Return the SHA-256 of the file of a class or function; "" without one."""
    try:
        return hashlib.sha256(Path(inspect.getfile(definition)).read_bytes()).hexdigest()
    except (TypeError, OSError):
        return ""


SUBMITTED = "submission:"
"""Prefix of the method of a submission's poses in its result; see `hhsim.submissions.score`."""


def find_method(name: str) -> Method:
    """Return the method of a name of `method_names`, or of `package.module:Class`.

    Raises UnknownNameError for no such method, InputError for one that cannot be imported, or is no method.
    """
    if name in METHODS:
        return METHODS[name]
    if name.startswith(SUBMITTED):
        summary = "poses that were computed elsewhere"
        return Method(summary, partial(_no_engine, name), gives=frozenset(), compiled=False, beside_parts=True)
    found = outside_class(name)
    if isinstance(found, Method):
        return replace(found, source=found.source or source_of(found.engine))
    lines = (found.__doc__ or "").strip().splitlines()
    forces, work = (bool(getattr(found, name, False)) for name in ("gives_forces", "gives_work"))
    return Method(
        summary=str(getattr(found, "summary", lines[0] if lines else "a method from outside")).rstrip("."),
        engine=partial(_made, "outside_method", "OutsideEngine", found, forces),
        never_penetrates=bool(getattr(found, "never_penetrates", False)),
        follows_input=True,
        gives=frozenset((TIMES, RUNS, *([FORCES] if forces else []), *([UNITS] if work else []))),
        compiled=False,
        missing=str(getattr(found, "missing", "")),
        source=source_of(found),
    )


def names_code(name: str) -> bool:
    """Return True for `package.module:Class`, which `find_method` imports: code that the name's author chose."""
    return ":" in name and not name.startswith(SUBMITTED) and name not in declared_methods()


def _no_engine(name: str, workspace: Any) -> Engine:
    raise InputError(f"'{name}' is poses computed elsewhere: hhsim score measures their file anew")


SURFACES: Registry["Surface"] = Registry("hhsim.kernels.surfaces", "SURFACE", "surface", first=("spheres", "mesh"))
"""Surfaces by name."""


def surface_of(arrays: Any) -> "Surface":
    """Return the surface of arrays, of several parts that of a part; InputError for arrays of no surface."""
    arrays = getattr(arrays, "pieces", arrays)
    for surface in SURFACES.values():
        if type(arrays) is surface.arrays:
            return surface
    expected = f"expected the arrays of {', '.join(SURFACES)}"
    raise InputError(f"{type(arrays).__name__} is no surface of an object; {expected}")
