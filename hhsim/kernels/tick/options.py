"""Lengths and tolerances of a tick."""

from typing import Any, NamedTuple

from hhsim.kernels.contact.self_pairs import NoPairs


class TickOptions(NamedTuple):
    """Options of a tick; lengths in metres.

    | field | meaning |
    |---|---|
    | force_model | FORCE_KKT or FORCE_PAPER |
    | linearisations | most of them in a tick |
    | budget | work units after which no further linearisation begins |
    | margin | pairs up to this far enter the program; the longest step near the object |
    | listed | pairs up to this far are at hand however slowly the hand moves; at most the margin |
    | skin | pairs up to this much farther are kept at hand between ticks |
    | offset | clearance that active contacts keep, so that second-order errors of small steps do not penetrate |
    | step_tolerance | a step shorter than this ends the tick |
    | tolerance, relaxation | of the QP, in units of √G δ, see `kernels.qp.active_set.solve` |
    | longest_correction | for curvature, in units of √G δ, see `kernels.tick.second_order` |
    | contact_stiffness | of Eq. 14 and Fig. 9 [N/m] |
    | touch | pairs nearer than this count as touching |
    | own | pairs of the hand's own parts that may meet: `SelfPairs`, or `NoPairs` |
    """

    force_model: int
    linearisations: int
    budget: int
    margin: float
    listed: float
    skin: float
    offset: float
    step_tolerance: float
    tolerance: float
    relaxation: float
    longest_correction: float
    contact_stiffness: float
    touch: float
    own: Any = NoPairs()
