"""A surface as ticks take it, whatever its kind: the addresses of the machine code that looks at it, and of its arrays.

So that a tick is compiled once for all surfaces, and each surface's own code once for all ticks. It is called a few
times a program, with all bodies of a hand at once.
"""

from typing import Any, NamedTuple

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.detection import Reach
from hhsim.kernels.hand.kinematics import BODY_COUNT, HandArrays
from hhsim.kernels.jit import Indices, Record, jit_inline, jit_noinline
from hhsim.kernels.machine_code import call_code


@by_reference
class SurfaceCode(NamedTuple):
    """Machine code of `kernels.contact.detection` for a surface, by `code_of`, and the arrays that it is called with.

    Candidates are known by `SHARED_CANDIDATES` alone: those of each kind of surface begin with them.
    """

    evaluating: int  # of `evaluate`
    finding: int  # of `find_contacts`
    counting: int  # of `count_pairs`
    arrays: Any  # address of the arrays; where nothing is compiled the arrays themselves


@jit_noinline
def evaluate_surface(
    hand: HandArrays, pose: Record, surface: SurfaceCode, reach: Reach, candidates: Record, work: Indices
) -> int:
    """Do what `evaluate` does."""
    return call_code(surface.evaluating, (hand, pose, surface.arrays, reach, candidates, work[:]))


@jit_noinline
def find_surface_contacts(
    surface: SurfaceCode, hand: HandArrays, pose: Record, candidates: Record, margin: float, contacts: Record
) -> int:
    """Do what `find_contacts` does."""
    return call_code(surface.finding, (surface.arrays, hand, pose, candidates, margin, contacts))


@jit_inline
def pairs_near(surface: SurfaceCode, hand: HandArrays, candidates: Record, limit: float) -> tuple[int, int]:
    """Count the bodies and the pairs that are at most `limit` [m] from the surface."""
    bodies = 0
    for body in range(BODY_COUNT):
        if candidates.nearest[body] <= limit:
            bodies += 1
    return bodies, call_code(surface.counting, (surface.arrays, hand, candidates, limit)) if bodies > 0 else 0
