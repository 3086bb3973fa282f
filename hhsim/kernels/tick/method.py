"""Which method a tick follows: a method is the type of its options, and what it does is declared for that type.

`tick` is what every method has. Those that go from linearisation to linearisation share the tick of `kernels.tick.tick`
and declare what differs: how a program is solved, and what is special about palm and fingers that are solved apart.
"""

from typing import Any, NamedTuple

from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import Record, generic
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.options import TickOptions


class Coupled(NamedTuple):
    """All 21 degrees of freedom in one program, see `kernels.tick.coupled`."""

    options: TickOptions


class Progressive(NamedTuple):
    """Palm, then finger by finger, see `kernels.tick.progressive`."""

    options: TickOptions


WAY_STEPS = 6
"""Linearisations after which it shows whether a way leads on or to and fro."""


@generic
def tick(method: Any, hand: HandArrays, surface: Any, state: Record, qp: QpWork) -> int:
    """Bring the graphic hand towards the haptic hand (`set_haptic`); returns status bits."""


@generic
def solve_program(method: Any, state: Record, qp: QpWork) -> int:
    """Solve the program at hand into the state's `step`; returns a status of `kernels.qp.active_set`."""


@generic
def is_oscillating(method: Any, state: Record, done: int) -> bool:
    """Whether the hand has been pulled to and fro, this tick's first `done` linearisations too, by programs apart."""


@generic
def is_strained(method: Any, state: Record) -> bool:
    """Whether the last program's multipliers are no forces, so that a program of what touches has to give them."""
