"""Errors of a hand against an object's true mesh, tick by tick, by the independent library coal.

Contact points are searched on the surface of the run; their distances from the mesh, and the hand's depth in it, are
coal's (`hhsim.verify.mesh_distance`), which shares no code with the solver.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.contact_points import find_contact_points
from hhsim.verify.mesh_distance import HandReferee
from hhsim.verify.tree_checks import coal_model, nearest_on
from hhsim.verify.verify import require_coal

MOST_HANDS = 400
"""Hands of a run whose depth is measured, 6 to 18 ms each: all that differ in a grasp, two in five in a slide."""
SAME = 12
"""Decimals to which equal lengths [m] agree."""


class MeshErrors(NamedTuple):
    """Errors of a run; lengths [m], NaN where undefined.

    Attributes:
        depth_max, depth_p95: Depth of the hand in the mesh, at the ticks it was measured at.
        contact_mean, contact_max: Distance of the contact points from the mesh, of all ticks given.
        points: Number of contact points, those at the same place once.
        ticks: Number of ticks at which the depth was measured.
    """

    depth_max: float
    depth_p95: float
    contact_mean: float
    contact_max: float
    points: int
    ticks: int


NOTHING = MeshErrors(np.nan, np.nan, np.nan, np.nan, 0, 0)


def sampled(ticks: IntArray, count: int, also: Sequence[int] = ()) -> IntArray:
    """Return `count` of some ticks, evenly spread with both ends, or all if there are fewer; and `also`."""
    spread = ticks[np.linspace(0, ticks.size - 1, min(count, ticks.size)).astype(int)] if ticks.size else ticks
    return np.unique(np.concatenate([spread, np.array(also, np.int64)]).astype(np.int64))


class MeshReferee:
    """Measures runs against one mesh.

    Args:
        mesh: World [m].
        most_hands: Hands of a run whose depth is measured; identical ones count once.

    Raises:
        InputError: coal is not installed.
    """

    def __init__(self, mesh: Mesh, most_hands: int = MOST_HANDS) -> None:
        require_coal()
        self.most_hands = most_hands
        self._model = coal_model(mesh)
        self._depths: HandReferee | None
        try:
            self._depths = HandReferee(mesh)
        except MeshError:
            self._depths = None

    @property
    def closed(self) -> bool:
        """True if the mesh is watertight; otherwise a depth in it is undefined."""
        return self._depths is not None

    def errors(
        self, surface: Any, shape: HandShape, placed: PlacedHand, touch: float, contact: IntArray, also: IntArray
    ) -> MeshErrors:
        """Measure a run.

        Args:
            surface: Arrays of the surface of the run, world.
            placed: Graphic hand of every tick.
            touch: Largest distance of a body and a piece of the surface that touch [m].
            contact: Ticks whose contact points are measured, ascending.
            also: Ticks whose depth is measured in any case.
        """
        if contact.size == 0:
            return NOTHING
        found = find_contact_points(surface, shape, placed, touch, chosen=contact)
        # A hand at rest touches at the same points over and over.
        points, times = np.unique(np.round(found.point, SAME), axis=0, return_counts=True)
        away = nearest_on(self._model, points)[0]
        mean, most = (float(np.average(away, weights=times)), float(away.max())) if away.size else (np.nan, np.nan)
        depth = self._depth(shape, placed, np.union1d(contact, also), also)
        deepest, p95 = (float(depth.max()), float(np.percentile(depth, 95))) if depth.size else (np.nan, np.nan)
        return MeshErrors(deepest, p95, mean, most, len(points), depth.size)

    def _depth(self, shape: HandShape, placed: PlacedHand, ticks: IntArray, also: IntArray) -> FloatArray:
        """Depth [m] at the measured ticks; empty for a mesh that is not closed."""
        if self._depths is None:
            return np.zeros(0)
        some = placed.at(ticks)
        poses = np.concatenate([values.reshape(len(ticks), -1) for values in some], axis=1)
        _, first, hand = np.unique(np.round(poses, SAME), axis=0, return_index=True, return_inverse=True)
        hand = hand.ravel()
        besides = np.flatnonzero(np.isin(ticks, also)).tolist()
        measured = np.unique(hand[sampled(np.sort(first), self.most_hands, besides)])
        depth = np.full(len(first), np.nan)
        # 0 - x and not -x: a free hand has depth 0, not minus 0.
        depth[measured] = 0.0 - self._depths.clearances(shape, some.at(first[measured]), 0.0).min(axis=1)
        found: FloatArray = depth[hand][np.isin(hand, measured)]
        return found
