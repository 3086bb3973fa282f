"""What sums up figures over runs, and what benches take from ticks."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics import metrics
from hhsim.metrics.metrics import statistics


def mean(values: ArrayLike) -> float:
    """Return the mean of the values that are not NaN; NaN without any."""
    return statistics(values).mean


def worst(values: ArrayLike) -> float:
    """Return the largest of the values that are not NaN; NaN without any."""
    return statistics(values).max


TOTALS: Mapping[str, Callable[[Sequence[Any]], Any]] = {"mean": mean, "worst": worst, "sum": np.nansum}
"""What sums up a figure over runs, by its name in the plan of a suite."""


def placed_of(record: TickRecord) -> PlacedHand:
    """Return the graphic hand of a run."""
    return PlacedHand(record.joints, record.position, record.orientation)


def hand_clearance(hand: HandModel, surface: Any, placed: PlacedHand, limit: float) -> FloatArray:
    """Return the least signed distance [m] of hand and surface at each tick, shape (T,), at most `limit`."""
    palm, finger = metrics.hand_clearance(surface, hand_shape(hand), placed, limit)
    return np.asarray(np.minimum(palm, finger.min(axis=1)))


def digest_of(record: TickRecord) -> str:
    """Return a digest of the poses and forces of a run."""
    digest = hashlib.sha256()
    for values in (record.position, record.orientation, record.flexion, record.total):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
