"""Which contacts method `paper` may have on another part of the hand than the nearest one.

Its phalanx is a cone frustum and the sphere at its thin end; where the foot of a sphere's centre lies decides between
the two. That is where the nearest point lies as long as hand and sphere only touch: with a sphere that is deep inside a
phalanx the two part ways, and so does the normal. The sphere at a finger's first joint is the palm's.
"""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.verify.contacts import PALM, Pairs, axis_places
from hhsim.verify.kinematics import OwnHand, Posed

ROUNDING = 1e-12
"""A place this near to an end of an axis, as a share of its length, is the end."""


def on_another_part(
    hand: OwnHand, posed: Posed, pairs: Pairs, center: FloatArray, radius: FloatArray, closed: bool
) -> BoolArray:
    """Whether `paper` may have each pair on another part than the nearest point's, shape (N,).

    Args:
        posed: The ticks of the pairs.
        pairs: N pairs of a hand body and a leaf sphere that touch.
        center: Of all leaf spheres [m], world, shape (L, 3).
        radius: [m], shape (L,).
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
