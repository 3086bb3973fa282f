"""Datasets of /tick as the object sees them, and back: which of them turn says the schema's `Column.turns`."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.motion.object_motion import RigidMotion
from hhsim.result.schema import TICK_COLUMNS

TURNS = {column.name: column.turns for column in TICK_COLUMNS if column.turns}
"""How each dataset that a frame changes is brought to another one."""


def as_object_sees(name: str, values: AnyArray, moved: RigidMotion) -> AnyArray:
    """Rows of a dataset of /tick in the frame that moves with the object, which is the world's at the first tick.

    Args:
        values: World, shape (T, ...).
        moved: How the object moved since the first tick.
    """
    ways = {"point": moved.seen_points, "vector": moved.seen_vectors, "orientation": moved.seen_orientations}
    return _brought(name, values, ways)


def in_the_world(columns: Mapping[str, AnyArray], moved: RigidMotion) -> dict[str, AnyArray]:
    """Datasets that the object sees, by name, brought to the world."""
    ways = {"point": moved.points, "vector": moved.vectors, "orientation": moved.orientations}
    return {name: _brought(name, values, ways) for name, values in columns.items()}


def _brought(name: str, values: AnyArray, ways: Mapping[str, Any]) -> AnyArray:
    kind = TURNS.get(name, "")
    if not kind:
        return values
    shape = values.shape
    whole = values if kind == "orientation" else values.reshape(*shape[:-1], -1, 3)
    return np.ascontiguousarray(ways[kind](whole).reshape(shape))
