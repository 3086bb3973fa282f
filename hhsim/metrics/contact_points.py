"""Contact points of a stored hand, tick by tick, with normals and bodies."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.contact.contact_points import find_contact_pairs
from hhsim.kernels.contact.surface import ContactPoints
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.jit import as_argument
from hhsim.system.thread_pool import Workers, ranges, usual_threads

CAPACITY = 64
"""Initial capacity for the pairs of a tick."""

TICKS_A_THREAD = 500
"""Ticks below which a second thread does not pay."""


def find_contact_points(
    surface: Any,
    shape: HandShape,
    placed: PlacedHand,
    touch: float,
    *,
    chosen: ArrayLike | None = None,
    fingers: ArrayLike | None = None,
) -> ContactPoints:
    """Find all pairs of a hand body and a piece of the surface no more than `touch` [m] apart, or inside each other.

    What contacts/touching of a result counts is within `SolverOptions.touch`. Hands and surface are in the world;
    `chosen` are the ticks to examine, in order, `fingers` those that count, shape (5,): None for all.
    """
    ticks = np.arange(len(placed.joints)) if chosen is None else np.asarray(chosen, np.int64)
    counted = np.ones(5, np.bool_) if fingers is None else np.asarray(fingers, np.bool_)
    shape, placed = HandShape(*map(as_argument, shape)), PlacedHand(*map(as_argument, placed))
    threads = usual_threads() if len(ticks) > TICKS_A_THREAD else 1

    def found(first: int, end: int) -> ContactPoints:
        some, count = np.ascontiguousarray(ticks[first:end]), -1
        capacity = max(CAPACITY, 4 * len(some))
        while count < 0:
            capacity *= 4
            columns = [np.empty((capacity, 3)) for _ in range(2)]
            pairs = ContactPoints(np.empty(capacity, np.int64), np.empty(capacity, np.int64), *columns)
            count = find_contact_pairs(shape, surface, some, *placed, counted, float(touch), pairs)
        return ContactPoints._make(column[:count] for column in pairs)

    with Workers(threads) as workers:
        parts = workers.each(found, ranges(len(ticks), threads))
    return parts[0] if len(parts) == 1 else ContactPoints(*(np.concatenate(columns) for columns in zip(*parts)))
