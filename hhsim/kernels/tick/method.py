"""Dispatch by method: a method is the type of its options, and its kernels are declared for that type.

`tick` is what every method has. Those that go from linearisation to linearisation share the loop of `kernels.tick.tick`
and declare its parts: those of a hand alone are in that file, those of a hand and a free object in `kernels.free.tick`.
"""

from typing import Any, NamedTuple

from hhsim.kernels.contact.surface_code import SurfaceCode
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import Record, generic
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.options import TickOptions


class Coupled(NamedTuple):
    """Method that solves all 21 degrees of freedom in one program, see `kernels.tick.coupled`."""

    options: TickOptions


class Progressive(NamedTuple):
    """Palm, then finger by finger, see `kernels.tick.progressive`."""

    options: TickOptions


OVERFLOW = -1
"""Status of a linearisation whose contacts do not fit into the arrays; the others are those of `qp.active_set`."""


@generic
def tick(method: Any, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Bring the graphic hand towards the haptic hand (`set_haptic`); returns status bits."""


@generic
def begin_motion(method: Any, hand: HandArrays, surface: SurfaceCode, state: Record) -> None:
    """Bring hand and object to where the first program of the tick is built."""


@generic
def may_end(method: Any, state: Record) -> bool:
    """Return whether a tick whose work budget is spent may end as it is."""


@generic
def solve_linearisation(
    method: Any, hand: HandArrays, surface: SurfaceCode, done: int, state: Record, qp: QpWork
) -> tuple[int, float]:
    """Build and solve the program at the present configuration, after `done` others of this tick.

    Returns a status, and the motion of the step before its target was brought nearer [m], see `clip_target`.
    """


@generic
def solve_program(method: Any, state: Record, qp: QpWork) -> int:
    """Solve the program at hand into the state's `step`; returns a status of `kernels.qp.active_set`."""


@generic
def recover(method: Any, hand: HandArrays, surface: SurfaceCode, state: Record) -> bool:
    """Make the next program easier after one without solution; returns False where nothing is left to try."""


@generic
def advance(method: Any, hand: HandArrays, surface: SurfaceCode, full_motion: float, state: Record) -> bool:
    """Make as much of the step as the listed pairs allow, and judge it; returns whether the tick is done."""


@generic
def finish_tick(method: Any, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Return to the last feasible configuration and compute the forces; returns status bits."""


@generic
def energy_stalled(method: Any, state: Record) -> bool:
    """Return whether the programs apart of a tick that lags have made no progress, see `kernels.tick.decoupling`."""
