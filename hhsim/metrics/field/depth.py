"""Penetration depth (PD): of joint centres, of skin vertices, and of the surface of round cones.

Of skin vertices it is GraspTTA's (Jiang et al. 2021, metric/penetration.py): the largest distance to the object's
surface of a vertex inside the object.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.metrics.field.hands import FieldHands, FieldMetric, largest, mean, of_frames
from hhsim.metrics.run_metric import each_with


def depths(distance: FloatArray | None) -> FloatArray:
    """Compute the depth of each frame [m], shape (T,), from signed distances, shape (T,) or (T, n); empty for None."""
    if distance is None:
        return np.zeros(0)
    return np.asarray(np.maximum(-distance.reshape(len(distance), -1).min(axis=1), 0.0))


def _figures(
    name: str, label: str, distance: Callable[[FieldHands], FloatArray | None], parameters: str
) -> tuple[FieldMetric, ...]:
    of = partial(of_frames, lambda _, hands: depths(distance(hands)))
    return each_with(
        FieldMetric(f"depth_{name}_max", f"PD, {label}, max", compute=of(largest)),
        FieldMetric(f"depth_{name}_mean", f"PD, {label}, mean of frames", compute=of(mean)),
        unit="mm",
        digits=3,
        parameters=parameters,
    )


METRICS = (
    *_figures("joints", "joints", lambda hands: hands.joint_distance, "21 joint centres"),
    *_figures("skin", "skin", lambda hands: hands.skin_distance, "vertices of the skin"),
    *_figures("cones", "cones", lambda hands: hands.cone_distance, "surface of cones and palm spheres"),
)
