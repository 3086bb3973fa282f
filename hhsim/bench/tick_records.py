"""Record of a solver's ticks as benches measure it: the hand that it shows, its distance, and a digest of it."""

import hashlib
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics import metrics


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
