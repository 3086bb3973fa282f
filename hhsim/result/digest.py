"""Digest of a run's poses and forces: the same for the same bits, whatever else the file holds."""

import hashlib

import numpy as np

from hhsim.result.reader import Result

OF_THE_HAND = (
    *("graphic/position", "graphic/orientation", "graphic/flexion", "graphic/abduction"),
    *("force/palm_wrench", "force/phalanx", "force/total"),
)
OF_A_FREE_OBJECT = ("object/position", "object/orientation")
DIGITS = 16
"""Hexadecimal digits of a digest."""


def tick_digest(result: Result) -> str:
    """Compute a digest of the shown hand's poses, its forces, and the poses of a free object, of all ticks."""
    found = hashlib.sha256()
    for name in (*OF_THE_HAND, *(OF_A_FREE_OBJECT if result.free else ())):
        found.update(np.ascontiguousarray(result[name], np.float64).tobytes())
    return found.hexdigest()[:DIGITS]
