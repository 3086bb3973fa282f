"""Where a stored hand touches the object, tick by tick: contact points, normals, and the body of the hand."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.contact.contact_points import find_contact_pairs
from hhsim.kernels.contact.surface import ContactPoints
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.jit import as_argument
from hhsim.system.thread_pool import Workers, ranges, usual_threads

ROOM = 64
"""Room for the pairs of a tick at first; more is made where it is too little."""

TICKS_A_THREAD = 500
"""Fewer are done before a second thread has begun."""


def find_contact_points(
    surface: Any,
    shape: HandShape,
    placed: PlacedHand,
    touch: float,
    *,
    chosen: ArrayLike | None = None,
    fingers: ArrayLike | None = None,
) -> ContactPoints:
    """Every pair of a hand body and a piece of the surface no more than `touch` [m] apart, or inside each other.

    Args:
        surface: The object's, world.
        touch: [m]; what a result's contacts/touching counts is within `SolverOptions.touch`.
        chosen: Ticks to look at, in order; all where it is not given.
        fingers: Which fingers count, shape (5,), all where it is not given.
    """
    ticks = np.arange(len(placed.joints)) if chosen is None else np.asarray(chosen, np.int64)
    counted = np.ones(5, np.bool_) if fingers is None else np.asarray(fingers, np.bool_)
    shape, placed = HandShape(*map(as_argument, shape)), PlacedHand(*map(as_argument, placed))
    threads = usual_threads() if len(ticks) > TICKS_A_THREAD else 1

    def found(first: int, end: int) -> ContactPoints:
        return _contact_points(surface, shape, placed, touch, np.ascontiguousarray(ticks[first:end]), counted)

    with Workers(threads) as workers:
        parts = workers.each(found, ranges(len(ticks), threads))
    return parts[0] if len(parts) == 1 else ContactPoints(*(np.concatenate(columns) for columns in zip(*parts)))


def _contact_points(
    surface: Any, shape: HandShape, placed: PlacedHand, touch: float, ticks: IntArray, counted: BoolArray
) -> ContactPoints:
    room = max(ROOM, 4 * len(ticks))
    count = -1
    while count < 0:
        room *= 4
        pairs = ContactPoints(
            np.empty(room, np.int64), np.empty(room, np.int64), np.empty((room, 3)), np.empty((room, 3))
        )
        count = find_contact_pairs(
            shape, surface, ticks, placed.joints, placed.position, placed.orientation, counted, float(touch), pairs
        )
    return ContactPoints(pairs.tick[:count], pairs.body[:count], pairs.point[:count], pairs.normal[:count])
