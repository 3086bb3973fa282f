"""What a method is: what it promises, what it takes, and the engine that runs its ticks.

To add a method, add a module to `hhsim.solver.methods` that declares a `METHOD`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import HapticBlock, TickRecord

FORCES, WORK, UNITS, TIMES, STATUS, RUNS = "forces", "work", "units", "times", "status", "runs"
EVERYTHING = frozenset((FORCES, WORK, UNITS, TIMES, STATUS, RUNS))
"""What can be known of a method's ticks besides the shown hand: the forces, the counters of work, the work as one
number, the times, whether a tick is stuck or lags, and what runs of its own show (a hold that a trembling hand
repeats)."""

PROMISES = ("never_penetrates", "nearest_to_user", "follows_input")
"""What a method may promise; a limit of a figure that it does not promise is not held against it."""

USUAL: Mapping[str, Any] = {"force": "kkt", "linearisations": 12, "margin": 1e-3}
"""Defaults of the options that a method may set otherwise: force model, linearisations, margin [m]."""


class Engine(Protocol):
    """Runs the ticks of one method for one hand and one object."""

    def begin(self) -> None:
        """Go on from the graphic hand as it now stands in the workspace, put there from outside.

        Raises:
            HhsimError: More pairs are near than the arrays hold.
        """

    def run(self, haptic: "HapticBlock", record: "TickRecord") -> int:
        """Run one tick for each row of the haptic input.

        Returns:
            The ticks done: fewer than asked for only where the pairs of the last one did not fit, as its status says.
        """


@dataclass(frozen=True)
class Method:
    """A method that can be selected and measured.

    Attributes:
        summary: One line for help texts and tables.
        engine: Makes the engine for a `hhsim.solver.workspace.TickWorkspace`; imports what it needs only then.
        never_penetrates: Promised; a method that does not promise it is measured, and misses no bar by it.
        nearest_to_user: Promised: no hand near the shown one is closer to the user's in coupling energy.
        follows_input: Promised: where nothing is near, the shown hand is the user's.
        takes_threads: Its ticks can be shared among threads.
        refuses_backends: Why it takes no QP solver but ours, with `{qp}` for the one that was asked for; "" where it
            takes any.
        refuses_surfaces: Why it takes no surface but spheres; "" where it takes any.
        defaults: Of the options named in `USUAL`.
        gives: What can be known of it, of `EVERYTHING`; what cannot has no row in a table.
        compiled: Whether its ticks run in hhsim's own compiled blocks.
        missing: What has to be installed first, in one line; "" where it can run.
        source: SHA-256 of the file that a class from outside is written in; "" for hhsim's own, and where none is.
    """

    summary: str
    engine: Callable[[Any], Engine]
    never_penetrates: bool = False
    nearest_to_user: bool = False
    follows_input: bool = False
    takes_threads: bool = False
    refuses_backends: str = "it solves its own programs and takes no QP solver, not {qp}"
    refuses_surfaces: str = ""
    defaults: Mapping[str, Any] = field(default_factory=lambda: USUAL)
    gives: frozenset[str] = EVERYTHING
    compiled: bool = True
    missing: str = ""
    source: str = ""

    @property
    def promises(self) -> frozenset[str]:
        """Those of `PROMISES` that it makes."""
        return frozenset(promise for promise in PROMISES if getattr(self, promise))


METHODS: Registry[Method] = Registry(
    "hhsim.solver.methods", "METHOD", "method", first=("coupled", "progressive", "paper", "penalty")
)
"""Every method of hhsim's own by its name; `hhsim.solver.known_methods` knows those from outside too."""


def methods_that(promise: str) -> tuple[str, ...]:
    """Names of the methods of which an attribute of `Method` holds, such as `never_penetrates`."""
    return tuple(name for name, method in METHODS.items() if getattr(method, promise))


def never_penetrates(name: str) -> bool:
    """Whether a method is known and promises it."""
    return name in METHODS and METHODS[name].never_penetrates
