"""Contact ratios: frames and fingertips near the object, and contacts of the recording that are kept.

The field has no single definition; each figure states its threshold. A point inside the object is in contact.
"""

from collections.abc import Callable

import numpy as np

from hhsim.metrics.field.hands import BeforeAfter, FieldHands, FieldMetric, FieldPair, mean, of_each, of_repair
from hhsim.metrics.run_metric import each_with

THRESHOLDS = (0.005, 0.002)
"""Largest distance of a contact from the object's surface [m]."""
KEPT, TOUCHING = "contacts_kept_5mm", "frames_in_contact_5mm"
"""Names of the figures that the verdict judges."""


def frames_in_contact(hands: FieldHands, threshold: float) -> float:
    """Compute the share of frames whose hand is in contact [%]."""
    return 100.0 * mean(np.where(hands.known, hands.distance <= threshold, np.nan))


def fingertips_in_contact(hands: FieldHands, threshold: float) -> float:
    """Compute the share of frames and fingertips in contact [%]."""
    return 100.0 * mean(np.where(hands.known[:, None], hands.finger_distance <= threshold, np.nan))


def contacts_kept(pair: FieldPair, threshold: float) -> float:
    """Compute the share of the recording's contacts of a frame and a fingertip that the repair has [%]; NaN if none."""
    before, after = (hands.finger_distance[pair.known] <= threshold for hands in pair.both)
    return 100.0 * float(after[before].mean()) if before.any() else float("nan")


def _figures(threshold: float) -> tuple[FieldMetric, ...]:
    def at(compute: Callable[[FieldHands, float], float]) -> Callable[[FieldPair], BeforeAfter]:
        return of_each(lambda hands: compute(hands, threshold))

    size, within = f"{1e3 * threshold:g}mm", f"within {1e3 * threshold:g} mm"
    tips = "distal phalanges, inside counts"
    kept = of_repair(lambda pair: contacts_kept(pair, threshold))
    return each_with(
        FieldMetric(
            f"frames_in_contact_{size}",
            f"frames {within}",
            compute=at(frames_in_contact),
            parameters="any point of the hand, inside counts",
        ),
        FieldMetric(
            f"fingertips_in_contact_{size}", f"fingertips {within}", compute=at(fingertips_in_contact), parameters=tips
        ),
        FieldMetric(f"contacts_kept_{size}", f"contacts kept {within}", compute=kept, parameters=tips),
        unit="%",
        digits=1,
        less_is_better=False,
    )


METRICS = (*_figures(THRESHOLDS[0]), *_figures(THRESHOLDS[1]))
