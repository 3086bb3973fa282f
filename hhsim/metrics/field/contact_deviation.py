"""Contact deviation (CDev) from a true hand, as ARCTIC defines it (Fan et al. 2023, eval_modules.py).

Of the true hand's vertices within 3 mm of a vertex of the object, it is the mean distance of the judged hand's vertices
from those vertices of the object: the mean over the vertices of a frame, then over frames. It depends on the density of
the object's vertices.
"""

import numpy as np

from hhsim.metrics.field.hands import FieldHands, FieldMetric, mean, of_each

CONTACT = 0.003
"""Largest distance of a true contact [m]."""


def contact_deviation(hands: FieldHands) -> float:
    """Compute the contact deviation [m]; NaN without a true skin, a skin, or a contact, and of parts that move."""
    if hands.truth is None or hands.skin is None or hands.parts is not None:
        return float("nan")
    from scipy.spatial import cKDTree

    tree = cKDTree(hands.mesh.vertices)
    of_frame = []
    for frame in np.flatnonzero(hands.known & np.isfinite(hands.truth).all(axis=(1, 2))):
        distance, nearest = tree.query(hands.truth[frame])
        gap = np.linalg.norm(hands.skin[frame] - hands.mesh.vertices[nearest], axis=1)
        of_frame.append(mean(gap[distance <= CONTACT]))
    return mean(np.array(of_frame))


METRICS = (
    FieldMetric(
        "contact_deviation", "CDev", 3, "mm", parameters=f"true contacts within {1e3 * CONTACT:g} mm",
        compute=of_each(contact_deviation),
    ),
)  # fmt: skip
