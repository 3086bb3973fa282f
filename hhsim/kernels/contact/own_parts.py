"""Pairs of the hand's own parts as ticks take them, whether there are any or not.

Their kernels are called by address, so that a tick is compiled once for hands whose parts meet and for others, and does
not contain what the others never run.
"""

from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.self_pairs import SelfPairs
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import Array, Indices, Record, jit_noinline
from hhsim.kernels.machine_code import ask_code, number_of_code, run_code


@by_reference
class OwnParts(NamedTuple):
    """Pairs that may meet, none where parts go through each other, and what is done with them, by `code_of`."""

    pairs: SelfPairs
    measuring: int = 0  # of `measure_pairs`
    adding: int = 0  # of `add_rows`
    foreseeing: int = 0  # of `foresee_rows`
    clearing: int = 0  # of `clear_fraction`
    bending: int = 0  # of `add_bends`
    correcting: int = 0  # of `kernels.world.second_order.correct`


NO_PARTS = OwnParts(SelfPairs(np.zeros(0, np.int64), np.zeros(0, np.int64)))
"""In place of the pairs of a hand whose parts go through each other."""


@jit_noinline
def measure_own(own: OwnParts, hand: HandArrays, pose: Record, exact: float, rows: Record) -> None:
    """Do what `measure_pairs` does."""
    if own.measuring != 0:
        run_code(own.measuring, (own.pairs, hand, pose, exact, rows))


@jit_noinline
def add_own_rows(own: OwnParts, hand: HandArrays, within: float, options: Any, state: Record) -> bool:
    """Do what `add_rows` does."""
    return own.adding != 0 and ask_code(own.adding, (own.pairs, hand, within, options, state))


@jit_noinline
def foresee_own_rows(own: OwnParts, hand: HandArrays, active: Record, options: Any, state: Record) -> None:
    """Do what `foresee_rows` does."""
    if own.foreseeing != 0:
        run_code(own.foreseeing, (own.pairs, hand, active, options, state))


@jit_noinline
def clear_own_fraction(own: OwnParts, fraction: float, hand: HandArrays, state: Record) -> float:
    """Do what `clear_fraction` does."""
    if own.clearing == 0:
        return fraction
    return number_of_code(own.clearing, (own.pairs, fraction, hand, state))


@jit_noinline
def add_own_bends(
    own: OwnParts,
    pose: Record,
    rows: Record,
    first: int,
    row: Indices,
    force: Array,
    inverse_root: Array,
    step: Array,
    product_out: Array,
) -> None:
    """Do what `add_bends` does."""
    if own.bending != 0:
        run_code(own.bending, (own.pairs, pose, rows, first, row, force, inverse_root, step, product_out))
