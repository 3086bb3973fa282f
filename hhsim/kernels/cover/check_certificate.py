"""Check of the proof that spheres cover a mesh, in one pass and without code of its maker or of the tree builder."""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import Array, jit_allocating

Codes = NDArray[np.int32]

HOLDS, NO_SUCH_SPHERE, CORNER_OUTSIDE, NO_SUCH_CODE, TOO_SHORT, TOO_LONG, TOO_DEEP = range(7)
"""Findings of a check: the proof holds, or its first fault."""

_DEEPEST = 512


@jit_allocating
def check_proof(corner: Array, center: Array, radius: Array, room: float, proof: Codes) -> tuple[int, int, int]:
    """Walk along the codes of a proof as of `certify_cover`; return the finding, and its face and code.

    Face and code are the numbers of both if the proof holds. A corner must lie `room` [m] inside its sphere: the
    largest error of the arithmetic here.
    """
    waiting = np.empty((_DEEPEST, 3, 3))
    place = 0
    for face in range(corner.shape[0]):
        for v in range(3):
            for k in range(3):
                waiting[0, v, k] = corner[face, 3 * v + k]
        count = 1
        while count > 0:
            if place >= proof.shape[0]:
                return TOO_SHORT, face, place
            code = proof[place]
            if code < -3:
                return NO_SUCH_CODE, face, place
            last = waiting[count - 1]
            if code >= 0:
                if code >= radius.shape[0]:
                    return NO_SUCH_SPHERE, face, place
                reach = radius[code] - room
                for v in range(3):
                    square = 0.0
                    for k in range(3):
                        square += (last[v, k] - center[code, k]) * (last[v, k] - center[code, k])
                    # Written so that a NaN does not pass.
                    if not (reach >= 0.0 and square <= reach * reach):
                        return CORNER_OUTSIDE, face, place
                count -= 1
            else:
                if count >= _DEEPEST:
                    return TOO_DEEP, face, place
                a = -1 - code
                b, c = (a + 1) % 3, (a + 2) % 3
                first = waiting[count]
                for k in range(3):
                    pa, pb, pc = last[a, k], last[b, k], last[c, k]
                    middle = 0.5 * (pa + pb)
                    first[0, k], first[1, k], first[2, k] = pa, middle, pc
                    last[0, k], last[1, k], last[2, k] = middle, pb, pc
                count += 1
            place += 1
    if place < proof.shape[0]:
        return TOO_LONG, corner.shape[0], place
    return HOLDS, corner.shape[0], place
