"""What a recording itself says of its joints: whether a position is valid, or only inferred.

| kind | words of a name | a joint is missing | it is doubtful |
|---|---|---|---|
| flags | flags, locationFlags | without OpenXR's XR_SPACE_LOCATION_POSITION_VALID_BIT | without …_TRACKED_BIT |
| valid | valid, active | at 0 | |
| tracked | tracked | at 0, unless its validity is stated: OpenXR's positions may be valid and inferred | at 0 |
| confidence | confidence | at 0 or less, unless its validity is stated | below 0.5 |

A missing joint has no position, whatever numbers stand there. A value is that of one joint, or of all joints of a hand.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray

VALIDITY_WORDS = {
    "flags": "flags", "flag": "flags", "locationflags": "flags",
    "valid": "valid", "isvalid": "valid", "active": "valid", "isactive": "valid",
    "tracked": "tracked", "istracked": "tracked", "confidence": "confidence",
}  # fmt: skip
"""Kind of a statement by a word of its name."""
POSITION_VALID, POSITION_TRACKED = 2, 8
"""XR_SPACE_LOCATION_POSITION_VALID_BIT and XR_SPACE_LOCATION_POSITION_TRACKED_BIT."""
SMALLEST_CONFIDENCE = 0.5
"""Confidence below which a joint is doubtful."""
_TRUTHS = {"true": 1.0, "yes": 1.0, "high": 1.0, "false": 0.0, "no": 0.0, "low": 0.25}


def stated_value(value: Any) -> float:
    """Return a number, a truth, or a word for one such as true, high or 0x0f; NaN for anything else."""
    text = str(value).strip().lower()
    try:
        return _TRUTHS[text] if text in _TRUTHS else float(int(text, 16) if text.startswith("0x") else text)
    except (ValueError, OverflowError):
        return np.nan


def missing_and_doubtful(stated: Mapping[str, FloatArray], shape: tuple[int, int]) -> tuple[BoolArray, BoolArray]:
    """Return which joints are missing and which are doubtful, shape (T, J), by statements of shapes (T, J) or (T, 1).

    NaN states nothing.
    """
    missing, doubtful, known = (np.zeros(shape, dtype=bool) for _ in range(3))
    if "flags" in stated:
        flags = np.broadcast_to(stated["flags"], shape)
        known |= np.isfinite(flags)
        bits = np.nan_to_num(flags, nan=POSITION_VALID | POSITION_TRACKED, posinf=0.0, neginf=0.0).astype(np.int64)
        missing |= bits & POSITION_VALID == 0
        doubtful |= bits & POSITION_TRACKED == 0
    if "valid" in stated:
        known |= np.isfinite(stated["valid"])
        missing |= stated["valid"] == 0.0
    if "tracked" in stated:
        missing |= (stated["tracked"] == 0.0) & ~known
        doubtful |= stated["tracked"] == 0.0
    if "confidence" in stated:
        missing |= (stated["confidence"] <= 0.0) & ~known
        doubtful |= stated["confidence"] < SMALLEST_CONFIDENCE
    return missing, doubtful & ~missing
