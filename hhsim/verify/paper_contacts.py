"""Contacts that method `paper` may find on another feature of the hand than the nearest one.

Its phalanx is a cone frustum with a sphere at its thin end, and the foot of a leaf's centre decides between the two.
That is the nearest feature while the two only touch; with deep penetration feature and normal may differ. The sphere
at a finger's first joint belongs to the palm.
"""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.verify.contacts import PALM, Pairs, axis_places
from hhsim.verify.kinematics import OwnHand, Posed

ROUNDING = 1e-12
"""Tolerance of the end of an axis, as a ratio of its length."""


def on_another_part(
    hand: OwnHand, posed: Posed, pairs: Pairs, center: FloatArray, radius: FloatArray, closed: bool
) -> BoolArray:
    """True for pairs that `paper` may have on another feature than the nearest point's, shape (N,).

    Args:
        hand: Dimensions of the hand.
        posed: Postures at the ticks of the pairs.
        pairs: N pairs of a hand body and a leaf sphere that touch.
        center, radius: All leaf spheres [m], world, shapes (L, 3) and (L,).
        closed: Spheres close both ends of every frustum, not the fingertip's alone.
    """
    found = np.zeros(len(pairs.body), bool)
    of_phalanx = np.flatnonzero(pairs.body != PALM)
    finger, phalanx = np.divmod(pairs.body[of_phalanx], 3)
    tick, leaf = pairs.tick[of_phalanx], pairs.leaf[of_phalanx]
    a, b = posed.joints[tick, finger, phalanx], posed.joints[tick, finger, phalanx + 1]
    radius_a, radius_b = hand.radius[finger, phalanx], hand.radius[finger, phalanx + 1]
    length = np.linalg.norm(b - a, axis=1)
    along = (b - a) / length[:, None]
    nearest, _ = axis_places(a, b, radius_a, radius_b, center[leaf])
    place = np.einsum("ni,ni->n", nearest - a, along)
    at_thick_end, at_thin_end = place <= ROUNDING * length, place >= (1.0 - ROUNDING) * length

    # Eq. 6 and 13: the foot's way from the thin bottom towards the thick one, and how far the frustum's part goes.
    sine = (radius_a - radius_b) / length
    foot = np.einsum("ni,ni->n", b - center[leaf], along) + radius_b * sine
    bottom, reach = length * (1.0 - sine**2), radius[leaf]
    lowest = np.where(closed | (phalanx == 2), -reach * sine, -reach)
    highest = bottom - reach * sine if closed else bottom + reach
    on_frustum = (foot >= lowest) & (foot <= highest)

    first_joint = np.linalg.norm(center[leaf] - a, axis=1) - reach - radius_a
    of_palm = (phalanx == 0) & (first_joint <= pairs.distance.max(initial=0.0))
    found[of_phalanx] = at_thick_end | of_palm | (on_frustum == at_thin_end)
    return found
