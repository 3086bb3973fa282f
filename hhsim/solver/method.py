"""Method records: promises, options, engine. A new method is a module of `hhsim.solver.methods` with a `METHOD`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import HapticBlock, TickRecord

FORCES, WORK, UNITS, TIMES, STATUS, RUNS = "forces", "work", "units", "times", "status", "runs"
EVERYTHING = frozenset((FORCES, WORK, UNITS, TIMES, STATUS, RUNS))
"""Possible contents of a method's ticks besides the shown hand: forces, counters of work, work as one number, times,
stuck and lagging ticks, and runs of its own (a hold that a trembling hand repeats)."""

PROMISES = ("never_penetrates", "nearest_to_user", "follows_input")
"""Promises that a method may make; it is held only to limits of figures that it promises."""

USUAL: Mapping[str, Any] = {"force": "kkt", "linearisations": 12, "margin": 1e-3}
"""Defaults of the options that a method may set otherwise: force model, linearisations, margin [m]."""


class Engine(Protocol):
    """Runs the ticks of one method for one hand and one object."""

    def begin(self) -> None:
        """Continue from the graphic hand in the workspace; HhsimError if more pairs are near than the arrays hold."""

    def run(self, haptic: "HapticBlock", record: "TickRecord") -> int:
        """Run one tick for each row of the haptic input; return the ticks done.

        They are fewer than the rows only where the pairs of the last one did not fit, as its status says.
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


METHODS: Registry[Method] = Registry(
    "hhsim.solver.methods", "METHOD", "method", first=("coupled", "progressive", "paper", "penalty")
)
"""hhsim's own methods by name; `hhsim.solver.known_methods` knows those from outside too."""


def methods_that(promise: str) -> tuple[str, ...]:
    """Return the names of the methods with a true attribute of `Method`, such as `never_penetrates`."""
    return tuple(name for name, method in METHODS.items() if getattr(method, promise))


def never_penetrates(name: str) -> bool:
    """Return True if a method is known and promises it."""
    return name in METHODS and METHODS[name].never_penetrates
