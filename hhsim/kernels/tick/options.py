"""Lengths and tolerances of a tick."""

from typing import NamedTuple

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.hand_pairs import NO_PAIRS, PairsCode


@by_reference
class TickOptions(NamedTuple):
    """Options of a tick; lengths in metres."""

    force_model: int  # FORCE_KKT or FORCE_PAPER
    linearisations: int  # most of them in a tick
    budget: int  # work units after which no further linearisation begins
    margin: float  # pairs up to this far enter the program; the longest step near the object
    listed: float  # pairs up to this far are listed however slowly the hand moves; at most the margin
    skin: float  # pairs up to this much farther are listed as well, so that a list lasts for several ticks
    offset: float  # clearance that active contacts keep, so that second-order errors of small steps do not penetrate
    step_tolerance: float  # a step shorter than this ends the tick
    tolerance: float  # of the QP, in units of √G δ, see `kernels.qp.active_set.solve`
    relaxation: float  # likewise
    longest_correction: float  # for curvature, in units of √G δ, see `kernels.world.second_order`
    snap_step: float  # a tick moves the hand no farther beyond the user's own motion
    contact_stiffness: float  # of Eq. 14 and Fig. 9 [N/m]
    touch: float  # pairs nearer than this count as touching
    pairs: PairsCode = NO_PAIRS  # of parts of the hands that may meet
    correcting: int = 0  # code of `kernels.world.second_order.correct`, 0 where nothing bends
