"""Transformation of /tick datasets between the world and a moving object's frame."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.motion.trajectory import RigidMotion
from hhsim.result.schema import TICK_COLUMNS

TURNS = {column.name: column.turns for column in TICK_COLUMNS if column.turns}
"""Kind of transformation (`Column.turns`) by dataset."""


def as_object_sees(name: str, values: AnyArray, moved: RigidMotion) -> AnyArray:
    """Transform rows (T, ...) of a /tick dataset to the object's frame, which is the world's at the first tick."""
    transforms = {"point": moved.seen_points, "vector": moved.seen_vectors, "orientation": moved.seen_orientations}
    return _transformed(name, values, transforms)


def in_the_world(columns: Mapping[str, AnyArray], moved: RigidMotion) -> dict[str, AnyArray]:
    """Transform datasets by name from the object's frame to the world."""
    transforms = {"point": moved.points, "vector": moved.vectors, "orientation": moved.orientations}
    return {name: _transformed(name, values, transforms) for name, values in columns.items()}


def _transformed(name: str, values: AnyArray, transforms: Mapping[str, Any]) -> AnyArray:
    kind = TURNS.get(name, "")
    if not kind:
        return values
    shape = values.shape
    whole = values if kind == "orientation" else values.reshape(*shape[:-1], -1, 3)
    return np.ascontiguousarray(transforms[kind](whole).reshape(shape))
