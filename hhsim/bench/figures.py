"""Figures of suites, columns of a table that know what sums them up over runs; and what benches take from ticks."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics import metrics
from hhsim.metrics.metrics import statistics
from hhsim.metrics.run.registry import run_metrics
from hhsim.table.table import Column

Total = Callable[[Sequence[Any]], Any]


class Figure(NamedTuple):
    """Figure of a run: its column, and what sums it up over runs."""

    column: Column
    total: Total


def figure(name: str, says: str, unit: str, total: Total) -> Figure:
    """Return a figure by its name, meaning, and shown unit."""
    return Figure(Column(name, says, unit), total)


def metric(name: str, total: Total) -> Figure:
    """Return a figure of a replay's table, by its name there."""
    shown = run_metrics()[name]
    return Figure(Column(name, shown.label, shown.unit), total)


def summed(figures: Sequence[Figure], runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what the figures of several runs sum up to, NaN for one that a run does not have."""
    nan = float("nan")
    return {one.column.name: one.total([run.get(one.column.name, nan) for run in runs]) for one in figures}


def mean(values: ArrayLike) -> float:
    """Return the mean of the values that are not NaN; NaN without any."""
    return statistics(values).mean


def worst(values: ArrayLike) -> float:
    """Return the largest of the values that are not NaN; NaN without any."""
    return statistics(values).max


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
