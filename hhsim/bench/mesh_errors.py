"""How far a hand is off an object's true mesh, tick by tick, by an independent library: coal's distances.

Contact points are looked for on the surface that the run had; how far they are from the mesh, and how deep the hand is
in it, is told by coal (`hhsim.verify.mesh_distance`), which shares no code with the solver.
"""

from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.bench.sampled_ticks import sampled
from hhsim.errors import MeshError
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.contact_points import find_contact_points
from hhsim.verify.mesh_distance import HandReferee
from hhsim.verify.tree_checks import coal_model, nearest_on
from hhsim.verify.verify import require_coal

MOST_HANDS = 400
"""Hands of a run whose depth is measured, at 6 to 18 ms each: all that differ in a grasp, two in five in a slide."""
SAME = 12
"""Lengths that agree to so many decimals [m] are the same."""


class MeshErrors(NamedTuple):
    """What a run has to do with the mesh; lengths [m], NaN where they are undefined.

    | field | meaning |
    |---|---|
    | depth_max, depth_p95 | of the hand in the mesh, at the ticks it was measured at |
    | contact_mean, contact_max | distance of the contact points from the mesh, of all ticks looked at |
    | points | contact points, those at the same place once |
    | ticks | at which the depth was measured |
    """

    depth_max: float
    depth_p95: float
    contact_mean: float
    contact_max: float
    points: int
    ticks: int


NOTHING = MeshErrors(np.nan, np.nan, np.nan, np.nan, 0, 0)


class MeshReferee:
    """Holds runs against one mesh.

    Args:
        mesh: World [m].
        most_hands: Hands of a run whose depth is measured; identical ones count once.

    Raises:
        InputError: coal is not installed.

    Attributes:
        closed: Whether the mesh is watertight: nothing is inside of another one, and a depth in it is undefined.
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
        """See the class."""
        return self._depths is not None

    def errors(
        self, surface: Any, shape: HandShape, placed: PlacedHand, touch: float, contact: IntArray, also: IntArray
    ) -> MeshErrors:
        """Measure a run.

        Args:
            surface: What the run touched, world: the arrays of a surface.
            placed: Where the hand was at every tick.
            touch: A body and a piece of the surface no farther apart than this touch [m].
            contact: Ticks to look at, ascending.
            also: Ticks whose depth is measured in any case, such as the one deepest in the surface.
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
        """Depth [m] at as many ticks as there is leave for; none where nothing is inside of the mesh."""
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
